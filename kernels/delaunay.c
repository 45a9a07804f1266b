/* Delaunay tetrahedra of points in space: one point after the other replaces the tetrahedra whose spheres contain it
   (Bowyer 1981, Watson 1981). Coordinates are rounded to 2^-24 of the extent, so that all signs are exact: in doubles
   where these are sure, else in integers of 128 bits. Points on a sphere count as outside of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "poise_kernels.h"

enum { OUTSIDE = -1, BITS = 24 }; /* OUTSIDE: the vertex of the tetrahedra beyond the hull */

typedef __int128 wide;
typedef struct {
  int32_t vertex[4], beside[4]; /* beside: the tetrahedron behind the face opposite each vertex; vertex[0] -2: free */
} cell;
typedef struct {
  double (*at)[3];
  cell *cells;
  int64_t *tested; /* stamp of the last point that was tested; its sign says whether it conflicts */
  int64_t count, room, stamp;
  int32_t *stack, *dying, *face, *spare;
  int64_t n_spare, held;
  struct edge *edges;
  int64_t n_edges;
  uint64_t random;
} mesh;
struct edge {
  int64_t stamp;
  int32_t low, high, cell, side;
};

static inline uint32_t draw(mesh *m) {
  m->random = m->random * 6364136223846793005ULL + 1442695040888963407ULL;
  return (uint32_t)(m->random >> 33);
}

/* Sign of the volume of a tetrahedron. */
static int orientation(const double *a, const double *b, const double *c, const double *d) {
  const double ax = a[0] - d[0], ay = a[1] - d[1], az = a[2] - d[2], bx = b[0] - d[0], by = b[1] - d[1],
               bz = b[2] - d[2], cx = c[0] - d[0], cy = c[1] - d[1], cz = c[2] - d[2];
  const double bc = bx * cy - cx * by, ca = cx * ay - ax * cy, ab = ax * by - bx * ay; /* exact */
  const double det = az * bc + bz * ca + cz * ab;
  const double sure = 1e-15 * (fabs(az * bc) + fabs(bz * ca) + fabs(cz * ab));
  if (det > sure) return 1;
  if (det < -sure) return -1;
  const wide exact = (wide)(int64_t)az * (int64_t)bc + (wide)(int64_t)bz * (int64_t)ca + (wide)(int64_t)cz * (int64_t)ab;
  return (exact > 0) - (exact < 0);
}

/* 1 where e is inside of the sphere through a, b, c, d, which are of positive orientation; -1 outside. */
static int in_sphere(const double *a, const double *b, const double *c, const double *d, const double *e) {
  const double ax = a[0] - e[0], ay = a[1] - e[1], az = a[2] - e[2], bx = b[0] - e[0], by = b[1] - e[1],
               bz = b[2] - e[2], cx = c[0] - e[0], cy = c[1] - e[1], cz = c[2] - e[2], dx = d[0] - e[0],
               dy = d[1] - e[1], dz = d[2] - e[2];
  const double ab = ax * by - bx * ay, bc = bx * cy - cx * by, cd = cx * dy - dx * cy, da = dx * ay - ax * dy,
               ac = ax * cy - cx * ay, bd = bx * dy - dx * by; /* exact, as are the lengths */
  const double al = ax * ax + ay * ay + az * az, bl = bx * bx + by * by + bz * bz, cl = cx * cx + cy * cy + cz * cz,
               dl = dx * dx + dy * dy + dz * dz;
  const double abc = az * bc - bz * ac + cz * ab, bcd = bz * cd - cz * bd + dz * bc, cda = cz * da + dz * ac + az * cd,
               dab = dz * ab + az * bd + bz * da;
  const double det = (dl * abc - cl * dab) + (bl * cda - al * bcd);
  const double sure =
      2e-15 * (dl * (fabs(az * bc) + fabs(bz * ac) + fabs(cz * ab)) + cl * (fabs(dz * ab) + fabs(az * bd) + fabs(bz * da)) +
               bl * (fabs(cz * da) + fabs(dz * ac) + fabs(az * cd)) + al * (fabs(bz * cd) + fabs(cz * bd) + fabs(dz * bc)));
  if (det > sure) return 1;
  if (det < -sure) return -1;
#define TIMES(x, y) ((wide)(int64_t)(x) * (int64_t)(y))
  const wide exact = (TIMES(az, bc) - TIMES(bz, ac) + TIMES(cz, ab)) * (int64_t)dl -
                     (TIMES(dz, ab) + TIMES(az, bd) + TIMES(bz, da)) * (int64_t)cl +
                     (TIMES(cz, da) + TIMES(dz, ac) + TIMES(az, cd)) * (int64_t)bl -
                     (TIMES(bz, cd) - TIMES(cz, bd) + TIMES(dz, bc)) * (int64_t)al;
#undef TIMES
  return (exact > 0) - (exact < 0);
}

