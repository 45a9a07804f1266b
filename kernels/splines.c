/* Least-squares quintic splines on uniform knots, with the noise of their derivatives; all matrices are banded. */
#include "splines.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double RIDGE = 1e-13;
enum { DECAY = 30 };

/* Row j: coefficients of 1, u, ..., u^5 of the j-th B-spline that is not zero on a knot interval, times 120. */
static const double BASIS[ORDER][ORDER] = {{1, -5, 10, -10, 5, -1},   {26, -50, 20, 20, -20, 5},
                                           {66, 0, -60, 0, 30, -10},  {26, 50, 20, -20, -20, 10},
                                           {1, 5, 10, 10, 5, -5},     {0, 0, 0, 0, 0, 1}};

struct grid grid_across(const double *seconds, int64_t count, int64_t intervals) {
  struct grid grid = {.origin = seconds[0], .intervals = intervals, .size = intervals + DEGREE};
  grid.spacing = (seconds[count - 1] - seconds[0]) / (double)intervals;
  for (int j = 0; j < ORDER; j++)
    for (int k = 0; k < ORDER; k++) grid.basis[0][j][k] = BASIS[j][k] / 120.0;
  for (int d = 1; d < 3; d++)
    for (int j = 0; j < ORDER; j++)
      for (int k = 0; k < ORDER - d; k++) grid.basis[d][j][k] = grid.basis[d - 1][j][k + 1] * (k + 1) / grid.spacing;
  return grid;
}

int64_t locate(const struct grid *grid, double second, double *powers) {
  const double scaled = (second - grid->origin) / grid->spacing;
  const double last = (double)(grid->intervals - 1);
  const int64_t start = (int64_t)fmin(fmax(floor(scaled), 0.0), last);
  const double place = scaled - (double)start;
  powers[0] = 1.0;
  for (int k = 1; k < ORDER; k++) powers[k] = powers[k - 1] * place;
  return start;
}

void weights_at(const struct grid *grid, int derivative, const double *powers, double *weights) {
  for (int j = 0; j < ORDER; j++) {
    double sum = 0.0;
    for (int k = 0; k < ORDER - derivative; k++) sum += grid->basis[derivative][j][k] * powers[k];
    weights[j] = sum;
  }
}

double *factorise(const double *band, int64_t size, int *status) {
  double *factor = malloc(sizeof(double) * (size_t)((ORDER + 1) * size));
  if (!factor) {
    *status = POISE_NO_MEMORY;
    return NULL;
  }
  double *scale = factor + ORDER * size;
  for (int64_t i = 0; i < size; i++) scale[i] = 1.0 / sqrt(band[i]);
  for (int64_t j = 0; j < size; j++) {
    for (int d = 0; d < ORDER && j + d < size; d++) {
      double sum = band[d * size + j] * scale[j] * scale[j + d];
      for (int k = 1; k + d < ORDER && k <= j; k++) sum -= factor[k * size + j - k] * factor[(k + d) * size + j - k];
      if (d > 0) {
        factor[d * size + j] = sum / factor[j];
      } else if (sum > 0.0) { /* false for NaN, too */
        factor[j] = sqrt(sum);
      } else {
        free(factor);
        *status = POISE_NOT_POSITIVE;
        return NULL;
      }
    }
  }
  return factor;
}

/* row -= weight * other, for columns in fours or a single one; the compiler makes vectors of the fours. */
static inline void subtract(double *restrict row, double weight, const double *restrict other, int64_t columns) {
  if (columns == 1) {
    row[0] -= weight * other[0];
    return;
  }
  for (int64_t c = 0; c < columns; c += 4)
    for (int k = 0; k < 4; k++) row[c + k] -= weight * other[c + k];
}

static inline void scale_row(double *row, double factor, int64_t columns) {
  for (int64_t c = 0; c < columns; c++) row[c] *= factor;
}

