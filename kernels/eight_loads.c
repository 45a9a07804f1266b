/* Conic programs for eight loads side by side: each lane computes in the order of operations of `solve_program`
   (cones.c), and of the factorisation in bodies.c, so that its answer is that of one load alone to the last bit. */
#include <stdlib.h>
#include <string.h>

#include "cones.h"

/* Row i of each vector has its component i for all eight loads. */
struct eight_loads {
  const struct cone_program *program;
  const struct layout *at;
  void *memory;
  row_of_block *diagonal, *lower; /* (count, 6, 6), (below, 6, 6): the upper blocks, which the factors take */
  struct scaling *scaling;        /* (cones), those of each pair in turn */
  row_of_block *squares, *scaled, *pulled, *room, *repaired_x, *repaired_z, *left_x, *left_z;
  row_of_block *x, *s, *z, *middle, *dx, *ds, *dz, *rest_x, *rest_z, *right, *aim, *q, *p;
  row_of_block *shared_weight, *denominator, *mu, *dual, *primal;
  row_of_block *fine; /* 1 in lanes in which nothing failed, otherwise 0 */
};

/* Room for all of them, laid out from `next`; returns where it ends. */
static row_of_block *lay_out(struct eight_loads *made, row_of_block *next) {
  const struct layout *at = made->at;
  const struct bodies *bodies = &made->program->bodies;
  const int64_t x = at->unknowns, z = at->rows + 1, block = SIDE * SIDE;
  struct {
    row_of_block **place;
    int64_t count;
  } all[] = {{&made->diagonal, block * bodies->count}, {&made->lower, block * bodies->below},
             {&made->squares, at->squares}, {&made->scaled, at->most_rows * (SIDE + at->most_locals)},
             {&made->pulled, x}, {&made->room, z}, {&made->repaired_x, x}, {&made->repaired_z, z}, {&made->left_x, x},
             {&made->left_z, z}, {&made->x, x}, {&made->s, z}, {&made->z, z}, {&made->middle, z}, {&made->dx, x},
             {&made->ds, z}, {&made->dz, z}, {&made->rest_x, x}, {&made->rest_z, z}, {&made->right, z},
             {&made->aim, z}, {&made->q, x}, {&made->p, x}, {&made->shared_weight, 1}, {&made->denominator, 1},
             {&made->mu, 1}, {&made->dual, 1}, {&made->primal, 1}, {&made->fine, 1}};
  for (size_t i = 0; i < sizeof all / sizeof *all; next += all[i++].count) *all[i].place = next;
  made->scaling = (struct scaling *)next;
  return next + at->cones * (int64_t)(sizeof(struct scaling) / sizeof *next);
}

void eight_loads_free(struct eight_loads *made) {
  if (!made) return;
  free(made->memory);
  free(made);
}

struct eight_loads *eight_loads_new(const struct cone_program *program, const struct layout *at) {
  struct eight_loads *made = calloc(1, sizeof *made);
  if (!made) return NULL;
  made->program = program;
  made->at = at;
  const uintptr_t size = sizeof(row_of_block);
  const uintptr_t total = (uintptr_t)lay_out(made, NULL);
  made->memory = calloc(total + size, 1);
  if (made->memory)
    lay_out(made, (row_of_block *)(((uintptr_t)made->memory + size - 1) / size * size));
  else {
    free(made);
    return NULL;
  }
  return made;
}

/* Call for each cone of pair e: `first`, its first row; `size`, a constant of each of three copies of `call`. */
#define CALL_CONES(made, e, first, size, call)                                                                    \
  for (int64_t first = (made)->at->row[e], c_ = -(made)->program->singles[e]; c_ < (made)->program->wides[e]; c_++) { \
    if (c_ < 0) {                                                                                                 \
      enum { size = 1 };                                                                                          \
      call;                                                                                                       \
      first += size;                                                                                              \
    } else if ((made)->program->wide == 3) {                                                                      \
      enum { size = 3 };                                                                                          \
      call;                                                                                                       \
      first += size;                                                                                              \
    } else {                                                                                                      \
      enum { size = WIDEST };                                                                                     \
      call;                                                                                                       \
      first += size;                                                                                              \
    }                                                                                                             \
  }

/* The same for the cones of all pairs, with the scaling `w` of each. */
#define CALL_SCALED(made, first, size, w, call)                          \
  {                                                                      \
    struct scaling *w = (made)->scaling;                                 \
    for (int64_t e_ = 0; e_ < (made)->program->bodies.pairs; e_++)       \
      CALL_CONES(made, e_, first, size, call; w++)                       \
  }

