/* What an answer leaves of blocks, and how much noise that shows; in Python: outliers.py and lasting.py. */
#include <math.h>
#include <stdlib.h>

#include "dense.h"
#include "search.h"

static const double UNLIKELY = 6.0, NOTABLE = 4.0, SLOW_NOTABLE = 3.0, MEAN_UNKNOWNS = 5.0, MOST_CORRELATED = 0.8;
static const double SAME_NOISE = 0.1, SAME_RESIDUAL = 0.02;
enum { ENOUGH_BLOCKS = 12, LEAST_PAIRS = 12, AXES = 3 };
static const int64_t NEAR = 500000000; /* ns */

int64_t compare(struct search *search) {
  double rows[CHANNELS * SIGNALS], moments[SIGNALS * SIGNALS], second[CHANNELS * CHANNELS], first[CHANNELS];
  double whole[CHANNELS * CHANNELS], parts[GROUPS][AXES * AXES], own[AXES * AXES];
  residual_rows(search->unknowns, search->entries, rows);
  if (inverse(search->residual, CHANNELS, whole)) return POISE_SINGULAR;
  for (int g = 0; g < GROUPS; g++) {
    for (int e = 0; e < AXES * AXES; e++)
      own[e] = search->residual[(AXES * g + e / AXES) * CHANNELS + AXES * g + e % AXES];
    if (inverse(own, AXES, parts[g])) return POISE_SINGULAR;
  }
  for (int64_t b = 0; b < search->blocks; b++) {
    const double *sums = search->moments + b * search->lags * SIGNALS * SIGNALS, size = (double)search->sizes[b];
    for (int e = 0; e < SIGNALS * SIGNALS; e++) moments[e] = 0.0;
    for (int64_t l = 0; l < search->lags; l++)
      if (search->at_delay[l] != 0.0)
        for (int e = 0; e < SIGNALS * SIGNALS; e++)
          moments[e] += search->at_delay[l] * sums[l * SIGNALS * SIGNALS + e];
    residual_sums(moments, rows, second, first);
    double squared = 0.0;
    for (int e = 0; e < CHANNELS * CHANNELS; e++) squared += second[e] * whole[e];
    const double freedom = CHANNELS * size, spread = 2.0 / (9.0 * freedom);
    if (squared < 0.0) squared = 0.0;
    search->surprise[b] = (cbrt(squared / freedom) - 1.0 + spread) / sqrt(spread);
    for (int g = 0; g < GROUPS; g++) {
      double samples = 0.0, mean = 0.0, trace = 0.0;
      for (int i = 0; i < AXES; i++) {
        trace += second[(AXES * g + i) * (CHANNELS + 1)];
        for (int j = 0; j < AXES; j++) {
          samples += second[(AXES * g + i) * CHANNELS + AXES * g + j] * parts[g][AXES * i + j];
          mean += first[AXES * g + i] * parts[g][AXES * i + j] * first[AXES * g + j];
        }
      }
      search->variance_ratio[GROUPS * b + g] = samples / (AXES * size);
      search->mean_ratio[GROUPS * b + g] = mean / (AXES * size);
      search->squares[GROUPS * b + g] = trace < 0.0 ? 0.0 : trace;
    }
    for (int i = 0; i < CHANNELS; i++) search->means[CHANNELS * b + i] = first[i] / size;
  }
  return POISE_OK;
}

static int by_size(const void *one, const void *other) {
  const double a = *(const double *)one, b = *(const double *)other;
  return (a > b) - (a < b);
}

/* `sample_excess`: by how much more force and torque vary from sample to sample than expected. */
static void sample_excess(const struct search *search, double *ratios, double *found) {
  double samples = 0.0;
  int64_t count = 0;
  for (int64_t b = 0; b < search->blocks; b++)
    if (search->free[b]) samples += (double)search->sizes[b], count++;
  const double freedom = AXES * samples / (double)count, by_chance = 1.25 * sqrt(2.0 / (freedom * (double)count));
  const double shrink = 1.0 - 2.0 / (9.0 * freedom);
  for (int g = 0; g < GROUPS; g++) {
    count = 0;
    for (int64_t b = 0; b < search->blocks; b++)
      if (search->free[b]) ratios[count++] = search->variance_ratio[GROUPS * b + g];
    qsort(ratios, (size_t)count, sizeof(double), by_size);
    const double middle = (ratios[(count - 1) / 2] + ratios[count / 2]) / 2.0 / (shrink * shrink * shrink);
    found[g] = fabs(middle - 1.0) > NOTABLE * by_chance ? middle : 1.0;
  }
}

