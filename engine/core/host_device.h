#pragma once

/// Marks a function of a *_math.h header: compiled for the host everywhere and for the device under nvcc.
#if defined(__CUDACC__)
#define ARS_HD __host__ __device__
#else
#define ARS_HD
#endif