/* The motion of the second body of a pair relative to the first. */
static POISE_INLINE void motion_of(const struct bodies *bodies, int64_t e, const row_of_block *x, row_of_block *out) {
  const int64_t first = bodies->sides[2 * e], second = bodies->sides[2 * e + 1];
  const row_of_block none = {0.0};
  for (int i = 0; i < SIDE; i++)
    out[i] = (second < 0 ? none : x[SIDE * second + i]) - (first < 0 ? none : x[SIDE * first + i]);
}

static POISE_INLINE void add_wrenches(const struct bodies *bodies, int64_t e, const row_of_block *wrench,
                                      row_of_block *loads) {
  const int64_t first = bodies->sides[2 * e], second = bodies->sides[2 * e + 1];
  for (int i = 0; i < SIDE; i++) {
    if (first >= 0) loads[SIDE * first + i] -= wrench[i];
    if (second >= 0) loads[SIDE * second + i] += wrench[i];
  }
}

/* out (rows) = A x, the last row is the shared one */
POISE_WIDE static void rows_of(const struct eight_loads *made, const row_of_block *x, row_of_block *restrict out) {
  const struct cone_program *program = made->program;
  const struct layout *at = made->at;
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e];
    const double *entry = program->entries + at->entry[e];
    const row_of_block *own = x + at->unknown[e];
    row_of_block motion[SIDE];
    motion_of(&program->bodies, e, x, motion);
    for (int64_t row = at->row[e]; row < at->row[e + 1]; row++, entry += SIDE + locals) {
      row_of_block sum = {0.0};
      for (int i = 0; i < SIDE; i++) sum += entry[i] * motion[i];
      for (int64_t i = 0; i < locals; i++) sum += entry[SIDE + i] * own[i];
      out[row] = sum;
    }
  }
  row_of_block sum = {0.0};
  for (int64_t i = 0; i < size_of(program); i++) sum += program->shared[i] * x[i];
  out[at->rows] = sum;
}

/* out (unknowns) += A' z */
POISE_WIDE static void columns_of(const struct eight_loads *made, const row_of_block *z, row_of_block *restrict out) {
  const struct cone_program *program = made->program;
  const struct layout *at = made->at;
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e];
    const double *entry = program->entries + at->entry[e];
    row_of_block *own = out + at->unknown[e], wrench[SIDE] = {{0.0}};
    for (int64_t row = at->row[e]; row < at->row[e + 1]; row++, entry += SIDE + locals) {
      for (int i = 0; i < SIDE; i++) wrench[i] += entry[i] * z[row];
      for (int64_t i = 0; i < locals; i++) own[i] += entry[SIDE + i] * z[row];
    }
    add_wrenches(&program->bodies, e, wrench, out);
  }
  for (int64_t i = 0; i < size_of(program); i++) out[i] += program->shared[i] * z[at->rows];
}

/* scaled (size, width) = W^-1 of the rows (size, width) of a cone */
static POISE_INLINE void scale_rows(const struct scaling *w, const double *rows, int64_t width, const int size,
                                    row_of_block *scaled) {
  row_of_block inverse[WIDEST][WIDEST];
  const row_of_block share = w->back * w->share;
  for (int i = 1; i < size; i++) {
    for (int j = 1; j < size; j++) inverse[i][j] = share * w->v[i] * w->v[j] + (i == j ? w->back : (row_of_block){0.0});
    inverse[i][0] = inverse[0][i] = -w->back * w->v[i];
  }
  inverse[0][0] = size > 1 ? w->back * w->v[0] : w->back;
  for (int64_t column = 0; column < width; column++)
    for (int i = 0; i < size; i++) {
      row_of_block sum = inverse[i][0] * rows[column];
      for (int j = 1; j < size; j++) sum += inverse[i][j] * rows[j * width + column];
      scaled[i * width + column] = sum;
    }
}

/* The lower triangle (n, n) becomes its factor; `fine` is where there is one. */
static POISE_INLINE void factor_triangle(row_of_block *a, const int64_t n, row_of_block *fine) {
  for (int64_t j = 0; j < n; j++) {
    row_of_block sum = a[j * n + j];
    for (int64_t k = 0; k < j; k++) sum -= a[j * n + k] * a[j * n + k];
    only_positive(&sum, fine);
    take_roots(&sum);
    a[j * n + j] = sum;
    for (int64_t i = j + 1; i < n; i++) {
      row_of_block below = a[i * n + j];
      for (int64_t k = 0; k < j; k++) below -= a[i * n + k] * a[j * n + k];
      a[i * n + j] = below / sum;
    }
  }
}

