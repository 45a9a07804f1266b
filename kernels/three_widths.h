/* Includes `POISE_TEMPLATE` once for each width of vectors that processors have. GCC 12 takes vectors wider than those
   of the processor through memory, one number after the other; so rows of eight numbers are taken in parts:

   - PART: bytes of one; PARTS: parts of a row; EACH: numbers in one.
   - part, choice: the numbers in one, and an integer for each, all bits of which are set where something holds.
   - NAMED(name): the name that a function of the template has for this width.

   All widths compute the same operations in the same order, so that they round alike. `FOR_WIDTH` calls the function
   for this processor. */
#define PART 16
#define NAMED(name) name##_16
#include "one_width.h"

#ifdef POISE_WIDTHS
#pragma GCC push_options
#pragma GCC target("avx2")
#define PART 32
#define NAMED(name) name##_32
#include "one_width.h"
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx512f")
#define PART 64
#define NAMED(name) name##_64
#include "one_width.h"
#pragma GCC pop_options

#define FOR_WIDTH(name, ...)                                           \
  (__builtin_cpu_supports("avx512f") ? name##_64(__VA_ARGS__)          \
   : __builtin_cpu_supports("avx2")  ? name##_32(__VA_ARGS__)          \
                                     : name##_16(__VA_ARGS__))
#else
#define FOR_WIDTH(name, ...) name##_16(__VA_ARGS__)
#endif
