/* Weights, delay, outliers and noise depend on the answer and the answer on them: rounds until they agree. In Python:
   PosteriorSearch.run. */
#include "search.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"

enum { MOST_ROUNDS = 16, IMPATIENT = 3, SQUARE = UNKNOWNS * UNKNOWNS, SUMS = SIGNALS * SIGNALS };
static const double STILL = 0.3, LEAST_VARIANCE = 1e-30;

/* Cut all arrays of a search out of one piece. */
static int64_t make_rounds(const struct search *search, struct rounds *rounds) {
  const int64_t n = search->model->states, lags = search->lags, cases = search->cases, all = search->hypotheses;
  const int64_t some = all > cases ? all : cases; /* the states of a case have a place there, too */
  double **rows[] = {&rounds->information,     &rounds->vector,    &rounds->scaled_information,
                     &rounds->scaled_vector,   &rounds->weights,   &rounds->totals,
                     &rounds->square,          &rounds->linear,    &rounds->reduced,
                     &rounds->pull,            &rounds->bias_covariance, &rounds->bias_mean,
                     &rounds->bias_slope,      &rounds->bias_determinant, &rounds->states,
                     &rounds->spreads,         &rounds->phi,       &rounds->penalty,
                     &rounds->determinant,     &rounds->log,       &rounds->answers,
                     &rounds->in_sensor,       &rounds->inner,     &rounds->priors,
                     &rounds->prior_means,     &rounds->evidence,  &rounds->steps,
                     &rounds->ratios};
  const int64_t sizes[] = {lags * SQUARE,     lags * UNKNOWNS,    lags * SQUARE,   lags * UNKNOWNS,
                           (cases + 2) * lags, cases * SUMS,      cases * SQUARE,  cases * UNKNOWNS,
                           cases * PHI * PHI, cases * PHI,        cases * BIAS * BIAS, cases * BIAS,
                           cases * BIAS * PHI, cases,             some * n,        some * n,
                           all * PHI,         all,                all,             all,
                           all * UNKNOWNS,    all * UNKNOWNS,     all * PHI * PHI, cases * SQUARE,
                           cases * UNKNOWNS,  cases * lags,       cases * lags * UNKNOWNS, search->blocks};
  enum { ARRAYS = sizeof rows / sizeof *rows };
  _Static_assert(sizeof sizes / sizeof *sizes == ARRAYS, "a size for each array");
  int64_t total = 2 * all;
  for (int k = 0; k < ARRAYS; k++) total += sizes[k];
  double *next = rounds->memory = malloc(sizeof(double) * (size_t)total);
  if (!next) return POISE_NO_MEMORY;
  for (int k = 0; k < ARRAYS; k++) *rows[k] = next, next += sizes[k];
  rounds->open = (int64_t *)next;
  rounds->which = rounds->open + all;
  return POISE_OK;
}

/* `ModelAverage.consider`: look at all hypotheses again. */
static void consider(const struct search *search, struct rounds *rounds) {
  rounds->n_open = search->hypotheses;
  for (int64_t h = 0; h < search->hypotheses; h++) rounds->open[h] = h;
}

/* Normal equations (16, 16) and (16,) in normalised phi, in units of the guessed mass. */
static void scale(const struct rounds *rounds, const double *square, const double *linear, double *to, double *vector) {
  double back[SQUARE] = {0.0}, turned[SQUARE], half[SQUARE];
  for (int i = 0; i < UNKNOWNS; i++)
    for (int j = 0; j < UNKNOWNS; j++) {
      const double entry = i < PHI && j < PHI ? rounds->back[i * PHI + j] : i == j;
      back[i * UNKNOWNS + j] = turned[j * UNKNOWNS + i] = entry;
    }
  product(square, back, UNKNOWNS, UNKNOWNS, UNKNOWNS, half);
  product(turned, half, UNKNOWNS, UNKNOWNS, UNKNOWNS, to);
  apply(turned, linear, UNKNOWNS, UNKNOWNS, vector);
}

