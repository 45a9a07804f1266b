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

static POISE_INLINE int all_of(const lanes_where *where) {
  int64_t found = -1;
  for (int l = 0; l < WIDTH; l++) found &= (*where)[l];
  return found != 0;
}

#endif
