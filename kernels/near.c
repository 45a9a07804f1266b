/* The nearest of many points. */
#include "near.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { CUBES = 32 }; /* for each point, at the most */

void near_free(near_grid *grid) {
  free(grid->start);
  free(grid->number);
  free(grid->at);
}

static int64_t cubes(const near_grid *grid) { return (int64_t)grid->size[0] * grid->size[1] * grid->size[2]; }

static int32_t row_of(const near_grid *grid, double value, int axis) {
  const double row = (value - grid->low[axis]) / grid->cube;
  return row > 0 ? (row < grid->size[axis] - 1 ? (int32_t)row : grid->size[axis] - 1) : 0;
}

static int64_t cube_of(const near_grid *grid, const double *point) {
  const int64_t first = (int64_t)row_of(grid, point[0], 0) * grid->size[1] + row_of(grid, point[1], 1);
  return first * grid->size[2] + row_of(grid, point[2], 2);
}

static void divide(near_grid *grid, const double *extent, double cube) {
  for (;; cube *= 1.3) {
    double all = 1;
    for (int axis = 0; axis < 3; axis++) all *= floor(extent[axis] / cube) + 1;
    if (!(all <= (double)CUBES * (double)grid->n + 1)) continue;
    grid->cube = cube;
    for (int axis = 0; axis < 3; axis++) grid->size[axis] = (int32_t)(extent[axis] / cube) + 1;
    return;
  }
}

int near_build(near_grid *grid, int64_t n, const double *points, double cube) {
  double extent[3], widest = 0;
  for (int axis = 0; axis < 3; axis++) {
    double high = grid->low[axis] = points[axis];
    for (int64_t k = 1; k < n; k++) {
      high = fmax(high, points[3 * k + axis]);
      grid->low[axis] = fmin(grid->low[axis], points[3 * k + axis]);
    }
    extent[axis] = high - grid->low[axis];
    widest = fmax(widest, extent[axis]);
  }
  grid->n = n;
  divide(grid, extent, fmax(fmax(cube, widest / 1e6), 1e-300));
  if (n > grid->room) {
    near_free(grid);
    grid->start = malloc((size_t)(CUBES * n + 2) * sizeof *grid->start);
    grid->number = malloc((size_t)n * sizeof *grid->number);
    grid->at = malloc((size_t)n * sizeof *grid->at);
    grid->room = grid->start && grid->number && grid->at ? n : 0;
    if (!grid->room) return 0;
  }
  const int64_t all = cubes(grid);
  memset(grid->start, 0, (size_t)(all + 1) * sizeof *grid->start);
  for (int64_t k = 0; k < n; k++) grid->start[cube_of(grid, points + 3 * k) + 1]++;
  for (int64_t k = 0; k < all; k++) grid->start[k + 1] += grid->start[k];
  for (int64_t k = n - 1; k >= 0; k--) {
    const int64_t own = --grid->start[cube_of(grid, points + 3 * k) + 1];
    grid->number[own] = (int32_t)k;
    memcpy(grid->at[own], points + 3 * k, sizeof *grid->at);
  }
  memmove(grid->start, grid->start + 1, (size_t)all * sizeof *grid->start);
  grid->start[all] = (int32_t)n;
  return 1;
}

/* Points of a row of cubes along the last axis among the nearest that are known, in order. */
static int look(const near_grid *grid, int64_t first, int64_t end, const double *place, int k, int found,
                int64_t *nearest, double *squares) {
  for (int32_t own = grid->start[first]; own < grid->start[end]; own++) {
    const double x = grid->at[own][0] - place[0], y = grid->at[own][1] - place[1], z = grid->at[own][2] - place[2];
    const double square = x * x + y * y + z * z;
    if (found == k && !(square < squares[k - 1])) continue;
    int at = found < k ? found++ : k - 1;
    for (; at > 0 && squares[at - 1] > square; at--) squares[at] = squares[at - 1], nearest[at] = nearest[at - 1];
    squares[at] = square;
    nearest[at] = grid->number[own];
  }
  return found;
}

