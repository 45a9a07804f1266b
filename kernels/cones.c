/* Conic programs over the motions of bodies in pairs: an interior-point method with one block factorisation a step, that
   begins at the analytic centre, which no load changes. Python: `ConicProgram` in poise/assembly/statics/solvers.py,
   which calls Clarabel. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cones.h"
#include "dense.h"

enum { CAREFUL_ROUNDS = 3, WORTHWHILE = 4, FEW_BODIES = 60 };
static const double CENTRED = 0.1;

/* Places without a cone in the last eight of a size repeat the last cone: what is computed again there is the same. */
static void lay_out_eights(const struct cone_program *program, struct layout *at) {
  int64_t *single = at->heads, *wide = at->heads + WIDTH * at->single_eights;
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    for (int64_t c = 0; c < program->singles[e]; c++) *single++ = at->row[e] + c;
    for (int64_t c = 0; c < program->wides[e]; c++) *wide++ = at->row[e] + program->singles[e] + program->wide * c;
  }
  for (; single < at->heads + WIDTH * at->single_eights; single++) *single = single[-1];
  for (; wide < at->heads + WIDTH * (at->single_eights + at->wide_eights); wide++) *wide = wide[-1];
}

static int lay_out(const struct cone_program *program, struct layout *at) {
  const int64_t pairs = program->bodies.pairs;
  int64_t singles = 0, wides = 0;
  memset(at, 0, sizeof *at);
  for (int64_t e = 0; e < pairs; e++) {
    singles += program->singles[e];
    wides += program->wides[e];
  }
  at->single_eights = (singles + WIDTH - 1) / WIDTH;
  at->wide_eights = (wides + WIDTH - 1) / WIDTH;
  const int64_t eights = at->single_eights + at->wide_eights;
  at->row = malloc(sizeof(int64_t) * (size_t)(4 * pairs + 4 + WIDTH * eights));
  if (!at->row) return POISE_NO_MEMORY;
  at->unknown = at->row + pairs + 1;
  at->entry = at->unknown + pairs + 1;
  at->square = at->entry + pairs + 1;
  at->heads = at->square + pairs + 1;
  at->unknowns = size_of(program);
  for (int64_t e = 0; e < pairs; e++) {
    const int64_t rows = program->singles[e] + program->wide * program->wides[e], locals = program->locals[e];
    at->row[e] = at->rows;
    at->unknown[e] = at->unknowns;
    at->entry[e] = at->entries;
    at->square[e] = at->squares;
    at->rows += rows;
    at->unknowns += locals;
    at->entries += rows * (SIDE + locals);
    at->squares += locals * (locals + SIDE);
    if (rows > at->most_rows) at->most_rows = rows;
    if (locals > at->most_locals) at->most_locals = locals;
  }
  at->row[pairs] = at->rows;
  at->unknown[pairs] = at->unknowns;
  at->cones = singles + wides;
  lay_out_eights(program, at);
  return POISE_OK;
}

/* out (rows) = A x, the last row is the shared one */
POISE_WIDE static void rows_of(const struct solver *solver, const double *x, double *restrict out) {
  const struct cone_program *program = solver->program;
  const struct layout *at = &solver->at;
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e];
    const double *entry = program->entries + at->entry[e], *own = x + at->unknown[e];
    double motion[SIDE];
    relative_motion(&program->bodies, e, x, motion);
    for (int64_t row = at->row[e]; row < at->row[e + 1]; row++, entry += SIDE + locals) {
      double sum = 0.0;
      for (int i = 0; i < SIDE; i++) sum += entry[i] * motion[i];
      for (int64_t i = 0; i < locals; i++) sum += entry[SIDE + i] * own[i];
      out[row] = sum;
    }
  }
  double sum = 0.0;
  for (int64_t i = 0; i < size_of(program); i++) sum += program->shared[i] * x[i];
  out[at->rows] = sum;
}

static int64_t in_vectors(int64_t width) { return (width + WIDTH - 1) / WIDTH * WIDTH; }