/* Take what the locals of a pair contribute from `total`. */
static POISE_INLINE void eliminate_locals(struct eight_loads *made, int64_t e, int64_t locals,
                                          row_of_block total[SIDE][SIDE]) {
  const int64_t rows = made->at->row[e + 1] - made->at->row[e], width = SIDE + locals;
  row_of_block *square = made->squares + made->at->square[e], *taken = square + locals * locals;
  const row_of_block *scaled = made->scaled;
  memset(square, 0, sizeof *square * (size_t)(locals * width));
  for (int64_t r = 0; r < rows; r++, scaled += width)
    for (int64_t i = 0; i < locals; i++) {
      for (int64_t j = 0; j <= i; j++) square[i * locals + j] += scaled[SIDE + i] * scaled[SIDE + j];
      for (int j = 0; j < SIDE; j++) taken[i * SIDE + j] += scaled[SIDE + i] * scaled[j];
    }
  factor_triangle(square, locals, made->fine);
  for (int64_t i = 0; i < locals; i++)
    for (int j = 0; j < SIDE; j++) {
      row_of_block sum = taken[i * SIDE + j];
      for (int64_t k = 0; k < i; k++) sum -= square[i * locals + k] * taken[k * SIDE + j];
      taken[i * SIDE + j] = sum / square[i * locals + i];
    }
  for (int64_t k = 0; k < locals; k++)
    for (int i = 0; i < SIDE; i++)
      for (int j = 0; j <= i; j++) total[i][j] -= taken[k * SIDE + i] * taken[k * SIDE + j];
}

/* Add the stiffness of a pair, of which there is the lower triangle. */
static POISE_INLINE void add_pair(struct eight_loads *made, int64_t e, row_of_block total[SIDE][SIDE]) {
  const struct bodies *bodies = &made->program->bodies;
  for (int side = 0; side < 2; side++) {
    const int64_t body = bodies->sides[2 * e + side];
    if (body < 0) continue;
    row_of_block *block = made->diagonal + SIDE * SIDE * body;
    for (int i = 0; i < SIDE; i++)
      for (int j = 0; j <= i; j++) block[SIDE * i + j] += total[i][j];
  }
  if (bodies->place[e] < 0) return;
  row_of_block *block = made->lower + SIDE * SIDE * bodies->place[e];
  for (int i = 0; i < SIDE; i++)
    for (int j = 0; j < SIDE; j++) block[SIDE * i + j] -= j <= i ? total[i][j] : total[j][i];
}

/* Rows of b become L^-1 b. */
static POISE_INLINE void divide_block(row_of_block *restrict b, const row_of_block *restrict pivot) {
  const row_of_block one = (row_of_block){0.0} + 1.0;
  for (int j = 0; j < SIDE; j++) {
    const row_of_block back = one / pivot[SIDE * j + j];
    for (int c = 0; c < SIDE; c++) {
      row_of_block sum = b[SIDE * j + c];
      for (int k = 0; k < j; k++) sum -= pivot[SIDE * j + k] * b[SIDE * k + c];
      b[SIDE * j + c] = sum * back;
    }
  }
}

/* out -= a^T b; of a diagonal block only the lower triangle */
static POISE_INLINE void take_product(const row_of_block *restrict a, const row_of_block *restrict b,
                                      row_of_block *restrict out, const int triangle) {
  for (int i = 0; i < SIDE; i++)
    for (int j = 0; j < (triangle ? i + 1 : SIDE); j++) {
      row_of_block sum = out[SIDE * i + j];
      for (int k = 0; k < SIDE; k++) sum -= a[SIDE * k + i] * b[SIDE * k + j];
      out[SIDE * i + j] = sum;
    }
}

static POISE_INLINE void factor_bodies(struct eight_loads *made) {
  const struct bodies *bodies = &made->program->bodies;
  const int64_t block = SIDE * SIDE;
  for (int64_t k = 0; k < bodies->count; k++) {
    const int64_t from = bodies->starts[k], to = bodies->starts[k + 1];
    row_of_block *pivot = made->diagonal + block * k;
    factor_triangle(pivot, SIDE, made->fine);
    for (int64_t b = from; b < to; b++) divide_block(made->lower + block * b, pivot);
    for (int64_t left = from; left < to; left++) {
      const int64_t column = bodies->rows[left];
      const row_of_block *one = made->lower + block * left;
      take_product(one, one, made->diagonal + block * column, 1);
      int64_t place = bodies->starts[column];
      for (int64_t right = left + 1; right < to; right++) {
        while (bodies->rows[place] != bodies->rows[right]) place++; /* both ascend */
        take_product(one, made->lower + block * right, made->lower + block * place, 0);
      }
    }
  }
}

