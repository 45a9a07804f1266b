/* Linear systems of pairs of bodies: block Cholesky where they are symmetric, otherwise block LU with exchanges of rows
   within the diagonal blocks. */
#include "bodies.h"

#include <math.h>
#include <string.h>

int64_t bodies_room(const struct bodies *bodies, int symmetric) {
  return BLOCK * (bodies->count + (symmetric ? 1 : 2) * bodies->below) + BEYOND;
}

struct body_matrix bodies_laid_out(const struct bodies *bodies, int symmetric, double *room, int64_t *whole) {
  struct body_matrix matrix = {room, room + BLOCK * bodies->count, NULL, whole, whole + SIDE * bodies->count};
  if (!symmetric) matrix.upper = matrix.lower + BLOCK * bodies->below;
  return matrix;
}

void bodies_clear(const struct bodies *bodies, struct body_matrix *matrix, double on_diagonal) {
  memset(matrix->diagonal, 0, sizeof(double) * (size_t)bodies_room(bodies, !matrix->upper));
  for (int64_t body = 0; body < bodies->count; body++)
    for (int i = 0; i < SIDE; i++) matrix->diagonal[BLOCK * body + (SIDE + 1) * i] = on_diagonal;
}

void bodies_add(const struct bodies *bodies, struct body_matrix *matrix, int64_t pair, const double *stiffness) {
  for (int side = 0; side < 2; side++) {
    const int64_t body = bodies->sides[2 * pair + side];
    if (body >= 0)
      for (int i = 0; i < BLOCK; i++) matrix->diagonal[BLOCK * body + i] += stiffness[i];
  }
  if (bodies->place[pair] < 0) return;
  double *below = matrix->lower + BLOCK * bodies->place[pair];
  for (int i = 0; i < BLOCK; i++) below[i] -= stiffness[i];
  if (!matrix->upper) return;
  double *above = matrix->upper + BLOCK * bodies->place[pair]; /* transposed */
  for (int i = 0; i < SIDE; i++)
    for (int j = 0; j < SIDE; j++) above[SIDE * j + i] -= stiffness[SIDE * i + j];
}

/* out -= a b^T, with b^T given as `turned`. Reads two numbers beyond `out`. */
static POISE_INLINE void subtract_product(double *restrict out, const double *restrict a,
                                          const row_of_block *restrict turned) {
  row_of_block rows[SIDE];
  for (int i = 0; i < SIDE; i++) {
    read_row(out + SIDE * i, rows + i);
    for (int k = 0; k < SIDE; k++) rows[i] -= a[SIDE * i + k] * turned[k];
  }
  put_rows(rows, out);
}

/* b^T as rows. */
static POISE_INLINE void turn(const double *b, row_of_block *turned) {
  for (int k = 0; k < SIDE; k++)
    turned[k] = (row_of_block){b[k], b[SIDE + k], b[2 * SIDE + k], b[3 * SIDE + k], b[4 * SIDE + k], b[5 * SIDE + k]};
}

static POISE_INLINE void transpose(const double *a, double *out) {
  for (int i = 0; i < SIDE; i++)
    for (int j = 0; j < SIDE; j++) out[SIDE * j + i] = a[SIDE * i + j];
}

/* The diagonal block becomes its lower factor. */
static int factor_symmetric_block(double *a) {
  for (int j = 0; j < SIDE; j++) {
    double sum = a[SIDE * j + j];
    for (int k = 0; k < j; k++) sum -= a[SIDE * j + k] * a[SIDE * j + k];
    if (!(sum > 0.0)) return POISE_NOT_POSITIVE;
    const double pivot = sqrt(sum);
    a[SIDE * j + j] = pivot;
    for (int i = j + 1; i < SIDE; i++) {
      double below = a[SIDE * i + j];
      for (int k = 0; k < j; k++) below -= a[SIDE * i + k] * a[SIDE * j + k];
      a[SIDE * i + j] = below / pivot;
    }
  }
  return POISE_OK;
}

/* The diagonal block becomes L (with ones on the diagonal) and U, its rows exchanged as `exchanges` lists. */
static int factor_block(double *a, int64_t *exchanges) {
  for (int k = 0; k < SIDE; k++) {
    int best = k;
    for (int i = k + 1; i < SIDE; i++)
      if (fabs(a[SIDE * i + k]) > fabs(a[SIDE * best + k])) best = i;
    exchanges[k] = best;
    if (a[SIDE * best + k] == 0.0 || !isfinite(a[SIDE * best + k])) return POISE_SINGULAR;
    for (int j = 0; j < SIDE && best != k; j++) {
      const double other = a[SIDE * k + j];
      a[SIDE * k + j] = a[SIDE * best + j];
      a[SIDE * best + j] = other;
    }
    for (int i = k + 1; i < SIDE; i++) {
      const double factor = a[SIDE * i + k] /= a[SIDE * k + k];
      for (int j = k + 1; j < SIDE; j++) a[SIDE * i + j] -= factor * a[SIDE * k + j];
    }
  }
  return POISE_OK;
}

/* Rows x of a (6, 6) become solutions of x T = a: T is upper, given as rows that are those of `t` or, where it is
   `lower`, those of its transpose. A lower T has ones on its diagonal if `plain`. */
