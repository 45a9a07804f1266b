/* Least squares with bounds; `_boxed` in poise/mismatch/inference/box.py. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "poise_kernels.h"

enum { MOST = 60, PIVOTS = 20, PATIENCE = 2 };
static const double GAP = 1e-4, NEARBY = 1.0, NEARER = 30.0, TOUCH = 1e-6, FLAT = 1e-10;

/* A problem with k coefficients, and room for (k, k) and for vectors (k,). `lower` and `upper` may be infinite. */
struct box {
  int64_t k;
  const double *normal, *right, *lower, *upper;
  double *factor, *vectors;
};

/* a (n, n), of which the upper triangle is used, becomes U with U^T U = a, row by row so that rows are vectors. */
static int factorise_upper(double *a, int64_t n) {
  for (int64_t j = 0; j < n; j++) {
    double *row = a + j * n;
    if (!(row[j] > 0.0)) return POISE_NOT_POSITIVE; /* NaN, too */
    const double scale = 1.0 / sqrt(row[j]);
    for (int64_t i = j; i < n; i++) row[i] *= scale;
    for (int64_t i = j + 1; i < n; i++) {
      const double weight = row[i];
      double *below = a + i * n;
      for (int64_t c = i; c < n; c++) below[c] -= weight * row[c];
    }
  }
  return POISE_OK;
}

static void solve_upper(const double *u, int64_t n, double *x) {
  for (int64_t j = 0; j < n; j++) {
    const double *row = u + j * n, value = x[j] / row[j];
    x[j] = value;
    for (int64_t i = j + 1; i < n; i++) x[i] -= value * row[i];
  }
  for (int64_t j = n - 1; j >= 0; j--) {
    const double *row = u + j * n;
    double sum = x[j];
    for (int64_t i = j + 1; i < n; i++) sum -= row[i] * x[i];
    x[j] = sum / row[j];
  }
}

/* out = normal x - right; the matrix is symmetric, so that its rows serve as columns. */
static void slope_at(const struct box *box, const double *x, double *out) {
  const int64_t k = box->k;
  for (int64_t i = 0; i < k; i++) out[i] = -box->right[i];
  for (int64_t j = 0; j < k; j++) {
    const double *row = box->normal + j * k, value = x[j];
    if (value != 0.0)
      for (int64_t i = 0; i < k; i++) out[i] += value * row[i];
  }
}

/* The least by pivoting from the bounds that hold (-1, 1 in `side`, which changes); `found` is 0 without progress. */
static int pivot(const struct box *box, int8_t *side, double *x, int *found) {
  const int64_t k = box->k;
  double *rest = box->vectors, *slope = rest + k, *tight = slope + k;
  int64_t *free_ones = (int64_t *)(tight + k), fewest = k + 1;
  int patience = PATIENCE;
  *found = 0;
  for (int64_t i = 0; i < k; i++) tight[i] = FLAT * sqrt(box->normal[i * (k + 1)]);
  for (int round = 0; round < PIVOTS; round++) {
    int64_t n = 0, wrong = 0;
    for (int64_t i = 0; i < k; i++) {
      x[i] = side[i] < 0 ? box->lower[i] : side[i] > 0 ? box->upper[i] : 0.0;
      if (!side[i]) free_ones[n++] = i;
    }
    slope_at(box, x, slope);
    for (int64_t a = 0; a < n; a++) {
      const double *row = box->normal + free_ones[a] * k;
      rest[a] = -slope[free_ones[a]];
      for (int64_t b = a; b < n; b++) box->factor[a * n + b] = row[free_ones[b]];
    }
    if (factorise_upper(box->factor, n)) return POISE_NOT_POSITIVE;
    solve_upper(box->factor, n, rest);
    for (int64_t a = 0; a < n; a++) x[free_ones[a]] = rest[a];
    slope_at(box, x, slope);
    for (int64_t i = 0; i < k; i++) {
      const int below = !side[i] && x[i] < box->lower[i], above = !side[i] && x[i] > box->upper[i];
      const int freed = side[i] && side[i] * slope[i] > tight[i] * (1.0 + fabs(x[i]));
      if (below || above || freed) {
        side[i] = (int8_t)(above - below);
        wrong++;
      }
    }
    if (!wrong) {
      *found = 1;
      return POISE_OK;
    }
    patience = wrong < fewest ? PATIENCE : patience - 1;
    if (!patience) return POISE_OK;
    if (wrong < fewest) fewest = wrong;
  }
  return POISE_OK;
}

