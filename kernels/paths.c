/* Follows a block on elastic contacts while a load grows: `follow` in poise/assembly/statics/load_path.py, with
   equilibria as of `CoulombBlock._reach`. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "elastic.h"

/* As in load_path.py and coulomb.py, where they are explained. */
static const double FIRST_SHARE = 0.25, FIRST_WEIGHT = 0.25, AFTER_MANY = 2.0, AFTER_FEW = 3.0, SURE = 1.5,
                    LEAST_GROWTH = 1.04, SETTLED = 1e-7, REACHED = 2e-4, CARRIED = 5e-5, LEAST_LOAD = 1e-2,
                    STEEP = 0.25, NEAR_END = 0.97, EARLIER = 0.8;
enum { FEW = 5, MOST = 25, MANY = 10, STEPS = 40, AT_PEAK = 12, SHORTER = 6, PAST_END = 3, BRIEF_LOOK = 6, SMALL = 20,
       ROOM = STEPS + AT_PEAK + 3, SLIDING_STEPS = 15, TRESCA_STEPS = 12 };

/* What Python gives and wants. */
struct path {
  const double *gravity, *push, *rest; /* (6 n) loads, and the displacement without the push */
  const double *begin;                 /* (6 n) the equilibrium to begin at; NULL: at rest */
  const double *response;              /* (6 n) change of it under a small push; NULL: it is found */
  double factor, compliance;           /* at the beginning */
  double above, tolerance, time;       /* s until the deadline; negative: there is none */
  double *displacements, *factors, *compliances; /* (ROOM, 6 n), (ROOM), (ROOM) points, the first at rest */
  int64_t *steps;                                /* (ROOM) */
  double *end;                                   /* (6 n) where it was left */
  int64_t look;                                  /* whether a state is looked for beyond its end */
  int64_t count, ended;                          /* points; whether it collapsed or reached `above` */
};

struct point {
  double factor, compliance;
  int64_t steps;
  int held;
  const double *change; /* of the displacement by the push, in the last step, until the next one; NULL: not known */
};

struct following {
  struct path *path;
  struct steps *made;
  int64_t size;
  double weight, until, catch; /* `until` of the clock */
  double *here, *guess, *slope, *total, *left; /* (6 n) each */
};

static double dot(const double *a, const double *b, int64_t count) {
  double sum = 0.0;
  for (int64_t i = 0; i < count; i++) sum += a[i] * b[i];
  return sum;
}

static double *point_at(const struct following *f, int64_t k) { return f->path->displacements + k * f->size; }

/* The share that a part (6 n), times a factor, is of the total on a body, or of its weight; the largest of all. */
static double share_of(const struct following *f, const double *part, double times) {
  double sum = 0.0, most = 0.0;
  for (int64_t i = 0; i < f->size; i += SIDE)
    sum += fmax(dot(f->total + i, f->total + i, SIDE), dot(f->path->gravity + i, f->path->gravity + i, SIDE));
  const double least = sum > 0.0 ? LEAST_LOAD * LEAST_LOAD * sum : 1.0;
  for (int64_t i = 0; i < f->size; i += SIDE) {
    const double *gravity = f->path->gravity + i;
    const double load = fmax(dot(f->total + i, f->total + i, SIDE), dot(gravity, gravity, SIDE));
    most = fmax(most, times * times * dot(part + i, part + i, SIDE) / fmax(load, least));
  }
  return sqrt(most);
}

/* `here` becomes the equilibrium with the power that the push has at `guess`. Whether there is one. */
static int reach(struct following *f, int64_t steps, struct point *found) {
  const struct path *path = f->path;
  if (f->until < INFINITY && elastic_clock() >= f->until) return 0;
  memcpy(f->here, f->guess, sizeof(double) * (size_t)f->size);
  const double enough = SETTLED / 10.0 * (f->weight > 0.0 ? f->weight : 1.0);
  const struct reached at = elastic_reach(f->made, path->gravity, path->push, enough, steps, f->until, f->here);
  for (int64_t i = 0; i < f->size; i++) f->total[i] = path->gravity[i] + at.factor * path->push[i];
  const double size = fmax(sqrt(dot(f->total, f->total, f->size)), f->weight);
  if (at.left > SETTLED * size) {
    if (at.left > REACHED * size) return 0;
    elastic_left(f->made, f->here, f->total, f->left);
    if (share_of(f, f->left, 1.0) > REACHED) return 0;
  }
  const int held = share_of(f, f->here, f->catch) <= CARRIED;
  const double *change = f->size > SIDE * SMALL && at.compliance > 0.0 ? at.change : NULL;
  *found = (struct point){at.factor, at.compliance, at.steps, held, change};
  return 1;
}