void solve_band(const double *factor, int64_t size, double *right, int64_t columns) {
  const double *scale = factor + ORDER * size;
  for (int64_t i = 0; i < size; i++) {
    scale_row(right + i * columns, scale[i], columns);
    for (int k = 1; k < ORDER && k <= i; k++)
      subtract(right + i * columns, factor[k * size + i - k], right + (i - k) * columns, columns);
    scale_row(right + i * columns, 1.0 / factor[i], columns);
  }
  for (int64_t i = size - 1; i >= 0; i--) {
    for (int k = 1; k < ORDER && i + k < size; k++)
      subtract(right + i * columns, factor[k * size + i], right + (i + k) * columns, columns);
    scale_row(right + i * columns, 1.0 / factor[i], columns);
  }
  for (int64_t i = 0; i < size; i++) scale_row(right + i * columns, scale[i], columns);
}

/* Where each sample is, and its weights in value and slope. */
static struct design *new_design(const struct grid *grid, const double *seconds, int64_t count) {
  struct design *design = malloc(sizeof *design * (size_t)count);
  double powers[ORDER];
  for (int64_t n = 0; design && n < count; n++) {
    design[n].start = locate(grid, seconds[n], powers);
    for (int d = 0; d < 2; d++) weights_at(grid, d, powers, design[n].weights[d]);
  }
  return design;
}

/* values -= B coefficients, and gradient += B^T values, with B that of a derivative; sums the squares that are left. */
static void take_away(const struct design *design, int derivative, int64_t count, const double *coefficients,
                      int64_t columns, double *values, double *gradient, double *squares) {
  for (int64_t n = 0; n < count; n++) {
    const double *weights = design[n].weights[derivative];
    const int64_t first = design[n].start * columns;
    double *row = values + n * columns;
    if (coefficients)
      for (int i = 0; i < ORDER; i++) subtract(row, weights[i], coefficients + first + i * columns, columns);
    for (int i = 0; i < ORDER; i++) subtract(gradient + first + i * columns, -weights[i], row, columns);
    if (squares)
      for (int64_t c = 0; c < columns; c++) squares[c] += row[c] * row[c];
  }
}

static double add_band(const struct grid *grid, const struct design *design, int derivative, int64_t count,
                       double *band) {
  double trace = 0.0;
  for (int64_t n = 0; n < count; n++) {
    const double *weights = design[n].weights[derivative];
    for (int d = 0; d < ORDER; d++)
      for (int i = 0; i + d < ORDER; i++) band[d * grid->size + design[n].start + i] += weights[i] * weights[i + d];
  }
  for (int64_t i = 0; i < grid->size; i++) trace += band[i];
  return trace;
}

/* Third differences of the coefficients, which settle knot intervals without samples. */
static void add_ridge(const struct grid *grid, int64_t count, double *band) {
  static const double difference[4] = {-1.0, 3.0, -3.0, 1.0};
  const double strength = RIDGE * fmax((double)count / (double)grid->intervals, 1.0);
  for (int64_t row = 0; row + 3 < grid->size; row++)
    for (int i = 0; i < 4; i++)
      for (int d = 0; i + d < 4; d++) band[d * grid->size + row + i] += strength * difference[i] * difference[i + d];
}

static struct fit *new_fit(int64_t size, int64_t columns, int with_bands, int *status) {
  struct fit *fit = calloc(1, sizeof *fit);
  if (fit) {
    fit->columns = columns;
    fit->coefficients = calloc((size_t)(size * columns), sizeof(double));
    fit->square_sum = calloc((size_t)columns, sizeof(double));
    fit->normal = calloc((size_t)(ORDER * size), sizeof(double));
    if (with_bands) fit->slope_band = calloc((size_t)(ORDER * size), sizeof(double));
    if (fit->coefficients && fit->square_sum && fit->normal && (fit->slope_band || !with_bands)) return fit;
  }
  free_fit(fit);
  *status = POISE_NO_MEMORY;
  return NULL;
}

