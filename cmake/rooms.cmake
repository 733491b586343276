# The rooms of the house. Every room is one shared library ars_NAME (alias ars::NAME), so that the program and the
# LibTorch plug-in share one copy of every global (log, thread budget, memory book).

# ars_room(NAME DEPENDS room... SOURCES file... [CUDA file...] [LINK library...] [LINK_PUBLIC library...])
# CUDA files are compiled only where there is an nvcc. A room without SOURCES is an interface target: it carries its
# place in the order of rooms before its first file arrives.
function(ars_room name)
    cmake_parse_arguments(ROOM "" "" "DEPENDS;SOURCES;CUDA;LINK;LINK_PUBLIC" ${ARGN})
    set(target ars_${name})
    list(TRANSFORM ROOM_DEPENDS PREPEND ars::)
    if(ROOM_SOURCES)
        if(ARS_HAVE_CUDA)
            list(APPEND ROOM_SOURCES ${ROOM_CUDA})
        endif()
        # Fuzzers are one static program each: coverage counters and sanitizers stay in one place.
        set(kind SHARED)
        if(ARS_FUZZ)
            set(kind STATIC)
        endif()
        add_library(${target} ${kind} ${ROOM_SOURCES})
        target_link_libraries(${target} PUBLIC ars_options ${ROOM_DEPENDS} ${ROOM_LINK_PUBLIC} PRIVATE ${ROOM_LINK})
        if(ARS_HAVE_CUDA AND ROOM_CUDA)
            # The static runtime finds the driver when it is first used: the program starts on a machine without one.
            target_link_libraries(${target} PRIVATE CUDA::cudart_static)
            target_compile_options(${target} PRIVATE
                $<$<COMPILE_LANGUAGE:CUDA>:--expt-relaxed-constexpr -Xcompiler=-Wall,-Wextra --diag-suppress=554>)
            # fmt 9 switches constexpr off under nvcc but not everywhere; the definition makes it consistent.
            target_compile_definitions(${target} PRIVATE $<$<COMPILE_LANGUAGE:CUDA>:GLM_FORCE_CUDA>
                $<$<COMPILE_LANGUAGE:CUDA>:FMT_USE_CONSTEXPR=1>)
        endif()
        target_compile_definitions(${target} PUBLIC $<$<BOOL:${ARS_HAVE_CUDA}>:ARS_HAVE_CUDA=1>)
    else()
        add_library(${target} INTERFACE)
        target_link_libraries(${target} INTERFACE ars_options ${ROOM_DEPENDS} ${ROOM_LINK_PUBLIC})
    endif()
    add_library(ars::${name} ALIAS ${target})
    set_property(GLOBAL APPEND PROPERTY ARS_ROOMS ${name})
endfunction()
