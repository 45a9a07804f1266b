/* Factors and solutions of bodies.c, with rows in parts; see three_widths.h. */

/* The diagonal block becomes its lower factor. */
static POISE_INLINE int NAMED(factor_symmetric_block)(row_of_block *a) {
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

static POISE_INLINE void NAMED(exchange)(row_of_block *one, row_of_block *other) {
  part *first = (part *)one, *second = (part *)other;
  for (int p = 0; p < PARTS; p++) {
    const part kept = first[p];
    first[p] = second[p];
    second[p] = kept;
  }
}

/* The diagonal block becomes L (with ones on the diagonal) and U, its rows exchanged as `exchanges` lists. */
static POISE_INLINE int NAMED(factor_block)(row_of_block *a, int64_t *exchanges) {
  for (int k = 0; k < SIDE; k++) {
    int best = k;
    for (int i = k + 1; i < SIDE; i++)
      if (fabs(a[i][k]) > fabs(a[best][k])) best = i;
    exchanges[k] = best;
    const double pivot = a[best][k];
    if (pivot == 0.0 || !isfinite(pivot)) return POISE_SINGULAR;
    NAMED(exchange)(a + k, a + best);
    for (int i = k + 1; i < SIDE; i++) {
      const double factor = a[i][k] / pivot;
      for (int j = k + 1; j < SIDE; j++) a[i][j] -= factor * a[k][j];
      a[i][k] = factor;
    }
  }
  return POISE_OK;
}

/* Rows of b become T^-1 b: T is the lower triangle of t, or if `turned`, the upper one transposed. `back`: one over
   each number on its diagonal; NULL: these are ones. */
static POISE_INLINE void NAMED(divide)(row_of_block *restrict b, const row_of_block *restrict t, int turned,
                                       const double *back) {
  for (int p = 0; p < PARTS; p++) {
    part *place = (part *)b + p, rows[SIDE];
    for (int j = 0; j < SIDE; j++) {
      rows[j] = place[PARTS * j];
      for (int k = 0; k < j; k++) rows[j] -= (turned ? t[k][j] : t[j][k]) * rows[k];
      if (back) rows[j] *= back[j];
    }
    for (int j = 0; j < SIDE; j++) place[PARTS * j] = rows[j];
  }
}

/* out -= sum of a^T b over the columns, where a is block number `left` below them and b number `right`. */
static POISE_INLINE void NAMED(take_one)(const struct columns *alike, const row_of_block *restrict a,
                                         const row_of_block *restrict b, int64_t left, int64_t right,
                                         row_of_block *restrict out) {
  for (int p = 0; p < PARTS; p++) {
    part *place = (part *)out + p, rows[SIDE];
    for (int i = 0; i < SIDE; i++) rows[i] = place[PARTS * i];
    for (int64_t c = 0; c < alike->count; c++) {
      const row_of_block *one = a + SIDE * (alike->blocks[c] + left);
      const part *other = (const part *)(b + SIDE * (alike->blocks[c] + right)) + p;
#pragma GCC unroll 1
      for (int k = 0; k < SIDE; k++)
        for (int i = 0; i < SIDE; i++) rows[i] -= one[k][i] * other[PARTS * k];
    }
    for (int i = 0; i < SIDE; i++) place[PARTS * i] = rows[i];
  }
}

/* The same of two blocks, with b number `right` and the one after it. */
static POISE_INLINE void NAMED(take_two)(const struct columns *alike, const row_of_block *restrict a,
                                         const row_of_block *restrict b, int64_t left, int64_t right,
                                         row_of_block *restrict out, row_of_block *restrict next) {
  for (int p = 0; p < PARTS; p++) {
    part *place[2] = {(part *)out + p, (part *)next + p}, rows[2][SIDE];
    for (int i = 0; i < SIDE; i++) {
      rows[0][i] = place[0][PARTS * i];
      rows[1][i] = place[1][PARTS * i];
    }
    for (int64_t c = 0; c < alike->count; c++) {
      const row_of_block *one = a + SIDE * (alike->blocks[c] + left);
      const part *other = (const part *)(b + SIDE * (alike->blocks[c] + right)) + p;
#pragma GCC unroll 1
      for (int k = 0; k < SIDE; k++) {
        const part here = other[PARTS * k], there = other[PARTS * (SIDE + k)];
        for (int i = 0; i < SIDE; i++) {
          rows[0][i] -= one[k][i] * here;
          rows[1][i] -= one[k][i] * there;
        }
      }
    }
    for (int i = 0; i < SIDE; i++) {
      place[0][PARTS * i] = rows[0][i];
      place[1][PARTS * i] = rows[1][i];
    }
  }
}

/* Take what columns contribute to blocks number `left` of their rows, with those after it, in `into`. */
static POISE_INLINE void NAMED(take_after)(const struct bodies *bodies, const int64_t *where,
                                           const struct columns *alike, const row_of_block *a, const row_of_block *b,
                                           int64_t left, row_of_block *into) {
  const int64_t *rows = bodies->rows + alike->blocks[0];
  int64_t right = left + 1;
  for (; right + 1 < alike->below; right += 2)
    NAMED(take_two)(alike, a, b, left, right, into + SIDE * where[rows[right]], into + SIDE * where[rows[right + 1]]);
  if (right < alike->below) NAMED(take_one)(alike, a, b, left, right, into + SIDE * where[rows[right]]);
}

/* Take what columns contribute from those after them; only from the first `most`. */
static POISE_INLINE void NAMED(eliminate)(const struct bodies *bodies, struct body_matrix *matrix,
                                          const struct columns *alike, int64_t most) {
  const row_of_block *right = matrix->upper ? matrix->upper : matrix->lower;
  for (int64_t left = 0; left < most; left++) {
    const int64_t column = bodies->rows[alike->blocks[0] + left];
    for (int64_t c = bodies->starts[column]; c < bodies->starts[column + 1]; c++) matrix->where[bodies->rows[c]] = c;
    NAMED(take_one)(alike, matrix->lower, right, left, left, matrix->diagonal + SIDE * column);
    NAMED(take_after)(bodies, matrix->where, alike, right, matrix->lower, left, matrix->lower);
    if (matrix->upper) NAMED(take_after)(bodies, matrix->where, alike, matrix->lower, right, left, matrix->upper);
  }
}

/* Factor the diagonal block of a column, and divide those below it. */
static POISE_INLINE int NAMED(factor_column)(const struct bodies *bodies, struct body_matrix *matrix, int64_t k) {
  row_of_block *pivot = matrix->diagonal + SIDE * k;
  int64_t *exchanges = matrix->exchanges + SIDE * k;
  const int status = matrix->upper ? NAMED(factor_block)(pivot, exchanges) : NAMED(factor_symmetric_block)(pivot);
  double back[SIDE];
  for (int i = 0; i < SIDE; i++) back[i] = 1.0 / pivot[i][i];
  for (int64_t b = bodies->starts[k]; !status && b < bodies->starts[k + 1]; b++) {
    if (matrix->upper) {
      row_of_block *above = matrix->upper + SIDE * b;
      for (int i = 0; i < SIDE; i++) NAMED(exchange)(above + i, above + exchanges[i]);
      NAMED(divide)(matrix->lower + SIDE * b, pivot, 1, back);
      NAMED(divide)(above, pivot, 0, NULL);
    } else
      NAMED(divide)(matrix->lower + SIDE * b, pivot, 0, back);
  }
  return status;
}

static int NAMED(bodies_factor)(const struct bodies *bodies, struct body_matrix *matrix) {
  for (int64_t k = 0; k < bodies->count;) {
    const struct columns alike = columns_from(bodies, k);
    for (const int64_t last = k + alike.count - 1; k <= last; k++) {
      const int status = NAMED(factor_column)(bodies, matrix, k);
      if (status) return status;
      const int64_t first = bodies->starts[k];
      const struct columns one = {.first = k, .count = 1, .blocks = {first}, .below = bodies->starts[k + 1] - first};
      NAMED(eliminate)(bodies, matrix, &one, last - k);
    }
    NAMED(eliminate)(bodies, matrix, &alike, alike.below);
  }
  return POISE_OK;
}

/* own (6) becomes what the factors of a diagonal block make of it on the way forwards. */
static POISE_INLINE void NAMED(forwards)(const row_of_block *pivot, const int64_t *exchanges, int plain, double *own) {
  for (int i = 0; i < SIDE && plain; i++) {
    const double other = own[i];
    own[i] = own[exchanges[i]];
    own[exchanges[i]] = other;
  }
  for (int i = 0; i < SIDE; i++) {
    for (int j = 0; j < i; j++) own[i] -= pivot[i][j] * own[j];
    if (!plain) own[i] /= pivot[i][i];
  }
}

/* taken (many, 6) rows: what blocks below a column contribute of the solutions x there. */
static POISE_INLINE void NAMED(take_solved)(const struct bodies *bodies, const row_of_block *right, int64_t k,
                                            const row_of_block *x, const int many, row_of_block *taken) {
  for (int p = 0; p < PARTS; p++) {
    part sums[2 * SIDE] = {{0.0}};
    for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++)
      for (int m = 0; m < many; m++) {
        const part there = ((const part *)(x + many * bodies->rows[b] + m))[p];
        for (int i = 0; i < SIDE; i++) sums[SIDE * m + i] += ((const part *)(right + SIDE * b + i))[p] * there;
      }
    for (int i = 0; i < SIDE * many; i++) ((part *)(taken + i))[p] = sums[i];
  }
}

