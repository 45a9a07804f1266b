/* Likelihoods from normal equations and sums over samples; in Python: ModelAverage.along, WithoutBias,
   log_likelihood, residual_moments, normal_equations. */
#include <math.h>
#include <string.h>

#include "dense.h"
#include "evidence.h"

int64_t evidence_at(int64_t cases, int64_t lags, const double *informations, const double *vectors,
                    const double *priors, const double *means, double *log, double *steps) {
  double gradient[UNKNOWNS], system[UNKNOWNS * UNKNOWNS], pulled[UNKNOWNS];
  int exchanges[UNKNOWNS];
  for (int64_t b = 0; b < cases; b++)
    for (int64_t l = 0; l < lags; l++) {
      const double *prior = priors + b * UNKNOWNS * UNKNOWNS, *mean = means + b * UNKNOWNS;
      const double *square = informations + l * UNKNOWNS * UNKNOWNS, *linear = vectors + l * UNKNOWNS;
      double *step = steps + (b * lags + l) * UNKNOWNS, sum = 0.0;
      apply(square, mean, UNKNOWNS, UNKNOWNS, pulled);
      for (int i = 0; i < UNKNOWNS; i++) gradient[i] = linear[i] - pulled[i];
      product(prior, square, UNKNOWNS, UNKNOWNS, UNKNOWNS, system);
      for (int i = 0; i < UNKNOWNS; i++) system[i * (UNKNOWNS + 1)] += 1.0;
      apply(prior, gradient, UNKNOWNS, UNKNOWNS, step);
      if (factor_rows(system, UNKNOWNS, exchanges)) return POISE_SINGULAR;
      solve_rows(system, UNKNOWNS, exchanges, step, 1);
      for (int i = 0; i < UNKNOWNS; i++) sum += gradient[i] * step[i] + (linear[i] + gradient[i]) * mean[i];
      log[b * lags + l] = (sum - log_determinant(system, UNKNOWNS)) / 2.0;
    }
  return POISE_OK;
}

/* out = [v]x */
static void cross_matrix(const double *v, double *out) {
  const double rows[9] = {0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0};
  memcpy(out, rows, sizeof rows);
}

void covariance_of(const double *phi, const double *variances, const double *motion, double *out) {
  static const int symmetric[3][3] = {{4, 5, 6}, {5, 7, 8}, {6, 8, 9}};
  double first[9], by_motion[CHANNELS][CHANNELS];
  cross_matrix(phi + 1, first);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      by_motion[i][j] = (i == j ? phi[0] : 0.0) * motion[0];
      by_motion[3 + i][j] = first[3 * i + j] * motion[0];
      by_motion[i][3 + j] = first[3 * i + j] * motion[1];
      by_motion[3 + i][3 + j] = -phi[symmetric[i][j]] * motion[1];
    }
  for (int i = 0; i < CHANNELS; i++)
    for (int j = 0; j < CHANNELS; j++) {
      double sum = i == j ? variances[i] : 0.0;
      for (int k = 0; k < CHANNELS; k++) sum += by_motion[i][k] * by_motion[j][k];
      out[i * CHANNELS + j] = sum;
    }
}

void residual_rows(const double *unknowns, const double *entries, double *rows) {
  memset(rows, 0, sizeof(double) * CHANNELS * SIGNALS);
  for (int i = 0; i < CHANNELS; i++) {
    for (int p = 0; p < UNKNOWNS; p++)
      for (int c = 0; c < MOTION; c++) rows[i * SIGNALS + c] -= unknowns[p] * entries[(i * UNKNOWNS + p) * MOTION + c];
    rows[i * SIGNALS + MOTION + i] = 1.0;
  }
}

void residual_sums(const double *moments, const double *rows, double *second, double *first) {
  double half[CHANNELS * SIGNALS];
  product(rows, moments, CHANNELS, SIGNALS, SIGNALS, half);
  for (int i = 0; i < CHANNELS; i++) {
    first[i] = half[i * SIGNALS + MOTION - 1];
    for (int j = 0; j < CHANNELS; j++) {
      double sum = 0.0;
      for (int c = 0; c < SIGNALS; c++) sum += half[i * SIGNALS + c] * rows[j * SIGNALS + c];
      second[i * CHANNELS + j] = sum;
    }
  }
}

