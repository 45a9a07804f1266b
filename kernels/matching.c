/* The rounds in which a surface moves to where points drawn from it lie as the observed ones do; as in
   poise/shape/matching.py. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "near.h"

/* Layout of `_Match` in poise/kernels/matching.py. */
struct match {
  int64_t vertices, triangles, used, edges, drawn, observed, rounds, noise_rounds, second_look, neighbours, together;
  double noise, spacing, smooth, band_sigmas, band_spacings, least_step, most_step, good, thick_good, haste, cube;
  const int64_t *triangle, *use, *edge, *which; /* (triangles, 3), (used,), (edges, 2), (drawn,) triangles */
  const double *within, *errors, *points;       /* (drawn, 3), (drawn, 3) sigmas, (observed, 3) m */
  double *places;                               /* (vertices, 3) m, moved */
  double *seen, *made;                          /* (observed,) and (drawn,) m outwards, of the points that are near */
  int64_t n_seen, n_made;
};

/* Points near the surface: the place that is nearest to each, and m outwards from it. */
struct cloud {
  int64_t count, near, *nearest;
  const double *points;
  double *out, *sums, *outer; /* sums over the points of each place, and of those outside of it */
  int64_t *numbers, *outer_numbers;
};

struct work {
  near_grid grid;
  double *normals, *here, *own, *alike, *weights, *squares, *middles, *sampled, *shift, *ratios, *degree;
  int64_t *beside;
  struct cloud seen, made;
};

static void facing(const struct match *m, double *normals) {
  memset(normals, 0, (size_t)(3 * m->vertices) * sizeof *normals);
  for (int64_t k = 0; k < m->triangles; k++) {
    const int64_t *corner = m->triangle + 3 * k;
    const double *a = m->places + 3 * corner[0], *b = m->places + 3 * corner[1], *c = m->places + 3 * corner[2];
    const double ux = b[0] - a[0], uy = b[1] - a[1], uz = b[2] - a[2], vx = c[0] - a[0], vy = c[1] - a[1], vz = c[2] - a[2];
    const double across[3] = {uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx};
    for (int i = 0; i < 3; i++)
      for (int axis = 0; axis < 3; axis++) normals[3 * corner[i] + axis] += across[axis];
  }
}

/* The places that are used, their unit normals, and how alike those of neighbours are. */
static int look_around(const struct match *m, struct work *w, int64_t round) {
  facing(m, w->normals);
  for (int64_t u = 0; u < m->used; u++) {
    const double *n = w->normals + 3 * m->use[u];
    const double size = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int axis = 0; axis < 3; axis++) {
      w->own[3 * u + axis] = size > 0 ? n[axis] / size : 0.0;
      w->here[3 * u + axis] = m->places[3 * m->use[u] + axis];
    }
  }
  if (!near_build(&w->grid, m->used, w->here, m->cube)) return 0;
  const int k = (int)m->neighbours;
  if (round == 0 || round == m->second_look)
    for (int64_t u = 0; u < m->used; u++) near_find(&w->grid, w->here + 3 * u, k, w->beside + k * u, w->squares);
  for (int64_t u = 0; u < m->used; u++)
    for (int j = 0; j < k; j++) {
      const double *one = w->own + 3 * u, *other = w->own + 3 * w->beside[k * u + j];
      const double same = fmax(other[0] * one[0] + other[1] * one[1] + other[2] * one[2], 0.0);
      w->alike[k * u + j] = same * same;
    }
  return 1;
}

static void draw(const struct match *m, double *points) {
  for (int64_t i = 0; i < m->drawn; i++) {
    const int64_t *corner = m->triangle + 3 * m->which[i];
    const double *share = m->within + 3 * i;
    for (int axis = 0; axis < 3; axis++) {
      double at = 0;
      for (int c = 0; c < 3; c++) at += share[c] * m->places[3 * corner[c] + axis];
      points[3 * i + axis] = at + m->noise * m->errors[3 * i + axis];
    }
  }
}

