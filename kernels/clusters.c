/* Points of a surface that become clusters, as in poise/shape/clustering.py. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "poise_kernels.h"

/* Layout of `_Clusters` in poise/kernels/clusters.py. */
struct clusters {
  int64_t points, edges, wanted, rounds;
  double position, colour, inward, outward, shading, equal;
  const double *at, *shade, *normal; /* (points, 3) */
  const int64_t *edge;               /* (edges, 2) */
  int64_t *label;                    /* (points,) */
};

struct pair {
  double cost;
  int32_t low, high;
};

struct groups {
  int64_t left, pairs; /* clusters and pairs of them */
  struct pair *pair, *sorted;
  int32_t *start, *best, *number, *representative;
  double *sum, *size, *least;
  uint8_t *grown;
};

static double fold(const double *at, const double *normal, const double *other_at, const double *other) {
  const double bend = 1 - (normal[0] * other[0] + normal[1] * other[1] + normal[2] * other[2]);
  double inwards = 0;
  for (int i = 0; i < 3; i++) inwards += (other_at[i] - at[i]) * (normal[i] - other[i]);
  return inwards > 0 ? bend : -bend;
}

/* Thesis eq. (3.28). */
static double dissimilarity(const struct clusters *c, int64_t i, int64_t j) {
  const double *a = c->at + 3 * i, *b = c->at + 3 * j, *one = c->shade + 3 * i, *other = c->shade + 3 * j;
  const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  const double both = one[0] * other[0] + one[1] * other[1] + one[2] * other[2];
  const double own = other[0] * other[0] + other[1] * other[1] + other[2] * other[2];
  const double scale = fmin(fmax(both / fmax(own, 1e-12), 1 / (1 + c->shading)), 1 + c->shading);
  const double p = one[0] - scale * other[0], q = one[1] - scale * other[1], r = one[2] - scale * other[2];
  const double folded = fold(a, c->normal + 3 * i, b, c->normal + 3 * j);
  return c->position * sqrt(x * x + y * y + z * z) + c->colour * sqrt(p * p + q * q + r * r) +
         (folded > 0 ? c->inward : -c->outward) * folded;
}

/* Of pairs whose ends are the lower first: each once, in order, with what joining them costs. */
static void distinct(const struct clusters *c, struct groups *g, int64_t count) {
  memset(g->start, 0, (size_t)(g->left + 1) * sizeof *g->start);
  for (int64_t k = 0; k < count; k++) g->start[g->pair[k].low + 1]++;
  int32_t *end = g->best;
  for (int64_t k = 0; k < g->left; k++) g->start[k + 1] += g->start[k];
  memcpy(end, g->start, (size_t)g->left * sizeof *end);
  for (int64_t k = 0; k < count; k++) {
    const struct pair own = g->pair[k];
    int64_t at = end[own.low]++;
    for (; at > g->start[own.low] && g->sorted[at - 1].high > own.high; at--) g->sorted[at] = g->sorted[at - 1];
    g->sorted[at] = own;
  }
  g->pairs = 0;
  for (int64_t k = 0; k < count; k++) {
    struct pair own = g->sorted[k];
    if (g->pairs && g->pair[g->pairs - 1].low == own.low && g->pair[g->pairs - 1].high == own.high) continue;
    own.cost = dissimilarity(c, g->representative[own.low], g->representative[own.high]);
    g->pair[g->pairs++] = own;
  }
}

static int by_cost(const void *a, const void *b) {
  const double one = *(const double *)a, other = *(const double *)b;
  return (one > other) - (one < other);
}

static int by_pair(const void *a, const void *b) {
  const struct pair *one = a, *other = b;
  if (one->cost != other->cost) return one->cost < other->cost ? -1 : 1;
  if (one->low != other->low) return one->low < other->low ? -1 : 1;
  return (one->high > other->high) - (one->high < other->high);
}

/* As numpy.median. */
static double median_cost(const struct groups *g) {
  double *costs = (double *)g->sorted;
  for (int64_t k = 0; k < g->pairs; k++) costs[k] = g->pair[k].cost;
  qsort(costs, (size_t)g->pairs, sizeof *costs, by_cost);
  return (costs[(g->pairs - 1) / 2] + costs[g->pairs / 2]) / 2;
}

/* The pairs under a threshold that are each other's best choice, the cheapest first, in `sorted`; how many. */
static int64_t best_pairs(struct groups *g, double threshold) {
  for (int64_t k = 0; k < g->left; k++) g->best[k] = -1;
  for (int64_t k = 0; k < g->pairs; k++) {
    const struct pair *own = g->pair + k;
    if (!(own->cost < threshold)) continue;
    if (g->best[own->low] < 0 || own->cost < g->pair[g->best[own->low]].cost) g->best[own->low] = (int32_t)k;
    if (g->best[own->high] < 0 || own->cost < g->pair[g->best[own->high]].cost) g->best[own->high] = (int32_t)k;
  }
  int64_t count = 0;
  for (int64_t k = 0; k < g->pairs; k++)
    if (g->best[g->pair[k].low] == k && g->best[g->pair[k].high] == k) g->sorted[count++] = g->pair[k];
  qsort(g->sorted, (size_t)count, sizeof *g->sorted, by_pair);
  return count;
}

