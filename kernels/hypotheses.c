/* All hypotheses about a payload at once, averaged; in Python: ModelAverage and LagGrid. */
#include <math.h>
#include <string.h>

#include "dense.h"
#include "search.h"

static const double TINY = 2.2250738585072014e-308, BALANCE = 0.1, FAINT = -40.0, TWO_PI = 6.283185307179586;

/* `LagGrid.weights` (L,) of a delay. */
static void lag_weights(const struct search *search, double delay, double *weights) {
  const int64_t lags = search->lags;
  weights[0] = 1.0;
  if (lags == 1) return;
  const double place = (delay - search->first_lag) / search->lag_step;
  const double nearest = fmin(fmax(rint(place), 1.0), (double)(lags - 2)), beyond = place - nearest;
  for (int64_t l = 0; l < lags; l++) {
    const double steps = (double)l - nearest;
    weights[l] = 0.0;
    if (steps == 0.0) weights[l] = 1.0 - beyond * beyond;
    if (fabs(steps) == 1.0) weights[l] = beyond * (beyond + steps) / 2.0;
  }
}

/* `LagGrid.estimate`: delay (3,) from the log evidence (L,). */
static void delay_of(const struct search *search, const double *evidence, double *delay) {
  const int64_t fine = search->fine, lags = search->lags;
  const double *beyond = search->beyond, spread = search->prior_spread;
  double total = 0.0, first = 0.0, second = 0.0, most = -INFINITY;
  for (int turn = 0; turn < 2; turn++)
    for (int64_t f = 0; f < fine; f++) {
      double log = 0.0;
      for (int64_t l = 0; l < lags; l++) log += search->smooth[f * lags + l] * evidence[l];
      const double at = (search->about + beyond[f]) / spread;
      log -= at * at / 2.0;
      if (!turn) {
        most = fmax(most, log);
      } else if (!(log - most < FAINT)) {
        const double chance = exp(log - most);
        total += chance, first += beyond[f] * chance, second += beyond[f] * beyond[f] * chance;
      }
    }
  const double step = beyond[1] - beyond[0], middle = first / total;
  const double place = fmin(fmax((middle - beyond[0]) / step, 0.0), (double)(fine - 1));
  const int64_t below = (int64_t)fmin(floor(place), (double)(fine - 2));
  double at_mean = 0.0;
  for (int64_t l = 0; l < lags; l++) {
    const double low = search->smooth[below * lags + l], high = search->smooth[(below + 1) * lags + l];
    at_mean += (low + (high - low) * (place - (double)below)) * evidence[l];
  }
  const double norm = step / (sqrt(TWO_PI) * spread);
  delay[0] = search->about + middle;
  delay[1] = sqrt(fmax(second / total - middle * middle, 0.0) + step * step / 12.0);
  delay[2] = log(total * norm) + most - at_mean;
}

/* unknowns (16,) in the sensor frame, of scaled ones. */
static void to_sensor(const struct rounds *rounds, const double *scaled, double *out) {
  apply(rounds->back, scaled, PHI, PHI, out);
  memcpy(out + PHI, scaled + PHI, sizeof(double) * BIAS);
}

/* (H,) probabilities of log weights, up to a constant; in place. */
static void normalise(double *log, int64_t count) {
  double most = -INFINITY, sum = 0.0;
  for (int64_t h = 0; h < count; h++) most = fmax(most, log[h]);
  for (int64_t h = 0; h < count; h++) sum += log[h] = exp(log[h] - most);
  for (int64_t h = 0; h < count; h++) log[h] /= sum;
}

/* `_typical`: state and variances (n,) of a case of the bias, over the hypotheses of the last answer. */
static void typical(const struct search *search, struct rounds *rounds, int64_t which, double *state, double *spread) {
  const int64_t n = search->model->states, count = search->remaining;
  double *chances = rounds->log;
  int64_t same = 0;
  for (int64_t h = 0; h < count; h++) same += search->bias_case[search->left[h]] == which;
  for (int64_t h = 0; h < count; h++)
    chances[h] = same && search->bias_case[search->left[h]] != which ? -INFINITY : search->log_weights[h];
  normalise(chances, count);
  for (int64_t k = 0; k < n; k++) {
    state[k] = spread[k] = 0.0;
    for (int64_t h = 0; h < count; h++) {
      state[k] += chances[h] * search->states[search->left[h] * n + k];
      spread[k] += chances[h] * search->state_variances[search->left[h] * n + k];
    }
  }
}

