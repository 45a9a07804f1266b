/* Linear systems of pairs of bodies: block Cholesky where they are symmetric, otherwise block LU with exchanges of rows
   within the diagonal blocks. All products are sums of rows: blocks of L are transposed for that. */
#include "bodies.h"

#include <math.h>
#include <string.h>

int64_t bodies_room(const struct bodies *bodies, int symmetric) {
  return WIDTH * (SIDE * (bodies->count + (symmetric ? 1 : 2) * bodies->below) + 2 * bodies->count + 1);
}

struct body_matrix bodies_laid_out(const struct bodies *bodies, int symmetric, double *room, int64_t *whole) {
  const uintptr_t size = sizeof(row_of_block), aligned = ((uintptr_t)room + size - 1) / size * size;
  struct body_matrix matrix = {.exchanges = whole, .where = whole + SIDE * bodies->count};
  matrix.diagonal = (row_of_block *)aligned;
  matrix.lower = matrix.diagonal + SIDE * bodies->count;
  matrix.right = matrix.lower + SIDE * bodies->below;
  if (!symmetric) {
    matrix.upper = matrix.right;
    matrix.right += SIDE * bodies->below;
  }
  return matrix;
}

void bodies_clear(const struct bodies *bodies, struct body_matrix *matrix, double on_diagonal) {
  const size_t block = SIDE * sizeof(row_of_block);
  memset(matrix->diagonal, 0, block * (size_t)bodies->count);
  memset(matrix->lower, 0, block * (size_t)bodies->below);
  if (matrix->upper) memset(matrix->upper, 0, block * (size_t)bodies->below);
  for (int64_t body = 0; body < bodies->count; body++)
    for (int i = 0; i < SIDE; i++) matrix->diagonal[SIDE * body + i][i] = on_diagonal;
}

/* The diagonal block becomes its lower factor. */
static POISE_INLINE int factor_symmetric_block(row_of_block *a) {
  for (int j = 0; j < SIDE; j++) {
    double sum = a[j][j];
    for (int k = 0; k < j; k++) sum -= a[j][k] * a[j][k];
    if (!(sum > 0.0)) return POISE_NOT_POSITIVE;
    const double pivot = sqrt(sum);
    a[j][j] = pivot;
    for (int i = j + 1; i < SIDE; i++) {
      double below = a[i][j];
      for (int k = 0; k < j; k++) below -= a[i][k] * a[j][k];
      a[i][j] = below / pivot;
    }
  }
  return POISE_OK;
}

/* The diagonal block becomes L (with ones on the diagonal) and U, its rows exchanged as `exchanges` lists. */
static POISE_INLINE int factor_block(row_of_block *a, int64_t *exchanges) {
  for (int k = 0; k < SIDE; k++) {
    int best = k;
    for (int i = k + 1; i < SIDE; i++)
      if (fabs(a[i][k]) > fabs(a[best][k])) best = i;
    exchanges[k] = best;
    const row_of_block pivot = a[best];
    if (pivot[k] == 0.0 || !isfinite(pivot[k])) return POISE_SINGULAR;
    a[best] = a[k];
    a[k] = pivot;
    row_of_block after = {0.0}; /* what is in column k and before it stays */
    for (int j = k + 1; j < SIDE; j++) after[j] = pivot[j];
    for (int i = k + 1; i < SIDE; i++) {
      const double factor = a[i][k] / pivot[k];
      row_of_block row = a[i] - factor * after;
      row[k] = factor;
      a[i] = row;
    }
  }
  return POISE_OK;
}

/* Rows of b become T^-1 b: T is the lower triangle of t, or if `turned`, the upper one transposed. `back`: one over
   each number on its diagonal; NULL: these are ones. */
static POISE_INLINE void divide(row_of_block *restrict b, const row_of_block *restrict t, int turned,
                                const double *back) {
  row_of_block rows[SIDE];
  for (int j = 0; j < SIDE; j++) {
    rows[j] = b[j];
    for (int k = 0; k < j; k++) rows[j] -= (turned ? t[k][j] : t[j][k]) * rows[k];
    if (back) rows[j] *= back[j];
  }
  for (int j = 0; j < SIDE; j++) b[j] = rows[j];
}

/* Columns one after the other that have the same blocks below the last of them: what they contribute to a block after
   them is taken at once, so that it is read and written once. */
enum { ALIKE = 8 };
struct columns {
  int64_t first, count;   /* of them */
  int64_t blocks[ALIKE];  /* of each the first block below the last column */
  int64_t below;          /* number of these blocks */
};

