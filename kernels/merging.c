/* Clusters of tetrahedra that are merged, the cheapest pair first; as in poise/shape/hierarchy.py. */
#include <math.h>
#include <stdlib.h>

#include "poise_kernels.h"

enum { MOMENTS = 10 };

/* Layout of `_Merging` in poise/kernels/merging.py. What is known of the clusters has a row for each that there may ever
   be, and is filled as they are merged; that of pairs has one for each of the first clusters, which a parent takes over
   from its left child. */
struct merging {
  int64_t count, pairs, borders;
  double constant, concave, colour, spread, thickness, smaller, both, least, shading, one_colour; /* costs */
  double noise, alike, haste, few, thickest, smallest, flattest;
  const int64_t *pair, *border; /* (pairs, 2) that touch, (borders, 2) */
  const double *border_inwards, *border_edges;
  double *volume, *area, *weight, *shade, *moment; /* (2 count - 1,), the last two with 3 and 10 columns */
  int64_t *merge;                                  /* (count - 1, 2) */
  double *cost;
  int64_t merges;
};

struct offer {
  double cost;
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
  double *inwards, *edges; /* of each pair of slots */
  uint8_t *touch;
  int32_t *slot, *id; /* of each cluster, -1 when it was merged; and the cluster in each slot, -1 for none */
};

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

/* Root of the determinant of the covariance of what has these moments: 1, x, y, z, xx, yy, zz, xy, xz, yz. */
static double extent(const struct merging *m, const double *moment) {
  const double all = fmax(moment[0], m->smallest), x = moment[1] / all, y = moment[2] / all, z = moment[3] / all;
  const double a = moment[4] / all - x * x, b = moment[5] / all - y * y, c = moment[6] / all - z * z;
  const double d = moment[7] / all - x * y, e = moment[8] / all - x * z, f = moment[9] / all - y * z;
  const double determinant = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e);
  return sqrt(fmax(determinant, m->flattest));
}

/* As `_Clusters.merging` in poise/shape/hierarchy.py. */
static struct offer offer_of(const struct merging *m, const struct state *s, int32_t i, int32_t j) {
  const int64_t at = m->count * s->slot[i] + s->slot[j];
  const double weight = m->weight[i] * m->weight[j] / (m->weight[i] + m->weight[j]);
  const double seen = colour_step(m, i, j);
  const double step = sqrt(fmax(seen * seen - 3 * (m->noise * m->noise) / weight, 0.0));
  double joined[MOMENTS];
  for (int k = 0; k < MOMENTS; k++) joined[k] = m->moment[MOMENTS * i + k] + m->moment[MOMENTS * j + k];
  const double apart = extent(m, m->moment + MOMENTS * i) + extent(m, m->moment + MOMENTS * j);
  const double thick = (m->volume[i] * m->area[j]) / (m->volume[j] * m->area[i]);
  const double smaller = fmin(m->volume[i], m->volume[j]);
  const double odds = m->constant + m->concave * (s->inwards[at] / (s->edges[at] + m->few)) + m->colour * step +
                      m->spread * log(extent(m, joined) / apart) + m->thickness * fmin(fabs(log(thick)), m->thickest) +
                      m->smaller * log(fmax(smaller, m->smallest)) + m->both * log(m->volume[i] + m->volume[j]);
  const double surprise = fmax(odds, 0.0) + log1p(exp(-fabs(odds)));
  const double haste = smaller < m->least ? m->haste : step < m->alike ? m->one_colour : 1.0;
  return (struct offer){.cost = haste * fmin(m->weight[i], m->weight[j]) * surprise, .left = i, .right = j};
}

/* The cluster that takes the place of two. */
static int32_t merge(struct merging *m, struct state *s, const struct offer *offer) {
  const int64_t i = offer->left, j = offer->right, parent = m->count + m->merges, n = m->count;
  m->volume[parent] = m->volume[i] + m->volume[j];
  m->area[parent] = m->area[i] + m->area[j];
  m->weight[parent] = m->weight[i] + m->weight[j];
  for (int c = 0; c < 3; c++) {
    const double shades = m->shade[3 * i + c] * m->weight[i] + m->shade[3 * j + c] * m->weight[j];
    m->shade[3 * parent + c] = shades / m->weight[parent];
  }
  for (int k = 0; k < MOMENTS; k++)
    m->moment[MOMENTS * parent + k] = m->moment[MOMENTS * i + k] + m->moment[MOMENTS * j + k];
  const int64_t own = s->slot[i], other = s->slot[j];
  for (int64_t k = 0; k < n; k++) {
    const int64_t to = n * own + k, from = n * other + k;
    s->touch[to] |= s->touch[from];
    if (!s->touch[to]) s->inwards[from] = s->edges[from] = s->inwards[to] = s->edges[to] = 0; /* as of other clusters */
    s->touch[n * k + own] = s->touch[to];
    s->inwards[n * k + own] = s->inwards[to] += s->inwards[from];
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
      s->inwards[at[side]] = m->border_inwards[k];
      s->edges[at[side]] = m->border_edges[k];
    }
  }
}

/* Merges until nothing touches. */
POISE_EXPORT int64_t poise_merge(struct merging *m) {
  const size_t n = (size_t)m->count;
  struct state s = {0};
  s.inwards = calloc(n * n, sizeof *s.inwards);
  s.edges = calloc(n * n, sizeof *s.edges);
  s.touch = calloc(n * n, sizeof *s.touch);
  s.slot = calloc(2 * n, sizeof *s.slot);
  s.id = calloc(n, sizeof *s.id);
  int64_t status = POISE_NO_MEMORY;
  m->merges = 0;
  if (s.inwards && s.edges && s.touch && s.slot && s.id) {
    begin(m, &s);
    if (merge_all(m, &s)) status = POISE_OK;
  }
  free(s.waiting.item);
  free(s.inwards);
  free(s.edges);
  free(s.touch);
  free(s.slot);
  free(s.id);
  return status;
}
