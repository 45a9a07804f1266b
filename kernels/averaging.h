/* Hypotheses about one mass model, each on its own; poise/inertia/bayes/averaging.py and curvature.py say why. `cases`
   (count,) says which of the `informations` (cases, 10, 10) and `vectors` (cases, 10) about phi a hypothesis has. */
#ifndef POISE_AVERAGING_H
#define POISE_AVERAGING_H

#include "mass.h"

/* States (count, n) under prior variances (count, n) become the most probable ones, with phi (count, 10), penalties
   (count,) and log determinants (count,) of 1 + C H. */
int64_t climb_all(const struct mass_model *model, int64_t count, double *states, const double *variances,
                  const int64_t *cases, const double *informations, const double *vectors, double tolerance,
                  int64_t most, double *phi, double *penalties, double *determinants);
/* (count, 10, 10) covariances of phi after the samples. */
typedef int64_t (*covariances_of)(const struct mass_model *model, int64_t count, const double *states,
                                  const double *variances, const int64_t *cases, const double *informations,
                                  double *covariances);
int64_t narrowed(const struct mass_model *model, int64_t count, const double *states, const double *variances,
                 const int64_t *cases, const double *informations, double *covariances); /* to first order */
int64_t curved(const struct mass_model *model, int64_t count, const double *states, const double *variances,
               const int64_t *cases, const double *informations, double *covariances); /* `curved_covariance` */
/* mean (10,) and covariance (10, 10) of phi before the samples, linearised about a state. */
int64_t prior_of(const struct mass_model *model, const double *state, const double *variances, double *mean,
                 double *covariance);

#endif