/* Orientation of a cell with the vertex of one corner replaced by a point. */
static int oriented_with(const mesh *m, const cell *c, int corner, const double *point) {
  const double *at[4];
  for (int i = 0; i < 4; i++) at[i] = i == corner ? point : m->at[c->vertex[i]];
  return orientation(at[0], at[1], at[2], at[3]);
}

static int outer_corner(const cell *c) {
  for (int i = 0; i < 4; i++)
    if (c->vertex[i] == OUTSIDE) return i;
  return -1;
}

static int sphere_has(const mesh *m, const cell *c, const double *point) {
  return in_sphere(m->at[c->vertex[0]], m->at[c->vertex[1]], m->at[c->vertex[2]], m->at[c->vertex[3]], point) > 0;
}

/* Whether a point is in the sphere of a cell; beyond the hull that is the space over its face. */
static int conflicts(const mesh *m, int32_t which, const double *point) {
  const cell *c = m->cells + which;
  const int outer = outer_corner(c);
  if (outer < 0) return sphere_has(m, c, point);
  const int side = oriented_with(m, c, outer, point);
  return side > 0 || (side == 0 && sphere_has(m, m->cells + c->beside[outer], point));
}

/* A cell that conflicts with a point, from one nearby; -1 where the point is there already. */
static int32_t locate(mesh *m, int32_t from, const double *point) {
  const int first_outer = outer_corner(m->cells + from);
  if (first_outer >= 0) from = m->cells[from].beside[first_outer];
  for (;;) {
    const cell *c = m->cells + from;
    if (outer_corner(c) >= 0) return from;
    const int start = (int)(draw(m) & 3);
    int side = 0;
    for (; side < 4; side++)
      if (oriented_with(m, c, (start + side) & 3, point) < 0) break;
    if (side < 4) {
      from = c->beside[(start + side) & 3];
      continue;
    }
    for (int i = 0; i < 4; i++)
      if (memcmp(m->at[c->vertex[i]], point, sizeof *m->at) == 0) return -1;
    return from;
  }
}

static int grow(mesh *m, int64_t room) {
  if (room <= m->room) return 1;
  room = room + room / 2;
#define RESIZE(array, size)                                   \
  do {                                                        \
    void *larger = realloc(array, (size_t)(size) * sizeof *(array)); \
    if (!larger) return 0;                                    \
    array = larger;                                           \
  } while (0)
  RESIZE(m->cells, room);
  RESIZE(m->tested, room);
  RESIZE(m->stack, room);
  RESIZE(m->dying, room);
  RESIZE(m->face, 4 * room);
  RESIZE(m->spare, room);
#undef RESIZE
  memset(m->tested + m->room, 0, (size_t)(room - m->room) * sizeof *m->tested);
  m->room = room;
  return 1;
}

static int grow_edges(mesh *m, int64_t faces) {
  int64_t wanted = 256;
  while (wanted < 8 * faces) wanted *= 2;
  if (wanted <= m->n_edges) return 1;
  free(m->edges);
  m->edges = calloc((size_t)wanted, sizeof *m->edges);
  m->n_edges = m->edges ? wanted : 0;
  return m->edges != NULL;
}