/* The longest step, at most one, that keeps all values positive. */
static double reach(const double *values, const double *change, int64_t count) {
  double least = 1.0;
  for (int64_t i = 0; i < count; i++)
    if (change[i] < 0.0 && -values[i] / change[i] < least) least = -values[i] / change[i];
  return least;
}

/* Mehrotra's method until pivoting succeeds. Bound s has the coefficient `index` and the `sign` of the way inwards.
   `work` holds 8 vectors of 2 k numbers. */
static int interior(const struct box *box, double *x, int8_t *side, double *trial, double *work) {
  const int64_t k = box->k, most = 2 * k;
  double *slack = work, *pressure = slack + most, *moved = pressure + most, *risen = moved + most;
  double *wanted = risen + most, *rest = wanted + most, *dx = rest + k, *sign = dx + k, *aim = sign + most;
  int64_t *index = (int64_t *)(aim + most), count = 0;
  double pushed = 0.0, small = 0.0, tried = NEARBY;
  for (int side_of = 0; side_of < 2; side_of++)
    for (int64_t i = 0; i < k; i++)
      if (isfinite(side_of ? box->upper[i] : box->lower[i])) {
        index[count] = i;
        sign[count++] = side_of ? -1.0 : 1.0;
      }
  for (int64_t i = 0; i < k; i++) { /* one unit from each bound at least */
    x[i] = fmin(fmax(0.0, box->lower[i] + 1.0), fmax(box->upper[i] - 1.0, box->lower[i] + 1.0));
    small = fmax(small, fabs(box->right[i]));
  }
  small = 1e-6 * (1.0 + small);
  slope_at(box, x, rest);
  for (int64_t s = 0; s < count; s++) {
    const int64_t i = index[s];
    slack[s] = sign[s] * (x[i] - (sign[s] > 0.0 ? box->lower[i] : box->upper[i]));
    pressure[s] = fmax(sign[s] * rest[i], 0.0);
    pushed += fabs(rest[i]);
  }
  for (int64_t s = 0; s < count; s++) pressure[s] += fmax(pushed / (double)count, 1e-3);
  for (int round = 0; round < MOST; round++) {
    double gap = 0.0, largest = 0.0;
    int found = 0;
    for (int64_t s = 0; s < count; s++) gap += slack[s] * pressure[s];
    if (gap < tried) {
      memset(side, 0, (size_t)k);
      for (int64_t s = 0; s < count; s++)
        if (slack[s] < pressure[s]) side[index[s]] = (int8_t)-sign[s];
      const int status = pivot(box, side, trial, &found);
      if (found) memcpy(x, trial, sizeof(double) * (size_t)k);
      if (status || found) return status;
      tried = gap / NEARER;
    }
    slope_at(box, x, rest);
    for (int64_t s = 0; s < count; s++) rest[index[s]] -= sign[s] * pressure[s];
    for (int64_t i = 0; i < k; i++) largest = fmax(largest, fabs(rest[i]));
    if (gap < GAP && largest < small) break;
    for (int64_t i = 0; i < k; i++)
      memcpy(box->factor + i * (k + 1), box->normal + i * (k + 1), sizeof(double) * (size_t)(k - i));
    for (int64_t s = 0; s < count; s++) box->factor[index[s] * (k + 1)] += pressure[s] / slack[s];
    if (factorise_upper(box->factor, k)) return POISE_NOT_POSITIVE;
    memset(aim, 0, sizeof(double) * (size_t)count);
    for (int predicting = 1; predicting >= 0; predicting--) { /* a predictor, then a centred corrector */
      for (int64_t i = 0; i < k; i++) dx[i] = -rest[i];
      for (int64_t s = 0; s < count; s++) {
        wanted[s] = aim[s] / slack[s] - pressure[s];
        dx[index[s]] += sign[s] * wanted[s];
      }
      solve_upper(box->factor, k, dx);
      for (int64_t s = 0; s < count; s++) {
        moved[s] = sign[s] * dx[index[s]];
        risen[s] = wanted[s] - pressure[s] / slack[s] * moved[s];
      }
      if (!predicting) break;
      const double far = reach(slack, moved, count), high = reach(pressure, risen, count);
      double after = 0.0;
      for (int64_t s = 0; s < count; s++) after += (slack[s] + far * moved[s]) * (pressure[s] + high * risen[s]);
      const double centre = gap / (double)count * pow(after / gap, 3.0);
      for (int64_t s = 0; s < count; s++) aim[s] = centre - moved[s] * risen[s];
    }
    const double along = fmin(0.995 * fmin(reach(slack, moved, count), reach(pressure, risen, count)), 1.0);
    for (int64_t i = 0; i < k; i++) x[i] += along * dx[i];
    for (int64_t s = 0; s < count; s++) {
      slack[s] += along * moved[s];
      pressure[s] += along * risen[s];
    }
  }
  return POISE_OK;
}

