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
static const double LENGTH_ERROR = 1e-8; /* of a link's square, relative */

/* A vector for each link. */
typedef struct {
  double at[3][MOST_LINKS];
} vectors;

/* Links (above each bead) of beads (below each link); the first link begins at the pivot, the origin. */
static POISE_INLINE void linked(int links, const vectors *bead, vectors *link) {
  for (int axis = 0; axis < 3; axis++) {
    link->at[axis][0] = bead->at[axis][0];
    for (int i = 1; i < links; i++) link->at[axis][i] = bead->at[axis][i] - bead->at[axis][i - 1];
  }
}

static POISE_INLINE double dot_of(const vectors *a, int i, const vectors *b, int j) {
  return a->at[0][i] * b->at[0][j] + a->at[1][i] * b->at[1][j] + a->at[2][i] * b->at[2][j];
}

static POISE_INLINE void crossed(int links, const vectors *a, const vectors *b, vectors *out) {
  for (int i = 0; i < links; i++) {
    out->at[0][i] = a->at[1][i] * b->at[2][i] - a->at[2][i] * b->at[1][i];
    out->at[1][i] = a->at[2][i] * b->at[0][i] - a->at[0][i] * b->at[2][i];
    out->at[2][i] = a->at[0][i] * b->at[1][i] - a->at[1][i] * b->at[0][i];
  }
}

/* Solve three bands from both ends to the middle, as divisions that wait for each other take most of the time. `lower`
 * and `upper` are the entries beside the diagonal in each row. The solution is in `right`. */
static POISE_INLINE void solved(int links, const double *lower, double *diagonal, const double *upper, double *right) {
  const int low = (links - 1) / 2, high = links - 1; /* rows low and low + 1 meet */
  double inverse[MOST_LINKS];
  for (int i = 0; i < low; i++) {
    inverse[i] = 1.0 / diagonal[i];
    const double share = lower[i + 1] * inverse[i];
    diagonal[i + 1] -= share * upper[i];
    right[i + 1] -= share * right[i];
  }
  for (int i = high; i > low + 1; i--) {
    inverse[i] = 1.0 / diagonal[i];
    const double share = upper[i - 1] * inverse[i];
    diagonal[i - 1] -= share * lower[i];
    right[i - 1] -= share * right[i];
  }
  if (links == 1) {
    right[0] /= diagonal[0];
    return;
  }
  const double whole = 1.0 / (diagonal[low] * diagonal[low + 1] - upper[low] * lower[low + 1]);
  const double above = (right[low] * diagonal[low + 1] - upper[low] * right[low + 1]) * whole;
  right[low + 1] = (right[low + 1] * diagonal[low] - lower[low + 1] * right[low]) * whole;
  right[low] = above;
  for (int i = low - 1; i >= 0; i--) right[i] = (right[i] - upper[i] * right[i + 1]) * inverse[i];
  for (int i = low + 2; i <= high; i++) right[i] = (right[i] - lower[i] * right[i - 1]) * inverse[i];
}

/* Move beads, which are free at first, so that each is a link from the one above it, by forces along the links before
 * the step (SHAKE): Newton's method on all tensions at once, whose matrix has three bands. */
