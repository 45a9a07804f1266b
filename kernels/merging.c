/* Clusters of tetrahedra that are merged, the cheapest pair first; as in poise/shape/hierarchy.py. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "poise_kernels.h"

enum { LANES = 8 };

/* Layout of `_Merging` in poise/kernels/merging.py. What is known of the clusters has a row for each that there may ever
   be, and is filled as they are merged; that of pairs has one for each of the first clusters, which a parent takes over
   from its left child. */
struct merging {
  int64_t count, directions, corners, pairs, borders;
  double colour, fold, hollow, size, least, shading, one_colour, smooth; /* costs */
  double noise, total, folded, alike, haste, few;
  const int64_t *pair, *border; /* (pairs, 2) that touch, (borders, 2) */
  const double *border_fold, *border_edges;
  const int32_t *corner; /* (corners, 3) directions whose points are the corners of a triangle */
  double *reach, *points, *volume, *hull, *shade, *weight;
  int64_t *merge; /* (count - 1, 2) */
  double *cost;
  int64_t merges;
};

struct offer {
  double cost, hull;
  int32_t left, right;
};

static int before(const struct offer *a, const struct offer *b) {
  if (a->cost != b->cost) return a->cost < b->cost;
  return a->left != b->left ? a->left < b->left : a->right < b->right;
}

#define HEAP_ITEM struct offer
#define HEAP_SOONER before
#include "heap.h"

struct state {
  heap waiting;
  double *fold, *edges, *buffer; /* of each pair of slots; of a hull */
  uint8_t *touch;
  int32_t *slot, *id; /* of each cluster, -1 when it was merged; and the cluster in each slot, -1 for none */
};

/* Six times the volume over the corners of a hull, whose points (3, directions) are laid out by axis. */
POISE_WIDE static double hull_volume(int64_t corners, const int32_t *restrict corner, int64_t directions,
                                     const double *restrict points) {
  const double *x = points, *y = points + directions, *z = y + directions;
  double lanes[LANES] = {0}, sum = 0;
  int64_t k = 0;
  for (; k + LANES <= corners; k += LANES)
    for (int l = 0; l < LANES; l++) {
      const int32_t p = corner[k + l], q = corner[corners + k + l], r = corner[2 * corners + k + l];
      lanes[l] += x[p] * (y[q] * z[r] - y[r] * z[q]) - y[p] * (x[q] * z[r] - x[r] * z[q]) +
                  z[p] * (x[q] * y[r] - x[r] * y[q]);
    }
  for (; k < corners; k++) {
    const int32_t p = corner[k], q = corner[corners + k], r = corner[2 * corners + k];
    sum += x[p] * (y[q] * z[r] - y[r] * z[q]) - y[p] * (x[q] * z[r] - x[r] * z[q]) + z[p] * (x[q] * y[r] - x[r] * y[q]);
  }
  for (int l = 0; l < LANES; l++) sum += lanes[l];
  return sum;
}

/* The points that are the outermost of either, and how far they reach. */
POISE_WIDE static void join(int64_t directions, const double *restrict reach, const double *restrict points,
                            const double *restrict other_reach, const double *restrict other_points,
                            double *restrict joined_reach, double *restrict joined) {
  for (int64_t d = 0; d < directions; d++) {
    const int own = reach[d] >= other_reach[d];
    joined_reach[d] = own ? reach[d] : other_reach[d];
    for (int axis = 0; axis < 3; axis++)
      joined[axis * directions + d] = own ? points[axis * directions + d] : other_points[axis * directions + d];
  }
}

/* Takes a point into a hull, if it is the outermost in some of the directions (3, directions). */
POISE_WIDE static void take(int64_t directions, const double *restrict direction, const double *restrict point,
                            double *restrict reach, double *restrict points) {
  const double x = point[0], y = point[1], z = point[2];
  double *px = points, *py = px + directions, *pz = py + directions;
  for (int64_t d = 0; d < directions; d++) {
    const double along = direction[d] * x + direction[directions + d] * y + direction[2 * directions + d] * z;
    const int outer = along > reach[d];
    reach[d] = outer ? along : reach[d];
    px[d] = outer ? x : px[d];
    py[d] = outer ? y : py[d];
    pz[d] = outer ? z : pz[d];
  }
}

