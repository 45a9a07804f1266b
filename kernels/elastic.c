/* Elastic contacts of a block of bodies: damped Newton steps; `CoulombBlock._descend` in
   poise/assembly/statics/coulomb.py. */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bodies.h"

static const double SPARE = 1e-9, LITTLE = 1e-4, MOST_DAMPING = 10.0, FORGOTTEN = 1e-7,
                    NEARLY = 1e4, GAINS = 0.7, GOOD = 0.5;
enum { PATIENCE = 4, LENGTHS = 5, AGAIN = 2 };

/* The springs of all pairs, one pair after another. */
struct elastic {
  struct bodies bodies;
  const int64_t *springs;    /* (pairs + 1) first spring of each pair */
  const double *wrenches;    /* (springs, 3, 6) of unit forces along the normal and two tangents */
  const double *stiffness;   /* (springs) */
  const double *friction;    /* (springs) */
  double catch, slack;       /* stiffness that holds every body; by how much nothing presses */
};

static double seconds(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int64_t springs_of(const struct elastic *contacts) { return contacts->springs[contacts->bodies.pairs]; }

/* out (springs, 3) = motion of the second body relative to the first at each spring */
POISE_WIDE static void spring_motions(const struct elastic *contacts, const double *u, double *restrict out) {
  for (int64_t pair = 0; pair < contacts->bodies.pairs; pair++) {
    double motion[SIDE];
    relative_motion(&contacts->bodies, pair, u, motion);
    for (int64_t row = 3 * contacts->springs[pair]; row < 3 * contacts->springs[pair + 1]; row++) {
      const double *wrench = contacts->wrenches + SIDE * row;
      double sum = 0.0;
      for (int i = 0; i < SIDE; i++) sum += wrench[i] * motion[i];
      out[row] = sum;
    }
  }
}

/* Force (3) of a spring; friction is limited by `bound`, or by Coulomb's law where that is NULL. */
static POISE_INLINE void spring_force(const struct elastic *contacts, int64_t p, const double *motion, const double *bound,
                         double *force) {
  const double k = contacts->stiffness[p];
  for (int i = 0; i < 3; i++) force[i] = -k * motion[i];
  if (!(force[0] > 0.0)) {
    force[0] = 0.0;
    if (!bound) { /* open: no friction either */
      force[1] = force[2] = 0.0;
      return;
    }
  }
  const double limit = bound ? bound[p] : contacts->friction[p] * force[0];
  const double square = force[1] * force[1] + force[2] * force[2];
  if (square > limit * limit) {
    const double share = limit / sqrt(square);
    force[1] *= share;
    force[2] *= share;
  }
}

/* out (6 n) = what springs and catch leave of a load, negated */
POISE_WIDE static void left_over(const struct elastic *contacts, const double *u, const double *load, const double *relative,
                      const double *bounds, double *restrict out) {
  for (int64_t i = 0; i < SIDE * contacts->bodies.count; i++) out[i] = contacts->catch * u[i] - load[i];
  for (int64_t pair = 0; pair < contacts->bodies.pairs; pair++) {
    double total[SIDE] = {0.0};
    for (int64_t p = contacts->springs[pair]; p < contacts->springs[pair + 1]; p++) {
      double force[3];
      spring_force(contacts, p, relative + 3 * p, bounds, force);
      for (int i = 0; i < 3; i++)
        for (int j = 0; j < SIDE; j++) total[j] -= force[i] * contacts->wrenches[SIDE * (3 * p + i) + j];
    }
    add_wrench(&contacts->bodies, pair, total, out);
  }
}

static double energy(const struct elastic *contacts, const double *u, const double *load, const double *relative,
                     const double *bounds) {
  double sum = 0.0;
  for (int64_t p = 0; p < springs_of(contacts); p++) {
    const double *motion = relative + 3 * p, k = contacts->stiffness[p], bound = bounds[p];
    const double slide = sqrt(motion[1] * motion[1] + motion[2] * motion[2]);
    if (motion[0] < 0.0) sum += k * motion[0] * motion[0] / 2.0;
    sum += k * slide <= bound ? k * slide * slide / 2.0 : bound * slide - bound * bound / (2.0 * k);
  }
  for (int64_t i = 0; i < SIDE * contacts->bodies.count; i++)
    sum += (contacts->catch * u[i] / 2.0 - load[i]) * u[i];
  return sum;
}

/* The derivative of a spring's force (3, 3), negated: what opens keeps a trace of stiffness. Without a motion, nothing
   opens or slips. */
static POISE_INLINE void spring_stiffness(const struct elastic *contacts, int64_t p, const double *motion, const double *bounds,
                             double damping, double own[3][3]) {
  memset(own, 0, 9 * sizeof(double));
  if (!motion) {
    own[0][0] = own[1][1] = own[2][2] = contacts->stiffness[p];
    return;
  }
  const double k = contacts->stiffness[p], slide = sqrt(motion[1] * motion[1] + motion[2] * motion[2]);
  const int closed = motion[0] <= 0.0;
  const double limit = bounds ? bounds[p] : contacts->friction[p] * fmax(-k * motion[0], 0.0);
  const int slips = k * slide > limit;
  own[0][0] = ((closed ? 1.0 : SPARE) + damping) * k;
  const double sticking = (slips ? damping : 1.0 + damping) * k;
  own[1][1] = own[2][2] = sticking;
  if (!slips) return;
  const double first = slide > 0.0 ? motion[1] / slide : 0.0, second = slide > 0.0 ? motion[2] / slide : 0.0;
  const double across = limit / (slide > 0.0 ? slide : 1.0);
  own[1][1] += across * second * second;
  own[2][2] += across * first * first;
  own[1][2] = own[2][1] = -across * first * second;
  if (bounds || !closed) return;
  own[1][0] = -contacts->friction[p] * k * first;
  own[2][0] = -contacts->friction[p] * k * second;
}

POISE_WIDE static void assemble(const struct elastic *contacts, const double *relative, const double *bounds, double damping,
                     struct body_matrix *matrix) {
  const int64_t last = springs_of(contacts) - 1;
  double last_wrench[3 * SIDE + BEYOND] = {0.0};
  if (last >= 0) memcpy(last_wrench, contacts->wrenches + 3 * SIDE * last, 3 * SIDE * sizeof(double));
  bodies_clear(&contacts->bodies, matrix, contacts->catch);
  for (int64_t pair = 0; pair < contacts->bodies.pairs; pair++) {
    row_of_block total[SIDE] = {{0.0}};
    double stiffness[BLOCK];
    for (int64_t p = contacts->springs[pair]; p < contacts->springs[pair + 1]; p++) {
      const double *wrench = p == last ? last_wrench : contacts->wrenches + 3 * SIDE * p;
      double own[3][3];
      row_of_block unit[3], rows[3];
      for (int i = 0; i < 3; i++) read_row(wrench + SIDE * i, unit + i);
      spring_stiffness(contacts, p, relative ? relative + 3 * p : NULL, bounds, damping, own);
      for (int i = 0; i < 3; i++) rows[i] = own[i][0] * unit[0] + own[i][1] * unit[1] + own[i][2] * unit[2];
      for (int i = 0; i < SIDE; i++)
        total[i] += wrench[i] * rows[0] + wrench[SIDE + i] * rows[1] + wrench[2 * SIDE + i] * rows[2];
    }
    put_rows(total, stiffness);
    bodies_add(&contacts->bodies, matrix, pair, stiffness);
  }
}

/* Room for the vectors of Newton steps. */
struct steps {
  struct body_matrix matrix;
  double *rest, *step, *along, *there_u, *relative, *moved, *there, *room;
  int64_t *whole;
};

static int make_room(const struct elastic *contacts, struct steps *made) {
  const int64_t size = SIDE * contacts->bodies.count, springs = springs_of(contacts);
  const int64_t matrix = bodies_room(&contacts->bodies, 0);
  made->room = malloc(sizeof(double) * (size_t)(matrix + 4 * size + 9 * springs));
  made->whole = malloc(sizeof(int64_t) * (size_t)(7 * contacts->bodies.count));
  if (!made->room || !made->whole) return POISE_NO_MEMORY;
  made->matrix = bodies_laid_out(&contacts->bodies, 0, made->room, made->whole);
  made->rest = made->room + matrix;
  made->step = made->rest + size;
  made->along = made->step + size;
  made->there_u = made->along + size;
  made->relative = made->there_u + size;
  made->moved = made->relative + 3 * springs;
  made->there = made->moved + 3 * springs;
  return POISE_OK;
}

static double dot(const double *a, const double *b, int64_t count) {
  double sum = 0.0;
  for (int64_t i = 0; i < count; i++) sum += a[i] * b[i];
  return sum;
}

/* What is to be found: u under a load; with friction bounds, or at a share of a push that u decides. */
struct aim {
  const double *load, *bounds, *push;
  double push_square, factor; /* of the push, which leaves the least */
  double compliance;          /* power of the push on its own change of u, in the last step */
};

/* What is left at u, and its size, or the energy where friction has bounds. */
static double merit_at(const struct elastic *contacts, struct aim *aim, const double *u, const double *relative,
                       double *rest) {
  const int64_t size = SIDE * contacts->bodies.count;
  if (aim->bounds) return energy(contacts, u, aim->load, relative, aim->bounds);
  left_over(contacts, u, aim->load, relative, NULL, rest);
  if (aim->push) {
    aim->factor = dot(aim->push, rest, size) / aim->push_square;
    for (int64_t i = 0; i < size; i++) rest[i] -= aim->factor * aim->push[i];
  }
  return sqrt(dot(rest, rest, size));
}

static double merit_along(const struct elastic *contacts, struct aim *aim, struct steps *made, const double *u,
                          double length) {
  const int64_t size = SIDE * contacts->bodies.count, springs = springs_of(contacts);
  for (int64_t i = 0; i < size; i++) made->there_u[i] = u[i] + length * made->step[i];
  for (int64_t i = 0; i < 3 * springs; i++) made->there[i] = made->relative[i] + length * made->moved[i];
  return merit_at(contacts, aim, made->there_u, made->there, made->rest);
}

/* How long a step from u, of merit `value`, is best: the first length that halves what is left (of an energy: that
   lessens it), otherwise the best one of those tried. The place it leads to is left in `made`. */
static void search_line(const struct elastic *contacts, struct aim *aim, struct steps *made, const double *u,
                        double value, double *best, double *least) {
  const double good = aim->bounds ? value : GOOD * value;
  double length = 1.0;
  *least = INFINITY;
  *best = 0.0;
  for (int tried = 0; tried < LENGTHS; tried++, length /= 2.0) {
    const double new = merit_along(contacts, aim, made, u, length);
    if (new < *least) {
      *least = new;
      *best = length;
    }
    if (new < good) return;
  }
  if (*least < value) merit_along(contacts, aim, made, u, *best);
}

/* u (6 n) moves by damped Newton steps that lessen the merit; the power of a push on u does not change. */
static void newton(const struct elastic *contacts, struct aim *aim, struct steps *made, double enough, int64_t steps,
                  double time, double *u, double *value, int64_t *taken) {
  const int64_t size = SIDE * contacts->bodies.count, springs = springs_of(contacts);
  const double end = time < 0.0 ? INFINITY : seconds() + time;
  double damping = 0.0, earlier = INFINITY;
  int stale = 0, full = 0;
  spring_motions(contacts, u, made->relative);
  for (int64_t p = 0; p < springs; p++) made->relative[3 * p] += contacts->slack;
  *value = merit_at(contacts, aim, u, made->relative, made->rest);
  for (*taken = 0; *taken < steps; ++*taken) {
    if (aim->bounds) left_over(contacts, u, aim->load, made->relative, aim->bounds, made->rest);
    if (sqrt(dot(made->rest, made->rest, size)) <= enough || (end < INFINITY && seconds() >= end)) break;
    if (aim->push && *value <= NEARLY * enough) { /* where all slides, rounding soon leaves no more to gain */
      stale = *value > GAINS * earlier ? stale + 1 : 0;
      if (stale == PATIENCE) break;
      earlier = fmin(earlier, *value);
    }
    assemble(contacts, made->relative, aim->bounds, damping, &made->matrix);
    if (bodies_factor(&contacts->bodies, &made->matrix)) {
      damping = fmax(10.0 * damping, LITTLE);
      if (damping > MOST_DAMPING) break;
      continue;
    }
    for (int64_t i = 0; i < size; i++) made->step[i] = -made->rest[i];
    bodies_solve(&contacts->bodies, &made->matrix, made->step);
    if (aim->push) {
      memcpy(made->along, aim->push, sizeof(double) * (size_t)size);
      bodies_solve(&contacts->bodies, &made->matrix, made->along);
      aim->compliance = dot(aim->push, made->along, size);
      const double share = dot(aim->push, made->step, size) / aim->compliance;
      for (int64_t i = 0; i < size; i++) made->step[i] -= share * made->along[i];
    }
    spring_motions(contacts, made->step, made->moved);
    const double factor = aim->factor;
    double length, new;
    search_line(contacts, aim, made, u, *value, &length, &new);
    if (new < *value) {
      memcpy(u, made->there_u, sizeof(double) * (size_t)size);
      memcpy(made->relative, made->there, sizeof(double) * (size_t)(3 * springs));
      *value = new;
      full = length == 1.0 ? full + 1 : 0;
      if (full >= AGAIN || (full && damping <= LITTLE)) damping = damping > FORGOTTEN ? damping / 10.0 : 0.0;
    } else {
      full = 0;
      aim->factor = factor;
      damping = fmax(10.0 * damping, LITTLE);
      if (damping > MOST_DAMPING) break;
      if (!aim->bounds) merit_at(contacts, aim, u, made->relative, made->rest);
    }
  }
}

/* u (6 n) moves by damped Newton steps that lessen what is left, or the energy where friction has bounds (springs).
   Bodies in the order of elimination. `time` is negative without a deadline. Returns a status; `taken` steps. */
POISE_EXPORT int64_t poise_elastic_descend(const struct elastic *contacts, const double *load, const double *bounds,
                                           double enough, int64_t steps, double time, double *u, int64_t *taken) {
  struct steps made = {0};
  struct aim aim = {.load = load, .bounds = bounds};
  double value;
  int status = make_room(contacts, &made);
  if (!status) newton(contacts, &aim, &made, enough, steps, time, u, &value, taken);
  free(made.room);
  free(made.whole);
  return status;
}

/* u (6 n), of which the power of the push (6 n) does not change, becomes an equilibrium under load + factor push.
   `found` (3) is the factor, the size of what is left, and the power of the push on the change of u by it. */
POISE_EXPORT int64_t poise_elastic_reach(const struct elastic *contacts, const double *load, const double *push,
                                         double enough, int64_t steps, double time, double *u, double *found,
                                         int64_t *taken) {
  struct steps made = {0};
  struct aim aim = {.load = load, .push = push};
  aim.push_square = dot(push, push, SIDE * contacts->bodies.count);
  int status = make_room(contacts, &made);
  if (!status) newton(contacts, &aim, &made, enough, steps, time, u, found + 1, taken);
  found[0] = aim.factor;
  found[2] = aim.compliance;
  free(made.room);
  free(made.whole);
  return status;
}

/* u (6 n) becomes the change under a small push (6 n) at a displacement u; without `at`, nothing opens or slips. */
POISE_EXPORT int64_t poise_elastic_response(const struct elastic *contacts, const double *at, const double *push,
                                            double *u) {
  struct steps made = {0};
  int status = make_room(contacts, &made);
  if (!status) {
    if (at) spring_motions(contacts, at, made.relative);
    for (int64_t p = 0; at && p < springs_of(contacts); p++) made.relative[3 * p] += contacts->slack;
    assemble(contacts, at ? made.relative : NULL, NULL, 0.0, &made.matrix);
    status = bodies_factor(&contacts->bodies, &made.matrix);
    memcpy(u, push, sizeof(double) * (size_t)(SIDE * contacts->bodies.count));
    if (!status) bodies_solve(&contacts->bodies, &made.matrix, u);
  }
  free(made.room);
  free(made.whole);
  return status;
}

/* What springs and catch leave of a load, negated, (6 n). */
POISE_EXPORT int64_t poise_elastic_left(const struct elastic *contacts, const double *u, const double *load,
                                        double *out) {
  double *relative = malloc(sizeof(double) * (size_t)(3 * springs_of(contacts)));
  if (!relative) return POISE_NO_MEMORY;
  spring_motions(contacts, u, relative);
  for (int64_t p = 0; p < springs_of(contacts); p++) relative[3 * p] += contacts->slack;
  left_over(contacts, u, load, relative, NULL, out);
  free(relative);
  return POISE_OK;
}
