/* Conic programs over the motions of bodies in pairs: what one load and eight loads at a time have in common. */
#ifndef POISE_CONES_H
#define POISE_CONES_H

#include <math.h>

#include "eight_cones.h"

enum { MOST_STEPS = 60, SOLVED = 0, STUCK = 1 };
static const double SHORT = 0.99, ENOUGH_KEPT = 1e-13, LEFT = 1e-7, NEAR = 0.7, ROUNDED = 1e-11;

/* max w y, where the slacks -(rows of each pair) (relative motion, locals of the pair) are in cones, and for one row
   more, `shared` y <= 1, or = 1 if `equal`. Of each pair first the rows of cones of one, then of `wide` each. */
struct cone_program {
  struct bodies bodies;
  const int64_t *singles, *wides; /* (pairs) cones of one row, and of `wide` rows */
  const int64_t *locals;          /* (pairs) unknowns of the pair alone */
  int64_t wide, equal;
  const double *entries; /* of each pair, row after row: 6 for the motion, then the locals */
  const double *shared;  /* (6 count) */
  double tolerance;      /* of equations, and of the gap */
};

/* Where things of each pair begin. */
struct layout {
  int64_t *row, *unknown, *entry, *square, rows, unknowns, entries, squares, cones, most_rows, most_locals;
  int64_t *heads; /* (single_eights + wide_eights, 8) first row of each cone: eight of a size are computed at a time */
  int64_t single_eights, wide_eights;
};

struct solver {
  const struct cone_program *program;
  struct layout at;
  struct body_matrix matrix;
  struct scaling *scaling; /* of the eights */
  double *squares;  /* (M, M) factor of the locals, and (M, 6) what the locals take of the motion, of each pair */
  double *scaled;   /* rows of one pair in the scale of their cones */
  double *local;    /* (unknowns - 6 n) scratch */
  double *pulled;   /* (6 n + locals) what the shared row pulls */
  double *room, *repaired_x, *repaired_z, *rest_x, *rest_z;
  double shared_weight; /* 1 / W^2 of the shared row; 0 for an equation */
  double denominator;
};

/* min q x with A x + s = b: unknowns x, slacks s, multipliers z, and vectors of the step. */
struct iterate {
  double *x, *s, *z, *middle, *dx, *ds, *dz, *rest_x, *rest_z, *right, *aim, *q, *p;
  double mu, dual, primal;
};

/* The lesser and the larger of two; the second where the first is not a number. */
static POISE_INLINE double lesser(double a, double b) { return a < b ? a : b; }
static POISE_INLINE double larger(double a, double b) { return a > b ? a : b; }

static inline int64_t size_of(const struct cone_program *program) { return SIDE * program->bodies.count; }

/* What the answers of some loads are written to; see `poise_cones_solve`. */
struct cone_answers {
  double *value, *upper, *motion, *multipliers;
  int64_t *outcome, *steps;
};

/* Room to solve for eight loads at a time; NULL without memory. */
struct eight_loads *eight_loads_new(const struct cone_program *program, const struct layout *at);
void eight_loads_free(struct eight_loads *made);
/* Solve for up to eight loads (count, 6 n), each as one alone, from the centre that `it` and the factors are of. */
void eight_loads_solve(struct eight_loads *made, const struct solver *solver, const struct iterate *it, int64_t count,
                       const double *load, const double *enough, const struct cone_answers *answers);

#endif
