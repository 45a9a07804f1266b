/* Columns averaged in blocks and whitened, and the most likely coloured noise; in Python: inference/noise.py of
   poise/mismatch. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "poise_kernels.h"

enum { LANES = 4 };

/* Values whose row r, channel c and sample i are at r row + c channel + i sample; means of `length` samples from
   `first` (blocks,) on. */
struct columns {
  const double *values;
  int64_t rows, channels, row, channel, sample, blocks, length;
  const int64_t *first;
};

/* out (rows, channels, blocks) */
static void averaged(const struct columns *of, double *out) {
  const int64_t together = of->rows * of->channels;
  if (of->sample == 1) {
    for (int64_t e = 0; e < together; e++) {
      const double *from = of->values + e / of->channels * of->row + e % of->channels * of->channel;
      for (int64_t i = 0; i < of->blocks; i++) {
        double sum = 0.0;
        for (int64_t l = 0; l < of->length; l++) sum += from[of->first[i] + l];
        out[e * of->blocks + i] = sum / (double)of->length;
      }
    }
    return;
  }
  for (int64_t i = 0; i < of->blocks; i++)
    for (int64_t c = 0; c < of->channels; c++) {
      const double *from = of->values + of->first[i] * of->sample + c * of->channel;
      for (int64_t r = 0; r < of->rows; r++) {
        double sum = 0.0;
        for (int64_t l = 0; l < of->length; l++) sum += from[l * of->sample + r * of->row];
        out[(r * of->channels + c) * of->blocks + i] = sum / (double)of->length;
      }
    }
}

/* Some rows, `stride` apart, become their innovations; they are filtered at once, because each waits for itself. */
static inline void innovate(int lanes, int64_t n, int64_t stride, double *values, double scale, const double *gain,
                            const double *fade, const double *drive, const double *weight) {
  double state[LANES] = {0.0};
  for (int64_t i = 0; i < n; i++)
    for (int lane = 0; lane < lanes; lane++) {
      double *at = values + lane * stride + i;
      const double value = *at * scale;
      *at = (value - gain[i] * state[lane]) * weight[i];
      state[lane] = fade[i] * state[lane] + drive[i] * value;
    }
}

/* The rows of `lane` (at most LANES) of a channel, by its filter (4, channels, n); a plain channel is scaled. */
static void filtered(int lanes, int64_t n, int64_t stride, double *values, double scale, int64_t plain, int64_t apart,
                     const double *filter) {
  if (plain) {
    for (int lane = 0; lane < lanes; lane++)
      for (int64_t i = 0; i < n; i++) values[lane * stride + i] *= scale;
  } else if (lanes == LANES) {
    innovate(LANES, n, stride, values, scale, filter, filter + apart, filter + 2 * apart, filter + 3 * apart);
  } else {
    for (int lane = 0; lane < lanes; lane++)
      innovate(1, n, stride, values + lane * stride, scale, filter, filter + apart, filter + 2 * apart,
               filter + 3 * apart);
  }
}

/* out (rows, outputs, kept): the blocks `keep` (kept,) of whitened columns. `places` (rows,): columns act in these of
   the output channels alone, and have one channel; NULL: in all. scale, plain (outputs,); filters (4, outputs, blocks):
   gain of the state, what is left of it, what of a value enters it, and weight of the innovation. */
POISE_EXPORT int64_t poise_whitened(int64_t rows, int64_t channels, const int64_t *strides, const double *values,
                                    int64_t blocks, int64_t length, const int64_t *first, const int64_t *places,
                                    int64_t outputs, const double *scale, const int64_t *plain, const double *filters,
                                    int64_t kept, const int64_t *keep, double *out) {
  const struct columns of = {values, rows, channels, strides[0], strides[1], strides[2], blocks, length, first};
  const int64_t apart = outputs * blocks, run = kept && keep[kept - 1] - keep[0] == kept - 1;
  double *white = malloc(sizeof(double) * (size_t)(rows * channels * blocks + 1));
  if (!white) return POISE_NO_MEMORY;
  averaged(&of, white);
  if (places)
    for (int64_t r = 0; r < rows; r++)
      filtered(1, blocks, blocks, white + r * blocks, scale[places[r]], plain[places[r]], apart,
               filters + places[r] * blocks);
  else
    for (int64_t c = 0; c < channels; c++)
      for (int64_t r = 0; r < rows; r += LANES)
        filtered((int)(rows - r < LANES ? rows - r : LANES), blocks, channels * blocks,
                 white + (r * channels + c) * blocks, scale[c], plain[c], apart, filters + c * blocks);
  if (places) memset(out, 0, sizeof(double) * (size_t)(rows * outputs * kept));
  for (int64_t e = 0; e < rows * channels; e++) {
    double *to = out + (places ? e * outputs + places[e] : e) * kept;
    const double *from = white + e * blocks;
    if (run)
      memcpy(to, from + keep[0], sizeof(double) * (size_t)kept);
    else
      for (int64_t i = 0; i < kept; i++) to[i] = from[keep[i]];
  }
  free(white);
  return POISE_OK;
}