/* Hulls of the clusters of tetrahedra (count, 4), in the directions (3, directions): reach (clusters, directions) and
   points (clusters, 3, directions). Each of the n points (n, 3) counts once in each. */
POISE_EXPORT int64_t poise_hulls(int64_t n, const double *points, int64_t count, const int64_t *tetrahedra,
                                 const int64_t *cluster, int64_t clusters, int64_t directions, const double *direction,
                                 double *reach, double *outermost) {
  int64_t *start = calloc((size_t)(clusters + 1 + count + n), sizeof *start);
  if (!start) return POISE_NO_MEMORY;
  int64_t *sorted = start + clusters + 1, *taken = sorted + count;
  for (int64_t k = 0; k < count; k++) start[cluster[k] + 1]++;
  for (int64_t k = 0; k < clusters; k++) start[k + 1] += start[k];
  for (int64_t k = 0; k < count; k++) sorted[start[cluster[k]]++] = k;
  for (int64_t k = 0; k < clusters * directions; k++) reach[k] = -INFINITY;
  for (int64_t k = 0; k < 4 * count; k++) {
    const int64_t own = sorted[k / 4], in = cluster[own], point = tetrahedra[4 * own + k % 4];
    if (taken[point] == in + 1) continue;
    taken[point] = in + 1;
    take(directions, direction, points + 3 * point, reach + directions * in, outermost + 3 * directions * in);
  }
  free(start);
  return POISE_OK;
}

static void join_clusters(const struct merging *m, int64_t i, int64_t j, double *reach, double *points) {
  const int64_t d = m->directions;
  join(d, m->reach + d * i, m->points + 3 * d * i, m->reach + d * j, m->points + 3 * d * j, reach, points);
}

static double clipped(double value, double low, double high) { return fmin(fmax(value, low), high); }

/* Distance of the colours of two clusters, the least when the lightness of one may change by a share. */
static double colour_step(const struct merging *m, int64_t i, int64_t j) {
  const double *one = m->shade + 3 * i, *other = m->shade + 3 * j;
  double both = 0, own = 0, square = 0;
  for (int c = 0; c < 3; c++) both += one[c] * other[c], own += other[c] * other[c];
  const double scale = clipped(both / fmax(own, 1e-12), 1 / (1 + m->shading), 1 + m->shading);
  for (int c = 0; c < 3; c++) {
    const double apart = one[c] - scale * other[c];
    square += apart * apart;
  }
  return sqrt(square);
}

static struct offer offer_of(const struct merging *m, const struct state *s, int32_t i, int32_t j) {
  const int64_t at = m->count * s->slot[i] + s->slot[j];
  const double weight = m->weight[i] * m->weight[j] / (m->weight[i] + m->weight[j]);
  const double seen = colour_step(m, i, j);
  const double step = sqrt(fmax(seen * seen - 3 * (m->noise * m->noise) / weight, 0.0));
  const double fold = s->fold[at] / (s->edges[at] + m->few);
  const double border = weight * (m->colour * step + m->fold * fmax(fold, 0.0));
  const double volume = m->volume[i] + m->volume[j];
  join_clusters(m, i, j, s->buffer, s->buffer + m->directions);
  const double filled = hull_volume(m->corners, m->corner, m->directions, s->buffer + m->directions) / 6 / m->total;
  const double hull = fmax(filled, volume);
  const int alike = step < m->alike;
  double added = fmax(hull - m->hull[i] - m->hull[j], 0.0);
  if (alike) added *= clipped(fold / m->folded, m->smooth, 1.0);
  const double shape = added + m->hollow * (hull - volume) + m->size * (volume * volume);
  const int small = fmin(m->volume[i], m->volume[j]) < m->least;
  const double haste = small ? m->haste : alike ? m->one_colour : 1.0;
  return (struct offer){.cost = haste * (border + shape), .hull = hull, .left = i, .right = j};
}

