#pragma once

// OpenGL 4.5 core with its functions as plain symbols (libOpenGL of the vendor-neutral dispatch has them all).
#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>