/* Join two cells that share the new point and an edge: the first of the two waits in the table for the second. */
static void meet(mesh *m, int32_t u, int32_t v, int32_t which, int side) {
  const int32_t low = u < v ? u : v, high = u < v ? v : u;
  uint64_t slot = ((uint64_t)(uint32_t)low * 0x9E3779B97F4A7C15ULL + (uint64_t)(uint32_t)high * 0xC2B2AE3D27D4EB4FULL) >> 20;
  for (;; slot++) {
    struct edge *e = m->edges + (slot & (uint64_t)(m->n_edges - 1));
    if (e->stamp != m->stamp) {
      *e = (struct edge){m->stamp, low, high, which, side};
      return;
    }
    if (e->low == low && e->high == high) {
      m->cells[which].beside[side] = e->cell;
      m->cells[e->cell].beside[e->side] = which;
      return;
    }
  }
}

/* The cells that conflict with a point, from one of them, in dying; and the faces around them, 4 cell + corner. */
static int64_t cavity(mesh *m, int32_t from, const double *point, int64_t *dying) {
  int64_t waiting = 0, faces = 0;
  *dying = 0;
  m->stack[waiting++] = from;
  m->tested[from] = m->stamp;
  while (waiting) {
    const int32_t which = m->stack[--waiting];
    m->dying[(*dying)++] = which;
    for (int i = 0; i < 4; i++) {
      const int32_t next = m->cells[which].beside[i];
      if (m->tested[next] == m->stamp) continue;
      if (m->tested[next] != -m->stamp) {
        if (conflicts(m, next, point)) {
          m->tested[next] = m->stamp;
          m->stack[waiting++] = next;
          continue;
        }
        m->tested[next] = -m->stamp;
      }
      m->face[faces++] = 4 * which + i;
    }
  }
  return faces;
}

/* Put a point in; a cell beside it, -1 where it is there already, -2 without memory. */
static int32_t insert(mesh *m, int32_t number, int32_t from) {
  const double *point = m->at[number];
  from = locate(m, from, point);
  if (from < 0) return -1;
  m->stamp++;
  int64_t dying;
  const int64_t faces = cavity(m, from, point, &dying);
  if (!grow(m, m->count + faces) || !grow_edges(m, faces)) return -2;
  int32_t which = -1;
  for (int64_t k = 0; k < faces; k++) {
    const int32_t old = m->face[k] / 4, corner = m->face[k] % 4;
    which = m->n_spare ? m->spare[--m->n_spare] : (int32_t)m->count++;
    const cell *was = m->cells + old;
    cell *made = m->cells + which;
    *made = *was;
    made->vertex[corner] = number;
    cell *behind = m->cells + was->beside[corner];
    for (int i = 0; i < 4; i++)
      if (behind->beside[i] == old) { /* maybe across another face: cells beyond the hull share two of them */
        int shared = 0;
        for (int j = 0; j < 4; j++)
          for (int l = 0; l < 4; l++) shared += j != corner && l != i && was->vertex[j] == behind->vertex[l];
        if (shared == 3) behind->beside[i] = which;
      }
    m->tested[which] = 0;
    for (int i = 0; i < 4; i++) {
      if (i == corner) continue;
      int32_t edge[2], n = 0;
      for (int j = 0; j < 4; j++)
        if (j != i && j != corner) edge[n++] = made->vertex[j];
      meet(m, edge[0], edge[1], which, i);
    }
  }
  for (int64_t k = 0; k < dying; k++) {
    m->cells[m->dying[k]].vertex[0] = -2;
    m->spare[m->n_spare++] = m->dying[k];
  }
  return which;
}