/* Factor A' W^-2 A; see `factor` in cones.c. */
POISE_WIDE static void factor(struct eight_loads *made) {
  const struct cone_program *program = made->program;
  const struct layout *at = made->at;
  const int64_t size = size_of(program), block = SIDE * SIDE;
  const struct scaling *w = made->scaling;
  memset(made->diagonal, 0, sizeof(row_of_block) * (size_t)(block * (program->bodies.count + program->bodies.below)));
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e], width = SIDE + locals;
    const double *entries = program->entries + at->entry[e];
    row_of_block total[SIDE][SIDE] = {{{0.0}}};
    CALL_CONES(made, e, first, high, const int64_t row = first - at->row[e];
               scale_rows(w++, entries + row * width, width, high, made->scaled + row * width))
    const row_of_block *scaled = made->scaled;
    for (int64_t r = at->row[e]; r < at->row[e + 1]; r++, scaled += width)
      for (int i = 0; i < SIDE; i++)
        for (int j = 0; j <= i; j++) total[i][j] += scaled[i] * scaled[j];
    if (locals) eliminate_locals(made, e, locals, total);
    add_pair(made, e, total);
  }
  const row_of_block none = {0.0}, one = none + 1.0;
  row_of_block largest = none;
  for (int64_t i = 0; i < size; i++) {
    const row_of_block on = made->diagonal[block * (i / SIDE) + (SIDE + 1) * (i % SIDE)];
    largest = CHOOSE(on > largest, on, largest);
  }
  const row_of_block least = 1e-3 * CHOOSE(largest < one, largest, one);
  for (int64_t i = 0; i < size; i++) {
    row_of_block *on = made->diagonal + block * (i / SIDE) + (SIDE + 1) * (i % SIDE);
    *on += ENOUGH_KEPT * (*on + least);
  }
  factor_bodies(made);
}

static POISE_INLINE void solve_bodies(const struct eight_loads *made, row_of_block *x) {
  const struct bodies *bodies = &made->program->bodies;
  const int64_t block = SIDE * SIDE;
  for (int64_t k = 0; k < bodies->count; k++) {
    const row_of_block *pivot = made->diagonal + block * k;
    row_of_block *own = x + SIDE * k;
    for (int i = 0; i < SIDE; i++) {
      for (int j = 0; j < i; j++) own[i] -= pivot[SIDE * i + j] * own[j];
      own[i] /= pivot[SIDE * i + i];
    }
    for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++) {
      const row_of_block *below = made->lower + block * b;
      row_of_block *there = x + SIDE * bodies->rows[b];
      for (int i = 0; i < SIDE; i++) {
        const row_of_block *a = below + i;
        const row_of_block even = own[0] * a[0] + own[2] * a[2 * SIDE] + own[4] * a[4 * SIDE];
        const row_of_block odd = own[1] * a[SIDE] + own[3] * a[3 * SIDE] + own[5] * a[5 * SIDE];
        there[i] -= even + odd;
      }
    }
  }
  for (int64_t k = bodies->count - 1; k >= 0; k--) {
    const row_of_block *pivot = made->diagonal + block * k;
    row_of_block *own = x + SIDE * k, taken[SIDE][SIDE] = {{{0.0}}};
    for (int64_t b = bodies->starts[k]; b < bodies->starts[k + 1]; b++)
      for (int i = 0; i < SIDE; i++)
        for (int c = 0; c < SIDE; c++)
          taken[i][c] += made->lower[block * b + SIDE * i + c] * x[SIDE * bodies->rows[b] + c];
    for (int i = SIDE - 1; i >= 0; i--) {
      const row_of_block *row = taken[i];
      own[i] = own[i] - ((row[0] + row[1]) + (row[2] + row[3]) + (row[4] + row[5]));
      for (int j = i + 1; j < SIDE; j++) own[i] -= pivot[SIDE * j + i] * own[j];
      own[i] /= pivot[SIDE * i + i];
    }
  }
}