void free_fit(struct fit *fit) {
  if (!fit) return;
  free(fit->design);
  free(fit->normal);
  free(fit->slope_band);
  free(fit->coefficients);
  free(fit->square_sum);
  free(fit);
}

struct fit *fit_values(const double *seconds, int64_t count, const double *values, int64_t columns, int64_t intervals,
                       int *status) {
  const struct grid grid = grid_across(seconds, count, intervals);
  const int64_t entries = grid.size * columns;
  struct fit *fit = new_fit(grid.size, columns, 1, status);
  double *left = malloc(sizeof(double) * (size_t)(count * columns));
  double *gradient = calloc((size_t)entries, sizeof(double));
  double *factor = NULL;
  struct design *design = new_design(&grid, seconds, count);
  if (fit) fit->design = design;
  if (fit && left && gradient && design) {
    fit->grid = grid;
    fit->trace = add_band(&grid, design, 0, count, fit->normal);
    fit->slope_trace = add_band(&grid, design, 1, count, fit->slope_band);
    add_ridge(&grid, count, fit->normal);
    factor = factorise(fit->normal, grid.size, status);
  } else {
    *status = POISE_NO_MEMORY;
  }
  if (factor) {
    memcpy(left, values, sizeof(double) * (size_t)(count * columns));
    take_away(design, 0, count, NULL, columns, left, fit->coefficients, NULL);
    solve_band(factor, grid.size, fit->coefficients, columns);
    take_away(design, 0, count, fit->coefficients, columns, left, gradient, fit->square_sum);
    double *step = malloc(sizeof(double) * (size_t)entries);
    if (step) {
      memcpy(step, gradient, sizeof(double) * (size_t)entries);
      solve_band(factor, grid.size, step, columns); /* takes away what squaring the condition number cost */
      for (int64_t i = 0; i < entries; i++) {
        fit->coefficients[i] += step[i];
        fit->square_sum[i % columns] -= step[i] * gradient[i];
      }
      fit->degrees = (double)(count - grid.size);
      free(step);
    } else {
      *status = POISE_NO_MEMORY;
    }
  }
  free(factor);
  free(left);
  free(gradient);
  if (!fit) free(design);
  if (*status) {
    free_fit(fit);
    return NULL;
  }
  return fit;
}

int slope_sums(const struct fit *fit, int64_t count, const double *slopes, double *gradient, double *squares) {
  double *left = malloc(sizeof(double) * (size_t)(count * fit->columns));
  if (!left) return POISE_NO_MEMORY;
  memcpy(left, slopes, sizeof(double) * (size_t)(count * fit->columns));
  take_away(fit->design, 1, count, fit->coefficients, fit->columns, left, gradient, squares);
  free(left);
  return POISE_OK;
}

struct fit *one_column(const struct fit *plain, int64_t column, int *status) {
  const int64_t size = plain->grid.size;
  struct fit *fit = new_fit(size, 1, 0, status);
  if (!fit) return NULL;
  fit->grid = plain->grid;
  fit->degrees = plain->degrees;
  fit->square_sum[0] = plain->square_sum[column];
  memcpy(fit->normal, plain->normal, sizeof(double) * (size_t)(ORDER * size));
  for (int64_t i = 0; i < size; i++) fit->coefficients[i] = plain->coefficients[i * plain->columns + column];
  return fit;
}

