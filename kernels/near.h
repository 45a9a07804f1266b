/* Points in the cubes of a grid, to find the nearest. */
#ifndef POISE_NEAR_H
#define POISE_NEAR_H

#include "poise_kernels.h"

enum { NEAR_MOST = 64 }; /* neighbours that are asked for, at the most */

typedef struct {
  int64_t n, room;
  double low[3], cube;
  int32_t size[3];
  int32_t *start, *number; /* of each cube the first of its points, in `at`; and their numbers */
  double (*at)[3];
} near_grid;

/* The grid of points (n, 3), finite, n > 0; `cube` m wide, or wider where there would be too many. It may be built
   again of as many points; 0 without memory. Begins as all zeros. */
int near_build(near_grid *grid, int64_t n, const double *points, double cube);
void near_free(near_grid *grid);
/* The k nearest points of a place, k <= n and k <= NEAR_MOST, nearest first; and the squares of their distances. */
void near_find(const near_grid *grid, const double *place, int k, int64_t *nearest, double *squares);
/* The nearest point of a place; `guess`: one that is not far. */
int64_t near_one(const near_grid *grid, const double *points, const double *place, int64_t guess);

#endif