/* Factor the locals of a pair, whose rows are `scaled`, and what they take of its motion. */
static int factor_locals(const struct solver *solver, int64_t e, int64_t rows, int64_t stride) {
  const int64_t locals = solver->program->locals[e];
  double *square = solver->squares + solver->at.square[e], *taken = square + locals * locals;
  const double *scaled = solver->scaled;
  memset(square, 0, sizeof(double) * (size_t)(locals * (SIDE + locals)));
  for (int64_t r = 0; r < rows; r++, scaled += stride)
    for (int64_t i = 0; i < locals; i++) {
      const double value = scaled[SIDE + i];
      if (value == 0.0) continue;
      for (int64_t j = 0; j <= i; j++) square[i * locals + j] += value * scaled[SIDE + j];
      for (int j = 0; j < SIDE; j++) taken[i * SIDE + j] += value * scaled[j];
    }
  if (cholesky(square, locals)) return POISE_NOT_POSITIVE;
  for (int64_t i = 0; i < locals; i++) /* taken = L^-1 taken */
    for (int j = 0; j < SIDE; j++) {
      double sum = taken[i * SIDE + j];
      for (int64_t k = 0; k < i; k++) sum -= square[i * locals + k] * taken[k * SIDE + j];
      taken[i * SIDE + j] = sum / square[i * locals + i];
    }
  return POISE_OK;
}

#define POISE_TEMPLATE "cones_parts.h"
#include "three_widths.h"

static void columns_of(const struct solver *solver, const double *z, double *restrict out) {
  FOR_WIDTH(columns_of, solver, z, out);
}

/* Factor A' W^-2 A: the locals of each pair are eliminated, then the bodies. */
static int factor(struct solver *solver) {
  const int64_t size = size_of(solver->program);
  bodies_clear(&solver->program->bodies, &solver->matrix, 0.0);
  const int status = FOR_WIDTH(add_pairs, solver);
  if (status) return status;
  double largest = 0.0;
  for (int64_t i = 0; i < size; i++)
    largest = larger(solver->matrix.diagonal[i][i % SIDE], largest);
  for (int64_t i = 0; i < size; i++) { /* motions that no row feels */
    const double on = solver->matrix.diagonal[i][i % SIDE];
    solver->matrix.diagonal[i][i % SIDE] += ENOUGH_KEPT * (on + 1e-3 * lesser(largest, 1.0));
  }
  return bodies_factor(&solver->program->bodies, &solver->matrix);
}

/* Call for each cone of the program: `first` row, `size`, number. */
#define FOR_EACH_CONE(program, at, first, size, number)                                                     \
  for (int64_t e_ = 0, number = 0; e_ < (program)->bodies.pairs; e_++)                                      \
    for (int64_t c_ = 0, first = (at)->row[e_], size = 1; c_ < (program)->singles[e_] + (program)->wides[e_]; \
         first += size, c_++, number++)                                                                    \
      if ((size = c_ < (program)->singles[e_] ? 1 : (program)->wide) > 0)

/* Call for eight cones of a size at a time: `heads`, rows where they begin; `size`, a constant of each of three copies of
   `call`, a statement; number of the eight. */
#define CALL_EIGHTS(program, at, heads, size, number, call)                                  \
  for (int64_t number = 0; number < (at)->single_eights + (at)->wide_eights; number++) {     \
    const int64_t *heads = (at)->heads + WIDTH * number;                                    \
    if (number < (at)->single_eights) {                                                      \
      enum { size = 1 };                                                                     \
      call;                                                                                  \
    } else if ((program)->wide == 3) {                                                       \
      enum { size = 3 };                                                                     \
      call;                                                                                  \
    } else {                                                                                 \
      enum { size = WIDEST };                                                                \
      call;                                                                                  \
    }                                                                                        \
  }

static POISE_INLINE double edge(const double *u, int64_t size) { /* how far inside its cone u is */
  double square = 0.0;
  for (int64_t i = 1; i < size; i++) square += u[i] * u[i];
  return u[0] - sqrt(square);
}

