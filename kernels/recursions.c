/* Recursions from sample to sample; in Python: effects/part_motion.py of poise/mismatch. */
#include <math.h>

#include "poise_kernels.h"

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

enum { MOST_LINKS = 16, PROJECTIONS = 12 };

typedef struct {
  double at[3];
} vector;

static vector plus(vector a, double scale, vector b) {
  const vector out = {{a.at[0] + scale * b.at[0], a.at[1] + scale * b.at[1], a.at[2] + scale * b.at[2]}};
  return out;
}

static double dot3(vector a, vector b) { return a.at[0] * b.at[0] + a.at[1] * b.at[1] + a.at[2] * b.at[2]; }

static vector cross3(vector a, vector b) {
  const vector out = {{a.at[1] * b.at[2] - a.at[2] * b.at[1], a.at[2] * b.at[0] - a.at[0] * b.at[2],
                       a.at[0] * b.at[1] - a.at[1] * b.at[0]}};
  return out;
}

/* Move beads so that each is a link from the one above it, by forces along the links before the step (SHAKE): Newton's
 * method on all tensions at once, whose matrix has three bands. Bead 0 is the pivot. */
static void projected(int links, const double *square, const double *inverse, const vector *along, const vector *free,
                      vector *bead) {
  double tension[MOST_LINKS + 2] = {0.0}, lower[MOST_LINKS + 1], diagonal[MOST_LINKS + 1], upper[MOST_LINKS + 1];
  double right[MOST_LINKS + 1];
  for (int pass = 0; pass < PROJECTIONS; pass++) {
    double worst = 0.0;
    for (int i = 1; i <= links; i++) {
      bead[i] = plus(free[i], -inverse[i] * tension[i], along[i]);
      if (i < links) bead[i] = plus(bead[i], inverse[i] * tension[i + 1], along[i + 1]);
    }
    for (int i = 1; i <= links; i++) {
      const vector here = plus(bead[i], -1.0, bead[i - 1]);
      const double off = dot3(here, here) - square[i];
      worst = fabs(off) > worst * square[i] ? fabs(off) / square[i] : worst;
      right[i] = -off;
      diagonal[i] = -2.0 * (inverse[i] + inverse[i - 1]) * dot3(here, along[i]);
      lower[i] = i > 1 ? 2.0 * inverse[i - 1] * dot3(here, along[i - 1]) : 0.0;
      upper[i] = i < links ? 2.0 * inverse[i] * dot3(here, along[i + 1]) : 0.0;
    }
    if (worst < 1e-8) return;
    for (int i = 2; i <= links; i++) {
      const double share = lower[i] / diagonal[i - 1];
      diagonal[i] -= share * upper[i - 1];
      right[i] -= share * right[i - 1];
    }
    for (int i = links; i >= 1; i--) {
      right[i] = (right[i] - (i < links ? upper[i] * right[i + 1] : 0.0)) / diagonal[i];
      tension[i] += right[i];
    }
  }
  /* A link turns by more than a right angle in a step: each bead is put at its distance from the one above it. */
  for (int i = 1; i <= links; i++) {
    const vector here = plus(free[i], -1.0, bead[i - 1]);
    bead[i] = plus(bead[i - 1], sqrt(square[i] / fmax(dot3(here, here), 1e-300)), here);
  }
}

/* A rope of beads on rods from a pivot: centres of mass and directions of its first rod, (n, 3) each.
 * `lengths`, `masses` (links,) of each rod and of the bead at its lower end; `drive` (n, 3) m/s2 on every bead; `turn`
 * (n, 3) rad/s of the vessel; `damping` N m s/rad of each joint; `step` s. It begins straight along `start` (3,), at
 * rest. */
POISE_EXPORT void poise_rope(int64_t n, int64_t links, const double *lengths, const double *masses,
                             const double *start, const double *drive, const double *turn, double damping,
                             double step, double *centres, double *directions) {
  vector bead[MOST_LINKS + 1] = {{{0.0}}}, before[MOST_LINKS + 1], along[MOST_LINKS + 2], rate[MOST_LINKS + 2];
  vector free[MOST_LINKS + 1] = {{{0.0}}};
  double inverse[MOST_LINKS + 1] = {0.0}, square[MOST_LINKS + 1] = {0.0}, whole = 0.0;
  const int count = (int)links;
  for (int i = 1; i <= count; i++) {
    const vector down = {{start[0], start[1], start[2]}};
    bead[i] = plus(bead[i - 1], lengths[i - 1], down);
    square[i] = lengths[i - 1] * lengths[i - 1];
    inverse[i] = 1.0 / masses[i - 1];
    whole += masses[i - 1];
  }
  for (int i = 0; i <= count; i++) before[i] = bead[i];
  for (int64_t k = 0; k < n; k++) {
    const vector push = {{drive[3 * k], drive[3 * k + 1], drive[3 * k + 2]}};
    vector centre = {{0.0}};
    rate[0] = (vector){{turn[3 * k], turn[3 * k + 1], turn[3 * k + 2]}};
    for (int i = 1; i <= count; i++) {
      centre = plus(centre, masses[i - 1] / whole, bead[i]);
      along[i] = plus(bead[i], -1.0, bead[i - 1]);
      const vector old = plus(before[i], -1.0, before[i - 1]);
      const vector turned = cross3(along[i], plus(along[i], -1.0, old));
      rate[i] = plus((vector){{0.0}}, 1.0 / (step * square[i]), turned);
    }
    for (int i = 1; i <= count; i++) {
      const vector inertia = plus(plus(bead[i], 1.0, bead[i]), -1.0, before[i]);
      free[i] = plus(inertia, step * step, push);
    }
    for (int i = 1; i <= count; i++) {
      vector torque = plus(rate[i - 1], -1.0, rate[i]);
      if (i < count) torque = plus(plus(torque, 1.0, rate[i + 1]), -1.0, rate[i]);
      const vector couple = cross3(torque, along[i]);
      const double scale = damping * step * step / square[i];
      free[i] = plus(free[i], scale * inverse[i], couple);
      if (i > 1) free[i - 1] = plus(free[i - 1], -scale * inverse[i - 1], couple);
    }
    for (int axis = 0; axis < 3; axis++) {
      centres[3 * k + axis] = centre.at[axis];
      directions[3 * k + axis] = along[1].at[axis] / lengths[0];
    }
    for (int i = 1; i <= count; i++) before[i] = bead[i];
    projected(count, square, inverse, along, free, bead);
  }
}