/* x (unknowns) = (A' W^-2 A without the shared row)^-1 right, which is x before */
POISE_WIDE static void solve_without_shared(const struct eight_loads *made, row_of_block *x) {
  const struct cone_program *program = made->program;
  const struct layout *at = made->at;
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e];
    if (!locals) continue;
    const row_of_block *square = made->squares + at->square[e], *taken = square + locals * locals;
    row_of_block *own = x + at->unknown[e], wrench[SIDE] = {{0.0}};
    for (int64_t i = 0; i < locals; i++) {
      for (int64_t k = 0; k < i; k++) own[i] -= square[i * locals + k] * own[k];
      own[i] /= square[i * locals + i];
      for (int j = 0; j < SIDE; j++) wrench[j] -= taken[i * SIDE + j] * own[i];
    }
    add_wrenches(&program->bodies, e, wrench, x);
  }
  solve_bodies(made, x);
  for (int64_t e = 0; e < program->bodies.pairs; e++) {
    const int64_t locals = program->locals[e];
    if (!locals) continue;
    const row_of_block *square = made->squares + at->square[e], *taken = square + locals * locals;
    row_of_block *own = x + at->unknown[e], motion[SIDE];
    motion_of(&program->bodies, e, x, motion);
    for (int64_t i = 0; i < locals; i++)
      for (int j = 0; j < SIDE; j++) own[i] -= taken[i * SIDE + j] * motion[j];
    for (int64_t i = locals - 1; i >= 0; i--) {
      for (int64_t k = i + 1; k < locals; k++) own[i] -= square[k * locals + i] * own[k];
      own[i] /= square[i * locals + i];
    }
  }
}

/* Factor, and prepare what `solve_once` needs of the shared row. */
POISE_WIDE static void factor_with_shared(struct eight_loads *made) {
  const int64_t size = size_of(made->program);
  const row_of_block none = {0.0};
  const double *shared = made->program->shared;
  factor(made);
  for (int64_t i = 0; i < made->at->unknowns; i++) made->pulled[i] = i < size ? none + shared[i] : none;
  solve_without_shared(made, made->pulled);
  row_of_block sum = *made->shared_weight;
  for (int64_t i = 0; i < size; i++) sum += shared[i] * made->pulled[i];
  *made->denominator = sum;
  only_positive(&sum, made->fine);
}

static POISE_INLINE void square_in(const struct scaling *w, const row_of_block *u, const int size, const int inverse,
                                   row_of_block *out) {
  row_of_block there[WIDEST];
  apply_scaling(w, u, size, inverse, there);
  apply_scaling(w, there, size, inverse, out);
}

/* out = W^-2 (or W^2) u of all rows but the shared one */
POISE_WIDE static void apply_squares(const struct eight_loads *made, const row_of_block *u, int inverse,
                                     row_of_block *restrict out) {
  if (inverse) {
    CALL_SCALED(made, first, size, w, square_in(w, u + first, size, 1, out + first))
  } else {
    CALL_SCALED(made, first, size, w, square_in(w, u + first, size, 0, out + first))
  }
}

/* A' z = p, A x - W^2 z = r: x and z, without correction. */
POISE_WIDE static void solve_once(struct eight_loads *made, const row_of_block *p, const row_of_block *r,
                                  row_of_block *x, row_of_block *z) {
  const struct layout *at = made->at;
  apply_squares(made, r, 1, z);
  z[at->rows] = (row_of_block){0.0};
  memcpy(x, p, sizeof *x * (size_t)at->unknowns);
  columns_of(made, z, x);
  solve_without_shared(made, x);
  row_of_block sum = -r[at->rows];
  for (int64_t i = 0; i < size_of(made->program); i++) sum += made->program->shared[i] * x[i];
  const row_of_block zeta = sum / *made->denominator;
  for (int64_t i = 0; i < at->unknowns; i++) x[i] -= zeta * made->pulled[i];
  rows_of(made, x, made->room);
  for (int64_t i = 0; i < at->rows; i++) made->room[i] -= r[i];
  apply_squares(made, made->room, 1, z);
  z[at->rows] = zeta;
}

/* The same, then corrected once in lanes `where`. */
POISE_WIDE static void solve_corrected(struct eight_loads *made, const row_of_block *p, const row_of_block *r,
                                       row_of_block *x, row_of_block *z, const lanes_where *where) {
  const struct layout *at = made->at;
  solve_once(made, p, r, x, z);
  int any = 0;
  for (int l = 0; l < WIDTH; l++) any |= (*where)[l] != 0;
  if (!any) return;
  memcpy(made->left_x, p, sizeof *p * (size_t)at->unknowns);
  for (int64_t i = 0; i <= at->rows; i++) made->left_z[i] = -z[i];
  columns_of(made, made->left_z, made->left_x);
  rows_of(made, x, made->room);
  apply_squares(made, z, 0, made->left_z);
  made->left_z[at->rows] = *made->shared_weight * z[at->rows];
  for (int64_t i = 0; i <= at->rows; i++) made->left_z[i] += r[i] - made->room[i];
  solve_once(made, made->left_x, made->left_z, made->repaired_x, made->repaired_z);
  for (int64_t i = 0; i < at->unknowns; i++) x[i] = CHOOSE(*where, x[i] + made->repaired_x[i], x[i]);
  for (int64_t i = 0; i <= at->rows; i++) z[i] = CHOOSE(*where, z[i] + made->repaired_z[i], z[i]);
}