/* x (unknowns) = (A' W^-2 A without the shared row)^-1 right, which is x before */
static void solve_without_shared(struct solver *solver, double *x) {
  const struct cone_program *program = solver->program;
  const struct layout *at = &solver->at;
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e];
    if (!locals) continue;
    const double *square = solver->squares + at->square[e], *taken = square + locals * locals;
    double *own = x + at->unknown[e], wrench[SIDE] = {0.0};
    for (int64_t i = 0; i < locals; i++) {
      for (int64_t k = 0; k < i; k++) own[i] -= square[i * locals + k] * own[k];
      own[i] /= square[i * locals + i];
      for (int j = 0; j < SIDE; j++) wrench[j] -= taken[i * SIDE + j] * own[i];
    }
    add_wrench(&program->bodies, e, wrench, x);
  }
  bodies_solve(&program->bodies, &solver->matrix, x, NULL);
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e];
    if (!locals) continue;
    const double *square = solver->squares + at->square[e], *taken = square + locals * locals;
    double *own = x + at->unknown[e], motion[SIDE];
    relative_motion(&program->bodies, e, x, motion);
    for (int64_t i = 0; i < locals; i++)
      for (int j = 0; j < SIDE; j++) own[i] -= taken[i * SIDE + j] * motion[j];
    for (int64_t i = locals - 1; i >= 0; i--) {
      for (int64_t k = i + 1; k < locals; k++) own[i] -= square[k * locals + i] * own[k];
      own[i] /= square[i * locals + i];
    }
  }
}

/* Prepare what `solve_once` needs of the shared row. */
static int factor_with_shared(struct solver *solver) {
  const int64_t size = size_of(solver->program);
  const int status = factor(solver);
  if (status) return status;
  memset(solver->pulled, 0, sizeof(double) * (size_t)solver->at.unknowns);
  memcpy(solver->pulled, solver->program->shared, sizeof(double) * (size_t)size);
  solve_without_shared(solver, solver->pulled);
  double sum = solver->shared_weight;
  for (int64_t i = 0; i < size; i++) sum += solver->program->shared[i] * solver->pulled[i];
  solver->denominator = sum;
  return sum > 0.0 ? POISE_OK : POISE_NOT_POSITIVE;
}

/* out = W^-2 (or W^2) u of all rows but the shared one */
static POISE_INLINE void square_in(const struct scaling *w, const double *u, const int64_t *heads, const int size,
                                   const int inverse, double *out) {
  row_of_block here[WIDEST], there[WIDEST];
  take(u, heads, size, here);
  apply_scaling(w, here, size, inverse, there);
  apply_scaling(w, there, size, inverse, here);
  put(here, heads, size, out);
}

POISE_WIDE static void apply_squares(const struct solver *solver, const double *u, int inverse, double *out) {
  if (inverse) {
    CALL_EIGHTS(solver->program, &solver->at, heads, size, number,
                square_in(solver->scaling + number, u, heads, size, 1, out))
  } else {
    CALL_EIGHTS(solver->program, &solver->at, heads, size, number,
                square_in(solver->scaling + number, u, heads, size, 0, out))
  }
}

/* A' z = p, A x - W^2 z = r: x and z, without correction. */
static void solve_once(struct solver *solver, const double *p, const double *r, double *x, double *z) {
  const struct layout *at = &solver->at;
  const int64_t size = size_of(solver->program);
  apply_squares(solver, r, 1, z);
  z[at->rows] = 0.0;
  memcpy(x, p, sizeof(double) * (size_t)at->unknowns);
  columns_of(solver, z, x);
  solve_without_shared(solver, x);
  /* shared x - weight zeta = r and (..) x + shared' zeta = ..: x -= pulled zeta */
  double sum = -r[at->rows];
  for (int64_t i = 0; i < size; i++) sum += solver->program->shared[i] * x[i];
  const double zeta = sum / solver->denominator;
  for (int64_t i = 0; i < at->unknowns; i++) x[i] -= zeta * solver->pulled[i];
  rows_of(solver, x, solver->room);
  for (int64_t i = 0; i < at->rows; i++) solver->room[i] -= r[i];
  apply_squares(solver, solver->room, 1, z);
  z[at->rows] = zeta;
}