/* Put a point in the list, before those from `k` on. */
static void insert(struct following *f, int64_t k, const double *displacement, const struct point *point) {
  struct path *path = f->path;
  const size_t after = (size_t)(path->count - k);
  memmove(point_at(f, k + 1), point_at(f, k), sizeof(double) * (size_t)f->size * after);
  memmove(path->factors + k + 1, path->factors + k, sizeof(double) * after);
  memmove(path->compliances + k + 1, path->compliances + k, sizeof(double) * after);
  memmove(path->steps + k + 1, path->steps + k, sizeof(int64_t) * after);
  memcpy(point_at(f, k), displacement, sizeof(double) * (size_t)f->size);
  path->factors[k] = point->factor;
  path->compliances[k] = point->compliance;
  path->steps[k] = point->steps;
  path->count++;
}

static void leave(struct following *f, const double *end, int ended) {
  memcpy(f->path->end, end, sizeof(double) * (size_t)f->size);
  f->path->ended = ended;
}

static void guess_from(struct following *f, const double *from, double way) {
  for (int64_t i = 0; i < f->size; i++) f->guess[i] = from[i] + way * f->slope[i];
}

static int flat_at(double factor, double compliance, double way, double tolerance) {
  return compliance != 0.0 && way / compliance <= tolerance * factor;
}

/* `_followed`: on from the last point, along the slope. */
static void go_along(struct following *f, double done, double way, double ahead) {
  const struct path *path = f->path;
  double longest = INFINITY;
  int shorter = 0;
  guess_from(f, point_at(f, path->count - 1), way - done);
  for (int round = 0; round < STEPS; round++) {
    const int careful = done > 0.0 && ahead > SURE;
    const double *last = point_at(f, path->count - 1), before = path->factors[path->count - 1];
    struct point here;
    if (!reach(f, careful ? MANY + 1 : MOST, &here) || (careful && here.steps > MANY)) {
      ahead = longest = sqrt(ahead);
      if (ahead < LEAST_GROWTH) {
        leave(f, last, 0);
        return;
      }
      way = done != 0.0 ? done * ahead : way / 4.0;
      guess_from(f, last, way - done);
      continue;
    }
    if (!here.held) {
      if (done != 0.0 || shorter == SHORTER) {
        leave(f, f->here, here.factor <= (1.0 + 2.0 * path->tolerance) * before || done == 0.0);
        return;
      }
      shorter++;
      way /= 8.0;
      guess_from(f, path->rest, way);
      continue;
    }
    const double gain = here.factor - before, few = path->tolerance * here.factor;
    const int collapsed = done != 0.0 && gain <= few * log2(way / done);
    const int flat = flat_at(here.factor, here.compliance, way, path->tolerance) &&
                     here.factor <= (1.0 + path->tolerance) * before;
    for (int64_t i = 0; i < f->size; i++)
      f->slope[i] = here.change ? here.change[i] / here.compliance : (f->here[i] - last[i]) / (way - done);
    insert(f, path->count, f->here, &here);
    if (here.factor >= path->above || collapsed || flat) {
      leave(f, f->here, 1);
      return;
    }
    if (here.steps <= MANY) longest = fmin(longest, AFTER_FEW) * fmin(longest, AFTER_FEW);
    ahead = fmin(longest, here.steps <= FEW ? AFTER_FEW : AFTER_MANY);
    done = way;
    way *= ahead;
    guess_from(f, f->here, way - done);
  }
  leave(f, point_at(f, path->count - 1), 0);
}

