# LibTorch as one interface target, ars_torch, over the unpacked wheel (set up by ./ars) or ARS_TORCH_DIR. The wheel's own
# TorchConfig.cmake insists on a CUDA toolkit, so the targets are made here.
set(ARS_TORCH_DIR "$ENV{ARS_TORCH_DIR}" CACHE PATH "Folder of a LibTorch (with include/ and lib/); empty: the one that ./ars fetched")
if(NOT ARS_TORCH_DIR)
    set(ARS_TORCH_DIR "${CMAKE_SOURCE_DIR}/.deps/torch/torch")
endif()
if(NOT EXISTS "${ARS_TORCH_DIR}/include/torch/csrc/api/include/torch/torch.h" OR NOT EXISTS "${ARS_TORCH_DIR}/lib/libtorch_cpu.so")
    message(FATAL_ERROR "No LibTorch in ${ARS_TORCH_DIR} (expected include/ and lib/libtorch_cpu.so). Run ./ars, which fetches it, "
                        "or set ARS_TORCH_DIR, or configure with -DARS_MODEL=OFF.")
endif()
file(STRINGS "${ARS_TORCH_DIR}/include/torch/headeronly/version.h" lines REGEX "define TORCH_VERSION(_MAJOR|_MINOR|_PATCH) ")
set(ARS_TORCH_VERSION "")
foreach(line ${lines})
    string(REGEX MATCH "[0-9]+$" number "${line}")
    list(APPEND ARS_TORCH_VERSION ${number})
endforeach()
list(JOIN ARS_TORCH_VERSION "." ARS_TORCH_VERSION)

add_library(ars_torch INTERFACE)
target_include_directories(ars_torch SYSTEM INTERFACE "${ARS_TORCH_DIR}/include" "${ARS_TORCH_DIR}/include/torch/csrc/api/include")
# The wheel carries the headers of another fmt than the distribution's; header-only, each side keeps its own.
target_compile_definitions(ars_torch INTERFACE FMT_HEADER_ONLY=1)
target_link_libraries(ars_torch INTERFACE "${ARS_TORCH_DIR}/lib/libtorch_cpu.so" "${ARS_TORCH_DIR}/lib/libc10.so")
if(ARS_HAVE_CUDA AND EXISTS "${ARS_TORCH_DIR}/lib/libtorch_cuda.so")
    # Nothing of ours names a symbol of it, yet loading it is what gives LibTorch its CUDA kernels.
    target_link_libraries(ars_torch INTERFACE -Wl,--no-as-needed "${ARS_TORCH_DIR}/lib/libtorch_cuda.so" -Wl,--as-needed)
endif()
# The wheel's own libgomp comes first on its path and is the one OpenMP of the whole program.
target_link_options(ars_torch INTERFACE "-Wl,-rpath-link,${ARS_TORCH_DIR}/lib")