/* x (count, many) becomes the solution, for 1 or 2 right sides. */
static POISE_INLINE void NAMED(solve_padded)(const struct bodies *bodies, const struct body_matrix *matrix,
                                             row_of_block *x, const int many) {
  const int plain = matrix->upper != NULL;
  const row_of_block *right = plain ? matrix->upper : matrix->lower;
  for (int64_t k = 0; k < bodies->count; k++)
    for (int m = 0; m < many; m++) {
      row_of_block *const place = x + many * k + m;
      double own[SIDE];
      for (int i = 0; i < SIDE; i++) own[i] = (*place)[i];
      NAMED(forwards)(matrix->diagonal + SIDE * k, matrix->exchanges + SIDE * k, plain, own);
      for (int i = 0; i < SIDE; i++) (*place)[i] = own[i];
      for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++) {
        const part *block = (const part *)(matrix->lower + SIDE * b);
        part *const there = (part *)(x + many * bodies->rows[b] + m);
        for (int p = 0; p < PARTS; p++) {
          const part *row = block + p;
          const part even = own[0] * row[0] + own[2] * row[2 * PARTS] + own[4] * row[4 * PARTS];
          const part odd = own[1] * row[PARTS] + own[3] * row[3 * PARTS] + own[5] * row[5 * PARTS];
          there[p] -= even + odd;
        }
      }
    }
  for (int64_t k = bodies->count - 1; k >= 0; k--) {
    const row_of_block *pivot = matrix->diagonal + SIDE * k;
    row_of_block taken[2 * SIDE];
    NAMED(take_solved)(bodies, right, k, x, many, taken);
    for (int m = 0; m < many; m++) {
      row_of_block *const place = x + many * k + m;
      double own[SIDE];
      for (int i = SIDE - 1; i >= 0; i--) {
        const row_of_block *row = taken + SIDE * m + i;
        own[i] = (*place)[i] - (((*row)[0] + (*row)[1]) + ((*row)[2] + (*row)[3]) + ((*row)[4] + (*row)[5]));
        for (int j = i + 1; j < SIDE; j++) own[i] -= (plain ? pivot[i][j] : pivot[j][i]) * own[j];
        own[i] /= pivot[i][i];
      }
      for (int i = 0; i < SIDE; i++) (*place)[i] = own[i];
    }
  }
}

static void NAMED(bodies_solve)(const struct bodies *bodies, const struct body_matrix *matrix, int many) {
  if (many == 2)
    NAMED(solve_padded)(bodies, matrix, matrix->right, 2);
  else
    NAMED(solve_padded)(bodies, matrix, matrix->right, 1);
}