/* `_normals`: at all lags, weighted by the last answer. */
static int64_t weigh(struct search *search, struct rounds *rounds, const double *phi) {
  const int64_t lags = search->lags;
  const double motion[2] = {search->linear, search->angular};
  double variances[CHANNELS], *counts = rounds->evidence; /* (L,), not needed here */
  memset(search->total, 0, sizeof(double) * (size_t)(lags * SUMS));
  memset(counts, 0, sizeof(double) * (size_t)lags);
  for (int64_t b = 0; b < search->blocks; b++) {
    if (!search->keep[b]) continue;
    for (int64_t e = 0; e < lags * SUMS; e++) search->total[e] += search->moments[b * lags * SUMS + e];
    for (int64_t l = 0; l < lags; l++) counts[l] += search->counts[b * lags + l];
  }
  for (int i = 0; i < CHANNELS; i++)
    variances[i] = search->variances[i] * search->sample[i / 3] * search->slow[i / 3];
  covariance_of(phi, variances, motion, search->residual);
  const int64_t status = poise_normal_equations(lags, search->total, counts, search->residual,
                                                fmax(search->angular * search->angular, LEAST_VARIANCE),
                                                search->entries, rounds->information, rounds->vector);
  for (int64_t l = 0; l < lags && !status; l++)
    scale(rounds, rounds->information + l * SQUARE, rounds->vector + l * UNKNOWNS,
          rounds->scaled_information + l * SQUARE, rounds->scaled_vector + l * UNKNOWNS);
  return status;
}

/* One round: weigh by the answer, find the delays, refine the answer and average; `first` before there is one. */
static int64_t go_round(struct search *search, struct rounds *rounds, int first, int with_delays,
                        covariances_of covariances) {
  double phi[PHI];
  memcpy(phi, first ? search->first_phi : search->unknowns, sizeof phi);
  int64_t status = weigh(search, rounds, phi);
  if (!status && with_delays) status = find_delays(search, rounds, first);
  if (!status) status = first ? refine(search, rounds, 0.1, 10, 0.0) : refine(search, rounds, 0.003, 25, 1e-4);
  return status ? status : average(search, rounds, covariances);
}

/* `_moved`: the answer has changed by something against its uncertainty. */
static int moved(const struct search *search, const double *before) {
  for (int i = 0; i < PHI; i++)
    if (fabs(search->unknowns[i] - before[i]) > STILL * sqrt(search->covariance[i * (UNKNOWNS + 1)])) return 1;
  return 0;
}

static int64_t search_rounds(struct search *search, struct rounds *rounds) {
  double before[UNKNOWNS];
  int64_t status = go_round(search, rounds, 1, 1, NULL);
  int settled = 0;
  for (int number = 0; number < MOST_ROUNDS && !status && !settled; number++) {
    memcpy(before, search->unknowns, sizeof before);
    status = go_round(search, rounds, 0, 1, narrowed);
    if (status) break;
    const int moves = moved(search, before);
    if (number < IMPATIENT && moves) continue;
    status = compare(search);
    const int other = status ? 0 : judge(search, rounds->ratios);
    if (other) consider(search, rounds);
    settled = !other && !moves;
  }
  if (!status && !settled) {
    status = go_round(search, rounds, 0, 0, NULL);
    if (!status) status = compare(search);
  }
  if (!status && shown_noise(search)) {
    status = go_round(search, rounds, 0, 0, NULL);
    if (!status) status = compare(search);
  }
  return status ? status : average(search, rounds, curved);
}

POISE_EXPORT int64_t poise_search(struct search *search) {
  struct rounds rounds;
  const int64_t lags = search->lags;
  int64_t status = make_rounds(search, &rounds);
  if (status) return status;
  for (int e = 0; e < PHI * PHI; e++) rounds.back[e] = search->to_sensor[e] * search->model->scale;
  memcpy(search->keep, search->free, (size_t)search->blocks);
  memset(search->delays, 0, sizeof(double) * (size_t)(DELAY * search->cases));
  memset(search->drifts, 0, sizeof(double) * (size_t)(UNKNOWNS * search->cases));
  for (int g = 0; g < GROUPS; g++) search->sample[g] = search->slow[g] = 1.0;
  consider(search, &rounds);
  status = search_rounds(search, &rounds);
  for (int64_t c = 0; c < SQUARE && !status; c++) {
    search->information[c] = 0.0;
    for (int64_t l = 0; l < lags; l++)
      search->information[c] += search->at_delay[l] * rounds.information[l * SQUARE + c];
  }
  for (int i = 0; i < UNKNOWNS && !status; i++) {
    search->vector[i] = 0.0;
    for (int64_t l = 0; l < lags; l++) search->vector[i] += search->at_delay[l] * rounds.vector[l * UNKNOWNS + i];
  }
  free(rounds.memory);
  return status;
}