static void measure(const struct match *m, struct work *w, struct cloud *cloud, double band) {
  cloud->near = 0;
  memset(cloud->sums, 0, (size_t)m->used * sizeof *cloud->sums);
  memset(cloud->outer, 0, (size_t)m->used * sizeof *cloud->outer);
  memset(cloud->numbers, 0, (size_t)m->used * sizeof *cloud->numbers);
  memset(cloud->outer_numbers, 0, (size_t)m->used * sizeof *cloud->outer_numbers);
  for (int64_t i = 0; i < cloud->count; i++) {
    const double *point = cloud->points + 3 * i;
    const int64_t u = cloud->nearest[i] = near_one(&w->grid, w->here, point, cloud->nearest[i]);
    const double *here = w->here + 3 * u, *up = w->own + 3 * u;
    const double out = (point[0] - here[0]) * up[0] + (point[1] - here[1]) * up[1] + (point[2] - here[2]) * up[2];
    if (!(fabs(out) < band)) continue;
    cloud->out[cloud->near++] = out;
    cloud->sums[u] += out;
    cloud->numbers[u]++;
    if (out > 0) {
      cloud->outer[u] += out;
      cloud->outer_numbers[u]++;
    }
  }
}

/* A place averages over the nearest neighbours of its side that have enough observed points together. */
static void weigh(const struct match *m, struct work *w) {
  for (int64_t u = 0; u < m->used; u++) {
    const int64_t first = m->neighbours * u;
    double before = 0;
    for (int64_t j = first; j < first + m->neighbours; j++) {
      const double own = w->alike[j] * (double)w->seen.numbers[w->beside[j]];
      w->weights[j] = before + own - own < (double)m->together ? w->alike[j] : 0.0;
      before += own;
    }
  }
}

static double mean(const struct match *m, const struct work *w, int64_t u, const double *sums, const int64_t *numbers) {
  double total = 0, all = 0;
  for (int64_t j = m->neighbours * u; j < m->neighbours * (u + 1); j++) {
    total += w->weights[j] * (double)numbers[w->beside[j]];
    all += w->weights[j] * sums[w->beside[j]];
  }
  return all / fmax(total, 1e-9);
}

static int by_size(const void *a, const void *b) {
  const double one = *(const double *)a, other = *(const double *)b;
  return (one > other) - (one < other);
}

/* By how much the noise of the drawn points has to grow. */
static double noise_ratio(const struct match *m, struct work *w) {
  int64_t known = 0;
  for (int64_t u = 0; u < m->used; u++) {
    const double seen = mean(m, w, u, w->seen.outer, w->seen.outer_numbers);
    const double made = mean(m, w, u, w->made.outer, w->made.outer_numbers);
    if (seen > 0 && made > 0) w->ratios[known++] = seen / made;
  }
  if (!known) return 1.0;
  qsort(w->ratios, (size_t)known, sizeof *w->ratios, by_size);
  const double place = (m->good + (m->thick_good - m->good) * fmin(m->noise / m->spacing, 1.0)) * (double)(known - 1);
  const int64_t low = (int64_t)place, high = low + 1 < known ? low + 1 : low;
  const double share = place - (double)low;
  return pow(w->ratios[low] + (w->ratios[high] - w->ratios[low]) * share, m->haste);
}

static void smooth(const struct match *m, struct work *w) {
  memset(w->middles, 0, (size_t)(3 * m->vertices) * sizeof *w->middles);
  for (int64_t e = 0; e < m->edges; e++) {
    const int64_t start = m->edge[2 * e], end = m->edge[2 * e + 1];
    for (int axis = 0; axis < 3; axis++) w->middles[3 * start + axis] += m->places[3 * end + axis];
  }
  for (int64_t v = 0; v < m->vertices; v++)
    for (int axis = 0; w->degree[v] > 0 && axis < 3; axis++) {
      const double middle = w->middles[3 * v + axis] / w->degree[v];
      m->places[3 * v + axis] += m->smooth * (middle - m->places[3 * v + axis]);
    }
}