/* `_rise`: what the factor would gain from a point to the next one; the way there is left in `slope`. */
static double rise_at(struct following *f, int64_t k) {
  const double *low = point_at(f, k), *high = point_at(f, k + 1), compliance = f->path->compliances[k];
  for (int64_t i = 0; i < f->size; i++) f->slope[i] = high[i] - low[i];
  return compliance > 0.0 ? dot(f->path->push, f->slope, f->size) / compliance : 0.0;
}

/* The point with the largest factor. */
static int64_t best_of(const struct path *path) {
  int64_t best = 0;
  for (int64_t k = 1; k < path->count; k++) best = path->factors[k] > path->factors[best] ? k : best;
  return best;
}

/* `_around_peak`: the last point before the peak, the most of all factors, and whether the factor falls after it. */
static int64_t before_peak(struct following *f, double little, double *most, int *falls) {
  const struct path *path = f->path;
  const int64_t best = best_of(path);
  *most = path->factors[best];
  *falls = best + 1 < path->count && rise_at(f, best) > little * *most;
  if (*falls) return best;
  int64_t k = best - 1;
  *falls = path->compliances[best] < 0.0;
  while (!*falls && k > 0 && rise_at(f, k) <= little * *most) k--;
  return k;
}

/* `_with_peak`: more points around a peak. */
static void go_to_peak(struct following *f) {
  const struct path *path = f->path;
  const double least = 2.0 * path->tolerance;
  double gain = least, change = 2.0, most;
  int falls;
  for (int round = 0; round < AT_PEAK && path->ended; round++) {
    const int64_t k = before_peak(f, least, &most, &falls);
    if (most >= path->above || k < 0) return;
    const double rise = rise_at(f, k);
    if (!(rise > (falls ? least : STEEP) * most)) return;
    const double share = ((1.0 + gain) * most - path->factors[k]) / rise;
    if (!(share < 1.0)) return;
    guess_from(f, point_at(f, k), share);
    struct point here;
    if (!reach(f, MOST, &here) || !here.held) return;
    if (falls && here.factor <= most) change = 0.5;
    gain = fmax(change * gain, least);
    insert(f, k + 1, f->here, &here);
  }
}

/* Newton steps of `here` towards an equilibrium under the load `total`. */
static void settle(struct following *f, int64_t steps) {
  const double size = sqrt(dot(f->total, f->total, f->size));
  elastic_settle(f->made, f->total, SETTLED / 10.0 * (size > 0.0 ? size : 1.0), steps, f->until, f->here);
}

/* `CoulombBlock._newton`: whether `here` becomes a state that stands under the load `total`. */
static int stands_near(struct following *f, int64_t steps) {
  settle(f, steps);
  elastic_left(f->made, f->here, f->total, f->left);
  const double left = share_of(f, f->left, 1.0);
  return left <= CARRIED / 2.0 && left + share_of(f, f->here, f->catch) <= CARRIED;
}

/* `look_beyond`: a state under more than the best factor, near where the path ended. */
static void look_beyond(struct following *f) {
  const struct path *path = f->path;
  int64_t best = best_of(path), near = 0;
  const double most = path->factors[best], factor = fmin((1.0 + PAST_END * path->tolerance) * most, path->above);
  if (!path->ended || !(most > 0.0 && most < path->above)) return;
  for (int64_t k = 0; k < path->count; k++) near = path->factors[k] <= NEAR_END * most ? k : near;
  const double *at = point_at(f, best), *before = point_at(f, best > 0 ? best - 1 : 0);
  for (int64_t i = 0; i < f->size; i++) f->total[i] = path->gravity[i] + factor * path->push[i];
  for (int start = 0; start < 3; start++) {
    for (int64_t i = 0; i < f->size; i++) {
      const double on = 2.0 * at[i] - before[i], after = best + 1 < path->count ? path->end[i] : on;
      f->here[i] = start == 0 ? on : start == 1 ? 2.0 * after - at[i] : point_at(f, near)[i];
    }
    if (!stands_near(f, BRIEF_LOOK)) continue;
    insert(f, path->count, f->here, &(struct point){.factor = factor, .held = 1});
    leave(f, f->here, factor >= path->above);
    return;
  }
}