int64_t find_delays(struct search *search, struct rounds *rounds, int first) {
  const int64_t n = search->model->states, lags = search->lags, cases = search->cases;
  if (lags == 1) return POISE_OK;
  memset(rounds->priors, 0, sizeof(double) * (size_t)(cases * UNKNOWNS * UNKNOWNS));
  memset(rounds->prior_means, 0, sizeof(double) * (size_t)(cases * UNKNOWNS));
  for (int64_t c = 0; c < cases; c++) {
    double *prior = rounds->priors + c * UNKNOWNS * UNKNOWNS, own[PHI * PHI];
    memcpy(rounds->states, search->starts + c * n, sizeof(double) * (size_t)n);
    memcpy(rounds->spreads, search->state_variances + search->scouts[c] * n, sizeof(double) * (size_t)n);
    if (!first) typical(search, rounds, c, rounds->states, rounds->spreads);
    if (prior_of(search->model, rounds->states, rounds->spreads, rounds->prior_means + c * UNKNOWNS, own))
      return POISE_NO_MEMORY;
    for (int i = 0; i < PHI; i++) memcpy(prior + i * UNKNOWNS, own + i * PHI, sizeof(double) * PHI);
    for (int i = 0; i < BIAS; i++) prior[(PHI + i) * (UNKNOWNS + 1)] = search->bias_variances[c * BIAS + i];
  }
  const int64_t status = evidence_at(cases, lags, rounds->scaled_information, rounds->scaled_vector, rounds->priors,
                                     rounds->prior_means, rounds->evidence, rounds->steps);
  const double step = 0.25 * search->lag_step;
  for (int64_t c = 0; c < cases && !status; c++) {
    double *delay = search->delays + DELAY * c, *drift = search->drifts + UNKNOWNS * c;
    double before[UNKNOWNS], moved[UNKNOWNS] = {0.0}, *late = rounds->weights, *early = late + lags;
    delay_of(search, rounds->evidence + c * lags, delay);
    lag_weights(search, delay[0] + step, late);
    lag_weights(search, delay[0] - step, early);
    for (int64_t l = 0; l < lags; l++)
      for (int i = 0; i < UNKNOWNS; i++) {
        before[i] = rounds->prior_means[c * UNKNOWNS + i] + rounds->steps[(c * lags + l) * UNKNOWNS + i];
        moved[i] += (late[l] - early[l]) / (2.0 * step) * before[i];
      }
    to_sensor(rounds, moved, drift);
  }
  return status;
}

/* The sums and the normal equations at the delay of each case of the bias, and the bias taken out of them. */
static int64_t at_delays(struct search *search, struct rounds *rounds) {
  enum { SQUARE = UNKNOWNS * UNKNOWNS, SUMS = SIGNALS * SIGNALS };
  const int64_t lags = search->lags, cases = search->cases;
  memset(rounds->totals, 0, sizeof(double) * (size_t)(cases * SUMS));
  memset(rounds->square, 0, sizeof(double) * (size_t)(cases * SQUARE));
  memset(rounds->linear, 0, sizeof(double) * (size_t)(cases * UNKNOWNS));
  for (int64_t c = 0; c < cases; c++) {
    lag_weights(search, search->delays[DELAY * c], rounds->weights + c * lags);
    for (int64_t l = 0; l < lags; l++) {
      const double weight = rounds->weights[c * lags + l];
      if (weight == 0.0) continue;
      for (int e = 0; e < SUMS; e++) rounds->totals[c * SUMS + e] += weight * search->total[l * SUMS + e];
      for (int e = 0; e < SQUARE; e++)
        rounds->square[c * SQUARE + e] += weight * rounds->scaled_information[l * SQUARE + e];
      for (int e = 0; e < UNKNOWNS; e++)
        rounds->linear[c * UNKNOWNS + e] += weight * rounds->scaled_vector[l * UNKNOWNS + e];
    }
  }
  return without_bias(cases, rounds->square, rounds->linear, search->bias_variances, rounds->reduced, rounds->pull,
                      rounds->bias_covariance, rounds->bias_mean, rounds->bias_slope, rounds->bias_determinant);
}