/* The point of each grown cluster that is nearest to its middle; of equal ones the first. */
static void represent(const struct clusters *c, struct groups *g) {
  for (int64_t k = 0; k < g->left; k++) g->least[k] = INFINITY;
  for (int pass = 0; pass < 2; pass++)
    for (int64_t k = c->points - 1; k >= 0; k--) {
      const int64_t own = c->label[k];
      if (!g->grown[own]) continue;
      double square = 0;
      for (int i = 0; i < 3; i++) {
        const double off = c->at[3 * k + i] - g->sum[3 * own + i] / g->size[own];
        square += off * off;
      }
      const double off = sqrt(square);
      if (pass && off <= (1 + c->equal) * g->least[own]) g->representative[own] = (int32_t)k;
      if (!pass && off < g->least[own]) g->least[own] = off;
    }
}

/* Unite the first pairs of `sorted`. */
static void merge(const struct clusters *c, struct groups *g, int64_t joined) {
  for (int64_t k = 0; k < g->left; k++) g->number[k] = -1, g->grown[k] = 0;
  for (int64_t k = 0; k < joined; k++) {
    const struct pair *own = g->sorted + k;
    g->number[own->high] = own->low;
    for (int i = 0; i < 3; i++) g->sum[3 * own->low + i] += g->sum[3 * own->high + i];
    g->size[own->low] += g->size[own->high];
    g->grown[own->low] = 1;
  }
  int32_t left = 0;
  for (int64_t k = 0; k < g->left; k++) {
    if (g->number[k] >= 0) {
      g->number[k] = g->number[g->number[k]]; /* its lower one has its new number already */
      continue;
    }
    memmove(g->sum + 3 * left, g->sum + 3 * k, 3 * sizeof *g->sum);
    g->size[left] = g->size[k];
    g->representative[left] = g->representative[k];
    g->grown[left] = g->grown[k];
    g->number[k] = left++;
  }
  g->left = left;
  for (int64_t k = 0; k < c->points; k++) c->label[k] = g->number[c->label[k]];
  represent(c, g);
  int64_t count = 0;
  for (int64_t k = 0; k < g->pairs; k++) {
    const int32_t i = g->number[g->pair[k].low], j = g->number[g->pair[k].high];
    if (i == j) continue;
    g->pair[count].low = i < j ? i : j;
    g->pair[count++].high = i < j ? j : i;
  }
  distinct(c, g, count);
}

static void grow(const struct clusters *c, struct groups *g) {
  g->left = c->points;
  for (int64_t k = 0; k < c->points; k++) {
    c->label[k] = g->representative[k] = (int32_t)k;
    memcpy(g->sum + 3 * k, c->at + 3 * k, 3 * sizeof *g->sum);
    g->size[k] = 1;
  }
  int64_t count = 0;
  for (int64_t k = 0; k < c->edges; k++) {
    const int32_t i = (int32_t)c->edge[2 * k], j = (int32_t)c->edge[2 * k + 1];
    if (i == j) continue;
    g->pair[count].low = i < j ? i : j;
    g->pair[count++].high = i < j ? j : i;
  }
  distinct(c, g, count);
  double threshold = g->pairs ? median_cost(g) : 0;
  for (int64_t round = 0; round < c->rounds && g->left > c->wanted && g->pairs; round++) {
    int64_t joined = best_pairs(g, threshold);
    if (joined > g->left - c->wanted) joined = g->left - c->wanted;
    if (joined)
      merge(c, g, joined);
    else
      threshold *= 2;
  }
}

/* Clusters points until about `wanted` clusters are left. */
POISE_EXPORT int64_t poise_clusters(const struct clusters *c) {
  const size_t n = (size_t)c->points, e = (size_t)c->edges + 1;
  struct groups g = {.pair = malloc(e * sizeof *g.pair), .sorted = malloc(e * sizeof *g.sorted)};
  int32_t *integers = malloc((4 * n + 1) * sizeof *integers);
  g.sum = malloc(5 * n * sizeof *g.sum + sizeof *g.sum);
  g.grown = malloc(n + 1);
  int64_t status = POISE_NO_MEMORY;
  if (g.pair && g.sorted && integers && g.sum && g.grown) {
    g.best = integers, g.number = g.best + n, g.representative = g.number + n, g.start = g.representative + n;
    g.size = g.sum + 3 * n, g.least = g.size + n;
    grow(c, &g);
    status = POISE_OK;
  }
  free(g.pair);
  free(g.sorted);
  free(integers);
  free(g.sum);
  free(g.grown);
  return status;
}
