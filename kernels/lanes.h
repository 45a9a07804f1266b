/* Choices and roots of eight numbers side by side, in the lanes of a row_of_block. */
#ifndef POISE_LANES_H
#define POISE_LANES_H

#include <math.h>

#include "bodies.h"

/* An integer for each lane, all bits of which are set where something holds. */
typedef int64_t lanes_where __attribute__((vector_size(WIDTH * sizeof(int64_t))));

#define CHOOSE(where, a, b) ((row_of_block)(((where) & (lanes_where)(a)) | (~(where) & (lanes_where)(b))))

static POISE_INLINE void take_roots(row_of_block *row) {
  double lanes[WIDTH];
  memcpy(lanes, row, sizeof lanes);
  for (int l = 0; l < WIDTH; l++) lanes[l] = sqrt(lanes[l]);
  memcpy(row, lanes, sizeof lanes);
}

/* Let `fine` be 0 in lanes in which a number is not positive. Loops like this one become vectors of comparisons; GCC 12
   takes combinations of vectors of comparisons one lane after the other. */
static POISE_INLINE void only_positive(const row_of_block *row, row_of_block *fine) {
  double lanes[WIDTH], kept[WIDTH];
  memcpy(lanes, row, sizeof lanes);
  memcpy(kept, fine, sizeof kept);
  for (int l = 0; l < WIDTH; l++) kept[l] = lanes[l] > 0.0 ? kept[l] : 0.0;
  memcpy(fine, kept, sizeof kept);
}

static POISE_INLINE int all_of(const row_of_block *fine) {
  double lanes[WIDTH], least = 1.0;
  memcpy(lanes, fine, sizeof lanes);
  for (int l = 0; l < WIDTH; l++) least = lanes[l] < least ? lanes[l] : least;
  return least > 0.0;
}

#endif