/* The same, then what is left of the equations is solved for, in so many rounds. */
static void solve_corrected(struct solver *solver, const double *p, const double *r, double *x, double *z, int rounds) {
  const struct layout *at = &solver->at;
  solve_once(solver, p, r, x, z);
  for (int round = 0; round < rounds; round++) {
    memcpy(solver->rest_x, p, sizeof(double) * (size_t)at->unknowns);
    for (int64_t i = 0; i <= at->rows; i++) solver->rest_z[i] = -z[i];
    columns_of(solver, solver->rest_z, solver->rest_x);
    rows_of(solver, x, solver->room);
    apply_squares(solver, z, 0, solver->rest_z);
    solver->rest_z[at->rows] = solver->shared_weight * z[at->rows];
    for (int64_t i = 0; i <= at->rows; i++) solver->rest_z[i] += r[i] - solver->room[i];
    solve_once(solver, solver->rest_x, solver->rest_z, solver->repaired_x, solver->repaired_z);
    for (int64_t i = 0; i < at->unknowns; i++) x[i] += solver->repaired_x[i];
    for (int64_t i = 0; i <= at->rows; i++) z[i] += solver->repaired_z[i];
  }
}

/* Move u into its cones: as `conelp` of CVXOPT begins. */
static void into_cones(const struct solver *solver, double *u) {
  const int with_shared = !solver->program->equal;
  double least = with_shared ? u[solver->at.rows] : INFINITY;
  FOR_EACH_CONE(solver->program, &solver->at, first, size, number) {
    (void)number;
    least = lesser(edge(u + first, size), least);
  }
  const double more = least > 1e-8 ? 0.0 : 1.0 - least;
  FOR_EACH_CONE(solver->program, &solver->at, first, size, number) {
    (void)number;
    (void)size;
    u[first] += more;
  }
  if (with_shared) u[solver->at.rows] += more;
}

static double dot(const double *u, const double *v, int64_t count) {
  double sum = 0.0;
  for (int64_t i = 0; i < count; i++) sum += u[i] * v[i];
  return sum;
}

static double largest_of(const double *u, int64_t count) {
  double largest = 0.0;
  for (int64_t i = 0; i < count; i++) largest = larger(fabs(u[i]), largest);
  return largest;
}

static POISE_INLINE int scale_in(struct scaling *w, struct iterate *it, const int64_t *heads, const int size) {
  row_of_block s[WIDEST], z[WIDEST], middle[WIDEST];
  take(it->s, heads, size, s);
  take(it->z, heads, size, z);
  row_of_block inside = (row_of_block){0.0} + 1.0;
  scale(s, z, size, w, middle, &inside);
  if (!all_of(&inside)) return 0;
  put(middle, heads, size, it->middle);
  return 1;
}

/* Scale all cones; 0 when an iterate has left them. */
POISE_WIDE static int rescale(struct solver *solver, struct iterate *it) {
  const int64_t shared = solver->at.rows;
  CALL_EIGHTS(solver->program, &solver->at, heads, size, number,
              if (!scale_in(solver->scaling + number, it, heads, size)) return 0)
  if (solver->program->equal) {
    solver->shared_weight = 0.0;
    return 1;
  }
  if (!(it->s[shared] > 0.0 && it->z[shared] > 0.0)) return 0;
  solver->shared_weight = it->s[shared] / it->z[shared];
  it->middle[shared] = sqrt(it->s[shared] * it->z[shared]);
  return 1;
}

/* What is left of the equations, and the mean of the products of slacks and multipliers. */
static void measure(const struct solver *solver, struct iterate *it) {
  const struct layout *at = &solver->at;
  memcpy(it->rest_x, it->q, sizeof(double) * (size_t)at->unknowns);
  columns_of(solver, it->z, it->rest_x);
  rows_of(solver, it->x, it->rest_z);
  for (int64_t i = 0; i <= at->rows; i++) it->rest_z[i] += it->s[i];
  it->rest_z[at->rows] -= 1.0;
  it->mu = dot(it->s, it->z, at->rows + 1) / (double)(at->cones + !solver->program->equal);
  it->dual = largest_of(it->rest_x, at->unknowns);
  it->primal = largest_of(it->rest_z, at->rows + 1);
}

/* aim (size) of eight cones; see `aim_at`. */
static POISE_INLINE void aim_in(const struct scaling *w, struct iterate *it, const int64_t *heads, const int size,
                                double centre, int curved) {
  row_of_block middle[WIDEST], aim[WIDEST], change[WIDEST], one[WIDEST], other[WIDEST], cross[WIDEST] = {{0.0}};
  take(it->middle, heads, size, middle);
  jordan(middle, middle, size, aim);
  if (curved) {
    take(it->ds, heads, size, change);
    apply_scaling(w, change, size, 1, one);
    take(it->dz, heads, size, change);
    apply_scaling(w, change, size, 0, other);
    jordan(one, other, size, cross);
  }
  for (int i = 0; i < size; i++) aim[i] = -aim[i] - cross[i];
  aim[0] += centre;
  put(aim, heads, size, it->aim);
}

