/* Small dense matrices, row-major. */
#include "dense.h"

#include <math.h>

enum { SWEEPS = 60, SMALL = 16 };

int factor_rows(double *a, int n, int *exchanges) {
  for (int k = 0; k < n; k++) {
    int best = k;
    for (int i = k + 1; i < n; i++)
      if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
    exchanges[k] = best;
    if (best != k)
      for (int j = 0; j < n; j++) {
        const double other = a[k * n + j];
        a[k * n + j] = a[best * n + j];
        a[best * n + j] = other;
      }
    if (a[k * n + k] == 0.0) return POISE_SINGULAR;
    for (int i = k + 1; i < n; i++) {
      const double factor = a[i * n + k] / a[k * n + k];
      a[i * n + k] = factor;
      for (int j = k + 1; j < n; j++) a[i * n + j] -= factor * a[k * n + j];
    }
  }
  return POISE_OK;
}

double log_determinant(const double *a, int n) {
  double sum = 0.0;
  for (int k = 0; k < n; k++) sum += log(fabs(a[k * n + k]));
  return sum;
}

void solve_rows(const double *a, int n, const int *exchanges, double *right, int columns) {
  for (int k = 0; k < n; k++)
    if (exchanges[k] != k)
      for (int c = 0; c < columns; c++) {
        const double other = right[k * columns + c];
        right[k * columns + c] = right[exchanges[k] * columns + c];
        right[exchanges[k] * columns + c] = other;
      }
  for (int k = 0; k < n; k++)
    for (int i = k + 1; i < n; i++)
      for (int c = 0; c < columns; c++) right[i * columns + c] -= a[i * n + k] * right[k * columns + c];
  for (int k = n - 1; k >= 0; k--) {
    for (int c = 0; c < columns; c++) right[k * columns + c] /= a[k * n + k];
    for (int i = 0; i < k; i++)
      for (int c = 0; c < columns; c++) right[i * columns + c] -= a[i * n + k] * right[k * columns + c];
  }
}

int inverse(const double *a, int n, double *out) {
  double rows[SMALL * SMALL];
  int exchanges[SMALL];
  for (int i = 0; i < n * n; i++) {
    rows[i] = a[i];
    out[i] = i % (n + 1) ? 0.0 : 1.0;
  }
  const int status = factor_rows(rows, n, exchanges);
  if (!status) solve_rows(rows, n, exchanges, out, n);
  return status;
}

int cholesky(double *a, int64_t n) {
  for (int64_t j = 0; j < n; j++) {
    double sum = a[j * n + j];
    for (int64_t k = 0; k < j; k++) sum -= a[j * n + k] * a[j * n + k];
    if (!(sum > 0.0)) return POISE_NOT_POSITIVE; /* true for NaN, too */
    const double pivot = sqrt(sum);
    a[j * n + j] = pivot;
    for (int64_t i = j + 1; i < n; i++) {
      double below = a[i * n + j];
      for (int64_t k = 0; k < j; k++) below -= a[i * n + k] * a[j * n + k];
      a[i * n + j] = below / pivot;
    }
  }
  return POISE_OK;
}

/* Turn rows (or columns) p and q, `stride` apart from entry to entry. */
static void turn_pair(double *p, double *q, int64_t n, int64_t stride, double c, double s) {
  for (int64_t k = 0; k < n; k++) {
    const double one = p[k * stride], other = q[k * stride];
    p[k * stride] = c * one - s * other;
    q[k * stride] = s * one + c * other;
  }
}

void eigen(double *a, int64_t n, double *values, double *vectors) {
  for (int64_t i = 0; i < n * n; i++) vectors[i] = i % (n + 1) ? 0.0 : 1.0;
  for (int sweep = 0, moved = 1; sweep < SWEEPS && moved; sweep++) {
    moved = 0;
    for (int64_t p = 0; p < n; p++)
      for (int64_t q = p + 1; q < n; q++) {
        const double apart = a[p * n + q];
        if (!(fabs(apart) > 1e-17 * sqrt(fabs(a[p * n + p] * a[q * n + q])))) continue; /* NaN ends it */
        moved = 1;
        const double ratio = (a[q * n + q] - a[p * n + p]) / (2.0 * apart);
        const double t = (ratio < 0.0 ? -1.0 : 1.0) / (fabs(ratio) + sqrt(ratio * ratio + 1.0));
        const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
        turn_pair(a + p * n, a + q * n, n, 1, c, s);
        turn_pair(a + p, a + q, n, n, c, s);
        turn_pair(vectors + p, vectors + q, n, n, c, s);
        a[p * n + q] = a[q * n + p] = 0.0;
      }
  }
  for (int64_t i = 0; i < n; i++) values[i] = a[i * (n + 1)];
}

void product(const double *a, const double *b, int64_t rows, int64_t inner, int64_t columns, double *restrict out) {
  for (int64_t i = 0; i < rows; i++) {
    double *row = out + i * columns;
    for (int64_t j = 0; j < columns; j++) row[j] = 0.0;
    for (int64_t k = 0; k < inner; k++) {
      const double weight = a[i * inner + k];
      for (int64_t j = 0; j < columns; j++) row[j] += weight * b[k * columns + j];
    }
  }
}

void apply(const double *a, const double *v, int64_t rows, int64_t inner, double *out) {
  for (int64_t i = 0; i < rows; i++) {
    double sum = 0.0;
    for (int64_t k = 0; k < inner; k++) sum += a[i * inner + k] * v[k];
    out[i] = sum;
  }
}
