/* Algebra of eight second-order cones of one size side by side: vectors hold component i of all eight in row i. Each
   lane computes in the order of operations that one cone alone would have, so that results do not depend on the lane.
   `size` is a constant where these are called, so that loops over components unroll. */
#ifndef POISE_EIGHT_CONES_H
#define POISE_EIGHT_CONES_H

#include "lanes.h"

enum { WIDEST = 4 };

/* W = eta (2 v v' - J)^(1/2), see Vandenberghe (2010), "The CVXOPT linear and quadratic cone program solvers",
   chapter 4. Cones of one number have v = 1 alone, and no share. */
struct scaling {
  row_of_block eta, v[WIDEST], back, share; /* back = 1 / eta, share = 1 / (1 + v0) */
};

/* Components of eight cones, whose first ones are numbers `heads` of u. */
static POISE_INLINE void take(const double *u, const int64_t *heads, const int size, row_of_block *out) {
  double lanes[WIDTH];
  for (int i = 0; i < size; i++) {
    for (int l = 0; l < WIDTH; l++) lanes[l] = u[heads[l] + i];
    memcpy(out + i, lanes, sizeof lanes);
  }
}

static POISE_INLINE void put(const row_of_block *u, const int64_t *heads, const int size, double *out) {
  for (int i = 0; i < size; i++)
    for (int l = 0; l < WIDTH; l++) out[heads[l] + i] = u[i][l];
}

static POISE_INLINE void minor(const row_of_block *u, const int size, row_of_block *out) { /* u' J u */
  row_of_block side = {0.0};
  for (int i = 1; i < size; i++) side += u[i] * u[i];
  take_roots(&side);
  *out = (u[0] - side) * (u[0] + side);
}

/* The scaling for which W z = W^-1 s = `middle` (size); `inside` becomes 0 in lanes whose s or z is not inside its cone. */
static POISE_INLINE void scale(const row_of_block *s, const row_of_block *z, const int size, struct scaling *w,
                               row_of_block *middle, row_of_block *inside) {
  const row_of_block none = {0.0}, one = none + 1.0;
  only_positive(s, inside);
  only_positive(z, inside);
  if (size == 1) {
    w->eta = s[0] / z[0];
    take_roots(&w->eta);
    w->back = one / w->eta;
    w->v[0] = one;
    middle[0] = s[0] * z[0];
    take_roots(middle);
    return;
  }
  row_of_block of_s, of_z;
  minor(s, size, &of_s);
  minor(z, size, &of_z);
  only_positive(&of_s, inside);
  only_positive(&of_z, inside);
  take_roots(&of_s);
  take_roots(&of_z);
  row_of_block product = none;
  for (int i = 0; i < size; i++) product += s[i] * z[i];
  row_of_block gamma = (one + product / (of_s * of_z)) / 2.0;
  take_roots(&gamma);
  w->eta = of_s / of_z;
  take_roots(&w->eta);
  for (int i = 1; i < size; i++) w->v[i] = (s[i] / of_s - z[i] / of_z) / (2.0 * gamma);
  row_of_block square = one; /* on the hyperboloid to the last bit */
  for (int i = 1; i < size; i++) square += w->v[i] * w->v[i];
  w->v[0] = square;
  take_roots(w->v);
  w->back = one / w->eta;
  w->share = one / (one + w->v[0]);
  row_of_block along = w->v[0] * z[0];
  for (int i = 1; i < size; i++) along += w->v[i] * z[i];
  middle[0] = w->eta * along;
  for (int i = 1; i < size; i++) middle[i] = w->eta * (z[i] + (z[0] + along) * w->share * w->v[i]);
}

/* out = W u, or W^-1 u */
static POISE_INLINE void apply_scaling(const struct scaling *w, const row_of_block *u, const int size,
                                       const int inverse, row_of_block *out) {
  const row_of_block eta = inverse ? w->back : w->eta;
  if (size == 1) {
    out[0] = u[0] * eta;
    return;
  }
  const double sign = inverse ? -1.0 : 1.0;
  row_of_block across = {0.0};
  for (int i = 1; i < size; i++) across += w->v[i] * u[i];
  const row_of_block along = w->v[0] * u[0] + sign * across, more = sign * u[0] + across * w->share;
  for (int i = 1; i < size; i++) out[i] = eta * (u[i] + more * w->v[i]);
  out[0] = eta * along;
}

/* Jordan product u o v, and the solution of u o out = v */
static POISE_INLINE void jordan(const row_of_block *u, const row_of_block *v, const int size, row_of_block *out) {
  row_of_block sum = {0.0};
  for (int i = 0; i < size; i++) sum += u[i] * v[i];
  for (int i = 1; i < size; i++) out[i] = u[0] * v[i] + v[0] * u[i];
  out[0] = sum;
}

static POISE_INLINE void divide(const row_of_block *u, const row_of_block *v, const int size, row_of_block *out) {
  if (size == 1) {
    out[0] = v[0] / u[0];
    return;
  }
  row_of_block sum = {0.0}, inside;
  for (int i = 1; i < size; i++) sum += u[i] * v[i];
  minor(u, size, &inside);
  const row_of_block first = (u[0] * v[0] - sum) / inside;
  for (int i = 1; i < size; i++) out[i] = (v[i] - first * u[i]) / u[0];
  out[0] = first;
}

/* Let `most` be the longest steps from u along d that stay in the cones, where they are shorter than it. */
static POISE_INLINE void reach(const row_of_block *u, const row_of_block *d, const int size, row_of_block *most) {
  double on[WIDTH], off[WIDTH], as[WIDTH], bs[WIDTH], cs[WIDTH], shortest[WIDTH];
  memcpy(on, u, sizeof on);
  memcpy(off, d, sizeof off);
  memcpy(shortest, most, sizeof shortest);
  if (size == 1) {
    for (int l = 0; l < WIDTH; l++) {
      const double end = -on[l] / off[l], least = off[l] < 0.0 ? end : INFINITY;
      shortest[l] = least < shortest[l] ? least : shortest[l];
    }
    memcpy(most, shortest, sizeof shortest);
    return;
  }
  row_of_block square = d[0] * d[0], across = u[0] * d[0], inside;
  for (int i = 1; i < size; i++) {
    square -= d[i] * d[i];
    across -= u[i] * d[i];
  }
  minor(u, size, &inside);
  memcpy(as, &square, sizeof as);
  memcpy(bs, &across, sizeof bs);
  memcpy(cs, &inside, sizeof cs);
  for (int l = 0; l < WIDTH; l++) { /* the first positive root of a t^2 + 2 b t + c */
    const double a = as[l], b = bs[l], c = cs[l] > 0.0 ? cs[l] : 0.0, end = -on[l] / off[l];
    const double root = b * b - a * c, side = sqrt(root > 0.0 ? root : 0.0);
    const int other = (b < 0.0) | (a >= 0.0), ends = (a < 0.0) | ((b < 0.0) & (root >= 0.0));
    const double found = (other ? c : -b - side) / (other ? -b + side : a);
    double least = off[l] < 0.0 ? end : INFINITY;
    least = ends & (found >= 0.0) & (found < least) ? found : least;
    shortest[l] = least < shortest[l] ? least : shortest[l];
  }
  memcpy(most, shortest, sizeof shortest);
}

#endif
