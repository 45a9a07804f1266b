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

#define POISE_TEMPLATE "bodies_parts.h"
#include "three_widths.h"

int bodies_factor(const struct bodies *bodies, struct body_matrix *matrix) {
  return FOR_WIDTH(bodies_factor, bodies, matrix);
}

void bodies_solve(const struct bodies *bodies, const struct body_matrix *matrix, double *right, double *other) {
  const int many = other ? 2 : 1;
  double *rights[2] = {right, other};
  for (int64_t k = 0; k < bodies->count; k++)
    for (int m = 0; m < many; m++) {
      double row[WIDTH] = {0.0};
      memcpy(row, rights[m] + SIDE * k, SIDE * sizeof(double));
      memcpy(matrix->right + many * k + m, row, sizeof row);
    }
  FOR_WIDTH(bodies_solve, bodies, matrix, many);
  for (int64_t k = 0; k < bodies->count; k++)
    for (int m = 0; m < many; m++) memcpy(rights[m] + SIDE * k, matrix->right + many * k + m, SIDE * sizeof(double));
}
