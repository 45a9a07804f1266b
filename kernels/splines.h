/* Least-squares quintic splines on uniform knots: what poise/robot/splines.py does with numpy, which says why. */
#ifndef POISE_SPLINES_H
#define POISE_SPLINES_H

#include "poise_kernels.h"

enum { DEGREE = 5, ORDER = 6 };

/* Uniform knots, and the samples that they belong to. */
struct grid {
  double origin, spacing;
  int64_t intervals, size; /* size: coefficients of a spline */
  double basis[3][ORDER][ORDER]; /* polynomials of the B-splines and their derivatives */
};

/* Of a sample: its knot interval, and its weights in value and slope. */
struct design {
  int64_t start;
  double weights[2][ORDER];
};

/* One spline for each column, a multiple of four or a single one, with the band matrices that it follows from. Bands
   are (ORDER, size) in lower form. */
struct fit {
  struct grid grid;
  struct design *design; /* (count,); NULL in a fit of one column */
  int64_t columns;
  double *normal, *slope_band; /* of the values, with the ridge; of the slopes */
  double trace, slope_trace;   /* of both, without the ridge */
  double *coefficients;        /* (size, columns) */
  double *square_sum;          /* (columns,) */
  double degrees;              /* of freedom */
};

struct grid grid_across(const double *seconds, int64_t count, int64_t intervals);
int64_t locate(const struct grid *grid, double second, double *powers);
void weights_at(const struct grid *grid, int derivative, const double *powers, double *weights);

/* The factor of a band matrix that was scaled to a unit diagonal, (ORDER + 1, size): the last row is the scale. */
double *factorise(const double *band, int64_t size, int *status);
void solve_band(const double *factor, int64_t size, double *right, int64_t columns);

/* Values (count, columns) about their mean; NULL and a status when it cannot be done. */
struct fit *fit_values(const double *seconds, int64_t count, const double *values, int64_t columns, int64_t intervals,
                       int *status);
/* What slopes (count, columns) leave about a fit: gradient (size, columns) and square sums (columns,). */
int slope_sums(const struct fit *fit, int64_t count, const double *slopes, double *gradient, double *squares);
/* One column of a fit that also follows its slopes with a weight. */
struct fit *with_slopes(const struct fit *plain, int64_t column, const double *gradient, const double *squares,
                        double weight, int *status);
/* One column of a fit, as it is. */
struct fit *one_column(const struct fit *plain, int64_t column, int *status);
void free_fit(struct fit *fit);

double fit_sigma(const struct fit *fit, int64_t column);
double fit_score(const struct fit *fit, int64_t column);

/* (intervals, ORDER, ORDER) of the inverse of the normal matrix; NULL when it cannot be done. */
double *inverse_windows(const struct fit *fit, int *status);

#endif