int64_t log_likelihoods(int64_t count, const double *moments, const int64_t *cases, const double *unknowns,
                        const double *entries, const double *variances, const double *motion, double *log) {
  double second[CHANNELS * CHANNELS], covariance[CHANNELS * CHANNELS], rows[CHANNELS * SIGNALS], first[CHANNELS];
  int exchanges[CHANNELS];
  for (int64_t h = 0; h < count; h++) {
    const double *own = unknowns + UNKNOWNS * h;
    residual_rows(own, entries, rows);
    residual_sums(moments + SIGNALS * SIGNALS * cases[h], rows, second, first);
    covariance_of(own, variances, motion, covariance);
    if (factor_rows(covariance, CHANNELS, exchanges)) return POISE_SINGULAR;
    solve_rows(covariance, CHANNELS, exchanges, second, CHANNELS);
    double trace = 0.0;
    for (int i = 0; i < CHANNELS; i++) trace += second[i * (CHANNELS + 1)];
    log[h] = -trace / 2.0;
  }
  return POISE_OK;
}

int64_t without_bias(int64_t cases, const double *informations, const double *vectors, const double *variances,
                     double *information, double *vector, double *covariance, double *mean, double *slope,
                     double *determinants) {
  double system[BIAS * BIAS], cross[BIAS * PHI];
  int exchanges[BIAS];
  for (int64_t b = 0; b < cases; b++) {
    const double *whole = informations + b * UNKNOWNS * UNKNOWNS, *pulls = vectors + b * UNKNOWNS;
    const double *spread = variances + b * BIAS;
    double *own = covariance + b * BIAS * BIAS, *at = mean + b * BIAS, *tilt = slope + b * BIAS * PHI;
    for (int i = 0; i < BIAS; i++)
      for (int j = 0; j < BIAS; j++) {
        system[i * BIAS + j] = (i == j ? 1.0 : 0.0) + spread[i] * whole[(PHI + i) * UNKNOWNS + PHI + j];
        own[i * BIAS + j] = i == j ? spread[i] : 0.0;
      }
    if (factor_rows(system, BIAS, exchanges)) return POISE_SINGULAR;
    determinants[b] = log_determinant(system, BIAS);
    solve_rows(system, BIAS, exchanges, own, BIAS);
    for (int i = 0; i < BIAS; i++) memcpy(cross + i * PHI, whole + (PHI + i) * UNKNOWNS, sizeof(double) * PHI);
    product(own, cross, BIAS, BIAS, PHI, tilt);
    for (int i = 0; i < BIAS * PHI; i++) tilt[i] = -tilt[i];
    apply(own, pulls + PHI, BIAS, BIAS, at);
    for (int i = 0; i < PHI; i++) {
      double taken = 0.0;
      for (int k = 0; k < BIAS; k++) taken += cross[k * PHI + i] * at[k];
      vector[b * PHI + i] = pulls[i] - taken;
      for (int j = 0; j < PHI; j++) {
        double sum = whole[i * UNKNOWNS + j];
        for (int k = 0; k < BIAS; k++) sum += cross[k * PHI + i] * tilt[k * PHI + j];
        information[(b * PHI + i) * PHI + j] = sum;
      }
    }
  }
  return POISE_OK;
}

/* motion (13, 13) less what the noise of angular accelerations has added to it; `without_noise`. */
static int take_noise(double *motion, double count, double variance) {
  enum { OTHERS = MOTION - 3 };
  static const int others[OTHERS] = {0, 1, 2, 6, 7, 8, 9, 10, 11, 12};
  double system[OTHERS * OTHERS], cross[OTHERS * 3], solved[OTHERS * 3], energy[9], values[3], axes[9], most = 0.0;
  int exchanges[OTHERS];
  for (int i = 0; i < OTHERS; i++) most = fmax(most, motion[others[i] * (MOTION + 1)]);
  for (int i = 0; i < OTHERS; i++) {
    for (int j = 0; j < OTHERS; j++) system[i * OTHERS + j] = motion[others[i] * MOTION + others[j]];
    system[i * (OTHERS + 1)] += 1e-12 * (motion[others[i] * (MOTION + 1)] + most);
    for (int j = 0; j < 3; j++) cross[3 * i + j] = solved[3 * i + j] = motion[others[i] * MOTION + 3 + j];
  }
  if (factor_rows(system, OTHERS, exchanges)) return POISE_SINGULAR;
  solve_rows(system, OTHERS, exchanges, solved, 3);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      double sum = motion[(3 + i) * MOTION + 3 + j];
      for (int k = 0; k < OTHERS; k++) sum -= cross[3 * k + i] * solved[3 * k + j];
      energy[3 * i + j] = sum / variance;
    }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < i; j++) energy[3 * j + i] = energy[3 * i + j]; /* the lower half counts, as in LAPACK */
  eigen(energy, 3, values, axes);
  for (int k = 0; k < 3; k++) {
    const double taken = fmax(fmin(count, values[k] - sqrt(2.0 * count)), 0.0) * variance;
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) motion[(3 + i) * MOTION + 3 + j] -= axes[3 * i + k] * taken * axes[3 * j + k];
  }
  return POISE_OK;
}

