/* Products with the rows of conic programs, and their factors, for cones.c, in parts of rows; see three_widths.h. */

/* A part of a row from `place`, of which there is no more from `end` on. */
static POISE_INLINE void NAMED(read_until)(const double *place, const double *end, part *row) {
  if (end - place >= EACH) {
    memcpy(row, place, sizeof *row);
    return;
  }
  double read[EACH] = {0.0};
  for (int i = 0; i < end - place; i++) read[i] = place[i];
  memcpy(row, read, sizeof read);
}

/* out (unknowns) += A' z */
static void NAMED(columns_of)(const struct solver *solver, const double *z, double *restrict out) {
  const struct cone_program *program = solver->program;
  const struct layout *at = &solver->at;
  const double *end = program->entries + at->entries;
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e];
    const double *entry = program->entries + at->entry[e];
    double *own = out + at->unknown[e], wrench[WIDTH];
    part sums[PARTS];
    memset(sums, 0, sizeof sums);
    for (int64_t row = at->row[e]; row < at->row[e + 1]; row++, entry += SIDE + locals) {
#pragma GCC unroll 4
      for (int p = 0; p < PARTS; p++) {
        part values;
        NAMED(read_until)(entry + EACH * p, end, &values);
        sums[p] += values * z[row];
      }
      for (int64_t i = 0; i < locals; i++) own[i] += entry[SIDE + i] * z[row];
    }
    memcpy(wrench, sums, sizeof wrench);
    add_wrench(&program->bodies, e, wrench, out);
  }
  for (int64_t i = 0; i < size_of(program); i++) out[i] += program->shared[i] * z[at->rows];
}

/* scaled (size, stride) = W^-1 of the rows (size, width) of a cone of eight, in whole vectors. */
static POISE_INLINE void NAMED(scale_rows)(const struct scaling *w, int64_t lane, const double *rows,
                                           const double *end, int64_t width, const int size, int64_t stride,
                                           double *scaled) {
  double inverse[WIDEST][WIDEST], v[WIDEST];
  const double scale = w->back[lane], share = size > 1 ? scale * w->share[lane] : 0.0;
  for (int i = 0; i < size; i++) v[i] = w->v[i][lane];
  for (int i = 1; i < size; i++) {
    for (int j = 1; j < size; j++) inverse[i][j] = share * v[i] * v[j] + (i == j ? scale : 0.0);
    inverse[i][0] = inverse[0][i] = -scale * v[i];
  }
  inverse[0][0] = size > 1 ? scale * v[0] : scale;
  for (int64_t begin = 0; begin < stride; begin += EACH) {
    part row[WIDEST];
    for (int i = 0; i < size; i++) NAMED(read_until)(rows + i * width + begin, end, row + i);
    for (int i = 0; i < size; i++) {
      part sum = inverse[i][0] * row[0];
      for (int j = 1; j < size; j++) sum += inverse[i][j] * row[j];
      memcpy(scaled + i * stride + begin, &sum, sizeof sum);
    }
  }
}

/* scaled (rows, stride) = W^-1 of the rows of a pair, whose cones come after `number` single ones, and wide ones. */
static POISE_INLINE int64_t NAMED(scale_pair)(struct solver *solver, int64_t e, int64_t number[2], int64_t stride) {
  const struct cone_program *program = solver->program;
  const double *entry = program->entries + solver->at.entry[e], *end = program->entries + solver->at.entries;
  const int64_t width = SIDE + program->locals[e];
  double *scaled = solver->scaled;
  int64_t rows = 0;
  for (int64_t c = 0; c < program->singles[e] + program->wides[e]; c++) {
    const int64_t high = c < program->singles[e] ? 1 : program->wide, cone = number[high > 1]++;
    const struct scaling *w = solver->scaling + cone / WIDTH;
    if (high == 1)
      NAMED(scale_rows)(w, cone % WIDTH, entry, end, width, 1, stride, scaled);
    else if (high == 3)
      NAMED(scale_rows)(w, cone % WIDTH, entry, end, width, 3, stride, scaled);
    else
      NAMED(scale_rows)(w, cone % WIDTH, entry, end, width, WIDEST, stride, scaled);
    entry += high * width;
    scaled += high * stride;
    rows += high;
  }
  return rows;
}

/* total (6) rows += sign times the sum of row' row over rows (count, stride). */
static POISE_INLINE void NAMED(add_squares)(const double *rows, int64_t count, int64_t stride, int taken,
                                            row_of_block *total) {
  for (int p = 0; p < PARTS; p++) {
    const double *place = rows;
    part sums[SIDE];
    for (int i = 0; i < SIDE; i++) sums[i] = ((const part *)(total + i))[p];
    for (int64_t r = 0; r < count; r++, place += stride) {
      part row;
      memcpy(&row, place + EACH * p, sizeof row);
      for (int i = 0; i < SIDE; i++) sums[i] = taken ? sums[i] - place[i] * row : sums[i] + place[i] * row;
    }
    for (int i = 0; i < SIDE; i++) ((part *)(total + i))[p] = sums[i];
  }
}

/* The stiffness of all pairs, from which what their locals take is taken. */
static int NAMED(add_pairs)(struct solver *solver) {
  const struct cone_program *program = solver->program;
  int64_t number[2] = {0, WIDTH * solver->at.single_eights};
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e], stride = in_vectors(SIDE + locals);
    row_of_block total[SIDE];
    memset(total, 0, sizeof total);
    const int64_t rows = NAMED(scale_pair)(solver, e, number, stride);
    NAMED(add_squares)(solver->scaled, rows, stride, 0, total);
    if (locals) {
      const double *taken = solver->squares + solver->at.square[e] + locals * locals;
      if (factor_locals(solver, e, rows, stride)) return POISE_NOT_POSITIVE;
      NAMED(add_squares)(taken, locals, SIDE, 1, total);
    }
    bodies_add(&program->bodies, &solver->matrix, e, total);
  }
  return POISE_OK;
}
