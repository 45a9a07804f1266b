/* Likelihoods from normal equations and sums over samples, see evidence.c. `entries` (6, 16, 13): the design by signals,
   which is sparse. */
#ifndef POISE_EVIDENCE_H
#define POISE_EVIDENCE_H

#include "mass.h"

enum { UNKNOWNS = 16, CHANNELS = 6, BIAS = 6, MOTION = 13, SIGNALS = 19 };

/* Log evidence (cases, lags) and the steps (cases, lags, 16) from means (cases, 16) under priors (cases, 16, 16), for
   normal equations (lags, 16, 16) and (lags, 16). */
int64_t evidence_at(int64_t cases, int64_t lags, const double *informations, const double *vectors,
                    const double *priors, const double *means, double *log, double *steps);
/* (6, 6) covariance of a residual; `variances` (6,) of the sensor, `motion` (2,) deviations of the accelerations. */
void covariance_of(const double *phi, const double *variances, const double *motion, double *out);
/* (6, 19): residual = rows times signals, of unknowns (16,). */
void residual_rows(const double *unknowns, const double *entries, double *rows);
/* (6, 6) sum of r r^T and (6,) sum of r of the residuals r of sums (19, 19). */
void residual_sums(const double *moments, const double *rows, double *second, double *first);
/* (count,) log likelihood of unknowns (count, 16) by sums (cases, 19, 19). */
int64_t log_likelihoods(int64_t count, const double *moments, const int64_t *cases, const double *unknowns,
                        const double *entries, const double *variances, const double *motion, double *log);
/* The bias integrated out of normal equations (cases, 16, 16) and (cases, 16) with prior variances (cases, 6): all that
   `WithoutBias` holds. */
int64_t without_bias(int64_t cases, const double *informations, const double *vectors, const double *variances,
                     double *information, double *vector, double *covariance, double *mean, double *slope,
                     double *determinants);
/* Normal equations (count, 16, 16) and (count, 16) of sums (count, 19, 19), weighed by a covariance (6, 6).
   `counts` (count,) samples; `variance` of the angular accelerations. */
POISE_EXPORT int64_t poise_normal_equations(int64_t count, const double *moments, const double *counts,
                                            const double *covariance, double variance, const double *entries,
                                            double *informations, double *vectors);

#endif
