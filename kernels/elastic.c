/* Elastic contacts of a block of bodies: damped Newton steps; `CoulombBlock._descend` in
   poise/assembly/statics/coulomb.py. */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "elastic.h"
#include "fill.h"
#include "lanes.h"

static const double SPARE = 1e-9, LITTLE = 1e-4, MOST_DAMPING = 10.0, FORGOTTEN = 1e-7,
                    NEARLY = 1e4, GAINS = 0.7, GOOD = 0.5, SHORT = 0.2, NEAR = 1e5, LEAP = 100.0;
enum { PATIENCE = 4, LENGTHS = 5, AGAIN = 2, BRIEF = 12, LEAPS = 3 };

double elastic_clock(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The same springs, eight side by side; the last of a pair are filled up with springs of no stiffness. */
struct lanes {
  const struct elastic *contacts;
  int64_t count;             /* of eights */
  int64_t *first;            /* (pairs + 1) first eight of each pair */
  row_of_block *arms;        /* (count, 3): moments of its unit forces about the other two, see `frames_of` */
  row_of_block *stiffness;   /* (count) */
  row_of_block *friction;    /* (count) */
  row_of_block *bounds;      /* (count) of friction, where it has any; otherwise NULL */
  row_of_block *room;        /* (count) for these */
  double *frames;            /* (pairs, 3, 3) directions of unit forces */
  double last[3 * SIDE + BEYOND]; /* wrenches of the last spring, so that rows can be read with what is beyond them */
};

static int64_t lanes_of(const struct elastic *contacts) {
  int64_t count = 0;
  for (int64_t pair = 0; pair < contacts->bodies.pairs; pair++)
    count += (contacts->springs[pair + 1] - contacts->springs[pair] + WIDTH - 1) / WIDTH;
  return count;
}

/* (3, 6) wrenches of a spring. */
static POISE_INLINE const double *wrenches_of(const struct lanes *lanes, int64_t p) {
  const struct elastic *contacts = lanes->contacts;
  return p + 1 == contacts->springs[contacts->bodies.pairs] ? lanes->last : contacts->wrenches + 3 * SIDE * p;
}

/* Unit forces of all springs of a pair have the same three directions n, at right angles. Their moments m at a place
   are B n1 - A n2, C n2 - B n0 and A n0 - C n1, where (C, A, B) is the place along the directions, or its opposite
   where these are left-handed. */
static POISE_INLINE double along(const double *moment, const double *direction) {
  return moment[0] * direction[0] + moment[1] * direction[1] + moment[2] * direction[2];
}

static void fill_lanes(struct lanes *lanes) {
  const struct elastic *contacts = lanes->contacts;
  const int64_t springs = contacts->springs[contacts->bodies.pairs];
  if (springs) memcpy(lanes->last, contacts->wrenches + 3 * SIDE * (springs - 1), 3 * SIDE * sizeof(double));
  memset(lanes->arms, 0, sizeof(row_of_block) * (size_t)(lanes->count * 6));
  int64_t eight = 0;
  for (int64_t pair = 0; pair < contacts->bodies.pairs; pair++) {
    lanes->first[pair] = eight;
    const int64_t first = contacts->springs[pair], last = contacts->springs[pair + 1];
    const double *forces = contacts->wrenches + 3 * SIDE * first;
    double *frame = lanes->frames + 9 * pair;
    for (int i = 0; i < 9 && first < last; i++) frame[i] = forces[SIDE * (i / 3) + i % 3];
    for (int64_t p = first; p < last; eight++)
      for (int lane = 0; lane < WIDTH; lane++, p++) { /* what fills up the last eight moves as the last spring does */
        const double *moments = contacts->wrenches + 3 * SIDE * (p < last ? p : last - 1) + 3;
        lanes->arms[3 * eight][lane] = -along(moments, frame + 6);
        lanes->arms[3 * eight + 1][lane] = along(moments, frame + 3);
        lanes->arms[3 * eight + 2][lane] = along(moments + SIDE, frame + 6);
        if (p >= last) continue;
        lanes->stiffness[eight][lane] = contacts->stiffness[p];
        lanes->friction[eight][lane] = contacts->friction[p];
      }
  }
  lanes->first[contacts->bodies.pairs] = eight;
}

/* Limit friction by bounds of each spring, or where there are none, by Coulomb's law. */
static void bound_friction(struct lanes *lanes, const double *bounds) {
  const struct elastic *contacts = lanes->contacts;
  lanes->bounds = bounds ? lanes->room : NULL;
  for (int64_t pair = 0; bounds && pair < contacts->bodies.pairs; pair++) {
    int64_t p = contacts->springs[pair];
    for (int64_t eight = lanes->first[pair]; eight < lanes->first[pair + 1]; eight++)
      for (int lane = 0; lane < WIDTH; lane++, p++)
        lanes->bounds[eight][lane] = p < contacts->springs[pair + 1] ? bounds[p] : 0.0;
  }
}

/* Whether a pair presses anywhere, or has friction with bounds: otherwise there is no force. */
static inline int acts(const struct lanes *lanes, int64_t pair, const row_of_block *relative) {
  int64_t found = 0;
  for (int64_t eight = lanes->first[pair]; eight < lanes->first[pair + 1]; eight++) {
    for (int l = 0; l < WIDTH; l++) found |= relative[3 * eight][l] <= 0.0;
    for (int l = 0; l < WIDTH && lanes->bounds; l++) found |= lanes->bounds[eight][l] > 0.0;
  }
  return found != 0;
}

static double energy(const struct lanes *lanes, const double *u, const double *load, const row_of_block *relative) {
  double sum = 0.0;
  for (int64_t eight = 0; eight < lanes->count; eight++)
    for (int l = 0; l < WIDTH; l++) {
      const row_of_block *motion = relative + 3 * eight;
      const double k = lanes->stiffness[eight][l], bound = lanes->bounds[eight][l];
      if (!(k > 0.0)) continue;
      const double slide = sqrt(motion[1][l] * motion[1][l] + motion[2][l] * motion[2][l]);
      if (motion[0][l] < 0.0) sum += k * motion[0][l] * motion[0][l] / 2.0;
      sum += k * slide <= bound ? k * slide * slide / 2.0 : bound * slide - bound * bound / (2.0 * k);
    }
  for (int64_t i = 0; i < SIDE * lanes->contacts->bodies.count; i++)
    sum += (lanes->contacts->catch * u[i] / 2.0 - load[i]) * u[i];
  return sum;
}

/* The derivative of the forces of springs, negated: of the normal force in its direction, of friction along both
   tangents and between them, and of both in the normal direction. */
enum { NORMAL, FIRST, SECOND, BETWEEN, FIRST_FOLLOWS, SECOND_FOLLOWS, DERIVATIVES };

#define POISE_TEMPLATE "elastic_parts.h"
#include "three_widths.h"

static void spring_motions(const struct lanes *lanes, const double *u, row_of_block *restrict out) {
  FOR_WIDTH(spring_motions, lanes, u, out);
}

static void left_over(const struct lanes *lanes, const double *u, const double *load, const row_of_block *relative,
                      double *restrict out) {
  FOR_WIDTH(left_over, lanes, u, load, relative, out);
}

static void assemble(const struct lanes *lanes, const struct bodies *bodies, const row_of_block *relative,
                     double damping, const char *coupled, struct body_matrix *matrix) {
  FOR_WIDTH(assemble, lanes, bodies, relative, damping, coupled, matrix);
}

/* Room for the vectors of Newton steps. */
struct steps {
  struct body_matrix matrix;
  struct lanes lanes;
  double *rest, *step, *along, *there_u, *turned, *room;
  row_of_block *relative, *moved, *there;
  int64_t *whole;
  struct fill fill;
  const struct bodies *order; /* in which the matrix is: that of the contacts, or of the fill */
  char *coupled, *before;     /* (pairs) whose stiffness counts, now and for the fill */
};

static int make_room(const struct elastic *contacts, struct steps *made) {
  const int64_t size = SIDE * contacts->bodies.count, eights = lanes_of(contacts);
  const int64_t matrix = bodies_room(&contacts->bodies, 0), lanes = WIDTH * eights * (6 + 9);
  const int64_t whole = 7 * contacts->bodies.count + contacts->bodies.pairs + 1, pairs = contacts->bodies.pairs;
  made->room = malloc(sizeof(double) * (size_t)(matrix + lanes + 6 * size + 9 * contacts->bodies.pairs + WIDTH));
  made->whole = malloc(sizeof(int64_t) * (size_t)(whole + fill_room(&contacts->bodies)) + 2 * (size_t)pairs);
  if (!made->room || !made->whole) return POISE_NO_MEMORY;
  made->matrix = bodies_laid_out(&contacts->bodies, 0, made->room, made->whole);
  made->lanes = (struct lanes){.contacts = contacts, .count = eights};
  made->lanes.first = made->whole + 7 * contacts->bodies.count;
  made->lanes.arms = made->matrix.right + 2 * contacts->bodies.count;
  made->lanes.stiffness = made->lanes.arms + 3 * eights;
  made->lanes.friction = made->lanes.stiffness + eights;
  made->lanes.room = made->lanes.friction + eights;
  made->relative = made->lanes.room + eights;
  made->moved = made->relative + 3 * eights;
  made->there = made->moved + 3 * eights;
  made->rest = (double *)(made->there + 3 * eights);
  made->step = made->rest + size;
  made->along = made->step + size;
  made->there_u = made->along + size;
  made->turned = made->there_u + size;
  made->lanes.frames = made->turned + 2 * size;
  made->fill = fill_laid_out(&contacts->bodies, made->whole + whole);
  made->coupled = (char *)(made->whole + whole + fill_room(&contacts->bodies));
  made->before = made->coupled + pairs;
  made->order = NULL;
  fill_lanes(&made->lanes);
  return POISE_OK;
}

/* Factor the stiffness at a place; without `relative`, where nothing opens or slips. */
static int factor_at(struct steps *made, const row_of_block *relative, double damping) {
  const struct bodies *bodies = &made->lanes.contacts->bodies;
  const char *coupled = relative ? made->coupled : NULL;
  if (relative) {
    for (int64_t pair = 0; pair < bodies->pairs; pair++)
      made->coupled[pair] = bodies->place[pair] < 0 || acts(&made->lanes, pair, relative);
    const size_t size = (size_t)bodies->pairs;
    if (!made->order || memcmp(made->coupled, made->before, size)) {
      made->order = fill_order(bodies, made->coupled, &made->fill) ? &made->fill.bodies : bodies;
      memcpy(made->before, made->coupled, size);
    }
  } else
    made->order = bodies;
  assemble(&made->lanes, made->order, relative, damping, coupled, &made->matrix);
  return bodies_factor(made->order, &made->matrix);
}

/* right (6 n), and another where there is one, become the solutions. */
static void solve_with(struct steps *made, double *right, double *other) {
  const int64_t count = made->lanes.contacts->bodies.count, *position = made->fill.position;
  if (made->order != &made->fill.bodies) {
    bodies_solve(made->order, &made->matrix, right, other);
    return;
  }
  double *given[2] = {right, other}, *turned[2] = {made->turned, other ? made->turned + SIDE * count : NULL};
  for (int m = 0; m < (other ? 2 : 1); m++)
    for (int64_t body = 0; body < count; body++)
      memcpy(turned[m] + SIDE * position[body], given[m] + SIDE * body, SIDE * sizeof(double));
  bodies_solve(made->order, &made->matrix, turned[0], turned[1]);
  for (int m = 0; m < (other ? 2 : 1); m++)
    for (int64_t body = 0; body < count; body++)
      memcpy(given[m] + SIDE * body, turned[m] + SIDE * position[body], SIDE * sizeof(double));
}

static void place_at(const struct steps *made, const double *u) {
  spring_motions(&made->lanes, u, made->relative);
  for (int64_t eight = 0; eight < made->lanes.count; eight++)
    for (int l = 0; l < WIDTH; l++) made->relative[3 * eight][l] += made->lanes.contacts->slack;
}

/* Eight sums side by side, so that none waits for the one before. */
POISE_WIDE static double dot(const double *a, const double *b, int64_t count) {
  double lane[WIDTH] = {0.0}, sum = 0.0;
  int64_t i = 0;
  for (; i + WIDTH <= count; i += WIDTH)
    for (int l = 0; l < WIDTH; l++) lane[l] += a[i + l] * b[i + l];
  for (; i < count; i++) sum += a[i] * b[i];
  for (int l = 0; l < WIDTH; l++) sum += lane[l];
  return sum;
}

/* What is to be found: u under a load, or with a share of a push that u decides. */
struct aim {
  const double *load, *push;
  double push_square, factor; /* of the push, which leaves the least */
  double compliance;          /* power of the push on its own change of u, in the last step */
};

/* What is left at u, and its size, or the energy where friction has bounds. */
static double merit_at(const struct lanes *lanes, struct aim *aim, const double *u, const row_of_block *relative,
                       double *rest) {
  const int64_t size = SIDE * lanes->contacts->bodies.count;
  if (lanes->bounds) return energy(lanes, u, aim->load, relative);
  left_over(lanes, u, aim->load, relative, rest);
  if (aim->push) {
    aim->factor = dot(aim->push, rest, size) / aim->push_square;
    for (int64_t i = 0; i < size; i++) rest[i] -= aim->factor * aim->push[i];
  }
  return sqrt(dot(rest, rest, size));
}

POISE_WIDE static double merit_along(struct aim *aim, struct steps *made, const double *u, double length) {
  const int64_t size = SIDE * made->lanes.contacts->bodies.count;
  for (int64_t i = 0; i < size; i++) made->there_u[i] = u[i] + length * made->step[i];
  const double *from = (const double *)made->relative, *change = (const double *)made->moved;
  double *to = (double *)made->there;
  for (int64_t i = 0; i < 3 * WIDTH * made->lanes.count; i++) to[i] = from[i] + length * change[i];
  return merit_at(&made->lanes, aim, made->there_u, made->there, made->rest);
}

/* How long a step from u, of merit `value`, is best: the first length that halves what is left (of an energy: that
   lessens it), otherwise the best one of those tried. The place it leads to is left in `made`. Whether it is a leap: a
   whole step where short ones lessen little, if those are allowed. */
static int search_line(struct aim *aim, struct steps *made, const double *u, double value, int leaps, double *best,
                       double *least) {
  const double good = made->lanes.bounds ? value : GOOD * value;
  double length = 1.0, whole = INFINITY;
  *least = INFINITY;
  *best = 0.0;
  for (int tried = 0; tried < LENGTHS; tried++, length /= 2.0) {
    const double new = merit_along(aim, made, u, length);
    if (tried == 0) whole = new;
    if (new < *least) {
      *least = new;
      *best = length;
    }
    if (new < good) return 0;
  }
  const int leap = leaps && whole < LEAP * value && (*best < SHORT || !(*least < value));
  if (leap) {
    *best = 1.0;
    *least = whole;
  }
  if (leap || *least < value) merit_along(aim, made, u, *best);
  return leap;
}

/* u (6 n) moves by damped Newton steps that lessen the merit; the power of a push on u does not change. */
static void newton(struct aim *aim, struct steps *made, double enough, int64_t steps, double end, double *u,
                   double *value, int64_t *taken) {
  const struct lanes *lanes = &made->lanes;
  const struct bodies *bodies = &lanes->contacts->bodies;
  const int64_t size = SIDE * bodies->count;
  double damping = 0.0, earlier = INFINITY;
  int stale = 0, full = 0, leaps = 0;
  const int brief = aim->push && steps <= BRIEF; /* asked of a place near a point of the path, which needs no damping */
  place_at(made, u);
  *value = merit_at(lanes, aim, u, made->relative, made->rest);
  for (*taken = 0; *taken < steps; ++*taken) {
    if (lanes->bounds) left_over(lanes, u, aim->load, made->relative, made->rest);
    if (sqrt(dot(made->rest, made->rest, size)) <= enough || (end < INFINITY && elastic_clock() >= end)) break;
    if (aim->push && *value <= NEARLY * enough) { /* where all slides, rounding soon leaves no more to gain */
      stale = *value > GAINS * earlier ? stale + 1 : 0;
      if (stale == PATIENCE) break;
      earlier = fmin(earlier, *value);
    }
    if (factor_at(made, made->relative, damping)) {
      damping = fmax(10.0 * damping, LITTLE);
      if (damping > MOST_DAMPING || brief) break;
      continue;
    }
    for (int64_t i = 0; i < size; i++) made->step[i] = -made->rest[i];
    if (aim->push) memcpy(made->along, aim->push, sizeof(double) * (size_t)size);
    solve_with(made, made->step, aim->push ? made->along : NULL);
    if (aim->push) {
      aim->compliance = dot(aim->push, made->along, size);
      const double share = dot(aim->push, made->step, size) / aim->compliance;
      for (int64_t i = 0; i < size; i++) made->step[i] -= share * made->along[i];
    }
    spring_motions(lanes, made->step, made->moved);
    const double factor = aim->factor;
    double length, new;
    const int may_leap = !lanes->bounds && leaps < LEAPS && *value <= NEAR * enough;
    const int leap = search_line(aim, made, u, *value, may_leap, &length, &new);
    leaps += leap;
    if (leap || new < *value) {
      memcpy(u, made->there_u, sizeof(double) * (size_t)size);
      memcpy(made->relative, made->there, sizeof(row_of_block) * (size_t)(3 * lanes->count));
      *value = new;
      full = length == 1.0 && !leap ? full + 1 : 0;
      if (full >= AGAIN || (full && damping <= LITTLE)) damping = damping > FORGOTTEN ? damping / 10.0 : 0.0;
    } else {
      full = 0;
      aim->factor = factor;
      damping = fmax(10.0 * damping, LITTLE);
      if (damping > MOST_DAMPING || brief) break;
      if (!lanes->bounds) merit_at(lanes, aim, u, made->relative, made->rest);
    }
  }
}

static double end_of(double time) { return time < 0.0 ? INFINITY : elastic_clock() + time; }

const struct elastic *elastic_contacts(const struct steps *made) { return made->lanes.contacts; }

void elastic_begin(struct steps *made, const double *bounds) {
  made->order = NULL; /* so that answers do not depend on what was asked before */
  bound_friction(&made->lanes, bounds);
}

POISE_EXPORT void poise_elastic_free(struct steps *made) {
  if (!made) return;
  free(made->room);
  free(made->whole);
  free(made);
}

/* Room for questions about contacts, which stay where they are; one at a time. NULL without memory. */
POISE_EXPORT struct steps *poise_elastic_new(const struct elastic *contacts) {
  struct steps *made = calloc(1, sizeof *made);
  if (made && make_room(contacts, made)) {
    poise_elastic_free(made);
    return NULL;
  }
  return made;
}

struct reached elastic_reach(struct steps *made, const double *load, const double *push, double enough, int64_t steps,
                             double end, double *u) {
  struct aim aim = {.load = load, .push = push};
  struct reached found;
  aim.push_square = dot(push, push, SIDE * made->lanes.contacts->bodies.count);
  newton(&aim, made, enough, steps, end, u, &found.left, &found.steps);
  found.factor = aim.factor;
  found.compliance = aim.compliance;
  found.change = made->along;
  return found;
}

void elastic_settle(struct steps *made, const double *load, double enough, int64_t steps, double end, double *u) {
  struct aim aim = {.load = load};
  double left;
  int64_t taken;
  newton(&aim, made, enough, steps, end, u, &left, &taken);
}

int elastic_response(struct steps *made, const double *at, const double *push, double *u) {
  if (at) place_at(made, at);
  const int status = factor_at(made, at ? made->relative : NULL, 0.0);
  memcpy(u, push, sizeof(double) * (size_t)(SIDE * made->lanes.contacts->bodies.count));
  if (!status) solve_with(made, u, NULL);
  return status;
}

void elastic_left(struct steps *made, const double *u, const double *load, double *out) {
  place_at(made, u);
  left_over(&made->lanes, u, load, made->relative, out);
}

/* u (6 n) moves by damped Newton steps that lessen what is left, or the energy where friction has bounds (springs).
   Bodies in the order of elimination. `time` is negative without a deadline. `taken` steps. */
POISE_EXPORT void poise_elastic_descend(struct steps *made, const double *load, const double *bounds, double enough,
                                        int64_t steps, double time, double *u, int64_t *taken) {
  struct aim aim = {.load = load};
  double value;
  elastic_begin(made, bounds);
  newton(&aim, made, enough, steps, end_of(time), u, &value, taken);
}

/* u (6 n), of which the power of the push (6 n) does not change, becomes an equilibrium under load + factor push.
   `found` (3) is the factor, the size of what is left, and the power of the push on the change of u by it. */
POISE_EXPORT void poise_elastic_reach(struct steps *made, const double *load, const double *push, double enough,
                                      int64_t steps, double time, double *u, double *found, int64_t *taken) {
  elastic_begin(made, NULL);
  const struct reached at = elastic_reach(made, load, push, enough, steps, end_of(time), u);
  memcpy(found, (double[]){at.factor, at.left, at.compliance}, 3 * sizeof(double));
  *taken = at.steps;
}

/* u (6 n) becomes the change under a small push (6 n) at a displacement u; without `at`, nothing opens or slips. */
POISE_EXPORT int64_t poise_elastic_response(struct steps *made, const double *at, const double *push, double *u) {
  elastic_begin(made, NULL);
  return elastic_response(made, at, push, u);
}

/* What springs and catch leave of a load, negated, (6 n). */
POISE_EXPORT void poise_elastic_left(struct steps *made, const double *u, const double *load, double *out) {
  elastic_begin(made, NULL);
  elastic_left(made, u, load, out);
}