/* aim (rows) = centre - middle o middle, and if `curved`, - (scaled change of s) o (scaled change of z). */
POISE_WIDE static void aim_at(const struct solver *solver, struct iterate *it, double centre, int curved) {
  const int64_t shared = solver->at.rows;
  CALL_EIGHTS(solver->program, &solver->at, heads, size, number,
              aim_in(solver->scaling + number, it, heads, size, centre, curved))
  if (!solver->program->equal)
    it->aim[shared] = centre - it->s[shared] * it->z[shared] - (curved ? it->ds[shared] * it->dz[shared] : 0.0);
}

/* The change of s (size) in eight cones that takes all of the aim. */
static POISE_INLINE void change_in(const struct scaling *w, struct iterate *it, const int64_t *heads, const int size) {
  row_of_block middle[WIDEST], aim[WIDEST], there[WIDEST];
  take(it->middle, heads, size, middle);
  take(it->aim, heads, size, aim);
  divide(middle, aim, size, there);
  apply_scaling(w, there, size, 0, aim);
  put(aim, heads, size, it->ds);
}

POISE_WIDE static void change_to(const struct solver *solver, struct iterate *it) {
  CALL_EIGHTS(solver->program, &solver->at, heads, size, number,
              change_in(solver->scaling + number, it, heads, size))
}

/* The change for which (scaled change of s + that of z) o middle is the aim, and all but `kept` of the rest remains;
   corrected in so many rounds. */
static void direction(struct solver *solver, struct iterate *it, double kept, int rounds) {
  const struct layout *at = &solver->at;
  const int64_t shared = at->rows;
  for (int64_t i = 0; i < at->unknowns; i++) it->p[i] = -kept * it->rest_x[i];
  change_to(solver, it);
  it->ds[shared] = solver->program->equal ? 0.0 : it->aim[shared] / it->z[shared];
  for (int64_t i = 0; i <= at->rows; i++) it->right[i] = -kept * it->rest_z[i] - it->ds[i];
  solve_corrected(solver, it->p, it->right, it->dx, it->dz, rounds);
  apply_squares(solver, it->dz, 0, it->right);
  it->right[shared] = solver->shared_weight * it->dz[shared];
  for (int64_t i = 0; i <= at->rows; i++) it->ds[i] -= it->right[i];
  if (solver->program->equal) it->ds[shared] = 0.0;
}

/* Let `most` be no longer than the steps that keep u in eight cones. */
static POISE_INLINE void reach_in(const double *u, const double *du, const int64_t *heads, const int size,
                                  row_of_block *most) {
  row_of_block here[WIDEST], change[WIDEST];
  take(u, heads, size, here);
  take(du, heads, size, change);
  reach(here, change, size, most);
}

/* The longest step that keeps u in its cones. */
POISE_WIDE static double longest(const struct solver *solver, const double *u, const double *du) {
  const double on = u[solver->at.rows], off = du[solver->at.rows]; /* of the shared row */
  row_of_block least = (row_of_block){0.0} + (!solver->program->equal && off < 0.0 ? -on / off : INFINITY);
  CALL_EIGHTS(solver->program, &solver->at, heads, size, number, (void)number; reach_in(u, du, heads, size, &least))
  double shortest = least[0];
  for (int l = 1; l < WIDTH; l++) shortest = lesser(least[l], shortest);
  return shortest;
}

static void step(const struct solver *solver, struct iterate *it, double slacks, double multipliers) {
  for (int64_t i = 0; i < solver->at.unknowns; i++) it->x[i] += slacks * it->dx[i];
  for (int64_t i = 0; i <= solver->at.rows; i++) {
    it->s[i] += slacks * it->ds[i];
    it->z[i] += multipliers * it->dz[i];
  }
}

/* Let x, s and z be the analytic centre: the slacks whose product is largest, and z their inverses. Without one (there
   is no motion that opens everything, or no forces inside all cones), the least slacks and multipliers. Returns
   whether there is one, or a negative status. */
