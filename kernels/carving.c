/* How large a ball comes into each tetrahedron, which way points face, and which pockets are opened; as in
   poise/shape/carving.py. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "poise_kernels.h"

static const int FACES[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
static const double TINY = 1e-30;

static void minus(const double *a, const double *b, double *out) {
  for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}

static void cross(const double *a, const double *b, double *out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static double length(const double *a) { return sqrt(dot(a, a)); }

/* A way to a node of a graph that is not in its tree yet; the best are taken first. */
struct way {
  double key; /* the least first */
  int64_t number, to, from;
};

static int sooner(const struct way *a, const struct way *b) {
  return a->key != b->key ? a->key < b->key : a->number < b->number;
}

#define HEAP_ITEM struct way
#define HEAP_SOONER sooner
#include "heap.h"

static double radius_of_triangle(const double *p, const double *q, const double *r) {
  double a[3], b[3], c[3], u[3], v[3], area[3];
  minus(q, r, a), minus(p, r, b), minus(p, q, c), minus(q, p, u), minus(r, p, v);
  cross(u, v, area);
  return length(a) * length(b) * length(c) / fmax(2 * length(area), TINY);
}

static double radius_of_tetrahedron(const double *const *at) {
  double edge[3][3], square[3], across[3], normal[3] = {0};
  for (int k = 0; k < 3; k++) {
    minus(at[k + 1], at[0], edge[k]);
    square[k] = dot(edge[k], edge[k]);
  }
  for (int k = 0; k < 3; k++) {
    cross(edge[(k + 1) % 3], edge[(k + 2) % 3], across);
    for (int i = 0; i < 3; i++) normal[i] += square[k] * across[i];
  }
  cross(edge[1], edge[2], across);
  return length(normal) / fmax(2 * fabs(dot(edge[0], across)), TINY);
}

/* Points (N, 3), and (N,) how much coarser than usual they are around each. */
struct cloud {
  const double *points, *coarse;
};

/* Radius of the ball that passes a face, over how coarse its corners are on average. */
static double gate(const struct cloud *cloud, const int64_t *tetrahedron, int face) {
  const int64_t a = tetrahedron[FACES[face][0]], b = tetrahedron[FACES[face][1]], c = tetrahedron[FACES[face][2]];
  const double radius = radius_of_triangle(cloud->points + 3 * a, cloud->points + 3 * b, cloud->points + 3 * c);
  return radius / ((cloud->coarse[a] + cloud->coarse[b] + cloud->coarse[c]) / 3);
}

static int begin_outside(const struct cloud *cloud, int64_t count, const int64_t *tetrahedra, const int64_t *beside,
                         const double *own, heap *ways) {
  for (int64_t k = 0; k < count; k++) {
    double widest = 0;
    for (int face = 0; face < 4; face++)
      if (beside[4 * k + face] < 0) widest = fmax(widest, fmin(gate(cloud, tetrahedra + 4 * k, face), own[k]));
    if (widest > 0 && !heap_push(ways, (struct way){-fmax(widest, TINY), 4 * count + k, k, count})) return 0;
  }
  return 1;
}

/* Of tetrahedra (count, 4), with those behind their faces, -1 outside: the radius of the largest ball that comes into
   each, m, over how coarse the points (N,) are there; an order in which each comes after the one that it comes from;
   and that one (count + 1,), `count` for the outside. The tree of ways in is the widest; of equal ways it has those of
   lower numbers. found (1,): how many. */
