/* The search for the knots of one stretch of samples, and the answers; poise/robot/smoother.py says what it does. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "splines.h"

static const double WORTHWHILE = 0.01;

struct smoother {
  int64_t count, columns, width, most, kept; /* width: columns, filled up with zeros to a multiple of four */
  double *seconds, *values, *rates; /* rates: NULL when none are followed */
  double *weights;                  /* (columns,) of the rates; 0 where they are not followed */
  int64_t *chosen;                  /* (columns,) knot intervals */
  struct level {
    int64_t intervals;
    struct fit *plain, **column; /* column: (columns,) that follow their rates, NULL until asked for */
    double *gradient, *squares;  /* of the rates; NULL until asked for */
  } * levels;                    /* in the order of their first use */
  int status;
};

/* (count, width) of (count, columns). */
static double *widened(const double *from, int64_t count, int64_t columns, int64_t width) {
  double *to = calloc((size_t)(count * width) + 1, sizeof(double));
  for (int64_t n = 0; to && n < count; n++)
    for (int64_t c = 0; c < columns; c++) to[n * width + c] = from[n * columns + c];
  return to;
}

POISE_EXPORT void poise_smoother_free(struct smoother *s) {
  if (!s) return;
  for (int64_t l = 0; l < s->kept; l++) {
    struct level *level = s->levels + l;
    for (int64_t c = 0; level->column && c < s->columns; c++) free_fit(level->column[c]);
    free(level->column);
    free_fit(level->plain);
    free(level->gradient);
    free(level->squares);
  }
  free(s->levels);
  free(s->seconds);
  free(s->values);
  free(s->rates);
  free(s->weights);
  free(s->chosen);
  free(s);
}

/* The fits on a number of knot intervals, made when they are first asked for; NULL after a failure. */
static struct level *level_of(struct smoother *s, int64_t intervals) {
  for (int64_t l = 0; l < s->kept; l++)
    if (s->levels[l].intervals == intervals) return s->levels + l;
  struct level *grown = realloc(s->levels, sizeof *grown * (size_t)(s->kept + 1));
  if (!grown) {
    s->status = POISE_NO_MEMORY;
    return NULL;
  }
  s->levels = grown;
  struct level *level = grown + s->kept;
  memset(level, 0, sizeof *level);
  level->intervals = intervals;
  level->plain = fit_values(s->seconds, s->count, s->values, s->width, intervals, &s->status);
  if (level->plain) level->column = calloc((size_t)s->columns, sizeof(struct fit *));
  if (!level->plain || !level->column) {
    free_fit(level->plain);
    if (!s->status) s->status = POISE_NO_MEMORY;
    return NULL;
  }
  s->kept++;
  return level;
}

static int know_slopes(struct smoother *s, struct level *level) {
  if (level->gradient) return 1;
  double *gradient = calloc((size_t)(level->plain->grid.size * s->width), sizeof(double));
  double *squares = calloc((size_t)s->width, sizeof(double));
  if (!gradient || !squares) s->status = POISE_NO_MEMORY;
  if (!s->status) s->status = slope_sums(level->plain, s->count, s->rates, gradient, squares);
  if (s->status) {
    free(gradient);
    free(squares);
    return 0;
  }
  level->gradient = gradient;
  level->squares = squares;
  return 1;
}

/* The fit of a column, and its column in there; NULL after a failure. */
static const struct fit *fit_of(struct smoother *s, int64_t column, int64_t intervals, int64_t *place) {
  struct level *level = level_of(s, intervals);
  *place = column;
  if (!level) return NULL;
  if (!(s->weights[column] > 0.0)) return level->plain;
  *place = 0;
  if (!level->column[column] && know_slopes(s, level))
    level->column[column] =
        with_slopes(level->plain, column, level->gradient, level->squares, s->weights[column], &s->status);
  return level->column[column];
}

static int64_t rung(const struct smoother *s, int64_t number) {
  const double intervals = rint(pow(2.0, (double)number / 4.0));
  return intervals < 1.0 ? 1 : intervals > (double)s->most ? s->most : (int64_t)intervals;
}