static int centre(struct solver *solver, struct iterate *it) {
  const struct layout *at = &solver->at;
  solver->shared_weight = !solver->program->equal;
  const row_of_block one = (row_of_block){0.0} + 1.0;
  for (int64_t eight = 0; eight < at->single_eights + at->wide_eights; eight++)
    solver->scaling[eight] = (struct scaling){.eta = one, .v = {one}, .back = one, .share = 0.5 * one};
  if (factor_with_shared(solver)) return -1;
  memset(it->p, 0, sizeof(double) * (size_t)at->unknowns);
  memset(it->right, 0, sizeof(double) * (size_t)(at->rows + 1));
  memset(it->z, 0, sizeof(double) * (size_t)(at->rows + 1));
  it->right[at->rows] = 1.0;
  solve_corrected(solver, it->p, it->right, it->x, it->s, 1);
  for (int64_t i = 0; i <= at->rows; i++) it->s[i] = -it->s[i];
  into_cones(solver, it->s);
  into_cones(solver, it->z);
  if (solver->program->equal) it->s[at->rows] = 0.0;
  for (int steps = 0; steps < MOST_STEPS; steps++) {
    measure(solver, it);
    if (!isfinite(it->mu) || !rescale(solver, it) || factor_with_shared(solver)) return 0;
    aim_at(solver, it, 1.0, 0);
    double apart = largest_of(it->aim, at->rows + !solver->program->equal);
    if (apart <= CENTRED && it->primal <= LEFT * 1e-2 && it->dual <= LEFT * 1e-2) return 1;
    direction(solver, it, 1.0, 1);
    const double along = fmin(longest(solver, it->s, it->ds), longest(solver, it->z, it->dz));
    step(solver, it, fmin(1.0, 0.9 * along), fmin(1.0, 0.9 * along));
    if (!(along > 1e-6)) return 0;
  }
  return 0;
}

/* Leave the centre for a load: the multipliers balance it, near the scaled ones of the centre. */
static void leave_centre(struct solver *solver, struct iterate *it, int central) {
  const struct layout *at = &solver->at;
  memset(it->right, 0, sizeof(double) * (size_t)(at->rows + 1));
  for (int64_t i = 0; i < at->unknowns; i++) it->p[i] = -it->q[i];
  solve_corrected(solver, it->p, it->right, it->dx, it->dz, 1);
  if (!central) {
    memcpy(it->z, it->dz, sizeof(double) * (size_t)(at->rows + 1));
    into_cones(solver, it->z);
    return;
  }
  const double far = sqrt(fmax(-dot(it->q, it->dx, at->unknowns), 0.0)) / NEAR;
  for (int64_t i = 0; i <= at->rows; i++) it->z[i] = far * it->z[i] + it->dz[i];
}

/* Solve for the load in `q`, from the centre that x, s, z and the factors are of, or until the most power is known to be
   at most `enough`. Every step is corrected if `careful`, otherwise only after one that left more than rounding: that
   takes less time, but near the end rounding of a single step may grow until no more is gained. Returns SOLVED or
   STUCK. */
static int solve_program(struct solver *solver, struct iterate *it, int central, int careful, double enough,
                         int64_t *steps) {
  const struct layout *at = &solver->at;
  const double tolerance = solver->program->tolerance, size_q = largest_of(it->q, at->unknowns);
  leave_centre(solver, it, central);
  for (int number = 0; number < MOST_STEPS; number++, ++*steps) {
    measure(solver, it);
    const double value = dot(it->q, it->x, at->unknowns), apart = fabs(value + it->z[at->rows]);
    if (!isfinite(it->mu)) return STUCK;
    if (it->primal <= LEFT * (1.0 + largest_of(it->x, at->unknowns)) && it->dual <= LEFT * (1.0 + size_q) &&
        (apart <= tolerance * fmax(1.0, fabs(value)) || it->z[at->rows] <= enough))
      return SOLVED;
    if (!rescale(solver, it) || factor_with_shared(solver)) return STUCK;
    aim_at(solver, it, 0.0, 0);
    direction(solver, it, 1.0, 0);
    const double far = fmin(1.0, longest(solver, it->s, it->ds)), high = fmin(1.0, longest(solver, it->z, it->dz));
    double after = 0.0;
    for (int64_t i = 0; i <= at->rows; i++) after += (it->s[i] + far * it->ds[i]) * (it->z[i] + high * it->dz[i]);
    after /= it->mu * (double)(at->cones + !solver->program->equal);
    const double left = fmin(1.0, fmax(after * after * after, 0.0));
    aim_at(solver, it, left * it->mu, 1);
    const int rounded = fmax(it->primal, it->dual) <= ROUNDED * (1.0 + size_q);
    direction(solver, it, 1.0 - left, careful ? CAREFUL_ROUNDS : !rounded);
    const double slacks = longest(solver, it->s, it->ds), multipliers = longest(solver, it->z, it->dz);
    if (!(fmin(slacks, multipliers) > 1e-10)) return STUCK;
    step(solver, it, fmin(1.0, SHORT * slacks), fmin(1.0, SHORT * multipliers));
  }
  return STUCK;
}

