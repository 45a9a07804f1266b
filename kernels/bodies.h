/* Linear systems of pairs of bodies: blocks of 6 by 6, factored in an order and with a fill that Python has found. */
#ifndef POISE_BODIES_H
#define POISE_BODIES_H

#include <string.h>

#include "poise_kernels.h"

enum { SIDE = 6, WIDTH = 8, BEYOND = WIDTH - SIDE };

/* A row of a block, and `BEYOND` numbers more that nothing depends on: eight fill a wide vector. */
typedef double row_of_block __attribute__((vector_size(WIDTH * sizeof(double))));

/* The row at a place, with what is beyond it. */
static POISE_INLINE void read_row(const double *place, row_of_block *row) { memcpy(row, place, sizeof *row); }

/* Bodies are numbered in the order of elimination. Blocks below the diagonal are stored column after column. */
struct bodies {
  int64_t count, pairs, below;
  const int64_t *sides;  /* (pairs, 2) the bodies of each pair; -1: the ground, which does not move */
  const int64_t *starts; /* (count + 1) first block of each column below the diagonal */
  const int64_t *rows;   /* (below) row of each block, ascending in each column */
  const int64_t *place;  /* (pairs) block in which the bodies of a pair meet; -1 when one is the ground */
};

/* A matrix and its factors, which take its place: L transposed, and U where it is not symmetric. */
struct body_matrix {
  row_of_block *diagonal, *lower, *upper; /* (count), (below), (below) blocks; no upper where it is symmetric */
  row_of_block *right;                    /* (count, 2) scratch */
  int64_t *exchanges;                     /* (count, 6) of rows in the diagonal blocks */
  int64_t *where;                         /* (count) scratch */
};

/* Numbers of doubles and of integers that a matrix needs, and the matrix laid into them. */
int64_t bodies_room(const struct bodies *bodies, int symmetric);
struct body_matrix bodies_laid_out(const struct bodies *bodies, int symmetric, double *room, int64_t *whole);

void bodies_clear(const struct bodies *bodies, struct body_matrix *matrix, double on_diagonal);
/* The stiffness (6, 6) of a pair: it acts on the difference of the motions of both bodies. */
static POISE_INLINE void bodies_add(const struct bodies *bodies, struct body_matrix *matrix, int64_t pair,
                                    const row_of_block *stiffness) {
  const row_of_block within = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
  row_of_block rows[SIDE];
  for (int i = 0; i < SIDE; i++) rows[i] = stiffness[i] * within;
  for (int side = 0; side < 2; side++) {
    const int64_t body = bodies->sides[2 * pair + side];
    for (int i = 0; body >= 0 && i < SIDE; i++) matrix->diagonal[SIDE * body + i] += rows[i];
  }
  if (bodies->place[pair] < 0) return;
  row_of_block *below = matrix->lower + SIDE * bodies->place[pair];
  row_of_block *above = matrix->upper + SIDE * bodies->place[pair];
  for (int i = 0; i < SIDE; i++)
    if (matrix->upper) {
      above[i] -= rows[i];
      below[i] -= (row_of_block){rows[0][i], rows[1][i], rows[2][i], rows[3][i], rows[4][i], rows[5][i]};
    } else
      below[i] -= rows[i];
}
/* POISE_NOT_POSITIVE or POISE_SINGULAR when there are no factors. */
int bodies_factor(const struct bodies *bodies, struct body_matrix *matrix);
/* right (6 count), and another where there is one, become the solutions. */
void bodies_solve(const struct bodies *bodies, const struct body_matrix *matrix, double *right, double *other);

/* Motion (6) of the second body of a pair relative to the first, of motions (6 count). */
static inline void relative_motion(const struct bodies *bodies, int64_t pair, const double *motion, double *out) {
  const int64_t first = bodies->sides[2 * pair], second = bodies->sides[2 * pair + 1];
  for (int i = 0; i < SIDE; i++)
    out[i] = (second < 0 ? 0.0 : motion[SIDE * second + i]) - (first < 0 ? 0.0 : motion[SIDE * first + i]);
}

/* Add a wrench (6) on the second body of a pair, and its opposite on the first, to loads (6 count). */
static inline void add_wrench(const struct bodies *bodies, int64_t pair, const double *wrench, double *loads) {
  const int64_t first = bodies->sides[2 * pair], second = bodies->sides[2 * pair + 1];
  for (int i = 0; i < SIDE; i++) {
    if (first >= 0) loads[SIDE * first + i] -= wrench[i];
    if (second >= 0) loads[SIDE * second + i] += wrench[i];
  }
}

#endif