static int move(struct match *m, struct work *w) {
  for (int64_t round = 0; round < m->rounds; round++) {
    if (!look_around(m, w, round)) return 0;
    draw(m, w->sampled);
    const double band = m->band_sigmas * m->noise + m->band_spacings * m->spacing;
    measure(m, w, &w->seen, band);
    measure(m, w, &w->made, band);
    weigh(m, w);
    if (round < m->noise_rounds) m->noise *= fmin(fmax(noise_ratio(m, w), m->least_step), m->most_step);
    for (int64_t u = 0; u < m->used; u++)
      w->shift[u] = mean(m, w, u, w->seen.sums, w->seen.numbers) - mean(m, w, u, w->made.sums, w->made.numbers);
    for (int64_t u = 0; u < m->used; u++)
      for (int axis = 0; axis < 3; axis++) m->places[3 * m->use[u] + axis] += w->shift[u] * w->own[3 * u + axis];
    if (round < m->rounds - 1) smooth(m, w);
  }
  m->n_seen = w->seen.near;
  m->n_made = w->made.near;
  return 1;
}

static void begin(const struct match *m, struct work *w) {
  int64_t *number = w->beside; /* of each vertex among those that are used, until neighbours are known */
  for (int64_t v = 0; v < m->vertices; v++) number[v] = 0;
  for (int64_t u = 0; u < m->used; u++) number[m->use[u]] = u;
  for (int64_t i = 0; i < m->drawn; i++) w->made.nearest[i] = number[m->triangle[3 * m->which[i]]];
  for (int64_t e = 0; e < m->edges; e++) w->degree[m->edge[2 * e]] += 1;
  near_grid grid = {0}; /* of the first places, for a first guess */
  for (int64_t u = 0; u < m->used; u++) memcpy(w->here + 3 * u, m->places + 3 * m->use[u], 3 * sizeof *w->here);
  if (near_build(&grid, m->used, w->here, m->cube))
    for (int64_t i = 0; i < m->observed; i++) near_find(&grid, m->points + 3 * i, 1, w->seen.nearest + i, w->squares);
  near_free(&grid);
}

/* Moves the places, and finds the noise. */
POISE_EXPORT int64_t poise_match(struct match *m) {
  const int64_t u = m->used, v = m->vertices, k = m->neighbours, n = m->observed, d = m->drawn;
  if (k > NEAR_MOST || k > u || u < 1) return POISE_SINGULAR;
  const int64_t n_doubles = 3 * v + 6 * u + 2 * k * u + NEAR_MOST + 3 * v + 3 * d + 2 * u + v + 4 * u;
  const int64_t n_integers = (k * u > v ? k * u : v) + n + d + 4 * u;
  double *doubles = calloc((size_t)n_doubles, sizeof *doubles), *next = doubles;
  int64_t *integers = calloc((size_t)n_integers, sizeof *integers), *number = integers;
  struct work w = {.grid = {0}};
  int64_t status = POISE_NO_MEMORY;
  if (doubles && integers) {
#define TAKE(field, from, size) w.field = from, from += (size)
    TAKE(normals, next, 3 * v);
    TAKE(here, next, 3 * u);
    TAKE(own, next, 3 * u);
    TAKE(alike, next, k * u);
    TAKE(weights, next, k * u);
    TAKE(squares, next, NEAR_MOST);
    TAKE(middles, next, 3 * v);
    TAKE(sampled, next, 3 * d);
    TAKE(shift, next, u);
    TAKE(ratios, next, u);
    TAKE(degree, next, v);
    TAKE(beside, number, k * u > v ? k * u : v);
    struct cloud *clouds[] = {&w.seen, &w.made};
    for (int i = 0; i < 2; i++) {
      struct cloud *c = clouds[i];
      c->count = i ? d : n, c->points = i ? w.sampled : m->points, c->out = i ? m->made : m->seen;
      c->sums = next, next += u;
      c->outer = next, next += u;
      c->nearest = number, number += c->count;
      c->numbers = number, number += u;
      c->outer_numbers = number, number += u;
    }
#undef TAKE
    begin(m, &w);
    if (move(m, &w)) status = POISE_OK;
  }
  near_free(&w.grid);
  free(doubles);
  free(integers);
  return status;
}
