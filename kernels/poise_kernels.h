/* Inner loops of Poise in C. Plain functions on arrays of doubles, called through ctypes (poise/kernels). */
#ifndef POISE_KERNELS_H
#define POISE_KERNELS_H

#include <stddef.h>
#include <stdint.h>

#define POISE_KERNELS_VERSION 12 /* of this interface; poise/kernels refuses another one */

#if defined(_WIN32)
#define POISE_EXPORT __declspec(dllexport)
#else
#define POISE_EXPORT __attribute__((visibility("default")))
#endif

enum { POISE_OK = 0, POISE_NO_MEMORY = 1, POISE_NOT_POSITIVE = 2, POISE_SINGULAR = 3 };

/* Functions that exist again for processors with wide vectors (AVX2, AVX-512), from the same operations in the same
   order, so that they round alike; the loader chooses. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define POISE_WIDE __attribute__((target_clones("avx512f", "avx2", "default")))
#define POISE_WIDTHS /* the same by hand, where each width needs its own types */
#define POISE_INLINE inline __attribute__((always_inline)) /* into both */
#else
#define POISE_WIDE
#define POISE_INLINE inline
#endif

#endif