static struct columns columns_from(const struct bodies *bodies, int64_t k) {
  struct columns alike = {.first = k, .count = 1};
  const int64_t *starts = bodies->starts;
  for (int64_t last = k; alike.count < ALIKE && last + 1 < bodies->count; last++, alike.count++) {
    const int64_t below = starts[last + 1] - starts[last];
    if (!below || bodies->rows[starts[last]] != last + 1 || starts[last + 2] - starts[last + 1] != below - 1) break;
  }
  for (int64_t c = 0; c < alike.count; c++) alike.blocks[c] = starts[k + c] + alike.count - 1 - c;
  alike.below = starts[k + alike.count] - alike.blocks[alike.count - 1];
  return alike;
}

/* out -= sum of a^T b over the columns, where a is block number `left` below them and b number `right`. */
static POISE_INLINE void take_one(const struct columns *alike, const row_of_block *restrict a,
                                  const row_of_block *restrict b, int64_t left, int64_t right,
                                  row_of_block *restrict out) {
  row_of_block rows[SIDE];
  for (int i = 0; i < SIDE; i++) rows[i] = out[i];
  for (int64_t c = 0; c < alike->count; c++) {
    const row_of_block *one = a + SIDE * (alike->blocks[c] + left), *other = b + SIDE * (alike->blocks[c] + right);
#pragma GCC unroll 1
    for (int k = 0; k < SIDE; k++)
      for (int i = 0; i < SIDE; i++) rows[i] -= one[k][i] * other[k];
  }
  for (int i = 0; i < SIDE; i++) out[i] = rows[i];
}

/* The same of two blocks, with b number `right` and the one after it. */
static POISE_INLINE void take_two(const struct columns *alike, const row_of_block *restrict a,
                                  const row_of_block *restrict b, int64_t left, int64_t right,
                                  row_of_block *restrict out, row_of_block *restrict next) {
  row_of_block rows[2][SIDE];
  for (int i = 0; i < SIDE; i++) {
    rows[0][i] = out[i];
    rows[1][i] = next[i];
  }
  for (int64_t c = 0; c < alike->count; c++) {
    const row_of_block *one = a + SIDE * (alike->blocks[c] + left), *other = b + SIDE * (alike->blocks[c] + right);
#pragma GCC unroll 1
    for (int k = 0; k < SIDE; k++)
      for (int i = 0; i < SIDE; i++) {
        rows[0][i] -= one[k][i] * other[k];
        rows[1][i] -= one[k][i] * other[SIDE + k];
      }
  }
  for (int i = 0; i < SIDE; i++) {
    out[i] = rows[0][i];
    next[i] = rows[1][i];
  }
}

/* Take what columns contribute to blocks number `left` of their rows, with those after it, in `into`. */
static POISE_INLINE void take_after(const struct bodies *bodies, const int64_t *where, const struct columns *alike,
                                    const row_of_block *a, const row_of_block *b, int64_t left, row_of_block *into) {
  const int64_t *rows = bodies->rows + alike->blocks[0];
  int64_t right = left + 1;
  for (; right + 1 < alike->below; right += 2)
    take_two(alike, a, b, left, right, into + SIDE * where[rows[right]], into + SIDE * where[rows[right + 1]]);
  if (right < alike->below) take_one(alike, a, b, left, right, into + SIDE * where[rows[right]]);
}

/* Take what columns contribute from those after them; only from the first `most`. */
static POISE_INLINE void eliminate(const struct bodies *bodies, struct body_matrix *matrix, const struct columns *alike,
                                   int64_t most) {
  const row_of_block *right = matrix->upper ? matrix->upper : matrix->lower;
  for (int64_t left = 0; left < most; left++) {
    const int64_t column = bodies->rows[alike->blocks[0] + left];
    for (int64_t c = bodies->starts[column]; c < bodies->starts[column + 1]; c++) matrix->where[bodies->rows[c]] = c;
    take_one(alike, matrix->lower, right, left, left, matrix->diagonal + SIDE * column);
    take_after(bodies, matrix->where, alike, right, matrix->lower, left, matrix->lower);
    if (matrix->upper) take_after(bodies, matrix->where, alike, matrix->lower, right, left, matrix->upper);
  }
}

/* Factor the diagonal block of a column, and divide those below it. */
static POISE_INLINE int factor_column(const struct bodies *bodies, struct body_matrix *matrix, int64_t k) {
  row_of_block *pivot = matrix->diagonal + SIDE * k;
  int64_t *exchanges = matrix->exchanges + SIDE * k;
  const int status = matrix->upper ? factor_block(pivot, exchanges) : factor_symmetric_block(pivot);
  double back[SIDE];
  for (int i = 0; i < SIDE; i++) back[i] = 1.0 / pivot[i][i];
  for (int64_t b = bodies->starts[k]; !status && b < bodies->starts[k + 1]; b++) {
    if (matrix->upper) {
      row_of_block *above = matrix->upper + SIDE * b;
      for (int i = 0; i < SIDE; i++) {
        const row_of_block other = above[i];
        above[i] = above[exchanges[i]];
        above[exchanges[i]] = other;
      }
      divide(matrix->lower + SIDE * b, pivot, 1, back);
      divide(above, pivot, 0, NULL);
    } else
      divide(matrix->lower + SIDE * b, pivot, 0, back);
  }
  return status;
}