/* The bias (6,) that belongs to phi (10,), after it in unknowns (16,); returns its log prior. */
static double with_bias(const struct search *search, const struct rounds *rounds, int64_t which, double *unknowns) {
  double log = -rounds->bias_determinant[which];
  apply(rounds->bias_slope + which * BIAS * PHI, unknowns, BIAS, PHI, unknowns + PHI);
  for (int i = 0; i < BIAS; i++) {
    unknowns[PHI + i] += rounds->bias_mean[which * BIAS + i];
    log -= unknowns[PHI + i] * unknowns[PHI + i] / fmax(search->bias_variances[which * BIAS + i], TINY);
  }
  return log / 2.0;
}

/* `Hypotheses.balanced`. */
static void balance(const struct search *search, struct rounds *rounds) {
  const int64_t count = rounds->n_open;
  double *result = rounds->penalty; /* no longer needed */
  memcpy(result, rounds->log, sizeof(double) * (size_t)count);
  for (int64_t h = 0; h < count; h++) {
    const int64_t twin = search->twins[rounds->open[h]];
    int64_t row = -1;
    for (int64_t k = 0; k < count; k++)
      if (rounds->open[k] == twin) row = k;
    if (row < 0 || row == h) continue;
    const double giving = rounds->log[h] + log(BALANCE), most = fmax(result[row], giving);
    result[row] = most + log1p(exp(fmin(result[row], giving) - most));
    result[h] += log1p(-BALANCE);
  }
  memcpy(rounds->log, result, sizeof(double) * (size_t)count);
}

/* Keep the hypotheses that are not negligible. */
static void drop(struct search *search, struct rounds *rounds, double negligible) {
  const int64_t n = search->model->states, count = rounds->n_open;
  double *chances = rounds->penalty;
  int64_t kept = 0;
  memcpy(chances, rounds->log, sizeof(double) * (size_t)count);
  normalise(chances, count);
  for (int64_t h = 0; h < count; h++) {
    if (!(chances[h] >= negligible)) continue;
    search->left[kept] = rounds->open[kept] = rounds->open[h];
    rounds->which[kept] = rounds->which[h];
    search->log_weights[kept] = rounds->log[h];
    memmove(rounds->answers + kept * UNKNOWNS, rounds->answers + h * UNKNOWNS, sizeof(double) * UNKNOWNS);
    memmove(rounds->states + kept * n, rounds->states + h * n, sizeof(double) * (size_t)n);
    memmove(rounds->spreads + kept * n, rounds->spreads + h * n, sizeof(double) * (size_t)n);
    kept++;
  }
  rounds->n_open = search->remaining = kept;
}

int64_t refine(struct search *search, struct rounds *rounds, double tolerance, int64_t most, double negligible) {
  const int64_t n = search->model->states, count = rounds->n_open;
  const double motion[2] = {search->linear, search->angular};
  double variances[CHANNELS];
  for (int64_t h = 0; h < count; h++) {
    rounds->which[h] = search->bias_case[rounds->open[h]];
    memcpy(rounds->states + h * n, search->states + rounds->open[h] * n, sizeof(double) * (size_t)n);
    memcpy(rounds->spreads + h * n, search->state_variances + rounds->open[h] * n, sizeof(double) * (size_t)n);
  }
  int64_t status = at_delays(search, rounds);
  if (!status)
    status = climb_all(search->model, count, rounds->states, rounds->spreads, rounds->which, rounds->reduced,
                       rounds->pull, tolerance, most, rounds->phi, rounds->penalty, rounds->determinant);
  if (status) return status;
  for (int64_t h = 0; h < count; h++) {
    double *own = rounds->answers + h * UNKNOWNS;
    memcpy(search->states + rounds->open[h] * n, rounds->states + h * n, sizeof(double) * (size_t)n);
    memcpy(own, rounds->phi + h * PHI, sizeof(double) * PHI);
    rounds->penalty[h] -= with_bias(search, rounds, rounds->which[h], own);
    to_sensor(rounds, own, rounds->in_sensor + h * UNKNOWNS);
  }
  for (int i = 0; i < CHANNELS; i++)
    variances[i] = search->variances[i] * search->sample[i / 3] * search->slow[i / 3];
  status = log_likelihoods(count, rounds->totals, rounds->which, rounds->in_sensor, search->entries, variances, motion,
                           rounds->log);
  if (status) return status;
  for (int64_t h = 0; h < count; h++)
    rounds->log[h] += search->delays[DELAY * rounds->which[h] + 2] + search->log_probability[rounds->open[h]] -
                      rounds->penalty[h] - rounds->determinant[h] / 2.0;
  balance(search, rounds);
  drop(search, rounds, negligible);
  return rounds->n_open ? POISE_OK : POISE_NOT_POSITIVE; /* none is left where there are no numbers */
}