POISE_WIDE static void products(const row_of_block *u, const row_of_block *v, int64_t count, row_of_block *out) {
  row_of_block sum = {0.0};
  for (int64_t i = 0; i < count; i++) sum += u[i] * v[i];
  *out = sum;
}

POISE_WIDE static void largest_of(const row_of_block *u, int64_t count, row_of_block *out) {
  const row_of_block none = {0.0};
  row_of_block largest = none;
  for (int64_t i = 0; i < count; i++) {
    const row_of_block size = CHOOSE(u[i] < none, -u[i], u[i]);
    largest = CHOOSE(size > largest, size, largest);
  }
  *out = largest;
}

POISE_WIDE static void rescale(struct eight_loads *made) {
  const int64_t shared = made->at->rows;
  const row_of_block none = {0.0};
  row_of_block fine = *made->fine;
  CALL_SCALED(made, first, size, w, scale(made->s + first, made->z + first, size, w, made->middle + first, &fine))
  *made->shared_weight = none;
  if (!made->program->equal) {
    only_positive(made->s + shared, &fine);
    only_positive(made->z + shared, &fine);
    *made->shared_weight = made->s[shared] / made->z[shared];
  }
  *made->fine = fine;
}

/* What is left of the equations, and the mean of the products of slacks and multipliers. */
POISE_WIDE static void measure(struct eight_loads *made) {
  const struct layout *at = made->at;
  memcpy(made->rest_x, made->q, sizeof(row_of_block) * (size_t)at->unknowns);
  columns_of(made, made->z, made->rest_x);
  rows_of(made, made->x, made->rest_z);
  for (int64_t i = 0; i <= at->rows; i++) made->rest_z[i] += made->s[i];
  made->rest_z[at->rows] -= 1.0;
  products(made->s, made->z, at->rows + 1, made->mu);
  *made->mu /= (double)(at->cones + !made->program->equal);
  largest_of(made->rest_x, at->unknowns, made->dual);
  largest_of(made->rest_z, at->rows + 1, made->primal);
}

/* aim (size) of a cone; see `aim_at` in cones.c. */
static POISE_INLINE void aim_in(const struct scaling *w, struct eight_loads *made, int64_t first, const int size,
                                const row_of_block *centre, const int curved) {
  row_of_block aim[WIDEST], one[WIDEST], other[WIDEST], cross[WIDEST] = {{0.0}};
  jordan(made->middle + first, made->middle + first, size, aim);
  if (curved) {
    apply_scaling(w, made->ds + first, size, 1, one);
    apply_scaling(w, made->dz + first, size, 0, other);
    jordan(one, other, size, cross);
  }
  for (int i = 0; i < size; i++) aim[i] = -aim[i] - cross[i];
  aim[0] += *centre;
  for (int i = 0; i < size; i++) made->aim[first + i] = aim[i];
}

POISE_WIDE static void aim_at(struct eight_loads *made, const row_of_block *centre, int curved) {
  const int64_t shared = made->at->rows;
  if (curved) {
    CALL_SCALED(made, first, size, w, aim_in(w, made, first, size, centre, 1))
  } else {
    CALL_SCALED(made, first, size, w, aim_in(w, made, first, size, centre, 0))
  }
  if (made->program->equal) return;
  const row_of_block cross = curved ? made->ds[shared] * made->dz[shared] : (row_of_block){0.0};
  made->aim[shared] = *centre - made->s[shared] * made->z[shared] - cross;
}

/* The change of s in a cone that takes all of the aim. */
static POISE_INLINE void change_in(const struct scaling *w, struct eight_loads *made, int64_t first, const int size) {
  row_of_block there[WIDEST];
  divide(made->middle + first, made->aim + first, size, there);
  apply_scaling(w, there, size, 0, made->ds + first);
}

/* See `direction` in cones.c; corrected once in lanes `where`. */
POISE_WIDE static void direction(struct eight_loads *made, const row_of_block *kept, const lanes_where *where) {
  const int64_t shared = made->at->rows, unknowns = made->at->unknowns;
  const row_of_block none = {0.0};
  for (int64_t i = 0; i < unknowns; i++) made->p[i] = -*kept * made->rest_x[i];
  CALL_SCALED(made, first, size, w, change_in(w, made, first, size))
  made->ds[shared] = made->program->equal ? none : made->aim[shared] / made->z[shared];
  for (int64_t i = 0; i <= shared; i++) made->right[i] = -*kept * made->rest_z[i] - made->ds[i];
  solve_corrected(made, made->p, made->right, made->dx, made->dz, where);
  apply_squares(made, made->dz, 0, made->right);
  made->right[shared] = *made->shared_weight * made->dz[shared];
  for (int64_t i = 0; i <= shared; i++) made->ds[i] -= made->right[i];
  if (made->program->equal) made->ds[shared] = none;
}

