/* The rounds of one estimate; poise/inertia/bayes/search.py does the same with numpy, and says why. */
#ifndef POISE_SEARCH_H
#define POISE_SEARCH_H

#include "averaging.h"
#include "evidence.h"

enum { GROUPS = 2, DELAY = 3 }; /* force and torque; mean, standard deviation and log integral of a delay */

/* B blocks, L lags, H hypotheses about n states, C cases of the bias, F delays of the fine grid. Layout of `_Search` in
   poise/kernels/search.py. */
struct search {
  int64_t blocks, lags, hypotheses, cases, fine;
  double first_lag, lag_step, about, prior_spread, linear, angular;
  const struct mass_model *model;
  const double *moments, *counts;      /* (B, L, 19, 19) and (B, L) */
  const int64_t *sizes, *start, *end;  /* (B,) samples, and ns */
  const uint8_t *free;                 /* (B,) */
  const double *smooth, *beyond;       /* (F, L) and (F,) s from the middle of the lags */
  const double *variances, *entries;   /* (6,) of the sensor, and (6, 16, 13) */
  const double *to_sensor, *starts;    /* (10, 10) of phi, and (C, n) */
  const double *first_phi;             /* (10,) in the sensor frame */
  const double *state_variances, *bias_variances, *log_probability; /* (H, n), (C, 6) and (H,) */
  const int64_t *bias_case, *twins, *scouts;                        /* (H,), (H,) and (C,) */
  /* What is found: */
  int64_t remaining;                                     /* hypotheses */
  double *states;                                        /* (H, n), at first where to begin */
  int64_t *left;                                         /* (remaining,) which ones these are, of (H,) */
  double *log_weights;                                   /* (remaining,) of (H,) */
  double *unknowns, *covariance;                         /* (16,) and (16, 16) */
  uint8_t *keep;                                         /* (B,) */
  double *sample, *slow;                                 /* (2,) factors on the variances */
  double *delays, *drifts, *shares;                      /* (C, 3), (C, 16) and (C,) */
  double *at_delay;                                      /* (L,) weights of the lags */
  double *total, *residual, *information, *vector;       /* (L, 19, 19), (6, 6), (16, 16) and (16,) */
  double *surprise, *variance_ratio, *mean_ratio, *squares, *means; /* (B,), (B, 2) three times, (B, 6) */
};

/* Arrays inside a search; "scaled" is in normalised phi, in units of the guessed mass. */
struct rounds {
  double *memory;
  double back[PHI * PHI];                    /* from scaled to sensor */
  double *information, *vector;              /* (L, 16, 16) and (L, 16) at the lags */
  double *scaled_information, *scaled_vector;
  double *weights, *totals;                  /* (C, L) and (C, 19, 19) at the delay of a case */
  double *square, *linear;                   /* (C, 16, 16) and (C, 16), scaled */
  double *reduced, *pull;                    /* (C, 10, 10) and (C, 10), the bias taken out */
  double *bias_covariance, *bias_mean, *bias_slope, *bias_determinant;
  int64_t *open, n_open;                     /* hypotheses that the next round looks at */
  int64_t *which;                            /* (H,) case of each of these */
  double *states, *spreads;                  /* (H, n) of these */
  double *phi, *penalty, *determinant, *log, *answers, *in_sensor, *inner; /* (H, ...) of these */
  double *priors, *prior_means, *evidence, *steps; /* (C, 16, 16), (C, 16), (C, L) and (C, L, 16) */
  double *ratios;                            /* (B,) to sort */
};

/* In hypotheses.c: `ModelAverage`. */
int64_t find_delays(struct search *search, struct rounds *rounds, int first);
int64_t refine(struct search *search, struct rounds *rounds, double tolerance, int64_t most, double negligible);
/* Without a function for covariances, the mean alone. */
int64_t average(struct search *search, struct rounds *rounds, covariances_of covariances);

/* In residuals.c: `residuals`, and what `PosteriorSearch._judge` and `_allow_for_residuals` make of them. */
int64_t compare(struct search *search);
int judge(struct search *search, double *ratios);
int shown_noise(struct search *search);

#endif