/* Add weight times the covariance of a hypothesis, and its distance from the mean, to total (16, 16). */
static void add_covariance(const struct rounds *rounds, int64_t h, double weight, const double *mean, double *total) {
  const int64_t which = rounds->which[h];
  const double *inner = rounds->inner + h * PHI * PHI, *slope = rounds->bias_slope + which * BIAS * PHI;
  const double *own = rounds->bias_covariance + which * BIAS * BIAS, *answer = rounds->answers + h * UNKNOWNS;
  double cross[BIAS * PHI];
  product(slope, inner, BIAS, PHI, PHI, cross);
  for (int i = 0; i < UNKNOWNS; i++)
    for (int j = 0; j < UNKNOWNS; j++) {
      double entry = (answer[i] - mean[i]) * (answer[j] - mean[j]);
      if (i < PHI && j < PHI) entry += inner[i * PHI + j];
      if (i >= PHI && j < PHI) entry += cross[(i - PHI) * PHI + j];
      if (i < PHI && j >= PHI) entry += cross[(j - PHI) * PHI + i];
      if (i >= PHI && j >= PHI) {
        entry += own[(i - PHI) * BIAS + j - PHI];
        for (int k = 0; k < PHI; k++) entry += cross[(i - PHI) * PHI + k] * slope[(j - PHI) * PHI + k];
      }
      total[i * UNKNOWNS + j] += weight * entry;
    }
}

int64_t average(struct search *search, struct rounds *rounds, covariances_of covariances) {
  const int64_t count = rounds->n_open, lags = search->lags;
  double mean[UNKNOWNS] = {0.0}, total[UNKNOWNS * UNKNOWNS] = {0.0}, half[UNKNOWNS * UNKNOWNS], *chances = rounds->log;
  memcpy(chances, search->log_weights, sizeof(double) * (size_t)count);
  normalise(chances, count);
  memset(search->shares, 0, sizeof(double) * (size_t)search->cases);
  for (int64_t h = 0; h < count; h++) {
    search->shares[rounds->which[h]] += chances[h];
    for (int i = 0; i < UNKNOWNS; i++) mean[i] += chances[h] * rounds->answers[h * UNKNOWNS + i];
  }
  for (int64_t l = 0; l < lags; l++) {
    search->at_delay[l] = 0.0;
    for (int64_t c = 0; c < search->cases; c++) search->at_delay[l] += search->shares[c] * rounds->weights[c * lags + l];
  }
  to_sensor(rounds, mean, search->unknowns);
  if (!covariances) return POISE_OK;
  const int64_t status = covariances(search->model, count, rounds->states, rounds->spreads, rounds->which,
                                     rounds->reduced, rounds->inner);
  for (int64_t h = 0; h < count && !status; h++) add_covariance(rounds, h, chances[h], mean, total);
  for (int i = 0; i < UNKNOWNS; i++) { /* rows, then columns: back total back^T */
    for (int j = 0; j < UNKNOWNS; j++)
      mean[j] = (total[i * UNKNOWNS + j] + total[j * UNKNOWNS + i]) / 2.0;
    to_sensor(rounds, mean, half + i * UNKNOWNS);
  }
  for (int j = 0; j < UNKNOWNS; j++) {
    double moved[UNKNOWNS];
    for (int i = 0; i < UNKNOWNS; i++) mean[i] = half[i * UNKNOWNS + j];
    to_sensor(rounds, mean, moved);
    for (int i = 0; i < UNKNOWNS; i++) search->covariance[i * UNKNOWNS + j] = moved[i];
  }
  return status;
}