/* weight (6, 6) = the inverse of a covariance, which has to be positive definite. */
static int inverse_of(const double *covariance, double *weight) {
  double factor[CHANNELS * CHANNELS], back[CHANNELS * CHANNELS] = {0.0};
  memcpy(factor, covariance, sizeof factor);
  if (cholesky(factor, CHANNELS)) return POISE_NOT_POSITIVE;
  for (int j = 0; j < CHANNELS; j++) /* back = the inverse of the factor */
    for (int i = j; i < CHANNELS; i++) {
      double sum = i == j ? 1.0 : 0.0;
      for (int k = j; k < i; k++) sum -= factor[i * CHANNELS + k] * back[k * CHANNELS + j];
      back[i * CHANNELS + j] = sum / factor[i * (CHANNELS + 1)];
    }
  for (int i = 0; i < CHANNELS; i++)
    for (int j = 0; j < CHANNELS; j++) {
      double sum = 0.0;
      for (int k = i > j ? i : j; k < CHANNELS; k++) sum += back[k * CHANNELS + i] * back[k * CHANNELS + j];
      weight[i * CHANNELS + j] = sum;
    }
  return POISE_OK;
}

POISE_EXPORT int64_t poise_normal_equations(int64_t count, const double *moments, const double *counts,
                                            const double *covariance, double variance, const double *entries,
                                            double *informations, double *vectors) {
  enum { BLOCK = UNKNOWNS * MOTION };
  double weight[CHANNELS * CHANNELS], motion[MOTION * MOTION], seen[CHANNELS * BLOCK], weighed[BLOCK], pull[MOTION];
  int status = inverse_of(covariance, weight);
  for (int64_t l = 0; l < count && !status; l++) {
    const double *sums = moments + l * SIGNALS * SIGNALS;
    double *square = informations + l * UNKNOWNS * UNKNOWNS, *linear = vectors + l * UNKNOWNS;
    for (int i = 0; i < MOTION; i++) memcpy(motion + i * MOTION, sums + i * SIGNALS, sizeof(double) * MOTION);
    status = take_noise(motion, counts[l], variance);
    memset(seen, 0, sizeof seen);
    memset(square, 0, sizeof(double) * UNKNOWNS * UNKNOWNS);
    memset(linear, 0, sizeof(double) * UNKNOWNS);
    for (int row = 0; row < CHANNELS * UNKNOWNS; row++) /* what each channel sees of the motion: E_i M */
      for (int c = 0; c < MOTION; c++) {
        const double entry = entries[row * MOTION + c];
        if (entry == 0.0) continue;
        for (int k = 0; k < MOTION; k++) seen[row * MOTION + k] += entry * motion[c * MOTION + k];
      }
    for (int i = 0; i < CHANNELS; i++) {
      memset(weighed, 0, sizeof weighed);
      memset(pull, 0, sizeof pull);
      for (int j = 0; j < CHANNELS; j++) {
        const double share = weight[i * CHANNELS + j];
        if (share == 0.0) continue;
        for (int e = 0; e < BLOCK; e++) weighed[e] += share * seen[j * BLOCK + e];
        for (int c = 0; c < MOTION; c++) pull[c] += share * sums[c * SIGNALS + MOTION + j];
      }
      for (int p = 0; p < UNKNOWNS; p++)
        for (int c = 0; c < MOTION; c++) {
          const double entry = entries[i * BLOCK + p * MOTION + c];
          if (entry == 0.0) continue;
          linear[p] += entry * pull[c];
          for (int q = 0; q <= p; q++) square[p * UNKNOWNS + q] += entry * weighed[q * MOTION + c];
        }
    }
    for (int p = 0; p < UNKNOWNS; p++)
      for (int q = 0; q < p; q++) square[q * UNKNOWNS + p] = square[p * UNKNOWNS + q];
  }
  return status;
}
