# Dear ImGui (docking), ImPlot, ImGuizmo, command palette, file dialogs and the ImGui Test Engine as one static library
# ars_imgui, compiled from the sources that ./ars unpacked. Only what we use is compiled.
set(ARS_IMGUI_DIR "${CMAKE_SOURCE_DIR}/.deps/imgui" CACHE PATH "Folder with the sources of Dear ImGui and its companions")
if(NOT EXISTS "${ARS_IMGUI_DIR}/imgui/imgui.h")
    message(FATAL_ERROR "No Dear ImGui in ${ARS_IMGUI_DIR}. Run ./ars, which fetches it, or configure with -DARS_WINDOW=OFF.")
endif()
find_package(glfw3 CONFIG REQUIRED)
set(OpenGL_GL_PREFERENCE GLVND)
find_package(OpenGL REQUIRED COMPONENTS OpenGL EGL)

file(STRINGS "${ARS_IMGUI_DIR}/imgui/imgui.h" line REGEX "define IMGUI_VERSION +\"")
string(REGEX MATCH "[0-9.]+" ARS_IMGUI_VERSION "${line}")

set(imgui "${ARS_IMGUI_DIR}/imgui")
set(implot "${ARS_IMGUI_DIR}/implot")
set(imguizmo "${ARS_IMGUI_DIR}/ImGuizmo/src")
set(palette "${ARS_IMGUI_DIR}/imgui-command-palette")
set(dialogs "${ARS_IMGUI_DIR}/portable_file_dialogs")
add_library(ars_imgui STATIC
    ${imgui}/imgui.cpp ${imgui}/imgui_draw.cpp ${imgui}/imgui_tables.cpp ${imgui}/imgui_widgets.cpp
    ${imgui}/imgui_stacklayout.cpp ${imgui}/misc/cpp/imgui_stdlib.cpp
    ${imgui}/backends/imgui_impl_glfw.cpp ${imgui}/backends/imgui_impl_opengl3.cpp
    ${implot}/implot.cpp ${implot}/implot_items.cpp
    ${imguizmo}/ImGuizmo.cpp
    ${palette}/imcmd_command_palette.cpp ${palette}/imcmd_fuzzy_search.cpp)
target_include_directories(ars_imgui SYSTEM PUBLIC ${imgui} ${imgui}/misc/cpp ${imgui}/backends ${implot} ${imguizmo} ${palette} ${dialogs})
# Drawing widgets is not where time goes; -O3 doubles the time that these take to compile.
target_compile_options(ars_imgui PRIVATE -w $<$<CONFIG:Release>:-O1>)
target_link_libraries(ars_imgui PUBLIC glfw OpenGL::OpenGL OpenGL::EGL ${CMAKE_DL_LIBS})
if(ARS_UI_TESTS)
    set(te "${ARS_IMGUI_DIR}/imgui_test_engine")
    target_sources(ars_imgui PRIVATE
        ${te}/imgui_te_context.cpp ${te}/imgui_te_coroutine.cpp ${te}/imgui_te_engine.cpp ${te}/imgui_te_exporters.cpp
        ${te}/imgui_te_perftool.cpp ${te}/imgui_te_ui.cpp ${te}/imgui_te_utils.cpp ${te}/imgui_capture_tool.cpp
        ${te}/imgui_te_python_gil.cpp)
    target_include_directories(ars_imgui SYSTEM PUBLIC "${ARS_IMGUI_DIR}" "${te}")
    target_compile_definitions(ars_imgui PUBLIC ARS_UI_TESTS=1 IMGUI_ENABLE_TEST_ENGINE
        IMGUI_TEST_ENGINE_ENABLE_COROUTINE_STDTHREAD_IMPL=1)
endif()