/* One room for all vectors; what the centre has comes first, its numbers in `kept`. */
static double *prepare(const struct cone_program *program, struct solver *solver, struct iterate *it, int64_t *whole,
                       int64_t *kept) {
  const struct layout *at = &solver->at;
  const int64_t x = at->unknowns, z = at->rows + 1, body_room = bodies_room(&program->bodies, 1);
  const int64_t eights = at->single_eights + at->wide_eights;
  const int64_t scalings = (int64_t)(sizeof(struct scaling) / sizeof(double)) * eights + WIDTH;
  const int64_t scaled = at->most_rows * in_vectors(SIDE + at->most_locals);
  *kept = body_room + at->squares + BEYOND + scalings + 2 * x + 3 * z;
  const int64_t total = *kept + scaled + 6 * x + 9 * z;
  double *room = calloc((size_t)total, sizeof(double)), *next = room;
  if (!room) return NULL;
#define TAKE(name, count) (name) = next, next += (count)
  solver->matrix = bodies_laid_out(&program->bodies, 1, next, whole);
  next += body_room;
  TAKE(solver->squares, at->squares + BEYOND);
  const uintptr_t vector = sizeof(row_of_block);
  solver->scaling = (struct scaling *)(((uintptr_t)next + vector - 1) / vector * vector), next += scalings;
  TAKE(solver->pulled, x);
  TAKE(it->x, x);
  TAKE(it->s, z);
  TAKE(it->z, z);
  TAKE(it->middle, z);
  TAKE(solver->scaled, scaled);
  TAKE(solver->repaired_x, x);
  TAKE(solver->rest_x, x);
  TAKE(it->dx, x);
  TAKE(it->rest_x, x);
  TAKE(it->q, x);
  TAKE(it->p, x);
  TAKE(solver->room, z);
  TAKE(solver->repaired_z, z);
  TAKE(solver->rest_z, z);
  TAKE(it->ds, z);
  TAKE(it->dz, z);
  TAKE(it->rest_z, z);
  TAKE(it->right, z);
  TAKE(it->aim, z);
#undef TAKE
  return room;
}

struct cone_solver {
  struct solver solver;
  struct iterate iterate;
  double *room, *begun; /* all vectors, and those of the centre */
  int64_t *whole, kept;
  double weight, denominator;
  int central;
  struct eight_loads *eight; /* made when it is first needed */
};

POISE_EXPORT void poise_cones_free(struct cone_solver *made) {
  if (!made) return;
  eight_loads_free(made->eight);
  free(made->begun);
  free(made->room);
  free(made->whole);
  free(made->solver.at.row);
  free(made);
}

/* Keep the centre that has been found, with its factors. */
static void keep_centre(struct cone_solver *made) {
  memcpy(made->begun, made->room, sizeof(double) * (size_t)made->kept);
  made->weight = made->solver.shared_weight;
  made->denominator = made->solver.denominator;
}

/* The centre of a program, to begin from; NULL without memory. The program stays where it is. */
POISE_EXPORT struct cone_solver *poise_cones_new(const struct cone_program *program) {
  struct cone_solver *made = calloc(1, sizeof *made);
  if (!made) return NULL;
  made->solver.program = program;
  made->whole = malloc(sizeof(int64_t) * (size_t)(7 * program->bodies.count));
  if (made->whole && !lay_out(program, &made->solver.at))
    made->room = prepare(program, &made->solver, &made->iterate, made->whole, &made->kept);
  if (made->room) made->begun = malloc(sizeof(double) * (size_t)made->kept);
  if (!made->begun) {
    poise_cones_free(made);
    return NULL;
  }
  made->central = centre(&made->solver, &made->iterate);
  keep_centre(made);
  return made;
}