/* The longest steps that keep u in its cones. */
POISE_WIDE static void longest(const struct eight_loads *made, const row_of_block *u, const row_of_block *du,
                               row_of_block *out) {
  const row_of_block none = {0.0}, on = u[made->at->rows], off = du[made->at->rows];
  row_of_block least = none + INFINITY;
  if (!made->program->equal) least = CHOOSE(off < none, -on / off, least);
  for (int64_t e = 0; e < made->program->bodies.pairs; e++)
    CALL_CONES(made, e, first, size, reach(u + first, du + first, size, &least))
  *out = least;
}

/* Where the steps so far along would lead: what would remain of the products of slacks and multipliers. */
POISE_WIDE static void products_after(const struct eight_loads *made, const row_of_block *far, const row_of_block *high,
                                      row_of_block *out) {
  row_of_block sum = {0.0};
  for (int64_t i = 0; i <= made->at->rows; i++)
    sum += (made->s[i] + *far * made->ds[i]) * (made->z[i] + *high * made->dz[i]);
  *out = sum / (*made->mu * (double)(made->at->cones + !made->program->equal));
}

POISE_WIDE static void step(struct eight_loads *made, const row_of_block *slacks, const row_of_block *multipliers) {
  for (int64_t i = 0; i < made->at->unknowns; i++) made->x[i] += *slacks * made->dx[i];
  for (int64_t i = 0; i <= made->at->rows; i++) {
    made->s[i] += *slacks * made->ds[i];
    made->z[i] += *multipliers * made->dz[i];
  }
}

static void spread(row_of_block *out, const double *from, int64_t count) {
  for (int64_t i = 0; i < count; i++) out[i] = (row_of_block){0.0} + from[i];
}

/* Let all lanes begin from the centre, with its factors and scaling. */
static void begin_at_centre(struct eight_loads *made, const struct solver *solver, const struct iterate *it) {
  const struct cone_program *program = made->program;
  const struct layout *at = made->at;
  const row_of_block none = {0.0};
  struct scaling *w = made->scaling;
  int64_t single = 0, wide = WIDTH * at->single_eights;
  for (int64_t e = 0; e < program->bodies.pairs; e++)
    for (int64_t c = 0; c < program->singles[e] + program->wides[e]; c++, w++) {
      const int64_t number = c < program->singles[e] ? single++ : wide++, lane = number % WIDTH;
      const struct scaling *from = solver->scaling + number / WIDTH;
      w->eta = none + from->eta[lane];
      w->back = none + from->back[lane];
      w->share = none + from->share[lane];
      for (int i = 0; i < WIDEST; i++) w->v[i] = none + from->v[i][lane];
    }
  for (int64_t i = 0; i < SIDE * program->bodies.count; i++)
    for (int j = 0; j < SIDE; j++) made->diagonal[SIDE * i + j] = none + solver->matrix.diagonal[i][j];
  for (int64_t i = 0; i < SIDE * program->bodies.below; i++)
    for (int j = 0; j < SIDE; j++) made->lower[SIDE * i + j] = none + solver->matrix.lower[i][j];
  spread(made->squares, solver->squares, at->squares);
  spread(made->pulled, solver->pulled, at->unknowns);
  spread(made->x, it->x, at->unknowns);
  spread(made->s, it->s, at->rows + 1);
  spread(made->z, it->z, at->rows + 1);
  spread(made->shared_weight, &solver->shared_weight, 1);
  spread(made->denominator, &solver->denominator, 1);
}

/* Leave the centre for the loads; see `leave_centre` in cones.c. */
static void leave_centre(struct eight_loads *made, const lanes_where *all) {
  const struct layout *at = made->at;
  row_of_block far;
  memset(made->right, 0, sizeof(row_of_block) * (size_t)(at->rows + 1));
  for (int64_t i = 0; i < at->unknowns; i++) made->p[i] = -made->q[i];
  solve_corrected(made, made->p, made->right, made->dx, made->dz, all);
  products(made->q, made->dx, at->unknowns, &far);
  for (int l = 0; l < WIDTH; l++) far[l] = sqrt(fmax(-far[l], 0.0)) / NEAR;
  for (int64_t i = 0; i <= at->rows; i++) made->z[i] = far * made->z[i] + made->dz[i];
}