/* x (k,) the least of x' normal x / 2 - right' x inside bounds, every coefficient with one bound at least. `near` (k,)
   is the least of a similar problem, or NULL. */
POISE_EXPORT int64_t poise_box_minimum(int64_t k, const double *normal, const double *right, const double *lower,
                                       const double *upper, const double *near, double *x) {
  const int64_t size = 2 * k * k + 30 * k;
  double *room = malloc(sizeof(double) * (size_t)size);
  int8_t *side = malloc((size_t)k);
  int status = POISE_OK, found = 0;
  if (!room || !side) {
    free(room);
    free(side);
    return POISE_NO_MEMORY;
  }
  double *scaled = room + k * k, *rows = scaled + k * k;
  struct box box = {k, normal, right, lower, upper, room, rows};
  if (near) {
    for (int64_t i = 0; i < k; i++) {
      const double width = TOUCH * (isfinite(upper[i] - lower[i]) ? upper[i] - lower[i] : 1.0);
      side[i] = (int8_t)((near[i] >= upper[i] - width) - (near[i] <= lower[i] + width));
    }
    status = pivot(&box, side, x, &found);
  }
  if (!status && !found) {
    /* Units in which the box, or the posterior of a coefficient with one bound, is about one. */
    double *unit = rows + 4 * k, *pulled = unit + k, *low = pulled + k, *high = low + k, *trial = high + k;
    for (int64_t i = 0; i < k; i++) {
      const int both = isfinite(lower[i]) && isfinite(upper[i]);
      unit[i] = both ? fmax((upper[i] - lower[i]) / 2.0, 1e-300) : fmax(1.0 / sqrt(normal[i * (k + 1)]), 1e-12);
    }
    for (int64_t i = 0; i < k; i++) {
      for (int64_t j = 0; j < k; j++) scaled[i * k + j] = normal[i * k + j] * unit[i] * unit[j];
      pulled[i] = right[i] * unit[i];
      low[i] = lower[i] / unit[i];
      high[i] = upper[i] / unit[i];
    }
    struct box other = {k, scaled, pulled, low, high, room, rows};
    status = interior(&other, x, side, trial, trial + k);
    for (int64_t i = 0; i < k; i++) x[i] *= unit[i];
  }
  for (int64_t i = 0; i < k; i++) x[i] = x[i] < lower[i] ? lower[i] : x[i] > upper[i] ? upper[i] : x[i]; /* NaN stays */
  free(room);
  free(side);
  return status;
}
