/* Sums over samples at many lags between two clocks; `ClockComparison._sum` in poise/inertia/bayes. */
#include <math.h>
#include <string.h>

#include "poise_kernels.h"

enum { MOTION = 13, WRENCH = 6, SIGNALS = 19, WIDE = 20, ROWS = 4 };

/* sums (20, 20) += s s^T, the lower half in blocks. */
static void add_square(const double *restrict s, double *restrict sums) {
  for (int block = 0; block < WIDE; block += ROWS)
    for (int i = block; i < block + ROWS; i++)
      for (int j = 0; j < block + ROWS; j++) sums[i * WIDE + j] += s[i] * s[j];
}

/* Add to moments (lags, 19, 19) and counts (lags,): samples (count,) at `stamps` ns with their wrenches (count, 6), and
   the motion signals (n, 13) at times `when` (n,) a lag before, interpolated where no more than `gap` ns are between.
   Times and stamps ascend. */
POISE_EXPORT void poise_clock_sums(int64_t n, const int64_t *when, const double *signals, int64_t count,
                                   const int64_t *stamps, const double *wrenches, int64_t lags, const int64_t *lag,
                                   int64_t gap, double *moments, double *counts) {
  for (int64_t l = 0; l < lags && n > 1; l++) {
    double sums[WIDE * WIDE] = {0.0}, s[WIDE] = {0.0};
    int64_t right = 1;
    for (int64_t k = 0; k < count; k++) {
      const int64_t wanted = stamps[k] - lag[l];
      while (right < n - 1 && when[right] < wanted) right++;
      const int64_t before = when[right - 1], span = when[right] - before;
      const double share = (double)(wanted - before) / (double)(span > 1 ? span : 1);
      if (!(share >= 0.0 && share <= 1.0 && span <= gap)) continue;
      const double *one = signals + MOTION * (right - 1), *other = one + MOTION;
      for (int i = 0; i < MOTION; i++) s[i] = (other[i] - one[i]) * share + one[i];
      memcpy(s + MOTION, wrenches + WRENCH * k, sizeof(double) * WRENCH);
      add_square(s, sums);
      counts[l] += 1.0;
    }
    for (int i = 0; i < SIGNALS; i++)
      for (int j = 0; j < SIGNALS; j++)
        moments[(l * SIGNALS + i) * SIGNALS + j] += i > j ? sums[i * WIDE + j] : sums[j * WIDE + i];
  }
}