/* After a change of the entries: the motion of the old centre will do while its slacks are inside their cones. */
POISE_EXPORT void poise_cones_renew(struct cone_solver *made) {
  struct solver *solver = &made->solver;
  struct iterate *it = &made->iterate;
  int inside = made->central > 0;
  if (inside) {
    memcpy(made->room, made->begun, sizeof(double) * (size_t)made->kept);
    rows_of(solver, it->x, it->s);
    for (int64_t i = 0; i <= solver->at.rows; i++) it->s[i] = -it->s[i];
    it->s[solver->at.rows] += 1.0;
    inside = rescale(solver, it) && !factor_with_shared(solver);
  }
  if (!inside) made->central = centre(solver, it);
  keep_centre(made);
}

/* Begin at the centre that is kept. */
static void begin(struct cone_solver *made) {
  memcpy(made->room, made->begun, sizeof(double) * (size_t)made->kept);
  made->solver.shared_weight = made->weight;
  made->solver.denominator = made->denominator;
}

/* Where the answers of the loads from number q on are written to. */
static struct cone_answers answers_from(const struct cone_solver *made, const struct cone_answers *all, int64_t q) {
  const int64_t size = size_of(made->solver.program), rows = made->solver.at.rows + 1;
  return (struct cone_answers){all->value + q,   all->upper + q, all->motion + q * size, all->multipliers + q * rows,
                               all->outcome + q, all->steps + q};
}

/* Solve for loads eight at a time, as far as that takes less time than one by one. */
static void solve_eights(struct cone_solver *made, int64_t loads, const double *load, const double *enough,
                         const struct cone_answers *all) {
  const struct cone_program *program = made->solver.program;
  if (made->central <= 0 || loads < WORTHWHILE || program->bodies.count > FEW_BODIES) return;
  if (!made->eight) made->eight = eight_loads_new(program, &made->solver.at);
  if (!made->eight) return;
  begin(made);
  for (int64_t q = 0; q + WORTHWHILE <= loads; q += WIDTH) {
    const struct cone_answers answers = answers_from(made, all, q);
    const int64_t count = loads - q < WIDTH ? loads - q : WIDTH;
    eight_loads_solve(made->eight, &made->solver, &made->iterate, count, load + q * size_of(program), enough + q,
                      &answers);
  }
}

/* For each load (loads, 6 n): the most of w y, what the multipliers prove that it is at most, y (6 n), and the
   multipliers (rows + 1, the shared row last). Where that is at most `enough` (loads), they need not be any closer.
   `outcome` (loads) is 0 where it was found; other answers are of no use. */
POISE_EXPORT void poise_cones_solve(struct cone_solver *made, int64_t loads, const double *load, const double *enough,
                                    double *value, double *upper, double *motion, double *multipliers,
                                    int64_t *outcome, int64_t *steps) {
  struct solver *solver = &made->solver;
  struct iterate *it = &made->iterate;
  const int64_t size = size_of(solver->program), rows = solver->at.rows + 1;
  const struct cone_answers answers = {value, upper, motion, multipliers, outcome, steps};
  for (int64_t q = 0; q < loads; q++) {
    outcome[q] = STUCK;
    steps[q] = 0;
  }
  solve_eights(made, loads, load, enough, &answers);
  for (int64_t q = 0; q < loads && made->central >= 0; q++) {
    if (outcome[q] == SOLVED) continue;
    for (int careful = steps[q] > 0; careful < 2 && outcome[q] == STUCK; careful++) {
      begin(made);
      for (int64_t i = 0; i < size; i++) it->q[i] = -load[q * size + i];
      outcome[q] = solve_program(solver, it, made->central, careful, enough[q], steps + q);
    }
    value[q] = -dot(it->q, it->x, solver->at.unknowns);
    upper[q] = it->z[rows - 1];
    memcpy(motion + q * size, it->x, sizeof(double) * (size_t)size);
    memcpy(multipliers + q * rows, it->z, sizeof(double) * (size_t)rows);
  }
}