/* The first tetrahedron and the four beyond its faces. */
static void begin(mesh *m, const int32_t *first) {
  cell *cells = m->cells;
  m->count = 5;
  for (int i = 0; i < 4; i++) cells[0].vertex[i] = first[i], cells[0].beside[i] = i + 1;
  for (int i = 0; i < 4; i++) {
    cell *outer = cells + 1 + i;
    for (int j = 0; j < 4; j++) outer->vertex[j] = first[j], outer->beside[j] = j == i ? 0 : j + 1;
    outer->vertex[i] = OUTSIDE;
    const int a = (i + 1) & 3, b = (i + 2) & 3;
    int32_t kept = outer->vertex[a];
    outer->vertex[a] = outer->vertex[b], outer->vertex[b] = kept;
    kept = outer->beside[a];
    outer->beside[a] = outer->beside[b], outer->beside[b] = kept;
  }
}

/* Four points, of the order, that span space, positive, moved to its front; 0 where there are none. */
static int spanning(const mesh *m, int32_t *order, int64_t n) {
  int found = 1;
  for (int64_t k = 1; k < n && found < 4; k++) {
    const double *p = m->at[order[k]], *a = m->at[order[0]], *b = found > 1 ? m->at[order[1]] : a;
    int apart;
    if (found == 1) {
      apart = memcmp(p, a, sizeof *m->at) != 0;
    } else if (found == 2) {
      const double u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
      apart = u[0] * v[1] != u[1] * v[0] || u[1] * v[2] != u[2] * v[1] || u[2] * v[0] != u[0] * v[2];
    } else {
      apart = orientation(a, b, m->at[order[2]], p) != 0;
    }
    if (!apart) continue;
    const int32_t own = order[k];
    memmove(order + found + 1, order + found, (size_t)(k - found) * sizeof *order);
    order[found++] = own;
  }
  if (found < 4) return 0;
  if (orientation(m->at[order[0]], m->at[order[1]], m->at[order[2]], m->at[order[3]]) < 0) {
    const int32_t own = order[0];
    order[0] = order[1], order[1] = own;
  }
  return 1;
}

struct key {
  uint64_t code;
  int32_t number;
};

static int by_code(const void *a, const void *b) {
  const struct key *one = a, *other = b;
  if (one->code != other->code) return one->code < other->code ? -1 : 1;
  return (one->number > other->number) - (one->number < other->number);
}

/* In rounds of twice as many points each, drawn at random, and along a curve that fills space within each (Amenta et al.
   2003): each point is near the one before. */
static int arrange(mesh *m, int64_t n, int32_t *order) {
  struct key *keys = malloc((size_t)n * sizeof *keys);
  if (!keys) return 0;
  for (int64_t k = 0; k < n; k++) {
    uint64_t code = 0, round = 15;
    while (round > 0 && (draw(m) & 1)) round--;
    for (int bit = BITS - 1; bit >= BITS - 20; bit--)
      for (int axis = 0; axis < 3; axis++) code = code << 1 | (((uint64_t)m->at[k][axis] >> bit) & 1);
    keys[k] = (struct key){round << 60 | code, (int32_t)k};
  }
  qsort(keys, (size_t)n, sizeof *keys, by_code);
  for (int64_t k = 0; k < n; k++) order[k] = keys[k].number;
  free(keys);
  return 1;
}

static void exchange(cell *c, int i, int j) {
  const int32_t vertex = c->vertex[i], beside = c->beside[i];
  c->vertex[i] = c->vertex[j], c->beside[i] = c->beside[j];
  c->vertex[j] = vertex, c->beside[j] = beside;
}

/* The cells in the order of their vertices, these increasing, but for the first two where that makes them right-handed;
   the side of flat ones follows from their neighbours. -1 beyond the hull. */