POISE_EXPORT int64_t poise_reach(const double *points, const double *coarse, int64_t count, const int64_t *tetrahedra,
                                 const int64_t *beside, double *reach, int64_t *order, int64_t *parent,
                                 int64_t *found) {
  const struct cloud cloud = {points, coarse};
  double *own = malloc((size_t)(count + 1) * sizeof *own);
  heap ways = {0};
  int64_t status = POISE_NO_MEMORY;
  *found = 0;
  if (!own) goto done;
  for (int64_t k = 0; k < count; k++) {
    const double *at[4];
    double sum = 0;
    for (int i = 0; i < 4; i++) {
      at[i] = points + 3 * tetrahedra[4 * k + i];
      sum += coarse[tetrahedra[4 * k + i]];
    }
    own[k] = radius_of_tetrahedron(at) / (sum / 4);
    reach[k] = 0;
    parent[k] = -1;
  }
  parent[count] = count;
  if (!begin_outside(&cloud, count, tetrahedra, beside, own, &ways)) goto done;
  while (ways.count) {
    const struct way way = heap_pop(&ways);
    const int64_t k = way.to;
    if (parent[k] >= 0) continue;
    parent[k] = way.from;
    reach[k] = way.from < count ? fmin(reach[way.from], -way.key) : -way.key;
    order[(*found)++] = k;
    for (int face = 0; face < 4; face++) {
      const int64_t next = beside[4 * k + face];
      if (next < 0 || parent[next] >= 0) continue;
      int64_t low = k;
      int side = face;
      if (next < k) /* the face is that of the lower of the two */
        for (low = next, side = 0; beside[4 * low + side] != k; side++) continue;
      const double width = fmin(fmin(gate(&cloud, tetrahedra + 4 * low, side), own[k]), own[next]);
      if (!heap_push(&ways, (struct way){-fmax(width, TINY), 4 * low + side, next, k})) goto done;
    }
  }
  status = POISE_OK;
done:
  free(own);
  free(ways.item);
  return status;
}

/* Unit eigenvector of the least eigenvalue of a symmetric matrix, which is destroyed (Jacobi's rotations). */
static void least_direction(double m[3][3], double *out) {
  double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int sweep = 0; sweep < 30; sweep++) {
    const double off = m[0][1] * m[0][1] + m[0][2] * m[0][2] + m[1][2] * m[1][2];
    const double size = m[0][0] * m[0][0] + m[1][1] * m[1][1] + m[2][2] * m[2][2];
    if (!(off > 1e-34 * size)) break;
    for (int p = 0; p < 2; p++)
      for (int q = p + 1; q < 3; q++) {
        if (m[p][q] == 0) continue;
        const double theta = (m[q][q] - m[p][p]) / (2 * m[p][q]);
        const double t = (theta >= 0 ? 1 : -1) / (fabs(theta) + sqrt(theta * theta + 1));
        const double c = 1 / sqrt(t * t + 1), s = t * c;
        for (int k = 0; k < 3; k++) {
          const double a = m[k][p], b = m[k][q];
          m[k][p] = c * a - s * b, m[k][q] = s * a + c * b;
        }
        for (int k = 0; k < 3; k++) {
          const double a = m[p][k], b = m[q][k], x = v[k][p], y = v[k][q];
          m[p][k] = c * a - s * b, m[q][k] = s * a + c * b;
          v[k][p] = c * x - s * y, v[k][q] = s * x + c * y;
        }
      }
  }
  int least = 0;
  for (int k = 1; k < 3; k++)
    if (m[k][k] < m[least][least]) least = k;
  for (int k = 0; k < 3; k++) out[k] = v[k][least];
}

static void plane_normal(const double *points, const int64_t *near, int64_t k, double *normal) {
  double middle[3] = {0}, off[3], spread[3][3] = {{0}};
  for (int64_t j = 0; j < k; j++)
    for (int i = 0; i < 3; i++) middle[i] += points[3 * near[j] + i] / (double)k;
  for (int64_t j = 0; j < k; j++) {
    minus(points + 3 * near[j], middle, off);
    for (int a = 0; a < 3; a++)
      for (int b = 0; b < 3; b++) spread[a][b] += off[a] * off[b];
  }
  least_direction(spread, normal);
}

/* The ways from a point to the neighbours whose side is not known; `next` (2 n k,) are lists of the edges at each point,
   from `first` (n,): edge e is one of point e / 2 / k, and of its neighbour. */
static int hand_on(int64_t k, const int64_t *near, const double *normals, const uint8_t *known, const int64_t *first,
                   const int64_t *next, int64_t point, heap *ways) {
  for (int64_t e = first[point]; e >= 0; e = next[e]) {
    const int64_t edge = e / 2, other = e % 2 ? edge / k : near[edge];
    if (known[other]) continue;
    const double bend = 1.01 - fabs(dot(normals + 3 * point, normals + 3 * other));
    if (!heap_push(ways, (struct way){bend, edge, other, point})) return 0;
  }
  return 1;
}