struct fit *with_slopes(const struct fit *plain, int64_t column, const double *gradient, const double *squares,
                        double weight, int *status) {
  const int64_t size = plain->grid.size;
  struct fit *fit = one_column(plain, column, status);
  double *step = malloc(sizeof(double) * (size_t)size);
  double *factor = NULL;
  if (fit && step) {
    for (int64_t i = 0; i < ORDER * size; i++) fit->normal[i] += weight * plain->slope_band[i];
    factor = factorise(fit->normal, size, status);
  } else {
    *status = POISE_NO_MEMORY;
  }
  if (factor) {
    double square = fit->square_sum[0] + weight * squares[column];
    for (int64_t i = 0; i < size; i++) step[i] = weight * gradient[i * plain->columns + column];
    solve_band(factor, size, step, 1);
    for (int64_t i = 0; i < size; i++) {
      fit->coefficients[i] += step[i];
      square -= step[i] * weight * gradient[i * plain->columns + column];
    }
    fit->square_sum[0] = fmax(square, 0.0);
    fit->degrees = 2.0 * (plain->degrees + (double)size) - (double)size;
  }
  free(factor);
  free(step);
  if (*status) {
    free_fit(fit);
    return NULL;
  }
  return fit;
}

double fit_sigma(const struct fit *fit, int64_t column) {
  return sqrt(fmax(fit->square_sum[column], 0.0) / fmax(fit->degrees, 1.0));
}

double fit_score(const struct fit *fit, int64_t column) {
  const double size = (double)fit->grid.size, count = fit->degrees + size, left = count - 1.2 * size;
  return left > 0.0 ? count * fit->square_sum[column] / (left * left) : INFINITY;
}

/* The inverse of rows and columns low to high of the normal matrix, as far as it lies in the band: (ORDER, size) lower
   form (Takahashi 1973). `band` and `inverse` hold (ORDER, high - low). */
static int invert_part(const struct fit *fit, int64_t low, int64_t high, double *band, double *inverse) {
  const int64_t size = high - low, whole = fit->grid.size;
  int status = POISE_OK;
  for (int d = 0; d < ORDER; d++)
    for (int64_t i = 0; i < size; i++) band[d * size + i] = i + d < size ? fit->normal[d * whole + low + i] : 0.0;
  double *factor = factorise(band, size, &status);
  if (!factor) return status;
  const double *scale = factor + ORDER * size;
  for (int64_t j = size - 1; j >= 0; j--) {
    const int reach = (int)(size - 1 - j < DEGREE ? size - 1 - j : DEGREE);
    for (int d = reach; d >= 0; d--) {
      double sum = d == 0 ? 1.0 / factor[j] : 0.0;
      for (int k = 1; k <= reach; k++) {
        const int64_t column = j + (k < d ? k : d), apart = k < d ? d - k : k - d;
        sum -= factor[k * size + j] * inverse[apart * size + column];
      }
      inverse[d * size + j] = sum / factor[j];
    }
  }
  for (int d = 0; d < ORDER; d++)
    for (int64_t i = 0; i + d < size; i++) inverse[d * size + i] *= scale[i] * scale[i + d];
  free(factor);
  return POISE_OK;
}

double *inverse_windows(const struct fit *fit, int *status) {
  const int64_t block = 4 * DECAY, most = block + 2 * DECAY + ORDER, intervals = fit->grid.intervals;
  double *windows = malloc(sizeof(double) * (size_t)(intervals * ORDER * ORDER));
  double *work = malloc(sizeof(double) * (size_t)(2 * ORDER * most));
  if (!windows || !work) *status = POISE_NO_MEMORY;
  for (int64_t left = 0; left < intervals && !*status; left += block) {
    const int64_t right = left + block < intervals ? left + block : intervals;
    const int64_t low = left > DECAY ? left - DECAY : 0;
    const int64_t high = right + ORDER + DECAY < fit->grid.size ? right + ORDER + DECAY : fit->grid.size;
    double *inverse = work + ORDER * most;
    *status = invert_part(fit, low, high, work, inverse);
    for (int64_t at = left; at < right && !*status; at++)
      for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) {
          const int64_t row = at - low + (i < j ? i : j), apart = i < j ? j - i : i - j;
          windows[(at * ORDER + i) * ORDER + j] = inverse[apart * (high - low) + row];
        }
  }
  free(work);
  if (*status) {
    free(windows);
    return NULL;
  }
  return windows;
}