static int64_t hand_out(mesh *m, int64_t n, int64_t *tetrahedra, int64_t *beside) {
  int64_t count = 0;
  int32_t *own = m->stack, *other = m->dying, *place = m->spare;
  for (int64_t k = 0; k < m->count; k++) {
    cell *c = m->cells + k;
    place[k] = -1;
    if (c->vertex[0] == -2 || outer_corner(c) >= 0) continue;
    own[count++] = (int32_t)k;
    m->tested[k] = 1; /* whether it is left-handed */
    for (int i = 1; i < 4; i++)
      for (int j = i; j > 0 && c->vertex[j] < c->vertex[j - 1]; j--) {
        exchange(c, j, j - 1);
        m->tested[k] = !m->tested[k];
      }
  }
  int64_t *start = calloc((size_t)n + 1, sizeof *start);
  if (!start) return -1;
  for (int corner = 3; corner >= 0; corner--) {
    memset(start, 0, (size_t)(n + 1) * sizeof *start);
    for (int64_t k = 0; k < count; k++) start[m->cells[own[k]].vertex[corner] + 1]++;
    for (int64_t k = 0; k < n; k++) start[k + 1] += start[k];
    for (int64_t k = 0; k < count; k++) other[start[m->cells[own[k]].vertex[corner]]++] = own[k];
    int32_t *kept = own;
    own = other, other = kept;
  }
  free(start);
  for (int64_t k = 0; k < count; k++) {
    place[own[k]] = (int32_t)k;
    if (m->tested[own[k]]) exchange(m->cells + own[k], 0, 1);
  }
  for (int64_t k = 0; k < count; k++)
    for (int i = 0; i < 4; i++) {
      tetrahedra[4 * k + i] = m->cells[own[k]].vertex[i];
      beside[4 * k + i] = place[m->cells[own[k]].beside[i]];
    }
  return count;
}

static int snapped(mesh *m, int64_t n, const double *points) {
  double low[3], extent = 0;
  for (int axis = 0; axis < 3; axis++) {
    double high = low[axis] = points[axis];
    for (int64_t k = 1; k < n; k++) {
      const double value = points[3 * k + axis];
      if (value < low[axis]) low[axis] = value;
      if (value > high) high = value;
    }
    if (high - low[axis] > extent) extent = high - low[axis];
  }
  if (!(extent > 0) || !isfinite(extent)) return 0;
  const double scale = ((1 << BITS) - 1) / extent;
  for (int64_t k = 0; k < n; k++)
    for (int axis = 0; axis < 3; axis++) m->at[k][axis] = floor((points[3 * k + axis] - low[axis]) * scale + 0.5);
  return 1;
}

static int triangulate(mesh *m, int64_t n, const double *points) {
  m->at = malloc((size_t)n * sizeof *m->at);
  int32_t *order = malloc((size_t)n * sizeof *order);
  int status = POISE_NO_MEMORY;
  if (!m->at || !order || !grow(m, 10 * n + 64) || !grow_edges(m, 64)) goto done;
  status = POISE_SINGULAR;
  if (n < 4 || !snapped(m, n, points)) goto done;
  status = POISE_NO_MEMORY;
  if (!arrange(m, n, order)) goto done;
  status = POISE_SINGULAR;
  if (!spanning(m, order, n)) goto done;
  begin(m, order);
  int32_t last = 0;
  status = POISE_OK;
  for (int64_t k = 4; k < n; k++) {
    const int32_t made = insert(m, order[k], last);
    if (made == -2) {
      status = POISE_NO_MEMORY;
      break;
    }
    if (made >= 0) last = made;
  }
done:
  free(order);
  return status;
}

/* Of points (n, 3), finite. At most `room` tetrahedra (room, 4) are written, as by `hand_out`, with the one behind the
   face opposite each vertex, -1 for none; found (1,): how many there are, and nothing is
   written if they are more. POISE_SINGULAR: the points lie in a plane. */
POISE_EXPORT int64_t poise_delaunay(int64_t n, const double *points, int64_t room, int64_t *tetrahedra, int64_t *beside,
                                    int64_t *found) {
  mesh m = {.random = 1};
  int64_t status = triangulate(&m, n, points);
  if (status == POISE_OK) {
    *found = 0;
    for (int64_t k = 0; k < m.count; k++) *found += m.cells[k].vertex[0] != -2 && outer_corner(m.cells + k) < 0;
    if (*found <= room && hand_out(&m, n, tetrahedra, beside) < 0) status = POISE_NO_MEMORY;
  }
  free(m.at);
  free(m.cells);
  free(m.tested);
  free(m.stack);
  free(m.dying);
  free(m.face);
  free(m.spare);
  free(m.edges);
  return status;
}