void near_find(const near_grid *grid, const double *place, int k, int64_t *nearest, double *squares) {
  int32_t own[3];
  for (int axis = 0; axis < 3; axis++) own[axis] = row_of(grid, place[axis], axis);
  int found = 0;
  for (int32_t ring = 0;; ring++) {
    int32_t low[3], high[3];
    double sure = INFINITY; /* m around the place that was looked at */
    for (int axis = 0; axis < 3; axis++) {
      low[axis] = own[axis] - ring, high[axis] = own[axis] + ring;
      const double from = place[axis] - grid->low[axis];
      if (low[axis] > 0) sure = fmin(sure, from - low[axis] * grid->cube);
      if (high[axis] < grid->size[axis] - 1) sure = fmin(sure, (high[axis] + 1) * grid->cube - from);
    }
    const int32_t z0 = low[2] > 0 ? low[2] : 0, z1 = high[2] < grid->size[2] - 1 ? high[2] : grid->size[2] - 1;
    for (int32_t x = low[0] > 0 ? low[0] : 0; x <= high[0] && x < grid->size[0]; x++)
      for (int32_t y = low[1] > 0 ? low[1] : 0; y <= high[1] && y < grid->size[1]; y++) {
        const int64_t row = ((int64_t)x * grid->size[1] + y) * grid->size[2];
        if (x == low[0] || x == high[0] || y == low[1] || y == high[1]) {
          found = look(grid, row + z0, row + z1 + 1, place, k, found, nearest, squares);
        } else {
          if (low[2] >= 0) found = look(grid, row + low[2], row + low[2] + 1, place, k, found, nearest, squares);
          if (high[2] < grid->size[2]) found = look(grid, row + high[2], row + high[2] + 1, place, k, found, nearest, squares);
        }
      }
    if (sure == INFINITY || (found == k && sure > 0 && squares[k - 1] <= sure * sure)) return;
  }
}

int64_t near_one(const near_grid *grid, const double *points, const double *place, int64_t guess) {
  const double *g = points + 3 * guess;
  const double gx = g[0] - place[0], gy = g[1] - place[1], gz = g[2] - place[2];
  double best = gx * gx + gy * gy + gz * gz;
  const double reach = sqrt(best) * (1 + 1e-9);
  int32_t low[3], high[3];
  for (int axis = 0; axis < 3; axis++) {
    low[axis] = row_of(grid, place[axis] - reach, axis);
    high[axis] = row_of(grid, place[axis] + reach, axis);
  }
  for (int64_t x = low[0]; x <= high[0]; x++)
    for (int64_t y = low[1]; y <= high[1]; y++) {
      const int64_t row = (x * grid->size[1] + y) * grid->size[2];
      look(grid, row + low[2], row + high[2] + 1, place, 1, 1, &guess, &best);
    }
  return guess;
}

/* Of points (n, 3) the k nearest of each place (m, 3): numbers (m, k), nearest first, and distances (m, k), m; cube: m,
   a few points wide. */
POISE_EXPORT int64_t poise_nearest(int64_t n, const double *points, double cube, int64_t m, const double *places, int64_t k,
                                   int64_t *numbers, double *distances) {
  near_grid grid = {0};
  const int ready = near_build(&grid, n, points, cube);
  for (int64_t i = 0; ready && i < m; i++) {
    near_find(&grid, places + 3 * i, (int)k, numbers + k * i, distances + k * i);
    for (int64_t j = 0; j < k; j++) distances[k * i + j] = sqrt(distances[k * i + j]);
  }
  near_free(&grid);
  return ready ? POISE_OK : POISE_NO_MEMORY;
}

/* Averages unit normals (n, 3) of points over those within a radius, m, and of the same side, in some rounds. */
POISE_EXPORT int64_t poise_side_normals(int64_t n, const double *points, double radius, int64_t rounds, double *normals) {
  near_grid grid = {0};
  double *sums = malloc((size_t)(3 * n + 1) * sizeof *sums);
  const int ready = sums && near_build(&grid, n, points, radius);
  for (int64_t round = 0; ready && round < rounds; round++) {
    memcpy(sums, normals, (size_t)(3 * n) * sizeof *sums);
    for (int64_t i = 0; i < n; i++) {
      const double *at = points + 3 * i, *own = normals + 3 * i;
      int32_t low[3], high[3];
      for (int axis = 0; axis < 3; axis++)
        low[axis] = row_of(&grid, at[axis] - radius, axis), high[axis] = row_of(&grid, at[axis] + radius, axis);
      for (int64_t x = low[0]; x <= high[0]; x++)
        for (int64_t y = low[1]; y <= high[1]; y++) {
          const int64_t row = (x * grid.size[1] + y) * grid.size[2];
          for (int32_t k = grid.start[row + low[2]]; k < grid.start[row + high[2] + 1]; k++) {
            const double dx = grid.at[k][0] - at[0], dy = grid.at[k][1] - at[1], dz = grid.at[k][2] - at[2];
            if (grid.number[k] == i || !(dx * dx + dy * dy + dz * dz <= radius * radius)) continue;
            const double *other = normals + 3 * grid.number[k];
            const double same = fmax(own[0] * other[0] + own[1] * other[1] + own[2] * other[2], 0.0);
            for (int axis = 0; axis < 3; axis++) sums[3 * i + axis] += same * same * other[axis];
          }
        }
    }
    for (int64_t i = 0; i < n; i++) {
      const double *sum = sums + 3 * i, size = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
      for (int axis = 0; axis < 3; axis++) normals[3 * i + axis] = sum[axis] / fmax(size, 1e-30);
    }
  }
  near_free(&grid);
  free(sums);
  return ready ? POISE_OK : POISE_NO_MEMORY;
}