/* `neighbour_correlation` of the means of blocks. */
static void neighbour_correlation(const struct search *search, const uint8_t *keep, double *found) {
  double products[GROUPS] = {0.0}, squares[GROUPS] = {0.0};
  int64_t pairs = 0, count = 0;
  for (int64_t b = 0; b < search->blocks; b++) {
    const double *own = search->means + CHANNELS * b;
    if (!keep[b]) continue;
    count++;
    for (int i = 0; i < CHANNELS; i++) squares[i / AXES] += own[i] * own[i];
    if (b + 1 == search->blocks || !keep[b + 1] || search->start[b + 1] - search->end[b] >= NEAR) continue;
    pairs++;
    for (int i = 0; i < CHANNELS; i++) products[i / AXES] += own[i] * own[CHANNELS + i];
  }
  const double lost = MEAN_UNKNOWNS / (AXES * (double)pairs);
  for (int g = 0; g < GROUPS; g++) {
    const double shown = products[g] / (double)pairs / (squares[g] / (double)count);
    found[g] = pairs < LEAST_PAIRS ? 0.0 : fmin(fmax((shown + lost) / (1.0 - 3.0 * lost), 0.0), MOST_CORRELATED);
  }
}

/* `slow_excess`: by how much more slow errors vary than white noise lets expect. */
static void slow_excess(const struct search *search, const uint8_t *keep, double *found) {
  double correlation[GROUPS], sums[GROUPS] = {0.0};
  int64_t count = 0;
  neighbour_correlation(search, keep, correlation);
  for (int64_t b = 0; b < search->blocks; b++)
    if (keep[b]) {
      count++;
      for (int g = 0; g < GROUPS; g++) sums[g] += search->mean_ratio[GROUPS * b + g];
    }
  const double freedom = AXES * (double)count - MEAN_UNKNOWNS;
  const double by_chance = sqrt(2.0 / freedom + 4.0 / (AXES * (double)count));
  for (int g = 0; g < GROUPS; g++) {
    const double together = sums[g] * AXES / freedom * (1.0 + correlation[g]) / (1.0 - correlation[g]);
    found[g] = count >= ENOUGH_BLOCKS && together > 1.0 + SLOW_NOTABLE * by_chance ? together : 1.0;
  }
}

static int differ(const double *one, const double *other, double notable) {
  return fabs(one[0] / other[0] - 1.0) > notable || fabs(one[1] / other[1] - 1.0) > notable;
}

int judge(struct search *search, double *ratios) {
  double excess[GROUPS], before[GROUPS];
  int64_t explained = 0;
  int others = 0, noise;
  for (int64_t b = 0; b < search->blocks; b++) explained += search->free[b] && search->surprise[b] < UNLIKELY;
  for (int64_t b = 0; b < search->blocks && explained; b++) {
    const uint8_t fits = search->free[b] && search->surprise[b] < UNLIKELY;
    others |= fits != search->keep[b];
    search->keep[b] = fits;
  }
  sample_excess(search, ratios, excess);
  for (int g = 0; g < GROUPS; g++) {
    before[g] = search->sample[g];
    search->sample[g] = fmax(before[g] * excess[g], 1.0);
  }
  noise = differ(search->sample, before, SAME_NOISE);
  if (!others && !noise) {
    slow_excess(search, search->keep, excess);
    for (int g = 0; g < GROUPS; g++) {
      before[g] = search->slow[g];
      search->slow[g] = before[g] * excess[g];
    }
    noise = differ(search->slow, before, SAME_NOISE);
  }
  return others || noise;
}

int shown_noise(struct search *search) {
  double samples = 0.0, shown[GROUPS] = {0.0};
  const double expected[GROUPS] = {1.0, 1.0};
  for (int64_t b = 0; b < search->blocks; b++)
    if (search->keep[b]) {
      samples += (double)search->sizes[b];
      for (int g = 0; g < GROUPS; g++) shown[g] += (double)search->sizes[b] * search->variance_ratio[GROUPS * b + g];
    }
  for (int g = 0; g < GROUPS; g++) shown[g] = fmax(shown[g] / samples, 1.0);
  if (!differ(shown, expected, SAME_RESIDUAL)) return 0;
  for (int g = 0; g < GROUPS; g++) search->sample[g] *= shown[g];
  return 1;
}
