/* Recursions from sample to sample; in Python: poise/mismatch/inference/noise.py and poise/mismatch/effects/part_motion.py. */
#include <math.h>

#include "poise_kernels.h"

enum { LANES = 4 };

/* Some signals, `stride` apart, become their innovations; they are filtered at once, because each waits for itself. */
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

/* Signals (rows, n), `stride` apart, times `scale` become the innovations of white and coloured noise, in place. All
   other arrays (n,): of the state gain, what is left of it, what of a value enters it; weight of the innovation. */
POISE_EXPORT void poise_innovations(int64_t rows, int64_t n, int64_t stride, double *values, double scale,
                                    const double *gain, const double *fade, const double *drive, const double *weight) {
  int64_t row = 0;
  for (; row + LANES <= rows; row += LANES)
    innovate(LANES, n, stride, values + row * stride, scale, gain, fade, drive, weight);
  for (; row < rows; row++) innovate(1, n, stride, values + row * stride, scale, gain, fade, drive, weight);
}

/* squares (columns,) of the innovations of values (n, columns), divided by their variance. `gain` and `kalman` are
   (n, gains), of all columns (gains = 1) or of each; `decay` (n,). */
POISE_EXPORT void poise_innovation_squares(int64_t n, int64_t columns, const double *values, int64_t gains,
                                           const double *gain, const double *kalman, const double *decay,
                                           double *squares) {
  const int64_t each = gains > 1;
  for (int64_t first = 0; first < columns; first += LANES) {
    const int lanes = (int)(columns - first < LANES ? columns - first : LANES);
    double state[LANES] = {0.0}, sum[LANES] = {0.0};
    for (int64_t i = 0; i < n; i++)
      for (int lane = 0; lane < lanes; lane++) {
        const int64_t own = i * gains + each * (first + lane);
        const double value = values[i * columns + first + lane], g = gain[own], k = kalman[own], fade = 1.0 - k * g;
        const double innovation = value - g * state[lane];
        sum[lane] += fade * innovation * innovation; /* 1 - k g is one over the variance */
        state[lane] = decay[i] * (fade * state[lane] + k * value);
      }
    for (int lane = 0; lane < lanes; lane++) squares[first + lane] = sum[lane];
  }
}

/* Positions (n, 3) on the unit sphere under drives and turns (n, 3); `start` (6,): at the first step and before it. */
POISE_EXPORT void poise_pendulum(int64_t n, const double *start, const double *drive, const double *turn, double half,
                                 double *places) {
  double x = start[0], y = start[1], z = start[2], x0 = start[3], y0 = start[4], z0 = start[5];
  const double a = 2.0 / (1.0 + half), b = (1.0 - half) / (1.0 + half);
  for (int64_t i = 0; i < n; i++) {
    const double *push = drive + 3 * i, *w = turn + 3 * i;
    double *place = places + 3 * i;
    place[0] = x, place[1] = y, place[2] = z;
    const double fx = a * x - b * x0 + push[0] + w[1] * z - w[2] * y;
    const double fy = a * y - b * y0 + push[1] + w[2] * x - w[0] * z;
    const double fz = a * z - b * z0 + push[2] + w[0] * y - w[1] * x;
    /* Back to the sphere along the rod. */
    const double along = fx * x + fy * y + fz * z;
    const double beyond = along * along - (fx * fx + fy * fy + fz * fz - 1.0);
    const double held = along - (beyond > 0.0 ? sqrt(beyond) : 0.0);
    x0 = x, y0 = y, z0 = z;
    x = fx - held * x, y = fy - held * y, z = fz - held * z;
  }
}