/* Normals (n, 3) of points from planes through the k nearest of each (n, k), itself first. The side of those that are
   known, (n,), is that of `outward` (n, 3); it is handed on where the surface bends least. `known` is changed. */
POISE_EXPORT int64_t poise_oriented_normals(int64_t n, const double *points, int64_t k, const int64_t *near,
                                            const double *outward, uint8_t *known, double *normals) {
  int64_t *first = malloc((size_t)(n + 2 * n * k + 1) * sizeof *first), *next = first + n, status = POISE_NO_MEMORY;
  heap ways = {0};
  if (!first) return status;
  for (int64_t p = 0; p < n; p++) first[p] = -1;
  for (int64_t e = 0; e < n * k; e++) {
    const int64_t ends[2] = {e / k, near[e]};
    for (int i = 0; i < 2 && e % k; i++) {
      next[2 * e + i] = first[ends[i]];
      first[ends[i]] = 2 * e + i;
    }
  }
  for (int64_t p = 0; p < n; p++) {
    double *normal = normals + 3 * p;
    plane_normal(points, near + k * p, k, normal);
    if (known[p] && dot(normal, outward + 3 * p) < 0)
      for (int i = 0; i < 3; i++) normal[i] = -normal[i];
  }
  for (int64_t p = 0; p < n; p++)
    if (known[p] && !hand_on(k, near, normals, known, first, next, p, &ways)) goto done;
  while (ways.count) {
    const struct way way = heap_pop(&ways);
    double *normal = normals + 3 * way.to;
    if (known[way.to]) continue;
    known[way.to] = 1;
    if (dot(normal, normals + 3 * way.from) < 0)
      for (int i = 0; i < 3; i++) normal[i] = -normal[i];
    if (!hand_on(k, near, normals, known, first, next, way.to, &ways)) goto done;
  }
  status = POISE_OK;
done:
  free(first);
  free(ways.item);
  return status;
}

/* What speaks for a gap in each tetrahedron (count,): how far its corners face its middle. Corners that are not `deep`
   (points,) speak against one only, unless `fits` (count,). */
static double says(const double *points, const int64_t *tetrahedron, const double *facing, const uint8_t *deep, int fits) {
  double middle[3] = {0}, toward[3], sum = 0;
  for (int c = 0; c < 4; c++)
    for (int i = 0; i < 3; i++) middle[i] += points[3 * tetrahedron[c] + i] / 4;
  for (int c = 0; c < 4; c++) {
    const int64_t p = tetrahedron[c];
    minus(middle, points + 3 * p, toward);
    const double said = dot(toward, facing + 3 * p) / fmax(length(toward), TINY);
    sum += fits || deep[p] ? said : fmin(said, 0);
  }
  return sum / 4;
}

/* Layout of `_Pockets` in poise/kernels/carving.py. */
struct pockets {
  int64_t count, found;
  double ball, smallest, prior, cost;
  const double *points, *facing, *reach; /* (points, 3), (points, 3), (count,) in spacings */
  const uint8_t *deep, *inside;          /* (points,), (count,) */
  const int64_t *tetrahedra, *order, *parent;
  double *gain; /* (count,) */
  uint8_t *opened;
};

/* Which tetrahedra to open: the cut of the tree of ways in that gains most. */
POISE_EXPORT void poise_pockets(const struct pockets *p) {
  for (int64_t k = 0; k < p->count; k++) {
    p->opened[k] = 0;
    if (!p->inside[k]) continue;
    const int fits = p->reach[k] > p->ball;
    p->gain[k] = says(p->points, p->tetrahedra + 4 * k, p->facing, p->deep, fits) + (fits ? p->prior : -p->cost);
    if (p->reach[k] < p->smallest) p->gain[k] = -INFINITY;
  }
  for (int64_t i = p->found - 1; i >= 0; i--) {
    const int64_t k = p->order[i], from = p->parent[k];
    if (p->inside[k] && p->gain[k] > 0 && from < p->count && p->inside[from]) p->gain[from] += p->gain[k];
  }
  for (int64_t i = 0; i < p->found; i++) {
    const int64_t k = p->order[i], from = p->parent[k];
    p->opened[k] = p->inside[k] && p->gain[k] > 0 && (from == p->count || !p->inside[from] || p->opened[from]);
  }
}
