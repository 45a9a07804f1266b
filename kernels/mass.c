/* phi of a body as a function of log masses of parts and a deformation. */
#include "mass.h"

#include <math.h>
#include <string.h>

/* out = a b, 4 x 4 */
static void times(const double *a, const double *b, double *out) {
  for (int i = 0; i < 4; i++)
    for (int j = 0; j < 4; j++)
      out[4 * i + j] = a[4 * i] * b[j] + a[4 * i + 1] * b[4 + j] + a[4 * i + 2] * b[8 + j] + a[4 * i + 3] * b[12 + j];
}

/* out = a b^T, 4 x 4 */
static void times_transposed(const double *a, const double *b, double *out) {
  for (int i = 0; i < 4; i++)
    for (int j = 0; j < 4; j++) {
      double sum = 0.0;
      for (int k = 0; k < 4; k++) sum += a[4 * i + k] * b[4 * j + k];
      out[4 * i + j] = sum;
    }
}

/* phi of a symmetric pseudo-inertia, times a factor, into a column of a matrix. */
static void phi_of(const double *j, double factor, double *out, int64_t stride) {
  out[0] = factor * j[15];
  for (int k = 0; k < 3; k++) out[(1 + k) * stride] = factor * (j[4 * k + 3] + j[12 + k]) / 2.0;
  out[4 * stride] = factor * (j[5] + j[10]);
  out[5 * stride] = -factor * (j[1] + j[4]) / 2.0;
  out[6 * stride] = -factor * (j[2] + j[8]) / 2.0;
  out[7 * stride] = factor * (j[0] + j[10]);
  out[8 * stride] = -factor * (j[6] + j[9]) / 2.0;
  out[9 * stride] = factor * (j[0] + j[5]);
}

/* The deformation (16,) and its derivative (9, 16). */
static void deform(const struct mass_model *model, const double *coordinates, double *result, double *slopes) {
  const double share = ldexp(1.0, -(int)model->halvings);
  for (int e = 0; e < DEFORMATIONS * 16; e++) {
    double sum = 0.0;
    for (int c = 0; c < DEFORMATIONS; c++) sum += coordinates[c] * model->products[c * DEFORMATIONS * 16 + e];
    slopes[e] = model->flat[e] + share * sum;
  }
  for (int e = 0; e < 16; e++) {
    double sum = 0.0;
    for (int d = 0; d < DEFORMATIONS; d++) sum += coordinates[d] * (model->flat[16 * d + e] + slopes[16 * d + e]);
    result[e] = (e % 5 ? 0.0 : 1.0) + share / 2.0 * sum;
  }
  for (int e = 0; e < DEFORMATIONS * 16; e++) slopes[e] *= share;
  for (int64_t halving = 0; halving < model->halvings; halving++) {
    double left[16], right[16];
    for (int d = 0; d < DEFORMATIONS; d++) {
      times(slopes + 16 * d, result, right);
      times(result, slopes + 16 * d, left);
      for (int e = 0; e < 16; e++) slopes[16 * d + e] = left[e] + right[e];
    }
    times(result, result, left);
    memcpy(result, left, sizeof left);
  }
}

void mass_at(const struct mass_model *model, const double *state, double *phi, double *jacobian) {
  const int64_t n = model->states;
  double result[16], slopes[DEFORMATIONS * 16], whole[16] = {0.0}, half[16], moment[16], own[PHI];
  deform(model, state + model->parts, result, slopes);
  for (int i = 0; i < PHI; i++) phi[i] = 0.0;
  for (int64_t k = 0; k < model->parts; k++) {
    const double mass = model->shares[k] * exp(state[k]), *part = model->moments + 16 * k;
    for (int e = 0; e < 16; e++) whole[e] += mass * part[e];
    times(result, part, half);
    times_transposed(half, result, moment);
    phi_of(moment, mass / model->scale, own, 1);
    for (int i = 0; i < PHI; i++) phi[i] += own[i];
    for (int i = 0; jacobian && i < PHI; i++) jacobian[i * n + k] = own[i];
  }
  if (!jacobian) return;
  times_transposed(whole, result, half);
  for (int d = 0; d < DEFORMATIONS; d++) {
    times(slopes + 16 * d, half, moment);
    phi_of(moment, 2.0 / model->scale, jacobian + model->parts + d, n); /* and its transpose, which gives the same */
  }
}

void rooted(const struct mass_model *model, const double *jacobian, double *out) {
  const int64_t n = model->states, parts = model->parts;
  memcpy(out, jacobian, sizeof(double) * (size_t)(PHI * n));
  if (!model->root) return;
  for (int i = 0; i < PHI; i++)
    for (int64_t k = 0; k < parts; k++) {
      double sum = 0.0;
      for (int64_t j = 0; j < parts; j++) sum += jacobian[i * n + j] * model->root[j * parts + k];
      out[i * n + k] = sum;
    }
}

void by_mass(const struct mass_model *model, const double *jacobian, double *out) {
  for (int i = 0; i < PHI; i++) {
    out[i] = 0.0;
    for (int64_t k = 0; k < model->parts; k++) out[i] += jacobian[i * model->states + k];
  }
}