/* The cluster that takes the place of two. */
static int32_t merge(struct merging *m, struct state *s, const struct offer *offer) {
  const int64_t i = offer->left, j = offer->right, parent = m->count + m->merges, n = m->count, d = m->directions;
  join_clusters(m, i, j, m->reach + d * parent, m->points + 3 * d * parent);
  m->volume[parent] = m->volume[i] + m->volume[j];
  m->hull[parent] = offer->hull;
  m->weight[parent] = m->weight[i] + m->weight[j];
  for (int c = 0; c < 3; c++) {
    const double shades = m->shade[3 * i + c] * m->weight[i] + m->shade[3 * j + c] * m->weight[j];
    m->shade[3 * parent + c] = shades / m->weight[parent];
  }
  const int64_t own = s->slot[i], other = s->slot[j];
  for (int64_t k = 0; k < n; k++) {
    const int64_t to = n * own + k, from = n * other + k;
    s->touch[to] |= s->touch[from];
    if (!s->touch[to]) s->fold[from] = s->edges[from] = s->fold[to] = s->edges[to] = 0; /* as of other clusters */
    s->touch[n * k + own] = s->touch[to];
    s->fold[n * k + own] = s->fold[to] += s->fold[from];
    s->edges[n * k + own] = s->edges[to] += s->edges[from];
    s->touch[n * k + other] = s->touch[from] = 0;
  }
  s->touch[n * own + own] = s->touch[n * own + other] = s->touch[n * other + own] = s->touch[n * other + other] = 0;
  s->slot[i] = s->slot[j] = -1;
  s->id[other] = -1;
  s->id[own] = (int32_t)parent;
  s->slot[parent] = (int32_t)own;
  m->merge[2 * m->merges] = i;
  m->merge[2 * m->merges + 1] = j;
  m->cost[m->merges++] = offer->cost;
  return (int32_t)parent;
}

static int merge_all(struct merging *m, struct state *s) {
  for (int64_t k = 0; k < m->pairs; k++)
    if (!heap_push(&s->waiting, offer_of(m, s, (int32_t)m->pair[2 * k], (int32_t)m->pair[2 * k + 1]))) return 0;
  while (s->waiting.count) {
    const struct offer offer = heap_pop(&s->waiting);
    if (s->slot[offer.left] < 0 || s->slot[offer.right] < 0) continue;
    const int32_t parent = merge(m, s, &offer);
    const uint8_t *touch = s->touch + m->count * s->slot[parent];
    for (int64_t k = 0; k < m->count; k++)
      if (touch[k] && !heap_push(&s->waiting, offer_of(m, s, s->id[k], parent))) return 0;
  }
  return 1;
}

static void begin(const struct merging *m, struct state *s) {
  for (int64_t k = 0; k < m->count; k++) s->slot[k] = s->id[k] = (int32_t)k;
  for (int64_t k = 0; k < m->pairs; k++) {
    const int64_t i = m->pair[2 * k], j = m->pair[2 * k + 1];
    s->touch[m->count * i + j] = s->touch[m->count * j + i] = 1;
  }
  for (int64_t k = 0; k < m->borders; k++) {
    const int64_t at[2] = {m->count * m->border[2 * k] + m->border[2 * k + 1],
                           m->count * m->border[2 * k + 1] + m->border[2 * k]};
    for (int side = 0; side < 2; side++) {
      s->fold[at[side]] = m->border_fold[k];
      s->edges[at[side]] = m->border_edges[k];
    }
  }
}

/* Merges until nothing touches. */
POISE_EXPORT int64_t poise_merge(struct merging *m) {
  const size_t n = (size_t)m->count;
  struct state s = {0};
  s.fold = calloc(n * n, sizeof *s.fold);
  s.edges = calloc(n * n, sizeof *s.edges);
  s.touch = calloc(n * n, sizeof *s.touch);
  s.slot = calloc(2 * n, sizeof *s.slot);
  s.id = calloc(n, sizeof *s.id);
  s.buffer = malloc((size_t)(4 * m->directions) * sizeof *s.buffer);
  int64_t status = POISE_NO_MEMORY;
  m->merges = 0;
  if (s.fold && s.edges && s.touch && s.slot && s.id && s.buffer) {
    begin(m, &s);
    if (merge_all(m, &s)) status = POISE_OK;
  }
  free(s.waiting.item);
  free(s.fold);
  free(s.edges);
  free(s.touch);
  free(s.slot);
  free(s.id);
  free(s.buffer);
  return status;
}