static POISE_INLINE void divide(double *restrict a, const double *restrict t, int lower, int plain) {
  double turned[BLOCK];
  transpose(a, turned);
  for (int j = 0; j < SIDE; j++) {
    double *restrict row = turned + SIDE * j;
    for (int k = 0; k < j; k++) {
      const double weight = lower ? t[SIDE * j + k] : t[SIDE * k + j];
      for (int i = 0; i < SIDE; i++) row[i] -= weight * turned[SIDE * k + i];
    }
    const double scale = plain ? 1.0 : 1.0 / t[SIDE * j + j];
    for (int i = 0; i < SIDE; i++) row[i] *= scale;
  }
  transpose(turned, a);
}

static void exchange_columns(double *a, const int64_t *exchanges) {
  for (int k = 0; k < SIDE; k++)
    for (int r = 0; r < SIDE && exchanges[k] != k; r++) {
      const double other = a[SIDE * r + k];
      a[SIDE * r + k] = a[SIDE * r + exchanges[k]];
      a[SIDE * r + exchanges[k]] = other;
    }
}

/* Take what column k contributes from the columns after it. */
static POISE_INLINE void eliminate(const struct bodies *bodies, struct body_matrix *matrix, int64_t k) {
  const int64_t first = bodies->starts[k], last = bodies->starts[k + 1];
  row_of_block turned[SIDE] = {{0.0}}, turned_lower[SIDE] = {{0.0}};
  for (int64_t b = first; b < last; b++) {
    const int64_t column = bodies->rows[b];
    for (int64_t c = bodies->starts[column]; c < bodies->starts[column + 1]; c++) matrix->where[bodies->rows[c]] = c;
    turn((matrix->upper ? matrix->upper : matrix->lower) + BLOCK * b, turned);
    subtract_product(matrix->diagonal + BLOCK * column, matrix->lower + BLOCK * b, turned);
    if (matrix->upper) turn(matrix->lower + BLOCK * b, turned_lower);
    for (int64_t a = b + 1; a < last; a++) {
      const int64_t at = matrix->where[bodies->rows[a]];
      subtract_product(matrix->lower + BLOCK * at, matrix->lower + BLOCK * a, turned);
      if (matrix->upper) subtract_product(matrix->upper + BLOCK * at, matrix->upper + BLOCK * a, turned_lower);
    }
  }
}

POISE_WIDE int bodies_factor(const struct bodies *bodies, struct body_matrix *matrix) {
  for (int64_t k = 0; k < bodies->count; k++) {
    double *pivot = matrix->diagonal + BLOCK * k;
    int64_t *exchanges = matrix->exchanges + SIDE * k;
    const int status = matrix->upper ? factor_block(pivot, exchanges) : factor_symmetric_block(pivot);
    if (status) return status;
    for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++) {
      if (matrix->upper) {
        divide(matrix->lower + BLOCK * b, pivot, 0, 0);
        exchange_columns(matrix->upper + BLOCK * b, exchanges);
        divide(matrix->upper + BLOCK * b, pivot, 1, 1);
      } else
        divide(matrix->lower + BLOCK * b, pivot, 1, 0);
    }
    eliminate(bodies, matrix, k);
  }
  return POISE_OK;
}

/* out (6) -= a x */
static POISE_INLINE void subtract_applied(const double *restrict a, const double *restrict x, double *restrict out) {
  for (int i = 0; i < SIDE; i++) {
    const double *row = a + SIDE * i;
    out[i] -= (row[0] * x[0] + row[1] * x[1]) + (row[2] * x[2] + row[3] * x[3]) + (row[4] * x[4] + row[5] * x[5]);
  }
}

/* out (6) -= a^T x */
static POISE_INLINE void subtract_turned(const double *restrict a, const double *restrict x, double *restrict out) {
  for (int j = 0; j < SIDE; j++)
    for (int i = 0; i < SIDE; i++) out[i] -= a[SIDE * j + i] * x[j];
}

POISE_WIDE void bodies_solve(const struct bodies *bodies, const struct body_matrix *matrix, double *right) {
  const int plain = matrix->upper != NULL;
  for (int64_t k = 0; k < bodies->count; k++) {
    const double *pivot = matrix->diagonal + BLOCK * k;
    double *x = right + SIDE * k;
    for (int i = 0; i < SIDE && plain; i++) {
      const int64_t with = matrix->exchanges[SIDE * k + i];
      const double other = x[i];
      x[i] = x[with];
      x[with] = other;
    }
    for (int i = 0; i < SIDE; i++) {
      for (int j = 0; j < i; j++) x[i] -= pivot[SIDE * i + j] * x[j];
      if (!plain) x[i] /= pivot[SIDE * i + i];
    }
    for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++)
      subtract_applied(matrix->lower + BLOCK * b, x, right + SIDE * bodies->rows[b]);
  }
  for (int64_t k = bodies->count - 1; k >= 0; k--) {
    const double *pivot = matrix->diagonal + BLOCK * k;
    double *x = right + SIDE * k;
    for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++)
      subtract_turned((plain ? matrix->upper : matrix->lower) + BLOCK * b, right + SIDE * bodies->rows[b], x);
    for (int i = SIDE - 1; i >= 0; i--) {
      for (int j = i + 1; j < SIDE; j++) x[i] -= (plain ? pivot[SIDE * i + j] : pivot[SIDE * j + i]) * x[j];
      x[i] /= pivot[SIDE * i + i];
    }
  }
}
