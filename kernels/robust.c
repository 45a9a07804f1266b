/* Iteratively reweighted least squares of force and torque; `_weighted` in poise/weighing/fitting.py. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"

enum { CHANNELS = 6, GROUPS = 2, AXES = 3 };
static const double EFFICIENT = 0.89, RIDGE = 1e-9;

/* Entries of a design (rows, columns) that are not zero, row by row: half of a wrench's are. */
struct entries {
  int64_t *begin, *column; /* (rows + 1,), (entries,) */
  double *value;
};

static void gather(const double *design, int64_t rows, int64_t columns, struct entries *found) {
  int64_t count = 0;
  for (int64_t r = 0; r < rows; r++) {
    found->begin[r] = count;
    for (int64_t c = 0; c < columns; c++)
      if (design[r * columns + c] != 0.0) {
        found->column[count] = c;
        found->value[count++] = design[r * columns + c];
      }
  }
  found->begin[rows] = count;
}

/* The entry of an array that has `rank` smaller ones; orders the array about it. */
static double select_rank(double *values, int64_t count, int64_t rank) {
  int64_t low = 0, high = count - 1;
  while (low < high) {
    const double pivot = values[(low + high) / 2];
    int64_t i = low, j = high;
    while (i <= j) {
      while (values[i] < pivot) i++;
      while (pivot < values[j]) j--;
      if (i <= j) {
        const double other = values[i];
        values[i++] = values[j];
        values[j--] = other;
      }
    }
    if (rank <= j) {
      high = j;
    } else if (rank >= i) {
      low = i;
    } else {
      break;
    }
  }
  return values[rank];
}

/* As numpy.median; NaN where one of the values is. */
static double median(double *values, int64_t count) {
  for (int64_t i = 0; i < count; i++)
    if (isnan(values[i])) return NAN;
  const double upper = select_rank(values, count, count / 2);
  if (count % 2) return upper;
  double lower = -INFINITY; /* the largest of those before it */
  for (int64_t i = 0; i < count / 2; i++) lower = fmax(lower, values[i]);
  return (lower + upper) / 2.0;
}

static double at_least(double value, double least) { return value < least ? least : value; /* NaN stays */ }

/* Weighted least squares: unknowns (columns,) of entries with roots of weights (rows,). */
static int solve_weighted(const struct entries *design, int64_t rows, int columns, const double *right,
                          const double *root, double *normal, double *scale, int *exchanges, double *unknowns) {
  memset(normal, 0, sizeof(double) * (size_t)(columns * columns));
  memset(unknowns, 0, sizeof(double) * (size_t)columns);
  for (int64_t r = 0; r < rows; r++) {
    const double weight = root[r] * root[r];
    for (int64_t a = design->begin[r]; a < design->begin[r + 1]; a++) {
      const double pull = weight * design->value[a];
      double *row = normal + design->column[a] * columns;
      for (int64_t b = design->begin[r]; b <= a; b++) row[design->column[b]] += pull * design->value[b];
      unknowns[design->column[a]] += pull * right[r];
    }
  }
  for (int i = 0; i < columns; i++) {
    scale[i] = sqrt(normal[i * (columns + 1)]);
    if (scale[i] == 0.0) scale[i] = 1.0;
  }
  for (int i = 0; i < columns; i++) {
    unknowns[i] /= scale[i];
    for (int j = 0; j <= i; j++)
      normal[i * columns + j] = normal[j * columns + i] = normal[i * columns + j] / (scale[i] * scale[j]);
    normal[i * (columns + 1)] += RIDGE;
  }
  const int status = factor_rows(normal, columns, exchanges);
  if (status) return status;
  solve_rows(normal, columns, exchanges, unknowns, 1);
  for (int i = 0; i < columns; i++) unknowns[i] /= scale[i];
  return POISE_OK;
}