/* The score of a column on a rung; column -1: the sum over all columns. */
static double score(struct smoother *s, int64_t column, int64_t number) {
  if (column >= 0) {
    int64_t place;
    const struct fit *fit = fit_of(s, column, rung(s, number), &place);
    return fit ? fit_score(fit, place) : INFINITY;
  }
  double sum = 0.0;
  for (int64_t c = 0; c < s->columns && !s->status; c++) sum += score(s, c, number);
  return sum;
}

/* The rung with the least score among the powers of two. */
static int64_t coarse(struct smoother *s, int64_t column) {
  int64_t best = 0;
  double least = INFINITY;
  for (int64_t number = 0; s->most >> (number / 4) && !s->status; number += 4) {
    const double value = score(s, column, number);
    if (value < least) least = value, best = number;
  }
  return best;
}

/* The rung at the minimum that a descent finds, first by half octaves, then by quarters. */
static int64_t near(struct smoother *s, int64_t column, int64_t number) {
  for (int step = 2; step > 0; step--) {
    const double lower = score(s, column, number - step), higher = score(s, column, number + step);
    const int way = higher < lower ? step : -step;
    double least = higher < lower ? higher : lower, best = score(s, column, number);
    while (least < best && !s->status) {
      number += way;
      best = least;
      least = step > 1 ? score(s, column, number + way) : INFINITY;
    }
  }
  return number;
}

/* Variance of a column's positions over that of its rates; 0 when these are not worth it. */
static double rate_weight(struct smoother *s, int64_t column, int64_t intervals) {
  struct level *level = level_of(s, intervals);
  if (!level || !know_slopes(s, level)) return 0.0;
  const double scatter = level->squares[column] / (double)s->count, sigma = fit_sigma(level->plain, column);
  const double weight = scatter > 0.0 ? sigma * sigma / scatter : 0.0;
  return weight * level->plain->slope_trace >= WORTHWHILE * level->plain->trace ? weight : 0.0;
}

static void choose(struct smoother *s, int64_t given, int together, const int64_t *followed) {
  int64_t *start = s->chosen;
  for (int64_t c = 0; c < s->columns; c++)
    start[c] = given ? 0 : together ? (c ? start[0] : coarse(s, -1)) : coarse(s, c);
  for (int64_t c = 0; c < s->columns && s->rates && !s->status; c++)
    if (followed[c]) s->weights[c] = rate_weight(s, c, given ? given : rung(s, start[c]));
  for (int64_t c = 0; c < s->columns && !s->status; c++) {
    if (given)
      s->chosen[c] = given;
    else
      s->chosen[c] = together && c ? s->chosen[0] : rung(s, near(s, together ? -1 : c, start[c]));
  }
}

/* Chooses the knots for samples (count,) s and (count, columns), count at least 2; the values are about their mean.
   rates (count, columns) or NULL; followed (columns,): 0 where the rates of a column must not be used.
   given: knot intervals, 0 to choose; together: 1 for the same knots in all columns, without rates.
   chosen (columns,): knot intervals. NULL and a status after a failure; free the result otherwise. */
POISE_EXPORT struct smoother *poise_smoother_new(int64_t count, int64_t columns, const double *seconds,
                                                 const double *values, const double *rates, const int64_t *followed,
                                                 int64_t given, int64_t together, int64_t *chosen, int64_t *status) {
  struct smoother *s = calloc(1, sizeof *s);
  *status = POISE_NO_MEMORY;
  if (!s) return NULL;
  s->count = count;
  s->columns = columns;
  s->width = columns == 1 ? 1 : (columns + 3) / 4 * 4;
  s->most = count * 2 / 3 - DEGREE > 1 ? count * 2 / 3 - DEGREE : 1;
  s->seconds = widened(seconds, count, 1, 1);
  s->values = widened(values, count, columns, s->width);
  s->rates = rates ? widened(rates, count, columns, s->width) : NULL;
  s->weights = calloc((size_t)columns, sizeof(double));
  s->chosen = calloc((size_t)columns, sizeof(int64_t));
  if (s->seconds && s->values && s->weights && s->chosen && (s->rates || !rates)) {
    choose(s, given, (int)together, followed);
    memcpy(chosen, s->chosen, sizeof(int64_t) * (size_t)columns);
    *status = s->status;
  }
  if (!*status) return s;
  poise_smoother_free(s);
  return NULL;
}

