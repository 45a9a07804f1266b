/* One inclusion of `POISE_TEMPLATE`; see three_widths.h. */
#define PARTS ((int)(sizeof(row_of_block) / PART))
#define EACH ((int)(PART / sizeof(double)))
#define part NAMED(part)
#define choice NAMED(choice)
typedef double part __attribute__((vector_size(PART)));
typedef int64_t choice __attribute__((vector_size(PART)));

#include POISE_TEMPLATE

#undef PART
#undef NAMED
#undef PARTS
#undef EACH
#undef part
#undef choice