POISE_WIDE int bodies_factor(const struct bodies *bodies, struct body_matrix *matrix) {
  for (int64_t k = 0; k < bodies->count;) {
    const struct columns alike = columns_from(bodies, k);
    for (const int64_t last = k + alike.count - 1; k <= last; k++) {
      const int status = factor_column(bodies, matrix, k);
      if (status) return status;
      const int64_t first = bodies->starts[k];
      const struct columns one = {.first = k, .count = 1, .blocks = {first}, .below = bodies->starts[k + 1] - first};
      eliminate(bodies, matrix, &one, last - k);
    }
    eliminate(bodies, matrix, &alike, alike.below);
  }
  return POISE_OK;
}

/* x (count, many) becomes the solution, for 1 or 2 right sides. */
static POISE_INLINE void solve_padded(const struct bodies *bodies, const struct body_matrix *matrix, row_of_block *x,
                                      const int many) {
  const int plain = matrix->upper != NULL;
  const row_of_block *right = plain ? matrix->upper : matrix->lower;
  for (int64_t k = 0; k < bodies->count; k++) {
    const row_of_block *pivot = matrix->diagonal + SIDE * k;
    double own[2][SIDE];
    for (int m = 0; m < many; m++) {
      row_of_block *const place = x + many * k + m;
      for (int i = 0; i < SIDE; i++) own[m][i] = (*place)[i];
      for (int i = 0; i < SIDE && plain; i++) {
        const int64_t with = matrix->exchanges[SIDE * k + i];
        const double other = own[m][i];
        own[m][i] = own[m][with];
        own[m][with] = other;
      }
      for (int i = 0; i < SIDE; i++) {
        for (int j = 0; j < i; j++) own[m][i] -= pivot[i][j] * own[m][j];
        if (!plain) own[m][i] /= pivot[i][i];
      }
      for (int i = 0; i < SIDE; i++) (*place)[i] = own[m][i];
    }
    for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++) {
      const row_of_block *block = matrix->lower + SIDE * b;
      for (int m = 0; m < many; m++) {
        row_of_block *const there = x + many * bodies->rows[b] + m;
        const row_of_block even = own[m][0] * block[0] + own[m][2] * block[2] + own[m][4] * block[4];
        const row_of_block odd = own[m][1] * block[1] + own[m][3] * block[3] + own[m][5] * block[5];
        *there -= even + odd;
      }
    }
  }
  for (int64_t k = bodies->count - 1; k >= 0; k--) {
    const row_of_block *pivot = matrix->diagonal + SIDE * k;
    row_of_block taken[2][SIDE] = {{{0.0}}};
    for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++)
      for (int m = 0; m < many; m++)
        for (int i = 0; i < SIDE; i++) taken[m][i] += right[SIDE * b + i] * x[many * bodies->rows[b] + m];
    for (int m = 0; m < many; m++) {
      row_of_block *const place = x + many * k + m;
      double own[SIDE];
      for (int i = SIDE - 1; i >= 0; i--) {
        const row_of_block row = taken[m][i];
        own[i] = (*place)[i] - ((row[0] + row[1]) + (row[2] + row[3]) + (row[4] + row[5]));
        for (int j = i + 1; j < SIDE; j++) own[i] -= (plain ? pivot[i][j] : pivot[j][i]) * own[j];
        own[i] /= pivot[i][i];
      }
      for (int i = 0; i < SIDE; i++) (*place)[i] = own[i];
    }
  }
}

POISE_WIDE void bodies_solve(const struct bodies *bodies, const struct body_matrix *matrix, double *right,
                             double *other) {
  const int64_t many = other ? 2 : 1;
  double *rights[2] = {right, other};
  for (int64_t k = 0; k < bodies->count; k++)
    for (int64_t m = 0; m < many; m++) {
      row_of_block row = {0.0};
      for (int i = 0; i < SIDE; i++) row[i] = rights[m][SIDE * k + i];
      matrix->right[many * k + m] = row;
    }
  if (other)
    solve_padded(bodies, matrix, matrix->right, 2);
  else
    solve_padded(bodies, matrix, matrix->right, 1);
  for (int64_t k = 0; k < bodies->count; k++)
    for (int64_t m = 0; m < many; m++)
      for (int i = 0; i < SIDE; i++) rights[m][SIDE * k + i] = matrix->right[many * k + m][i];
}