/* The slope at the beginning, per power of the push; and the power that the response has. */
static int begin_slope(struct following *f, const double *at, double *compliance) {
  const struct path *path = f->path;
  int status = POISE_OK;
  if (path->response)
    memcpy(f->slope, path->response, sizeof(double) * (size_t)f->size);
  else
    status = elastic_response(f->made, at, path->push, f->slope);
  *compliance = dot(path->push, f->slope, f->size);
  for (int64_t i = 0; i < f->size; i++) f->slope[i] /= *compliance;
  return status;
}

static int follow(struct following *f) {
  struct path *path = f->path;
  const double push = sqrt(dot(path->push, path->push, f->size));
  double compliance, done = 0.0;
  f->weight = sqrt(dot(path->gravity, path->gravity, f->size));
  f->until = path->time < 0.0 ? INFINITY : elastic_clock() + path->time;
  path->count = path->ended = 0;
  insert(f, 0, path->rest, &(struct point){.held = 1});
  if (path->begin) {
    const struct point begun = {.factor = path->factor, .compliance = path->compliance, .held = 1};
    insert(f, 1, path->begin, &begun);
    for (int64_t i = 0; i < f->size; i++) f->left[i] = path->begin[i] - path->rest[i];
    done = dot(path->push, f->left, f->size);
    if (begun.factor >= path->above || flat_at(begun.factor, begun.compliance, done, path->tolerance)) {
      leave(f, path->begin, 1);
      return POISE_OK;
    }
  }
  const int status = begin_slope(f, path->begin ? path->begin : path->rest, &compliance);
  if (status) return status;
  const double first = fmin(FIRST_SHARE * path->above, FIRST_WEIGHT * f->weight / (push > 0.0 ? push : 1.0));
  if (path->begin)
    go_along(f, done, AFTER_MANY * done, AFTER_MANY);
  else
    go_along(f, 0.0, compliance * first, AFTER_FEW);
  go_to_peak(f);
  if (path->look) look_beyond(f);
  return POISE_OK;
}

/* The vectors of a question laid into room for 5 (6 n). */
static struct following lay_out(struct path *path, struct steps *made, double *room) {
  const struct elastic *contacts = elastic_contacts(made);
  struct following f = {.path = path, .made = made, .size = SIDE * contacts->bodies.count, .catch = contacts->catch};
  f.here = room;
  f.guess = f.here + f.size;
  f.slope = f.guess + f.size;
  f.total = f.slope + f.size;
  f.left = f.total + f.size;
  return f;
}

/* Fill in the points of a path, its end, and whether it ended. Bodies in the order of elimination. */
POISE_EXPORT int64_t poise_elastic_follow(struct steps *made, struct path *path) {
  double *room = malloc(sizeof(double) * (size_t)(5 * SIDE * elastic_contacts(made)->bodies.count));
  if (!room) return POISE_NO_MEMORY;
  struct following f = lay_out(path, made, room);
  elastic_begin(made, NULL);
  const int status = follow(&f);
  free(room);
  return status;
}

/* What Python gives and wants for many pushes, each followed from rest: `CoulombBlock.factor`. */
struct factors {
  const double *gravity, *rest, *pushes, *above; /* (6 n), (6 n), (count, 6 n), (count) */
  double tolerance, time;                        /* s until the deadline; negative: there is none */
  int64_t count;
  double *factors, *best, *earlier, *motions;    /* (count), (count, 6 n) each; motions of those that collapse */
  int64_t *outcomes;                             /* (count) */
};
enum { UNDECIDED = 0, HELD = 1, COLLAPSED = 2, LATE = 3 }; /* what is undecided is left to Python */

/* Whether, where a path ended, the block stands at more near the state of contacts that never slip. */
static int stands_stuck(struct following *f, double best, const double *unlimited) {
  const struct path *path = f->path;
  const double factor = (1.0 + PAST_END * path->tolerance) * best;
  if (!(best > 0.0 && best < factor && factor <= path->above)) return 0;
  for (int64_t i = 0; i < f->size; i++) f->total[i] = path->gravity[i] + factor * path->push[i];
  elastic_begin(f->made, NULL);
  if (elastic_response(f->made, NULL, f->total, f->here)) return 1;
  elastic_begin(f->made, unlimited);
  settle(f, TRESCA_STEPS);
  elastic_begin(f->made, NULL);
  return stands_near(f, SLIDING_STEPS);
}