static POISE_INLINE void projected(int links, const double *square, const double *inverse, const vectors *along,
                                   vectors *bead) {
  vectors link, free;
  double lower[MOST_LINKS], diagonal[MOST_LINKS], upper[MOST_LINKS], right[MOST_LINKS];
  for (int axis = 0; axis < 3; axis++)
    for (int i = 0; i < links; i++) free.at[axis][i] = bead->at[axis][i];
  linked(links, bead, &link);
  for (int pass = 0;; pass++) {
    int off = 0;
    for (int i = 0; i < links; i++) {
      right[i] = square[i] - dot_of(&link, i, &link, i);
      off |= fabs(right[i]) >= LENGTH_ERROR * square[i];
    }
    if (!off) return;
    if (pass == PROJECTIONS) break;
    for (int i = 0; i < links; i++) {
      diagonal[i] = -2.0 * (inverse[i] + (i ? inverse[i - 1] : 0.0)) * dot_of(&link, i, along, i);
      lower[i] = i ? 2.0 * inverse[i - 1] * dot_of(&link, i, along, i - 1) : 0.0;
      upper[i] = i < links - 1 ? 2.0 * inverse[i] * dot_of(&link, i, along, i + 1) : 0.0;
    }
    solved(links, lower, diagonal, upper, right);
    for (int axis = 0; axis < 3; axis++) {
      for (int i = 0; i < links; i++) {
        const double below = i < links - 1 ? right[i + 1] * along->at[axis][i + 1] : 0.0;
        bead->at[axis][i] += inverse[i] * (below - right[i] * along->at[axis][i]);
      }
    }
    linked(links, bead, &link);
  }
  /* A link turns by more than a right angle in a step: each bead is put at its distance from the one above it. */
  for (int i = 0; i < links; i++) {
    double here[3], apart = 0.0;
    for (int axis = 0; axis < 3; axis++) {
      here[axis] = free.at[axis][i] - (i ? bead->at[axis][i - 1] : 0.0);
      apart += here[axis] * here[axis];
    }
    const double scale = sqrt(square[i] / fmax(apart, 1e-300));
    for (int axis = 0; axis < 3; axis++) bead->at[axis][i] = (i ? bead->at[axis][i - 1] : 0.0) + scale * here[axis];
  }
}

/* Displacements (3, links) in a step, times the masses, of the couples of damped joints; `damping` (links,) is that
 * displacement of a bead for a couple on its link. `turn` (3,) is that of the vessel, `turned` what links turn by. */
static POISE_INLINE void damped(int links, const vectors *along, const vectors *turned, const double *turn,
                                const double *damping, vectors *moved) {
  vectors bend, couple;
  for (int axis = 0; axis < 3; axis++)
    for (int i = 0; i < links; i++) {
      const double above = (i ? turned->at[axis][i - 1] : turn[axis]) - turned->at[axis][i];
      const double below = i < links - 1 ? turned->at[axis][i] - turned->at[axis][i + 1] : 0.0;
      bend.at[axis][i] = damping[i] * (above - below);
    }
  crossed(links, &bend, along, &couple);
  for (int axis = 0; axis < 3; axis++)
    for (int i = 0; i < links; i++)
      moved->at[axis][i] = couple.at[axis][i] - (i < links - 1 ? couple.at[axis][i + 1] : 0.0);
}

/* A signal of vectors (n, 3) at ascending times, linear between them and constant beyond; it is asked forwards. */
typedef struct {
  int64_t n, at;
  const double *seconds, *values;
} signal3;

static POISE_INLINE void followed(signal3 *from, double time, double out[3]) {
  while (from->at < from->n - 1 && from->seconds[from->at + 1] <= time) from->at++;
  const double *here = from->values + 3 * from->at, since = time - from->seconds[from->at];
  const int inside = from->at < from->n - 1 && since > 0.0;
  const double share = inside ? since / (from->seconds[from->at + 1] - from->seconds[from->at]) : 0.0;
  for (int axis = 0; axis < 3; axis++) out[axis] = here[axis] + (inside ? share * (here[axis + 3] - here[axis]) : 0.0);
}

/* One step of a rope: its centre of mass, the direction of its first link, and the rate of the vessel. */
typedef struct {
  double centre[3], first[3], turn[3];
} rope_step;

/* Force and couple (6,) of a rope of 1 kg at `here`; `before` and `after` are `apart` steps from each other. */
static POISE_INLINE void felt(const rope_step *before, const rope_step *here, const rope_step *after, double apart,
                              double step, double damping, double *out) {
  const double *f = here->first, *w = here->turn;
  const double along = f[0] * w[0] + f[1] * w[1] + f[2] * w[2];
  double rate[3];
  for (int axis = 0; axis < 3; axis++) {
    rate[axis] = (after->first[axis] - before->first[axis]) / (apart * step);
    out[axis] = -(after->centre[axis] - 2.0 * here->centre[axis] + before->centre[axis]) / (step * step);
  }
  for (int axis = 0; axis < 3; axis++) {
    const int next = (axis + 1) % 3, last = (axis + 2) % 3;
    out[3 + axis] = damping * (f[next] * rate[last] - f[last] * rate[next] - (w[axis] - f[axis] * along));
  }
}