/* Steps in a time in which a part stays at a stop, at the most. */
static const double MOST_STEPS = 1e4;
enum { HALVINGS = 24 }; /* of the time in which a contact ends */

/* Place and speed of a part along its axis. */
typedef struct {
  double x, v;
} part;

/* The part after a free flight of t seconds under a push that begins with `push` and grows by `rate`. */
static part flown(part at, double push, double rate, double t) {
  const part out = {at.x + t * (at.v + t * (push / 2.0 + rate * t / 6.0)), at.v + t * (push + rate * t / 2.0)};
  return out;
}

/* When a flight that ends beyond a stop at `side` times `half` meets it: by bisection, then Newton's method. */
static double met(part at, double push, double rate, double span, double side, double half) {
  double early = 0.0, late = span;
  for (int step = 0; step < 6; step++) {
    const double middle = (early + late) / 2.0;
    if (side * flown(at, push, rate, middle).x > half) late = middle;
    else early = middle;
  }
  for (int step = 0; step < 3; step++) {
    const part there = flown(at, push, rate, late);
    if (side * there.v <= 0.0) break;
    late -= (side * there.x - half) / (side * there.v);
    late = late < 0.0 ? 0.0 : late > span ? span : late;
  }
  return late;
}

/* The part after t seconds at the stop at `side` times `half`: a critically damped spring, exact. */
static part held(part at, double push, double rate, double t, double side, double half, double settling) {
  const double lag = settling * settling * rate, fade = exp(-t / settling);
  const double rest = side * half + settling * settling * push - 2.0 * settling * lag;
  const double away = at.x - rest, slope = at.v - lag + away / settling;
  const part out = {rest + lag * t + (away + slope * t) * fade, lag + (at.v - lag - slope * t / settling) * fade};
  return out;
}

/* The force of the stop at `side` times `half`, in units of 1 / settling; it pushes where it is positive. */
static double pushed(part at, double side, double half, double settling) {
  return (side * at.x - half) / settling + 2.0 * side * at.v;
}

/* The part after `span` seconds in which the push grows from `push` to `end`, between stops at +-`half`. */
static part advanced(part at, double push, double end, double span, double half, double settling) {
  const double rate = (end - push) / span, step = fmax(settling / 2.0, span / MOST_STEPS);
  for (double left = span; left > 0.0;) {
    const double side = at.x > 0.0 ? 1.0 : -1.0;
    double t = left < step ? left : step;
    if (side * at.x < half) {
      const part there = flown(at, push, rate, left);
      if (fabs(there.x) <= half) return there;
      const double stop = there.x > 0.0 ? 1.0 : -1.0;
      t = met(at, push, rate, left, stop, half);
      at = flown(at, push, rate, t), at.x = stop * half;
    } else {
      const int touches = pushed(at, side, half, settling) > 0.0;
      double early = 0.0;
      for (int halving = 0; halving <= HALVINGS; halving++) { /* until the contact ends, or begins again */
        const double middle = halving ? (early + t) / 2.0 : t;
        const part there =
            touches ? held(at, push, rate, middle, side, half, settling) : flown(at, push, rate, middle);
        const int changed = side * there.x > half && (pushed(there, side, half, settling) > 0.0) != touches;
        if (changed) t = middle;
        else if (halving) early = middle;
        else break;
      }
      at = touches ? held(at, push, rate, t, side, half, settling) : flown(at, push, rate, t);
    }
    push += rate * t, left -= t;
  }
  return at;
}

/* Position, velocity and acceleration (3, n) of a part between two stops, `gap` apart, under a push (n,). It begins at
   rest. The acceleration is averaged over `blur` on either side of a stamp. */
POISE_EXPORT void poise_between_stops(int64_t n, const double *seconds, const double *push, double gap, double settling,
                                      double blur, double *motion) {
  const double half = gap / 2.0;
  part at = {(push[0] >= 0.0 ? half : -half) + push[0] * settling * settling, 0.0};
  double since = 0.0, before = 0.0;
  for (int64_t i = 0; i < n; i++) {
    motion[i] = at.x, motion[n + i] = at.v;
    if (i == n - 1) {
      motion[2 * n + i] = since > 0.0 ? (at.v - before) / since : 0.0;
      return;
    }
    const double span = seconds[i + 1] - seconds[i], near = span < 2.0 * blur ? span / 2.0 : blur;
    const double rate = (push[i + 1] - push[i]) / span, first = push[i] + rate * near, last = push[i + 1] - rate * near;
    at = advanced(at, push[i], first, near, half, settling);
    motion[2 * n + i] = (at.v - before) / (since + near);
    if (span > 2.0 * near) at = advanced(at, first, last, span - 2.0 * near, half, settling);
    before = at.v, since = near;
    at = advanced(at, last, push[i + 1], near, half, settling);
  }
}