/* The first step of `go_on`: where no next point was found, whether the block stands under all that is asked, which is
   little more than at the best point. That state then ends the path. */
static int stands_at_last(struct following *f) {
  const struct path *path = f->path;
  const int64_t best = best_of(path);
  if ((1.0 + 2.0 * path->tolerance) * path->factors[best] < path->above) return 0;
  for (int64_t i = 0; i < f->size; i++) f->total[i] = path->gravity[i] + path->above * path->push[i];
  memcpy(f->here, point_at(f, best), sizeof(double) * (size_t)f->size);
  elastic_begin(f->made, NULL);
  if (!stands_near(f, SLIDING_STEPS)) return 0;
  insert(f, path->count, f->here, &(struct point){.factor = path->above, .held = 1});
  leave(f, f->here, 1);
  return 1;
}

/* One push, `path->push`: its factor, the state there and one earlier, and the motion in which it collapses. */
static int64_t factor_of(struct following *f, const struct factors *all, const double *unlimited, int64_t number) {
  const struct path *path = f->path;
  const size_t size = sizeof(double) * (size_t)f->size;
  elastic_begin(f->made, NULL);
  if (follow(f)) return UNDECIDED;
  const int late = f->until < INFINITY && elastic_clock() >= f->until;
  const int over = path->ended || (!late && path->count > 1 && stands_at_last(f));
  const int64_t best = best_of(path);
  const double factor = path->factors[best];
  all->factors[number] = factor;
  if (!over && late) return LATE;
  if (!over || path->count == 1) return UNDECIDED;
  if (!late && stands_stuck(f, factor, unlimited)) return UNDECIDED;
  int64_t near = path->count - 1;
  while (near > 0 && path->factors[near] > EARLIER * factor) near--;
  memcpy(all->best + number * f->size, point_at(f, best), size);
  memcpy(all->earlier + number * f->size, point_at(f, near), size);
  if (factor >= path->above) return HELD;
  elastic_begin(f->made, NULL);
  const int status = elastic_response(f->made, path->end, path->push, all->motions + number * f->size);
  return status ? UNDECIDED : COLLAPSED;
}

/* Fill in the factors of many pushes. Bodies in the order of elimination. */
POISE_EXPORT int64_t poise_elastic_factors(struct steps *made, const struct factors *all) {
  const struct elastic *contacts = elastic_contacts(made);
  const int64_t size = SIDE * contacts->bodies.count, springs = contacts->springs[contacts->bodies.pairs];
  const double until = all->time < 0.0 ? INFINITY : elastic_clock() + all->time;
  double *room = malloc(sizeof(double) * (size_t)((6 + ROOM) * size + 2 * ROOM + springs));
  int64_t *steps = malloc(sizeof(int64_t) * ROOM);
  if (!room || !steps) {
    free(room);
    free(steps);
    return POISE_NO_MEMORY;
  }
  struct path path = {.gravity = all->gravity, .rest = all->rest, .tolerance = all->tolerance, .look = 1};
  struct following f = lay_out(&path, made, room);
  path.end = room + 5 * size;
  path.displacements = path.end + size;
  path.factors = path.displacements + ROOM * size;
  path.compliances = path.factors + ROOM;
  path.steps = steps;
  double *unlimited = path.compliances + ROOM;
  for (int64_t p = 0; p < springs; p++) unlimited[p] = INFINITY;
  for (int64_t number = 0; number < all->count; number++) {
    path.push = all->pushes + number * size;
    path.above = all->above[number];
    path.time = all->time < 0.0 ? -1.0 : fmax(until - elastic_clock(), 0.0);
    all->factors[number] = 0.0;
    all->outcomes[number] = path.time == 0.0 ? LATE : factor_of(&f, all, unlimited, number);
  }
  free(room);
  free(steps);
  return POISE_OK;
}