/* What is asked for: force and couple (n, 6) at times; `row`: those at two steps, `steps`: the last three. */
typedef struct {
  int64_t n, written;
  const double *seconds;
  double *out, step, damping, row[2][6];
  rope_step steps[3];
} answer;

/* Write what lies before step `k`, between two rows. */
static POISE_INLINE void write_before(answer *to, int64_t k) {
  const double begin = to->seconds[0] + (double)(k - 1) * to->step;
  for (; to->written < to->n && to->seconds[to->written] < begin + to->step; to->written++)
    for (int i = 0; i < 6; i++)
      to->out[6 * to->written + i] =
          to->row[0][i] + (to->row[1][i] - to->row[0][i]) * ((to->seconds[to->written] - begin) / to->step);
}

/* Step `k` shows the row of the step before it. The first row has the second difference of the next one. */
static POISE_INLINE void write_row(answer *to, int64_t k) {
  if (k == 0) return;
  for (int i = 0; i < 6; i++) to->row[0][i] = to->row[1][i];
  felt(to->steps + (k > 1 ? 0 : 1), to->steps + 1, to->steps + 2, k > 1 ? 2.0 : 1.0, to->step, to->damping, to->row[1]);
  for (int i = 0; i < 3; i++) {
    if (k == 1) to->row[1][i] = 0.0;
    if (k == 2) to->row[0][i] = to->row[1][i];
  }
  if (k > 1) write_before(to, k - 1);
}

/* The last row has the second difference of the one before it, and is held. */
static POISE_INLINE void write_end(answer *to, int64_t count) {
  for (int i = 0; i < 6; i++) to->row[0][i] = to->row[1][i];
  felt(to->steps + 1, to->steps + 2, to->steps + 2, 1.0, to->step, to->damping, to->row[1]);
  for (int i = 0; i < 3; i++) to->row[1][i] = to->row[0][i];
  write_before(to, count - 1);
  for (; to->written < to->n; to->written++)
    for (int i = 0; i < 6; i++) to->out[6 * to->written + i] = to->row[1][i];
}

/* See poise_rope, which has this twice: the compiler unrolls the loops over a number of links that it knows. */
static POISE_INLINE void hung(int links, const double *lengths, const double *masses, signal3 drives, signal3 turns,
                              int64_t count, answer *to) {
  vectors bead, before, along, old, change, turned, moved;
  double inverse[MOST_LINKS], square[MOST_LINKS], share[MOST_LINKS], rate[MOST_LINKS], held[MOST_LINKS], whole = 0.0;
  const double step = to->step, *start = drives.values;
  const double pulled = sqrt(start[0] * start[0] + start[1] * start[1] + start[2] * start[2]);
  for (int i = 0; i < links; i++) {
    square[i] = lengths[i] * lengths[i];
    inverse[i] = 1.0 / masses[i];
    rate[i] = 1.0 / (step * square[i]);
    held[i] = to->damping * step * step / square[i];
    whole += masses[i];
    for (int axis = 0; axis < 3; axis++) {
      old.at[axis][i] = lengths[i] * (start[axis] / pulled);
      before.at[axis][i] = bead.at[axis][i] = (i ? bead.at[axis][i - 1] : 0.0) + old.at[axis][i];
    }
  }
  for (int i = 0; i < links; i++) share[i] = masses[i] / whole;
  for (int64_t k = 0; k < count; k++) {
    rope_step *now = to->steps + 2;
    double drive[3];
    to->steps[0] = to->steps[1], to->steps[1] = to->steps[2];
    followed(&drives, to->seconds[0] + (double)k * step, drive);
    followed(&turns, to->seconds[0] + (double)k * step, now->turn);
    linked(links, &bead, &along);
    for (int axis = 0; axis < 3; axis++) {
      now->centre[axis] = 0.0;
      for (int i = 0; i < links; i++) {
        now->centre[axis] += share[i] * bead.at[axis][i];
        change.at[axis][i] = along.at[axis][i] - old.at[axis][i];
      }
      now->first[axis] = along.at[axis][0] / lengths[0];
    }
    crossed(links, &along, &change, &turned);
    for (int axis = 0; axis < 3; axis++)
      for (int i = 0; i < links; i++) turned.at[axis][i] *= rate[i];
    damped(links, &along, &turned, now->turn, held, &moved);
    for (int axis = 0; axis < 3; axis++)
      for (int i = 0; i < links; i++) {
        const double here = bead.at[axis][i];
        const double onward = here + here - before.at[axis][i] + step * step * drive[axis];
        bead.at[axis][i] = onward + inverse[i] * moved.at[axis][i];
        before.at[axis][i] = here;
        old.at[axis][i] = along.at[axis][i];
      }
    projected(links, square, inverse, &along, &bead);
    write_row(to, k);
  }
  write_end(to, count);
}