/* Which lanes are still under way. */
struct lanes_left {
  int left, under_way[WIDTH];
  row_of_block size_q;
};

static void keep_answer(const struct eight_loads *made, int lane, double value, const struct cone_answers *answers) {
  const int64_t size = size_of(made->program), rows = made->at->rows + 1;
  answers->value[lane] = -value;
  answers->upper[lane] = made->z[rows - 1][lane];
  for (int64_t i = 0; i < size; i++) answers->motion[lane * size + i] = made->x[i][lane];
  for (int64_t i = 0; i < rows; i++) answers->multipliers[lane * rows + i] = made->z[i][lane];
  answers->outcome[lane] = SOLVED;
}

static void end_lane(struct lanes_left *lanes, int lane) {
  lanes->under_way[lane] = 0;
  lanes->left--;
}

/* End the lanes that are solved. */
static void judge(const struct eight_loads *made, const double *enough, struct lanes_left *lanes,
                  const struct cone_answers *answers) {
  const struct layout *at = made->at;
  row_of_block values, size_x;
  products(made->q, made->x, at->unknowns, &values);
  largest_of(made->x, at->unknowns, &size_x);
  for (int l = 0; l < WIDTH; l++) {
    if (!lanes->under_way[l]) continue;
    const double value = values[l], bound = made->z[at->rows][l], apart = fabs(value + bound);
    if (!isfinite((*made->mu)[l]))
      end_lane(lanes, l);
    else if ((*made->primal)[l] <= LEFT * (1.0 + size_x[l]) && (*made->dual)[l] <= LEFT * (1.0 + lanes->size_q[l]) &&
             (apart <= made->program->tolerance * fmax(1.0, fabs(value)) || bound <= enough[l])) {
      keep_answer(made, l, value, answers);
      end_lane(lanes, l);
    }
  }
}

/* One step in all lanes; ends those that are stuck. */
static void go_on(struct eight_loads *made, struct lanes_left *lanes, const struct cone_answers *answers) {
  const row_of_block none = {0.0}, one = none + 1.0;
  row_of_block far, high, after, centre, kept;
  lanes_where rounds = {0};
  *made->fine = one;
  rescale(made);
  factor_with_shared(made);
  aim_at(made, &none, 0);
  direction(made, &one, &rounds);
  longest(made, made->s, made->ds, &far);
  longest(made, made->z, made->dz, &high);
  for (int l = 0; l < WIDTH; l++) {
    far[l] = fmin(1.0, far[l]);
    high[l] = fmin(1.0, high[l]);
  }
  products_after(made, &far, &high, &after);
  for (int l = 0; l < WIDTH; l++) {
    const double left = fmin(1.0, fmax(after[l] * after[l] * after[l], 0.0));
    centre[l] = left * (*made->mu)[l];
    kept[l] = 1.0 - left;
    const int rounded = fmax((*made->primal)[l], (*made->dual)[l]) <= ROUNDED * (1.0 + lanes->size_q[l]);
    rounds[l] = lanes->under_way[l] && !rounded ? -1 : 0;
  }
  aim_at(made, &centre, 1);
  direction(made, &kept, &rounds);
  longest(made, made->s, made->ds, &far);
  longest(made, made->z, made->dz, &high);
  for (int l = 0; l < WIDTH; l++) {
    if (!lanes->under_way[l]) continue;
    if ((*made->fine)[l] > 0.0 && fmin(far[l], high[l]) > 1e-10)
      answers->steps[l]++;
    else
      end_lane(lanes, l);
    far[l] = fmin(1.0, SHORT * far[l]);
    high[l] = fmin(1.0, SHORT * high[l]);
  }
  step(made, &far, &high);
}

void eight_loads_solve(struct eight_loads *made, const struct solver *solver, const struct iterate *it, int64_t count,
                       const double *load, const double *enough, const struct cone_answers *answers) {
  const int64_t size = size_of(made->program);
  const lanes_where all = ~(lanes_where){0};
  struct lanes_left lanes = {.left = (int)count};
  begin_at_centre(made, solver, it);
  memset(made->q, 0, sizeof(row_of_block) * (size_t)made->at->unknowns);
  for (int l = 0; l < WIDTH; l++) {
    lanes.under_way[l] = l < count;
    for (int64_t i = 0; i < size; i++) made->q[i][l] = -load[(l < count ? l : 0) * size + i];
  }
  largest_of(made->q, made->at->unknowns, &lanes.size_q);
  leave_centre(made, &all);
  for (int number = 0; number < MOST_STEPS && lanes.left; number++) {
    measure(made);
    judge(made, enough, &lanes, answers);
    if (lanes.left) go_on(made, &lanes, answers);
  }
}