/* Residual and its lengths (count, 2), in each group of three channels. */
static void leave(const struct entries *design, int64_t count, const double *wrench, const double *used,
                  const double *unknowns, double *residual, double *norm) {
  for (int64_t r = 0; r < count * CHANNELS; r++) {
    residual[r] = wrench[r];
    for (int64_t a = design->begin[r]; a < design->begin[r + 1]; a++)
      residual[r] -= design->value[a] * unknowns[design->column[a]];
  }
  for (int64_t g = 0; g < count * GROUPS; g++) {
    double sum = 0.0;
    for (int k = 0; k < AXES; k++) {
      const double left = (used ? used[AXES * g + k] : 1.0) * residual[AXES * g + k];
      sum += left * left;
    }
    norm[(g % GROUPS) * count + g / GROUPS] = sqrt(sum) / sqrt(3.0);
  }
}

static int fit(const struct entries *design, int64_t count, int columns, const double *wrench, const double *used,
               const double *least, double huber, int64_t rounds, double *unknowns, double *root, double *residual,
               double *room, int *exchanges) {
  double *norm = room, *sorted = norm + GROUPS * count, *normal = sorted + count, *scale = normal + columns * columns;
  for (int g = 0; g < GROUPS; g++) {
    double mean = 0.0, square = 0.0;
    for (int64_t n = 0; n < count; n++)
      for (int k = 0; k < AXES; k++) mean += wrench[n * CHANNELS + AXES * g + k] / (double)(AXES * count);
    for (int64_t n = 0; n < count; n++)
      for (int k = 0; k < AXES; k++) {
        const double apart = wrench[n * CHANNELS + AXES * g + k] - mean;
        square += apart * apart;
      }
    const double size = at_least(sqrt(square / (double)(AXES * count)), least[g]);
    for (int64_t n = 0; n < count; n++)
      for (int k = 0; k < AXES; k++) {
        const int64_t r = n * CHANNELS + AXES * g + k;
        root[r] = (used ? used[r] : 1.0) / size;
      }
  }
  for (int64_t round = 0; round < rounds; round++) {
    const int status =
        solve_weighted(design, count * CHANNELS, columns, wrench, root, normal, scale, exchanges, unknowns);
    if (status) return status;
    leave(design, count, wrench, used, unknowns, residual, norm);
    for (int g = 0; g < GROUPS; g++) {
      memcpy(sorted, norm + g * count, sizeof(double) * (size_t)count);
      const double size = at_least(median(sorted, count) / EFFICIENT, least[g]);
      for (int64_t n = 0; n < count; n++) {
        const double share = sqrt(huber * size / at_least(norm[g * count + n], 1e-12));
        for (int k = 0; k < AXES; k++) {
          const int64_t r = n * CHANNELS + AXES * g + k;
          root[r] = (used ? used[r] : 1.0) * ((share < 1.0 ? share : 1.0) / size);
        }
      }
    }
  }
  return POISE_OK;
}

/* Unknowns (columns,), roots of the weights (count, 6) and residual (count, 6) of a design (count, 6, columns) and
   wrenches (count, 6). `used` (count, 6) is 0 for readings that do not count, or NULL; `least` (2,) noise. */
POISE_EXPORT int64_t poise_robust_fit(int64_t count, int64_t columns, const double *matrix, const double *wrench,
                                      const double *used, const double *least, double huber, int64_t rounds,
                                      double *unknowns, double *root, double *residual) {
  const int64_t rows = count * CHANNELS;
  struct entries design = {.begin = malloc(sizeof(int64_t) * (size_t)(rows + 1)),
                           .column = malloc(sizeof(int64_t) * (size_t)(rows * columns + 1)),
                           .value = malloc(sizeof(double) * (size_t)(rows * columns + 1))};
  double *room = malloc(sizeof(double) * (size_t)(3 * count + columns * columns + columns + 1));
  int *exchanges = malloc(sizeof(int) * (size_t)(columns + 1));
  int status = POISE_NO_MEMORY;
  if (design.begin && design.column && design.value && room && exchanges) {
    gather(matrix, rows, columns, &design);
    status = fit(&design, count, (int)columns, wrench, used, least, huber, rounds, unknowns, root, residual, room,
                 exchanges);
  }
  free(design.begin);
  free(design.column);
  free(design.value);
  free(room);
  free(exchanges);
  return status;
}