/* Gains (n,) of the coloured part become those of a Kalman filter: `kalman`, and what of the state it keeps, `fade`
   (one over the variance of the innovation). `usual`: square of the middle decay. Returns the sum of log variances. */
static POISE_WIDE double stationary(int64_t n, const double *gain, const double *decay, double usual, double *predicted,
                                    double *kalman, double *fade) {
  enum { TOGETHER = 8 };
  const double rest = 1.0 - usual;
  double sum = 0.0;
  for (int64_t i = 0; i < n; i++) {
    const double square = gain[i] * gain[i], left = rest * (1.0 - square);
    predicted[i] = 2.0 * rest / (left + sqrt(left * left + 4.0 * square * rest) + 1e-300);
  }
  for (int64_t i = 0; i < n; i++) fade[i] = predicted[i] / (1.0 + gain[i] * gain[i] * predicted[i]);
  for (int64_t i = n - 1; i > 0; i--) predicted[i] = decay[i - 1] * decay[i - 1] * (fade[i - 1] - 1.0) + 1.0;
  predicted[0] = 1.0;
  for (int64_t i = 0; i < n; i++) {
    const double variance = 1.0 + gain[i] * gain[i] * predicted[i];
    kalman[i] = gain[i] * predicted[i] / variance;
    predicted[i] = variance;
    fade[i] = 1.0 - kalman[i] * gain[i];
  }
  for (int64_t i = 0; i < n; i += TOGETHER) { /* one logarithm of a few factors */
    double product = 1.0;
    for (int64_t j = i; j < n && j < i + TOGETHER; j++) product *= predicted[j];
    sum += log(product);
  }
  return sum;
}

/* Sums of squares of the innovations of some channels of values (n, channels), divided by their variance. */
static inline void summed(int lanes, int64_t n, int64_t channels, const double *values, const double *gain,
                          const double *kalman, const double *fade, const double *decay, double *squares) {
  double state[LANES] = {0.0}, sum[LANES] = {0.0};
  for (int64_t i = 0; i < n; i++)
    for (int lane = 0; lane < lanes; lane++) {
      const double value = values[i * channels + lane], innovation = value - gain[i] * state[lane];
      sum[lane] += fade[i] * innovation * innovation;
      state[lane] = decay[i] * (fade[i] * state[lane] + kalman[i] * value);
    }
  for (int lane = 0; lane < lanes; lane++) squares[lane] = sum[lane];
}

/* For each channel of values (n, channels) the most likely of some colours of the noise: `chosen` (channels,), and its
   variance of the white part, `likely`. Of each colour: floor and slope over speed (n,) of the gain; share of `motion`
   (channels, n), the variance by errors of the motion in units of the white level's, or NULL; decay (n,) to the next
   sample, number `course` of `decays`; square `usual` of its middle. `least` and `most` (channels,) bound the variance. */
POISE_EXPORT int64_t poise_likely_colours(int64_t n, int64_t channels, const double *values, const double *speed,
                                          const double *motion, int64_t colours, const double *floor,
                                          const double *slope, const double *share, const int64_t *course,
                                          const double *decays, const double *usual, const double *least,
                                          const double *most, int64_t *chosen, double *likely) {
  double *room = malloc(sizeof(double) * (size_t)(4 * n + 3 * channels));
  if (!room) return POISE_NO_MEMORY;
  double *gain = room, *predicted = gain + n, *kalman = predicted + n, *fade = kalman + n;
  double *best = fade + n, *squares = best + channels, *logs = squares + channels;
  for (int64_t c = 0; c < channels; c++) best[c] = -INFINITY, chosen[c] = -1;
  for (int64_t k = 0; k < colours; k++) {
    const double *decay = decays + course[k] * n;
    for (int64_t c = 0; c < channels; c += motion ? 1 : LANES) {
      const int64_t lanes = motion ? 1 : channels - c < LANES ? channels - c : LANES;
      if (motion || c == 0) {
        for (int64_t i = 0; i < n; i++) {
          const double coloured = floor[k] + slope[k] * speed[i];
          gain[i] = sqrt(coloured * coloured + (motion ? share[k] * motion[c * n + i] : 0.0));
        }
        logs[c] = stationary(n, gain, decay, usual[course[k]], predicted, kalman, fade);
      }
      for (int64_t lane = 0; lane < lanes; lane++) logs[c + lane] = motion ? logs[c] : logs[0];
      if (lanes == LANES)
        summed(LANES, n, channels, values + c, gain, kalman, fade, decay, squares + c);
      else
        for (int64_t lane = 0; lane < lanes; lane++)
          summed(1, n, channels, values + c + lane, gain, kalman, fade, decay, squares + c + lane);
    }
    for (int64_t c = 0; c < channels; c++) {
      const double variance = fmin(fmax(squares[c] / (double)n, least[c]), most[c]);
      const double score = -0.5 * (squares[c] / variance + (double)n * log(variance)) - 0.5 * logs[c];
      if (score > best[c]) best[c] = score, chosen[c] = k, likely[c] = variance;
    }
  }
  free(room);
  return POISE_OK;
}