/* Value, first and second derivative of one column of a fit at `second`. */
static void derivatives(const struct fit *fit, int64_t column, double second, double *values) {
  double powers[ORDER], weights[ORDER];
  const int64_t start = locate(&fit->grid, second, powers);
  for (int d = 0; d < 3; d++) {
    weights_at(&fit->grid, d, powers, weights);
    values[d] = 0.0;
    for (int i = 0; i < ORDER; i++) values[d] += weights[i] * fit->coefficients[(start + i) * fit->columns + column];
  }
}

/* (3, 3) covariance of the three at `second`, for unit noise. */
static void gain(const struct fit *fit, const double *windows, double second, double *out) {
  double powers[ORDER], weights[3][ORDER];
  const int64_t start = locate(&fit->grid, second, powers);
  const double *window = windows + start * ORDER * ORDER;
  for (int d = 0; d < 3; d++) weights_at(&fit->grid, d, powers, weights[d]);
  for (int d = 0; d < 3; d++) {
    double half[ORDER] = {0.0};
    for (int i = 0; i < ORDER; i++)
      for (int j = 0; j < ORDER; j++) half[j] += weights[d][i] * window[i * ORDER + j];
    for (int e = 0; e < 3; e++) {
      double sum = 0.0;
      for (int j = 0; j < ORDER; j++) sum += half[j] * weights[e][j];
      out[3 * d + e] = sum;
    }
  }
}

/* Values (3, M) of a column at M times: position, velocity, acceleration about the mean of the samples. */
POISE_EXPORT int64_t poise_smoother_at(struct smoother *s, int64_t column, int64_t count, const double *seconds,
                                       double *values) {
  int64_t place;
  const struct fit *fit = fit_of(s, column, s->chosen[column], &place);
  if (!fit) return s->status;
  for (int64_t n = 0; n < count; n++) {
    double found[3];
    derivatives(fit, place, seconds[n], found);
    for (int d = 0; d < 3; d++) values[d * count + n] = found[d];
  }
  return POISE_OK;
}

/* Covariance (count, 3, 3) of a column at the samples `first` to `first + count`, for the noise of its samples, and the
   squared lag (3,) of its spline behind a finer one at every `step`-th of the samples begin to end. */
POISE_EXPORT int64_t poise_smoother_covariance(struct smoother *s, int64_t column, int64_t first, int64_t count,
                                               int64_t finer, int64_t begin, int64_t end, int64_t step,
                                               double *covariance, double *lag) {
  int64_t place, other_place, checked = 0;
  int status = POISE_OK;
  const struct fit *fit = fit_of(s, column, s->chosen[column], &place);
  const struct fit *other = fit ? fit_of(s, column, finer, &other_place) : NULL;
  if (!other) return s->status;
  double *windows = inverse_windows(fit, &status), *other_windows = status ? NULL : inverse_windows(other, &status);
  const double sigma = fit_sigma(fit, place), other_sigma = fit_sigma(other, other_place);
  for (int64_t n = 0; n < count && !status; n++) {
    gain(fit, windows, s->seconds[first + n], covariance + 9 * n);
    for (int i = 0; i < 9; i++) covariance[9 * n + i] *= sigma * sigma;
  }
  lag[0] = lag[1] = lag[2] = 0.0;
  for (int64_t n = begin; n < end && !status; n += step, checked++) {
    double one[3], two[3], by_one[9], by_two[9];
    derivatives(fit, place, s->seconds[n], one);
    derivatives(other, other_place, s->seconds[n], two);
    gain(fit, windows, s->seconds[n], by_one);
    gain(other, other_windows, s->seconds[n], by_two);
    for (int d = 0; d < 3; d++) {
      const double excess = by_two[4 * d] * other_sigma * other_sigma - by_one[4 * d] * sigma * sigma;
      lag[d] += (one[d] - two[d]) * (one[d] - two[d]) - excess;
    }
  }
  for (int d = 0; d < 3; d++) lag[d] = checked ? fmax(lag[d] / (double)checked, 0.0) : NAN;
  free(windows);
  free(other_windows);
  return status;
}