enum { USUAL_LINKS = 4 };

/* Force and couple (n, 6) on its pivot of a rope of beads on rods, of 1 kg in all, beside those of that mass at the
 * pivot. `lengths`, `masses` (links,) of each rod and of the bead at its lower end; `pull` (n, 3) m/s2 on every bead
 * and `rates` (n, 3) rad/s of the vessel, linear between the `seconds` (n,); `damping` N m s/rad of each joint;
 * `count` steps, 2 at least. It begins straight along the pull, at rest. */
POISE_EXPORT POISE_WIDE void poise_rope(int64_t n, int64_t links, const double *lengths, const double *masses,
                                        const double *seconds, const double *pull, const double *rates, double damping,
                                        int64_t count, double *out) {
  const signal3 drives = {n, 0, seconds, pull}, turns = {n, 0, seconds, rates};
  const double step = (seconds[n - 1] - seconds[0]) / (double)(count - 1);
  answer to = {n, 0, seconds, out, step, damping, {{0.0}}, {{{0.0}, {0.0}, {0.0}}}};
  if (links == USUAL_LINKS) hung(USUAL_LINKS, lengths, masses, drives, turns, count, &to);
  else hung((int)links, lengths, masses, drives, turns, count, &to);
}

/* Steps in a time in which a part stays at a stop, at the most. */
static const double MOST_STEPS = 1e4;
enum { HALVINGS = 24 }; /* of the time in which a contact ends */
/* Times that dry friction stops or releases a part in one step, at the most: rounding could do it again and again. */
static const double MOST_TURNS = 1e3;
/* Share of half a gap by which a part that rests at a stop may move without another contact: rounding ends each
   contact at once there, and begins the next. */
static const double RESTS = 1e-9;

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

/* What acts on a part: its push, and the largest deceleration by dry friction. */
typedef struct {
  double push, drag;
} load;

/* `from`, and what it gains by `rate` in t seconds. */
static load after(load from, load rate, double t) {
  const load out = {from.push + rate.push * t, from.drag + rate.drag * t};
  return out;
}

/* How long dry friction holds a part at rest against `force`, which grows as the push does; infinity for ever. `sense`
   becomes the direction in which it starts. */
static double stuck(double force, load now, load rate, double *sense) {
  if (fabs(force) > now.drag) return *sense = force > 0.0 ? 1.0 : -1.0, 0.0;
  double soonest = INFINITY;
  for (double way = 1.0; way >= -1.0; way -= 2.0) {
    const double opens = way * rate.push - rate.drag, time = (now.drag - way * force) / opens;
    if (opens > 0.0 && time < soonest) soonest = time, *sense = way;
  }
  return soonest;
}

/* When the speed of a flight first vanishes after its begin; `span` where it does not before. */
static double turned(double v, double push, double rate, double span) {
  const double square = push * push - 2.0 * rate * v, sum = -(push + copysign(sqrt(fmax(square, 0.0)), push));
  if (square < 0.0) return span;
  const double one = rate != 0.0 ? sum / rate : span, other = sum != 0.0 ? 2.0 * v / sum : span;
  double soonest = span;
  if (one > 0.0 && one < soonest) soonest = one;
  if (other > 0.0 && other < soonest) soonest = other;
  return soonest;
}

/* How long, up to `most`, one law holds for a part in the stop at `side` times `half`: until the contact ends, or begins
   again, or dry friction has stopped the part (`sense` is 0 without friction). `at` becomes the part then. */
static double touched(part *at, double push, double rate, double most, double side, double half, double settling,
                      double sense) {
  const part begin = *at;
  const int touches = pushed(begin, side, half, settling) > 0.0;
  double early = 0.0, t = most;
  for (int halving = 0; halving <= HALVINGS; halving++) {
    const double middle = halving ? (early + t) / 2.0 : t;
    const part there =
        touches ? held(begin, push, rate, middle, side, half, settling) : flown(begin, push, rate, middle);
    const int turns = sense != 0.0 && sense * there.v <= 0.0;
    if (turns || (side * there.x > half && (pushed(there, side, half, settling) > 0.0) != touches)) t = middle;
    else if (halving) early = middle;
    else break;
  }
  *at = touches ? held(begin, push, rate, t, side, half, settling) : flown(begin, push, rate, t);
  if (sense != 0.0 && sense * at->v <= 0.0) at->v = 0.0;
  return t;
}

/* The part after `span` seconds in which its load changes from `now` to `end`, between stops at +-`half`. */
static part advanced(part at, load now, load end, double span, double half, double settling) {
  const load rate = {(end.push - now.push) / span, (end.drag - now.drag) / span};
  const int rubs = now.drag > 0.0 || rate.drag > 0.0;
  const double step = fmax(settling / 2.0, span / MOST_STEPS);
  for (double left = span, t; left > 0.0; now = after(now, rate, t), left -= t) {
    const double side = at.x > 0.0 ? 1.0 : -1.0;
    const double moves = left * (fabs(at.v) + left * fmax(fabs(now.push), fabs(end.push)));
    if (fabs(side * at.x - half) + moves < RESTS * half) return flown(at, now.push, rate.push, left);
    double sense = !rubs || at.v == 0.0 ? 0.0 : at.v > 0.0 ? 1.0 : -1.0;
    if (rubs && at.v == 0.0) {
      const double stop = side * fmax(side * at.x - half, 0.0) / (settling * settling);
      t = stuck(now.push - stop, now, rate, &sense);
      if (t > 0.0) {
        t = fmin(fmax(t, span / MOST_TURNS), left);
        continue;
      }
    }
    const double push = now.push - sense * now.drag, growth = rate.push - sense * rate.drag;
    if (side * at.x < half) {
      const double turn = rubs ? turned(at.v, push, growth, left) : left;
      part there = flown(at, push, growth, turn);
      if (fabs(there.x) <= half) {
        if (turn >= left) return there;
        t = turn, at.x = there.x, at.v = 0.0;
      } else {
        const double stop = there.x > 0.0 ? 1.0 : -1.0;
        t = met(at, push, growth, turn, stop, half);
        at = flown(at, push, growth, t), at.x = stop * half;
      }
    } else {
      t = touched(&at, push, growth, left < step ? left : step, side, half, settling, sense);
      if (rubs && at.v == 0.0) t = fmax(t, span / MOST_TURNS);
    }
  }
  return at;
}

/* Position, velocity and acceleration (3, n) of a part between two stops, `gap` apart, under a push (n,) and with dry
   friction of at most `drag` (n,), or none if it is null. It begins at rest. The acceleration is averaged over `blur` on
   either side of a stamp. */
POISE_EXPORT void poise_between_stops(int64_t n, const double *seconds, const double *push, const double *drag,
                                      double gap, double settling, double blur, double *motion) {
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
    const load begin = {push[i], drag ? drag[i] : 0.0}, end = {push[i + 1], drag ? drag[i + 1] : 0.0};
    const load rate = {(end.push - begin.push) / span, (end.drag - begin.drag) / span};
    const load first = after(begin, rate, near), last = after(end, rate, -near);
    at = advanced(at, begin, first, near, half, settling);
    motion[2 * n + i] = (at.v - before) / (since + near);
    if (span > 2.0 * near) at = advanced(at, first, last, span - 2.0 * near, half, settling);
    before = at.v, since = near;
    at = advanced(at, last, end, near, half, settling);
  }
}
