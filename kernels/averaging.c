/* Gauss-Newton and covariance of the hypotheses about a payload; what poise/inertia/bayes/averaging.py and curvature.py
   do with numpy, and why, is said there. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "averaging.h"
#include "dense.h"

static const double LARGEST_FALL = 0.8, LARGEST_STEP = 0.5, SHORTENING = 0.25, TINY = 1e-20;
static const double UNSEEN = 1e-6, PRECISION = 1e-12;

/* Arrays of one hypothesis; wide = states + 1. */
struct room {
  double *jacobian, *freed, *root, *half;            /* (10, wide) */
  double *seen;                                      /* (wide, wide) */
  double *trial, *step, *offset, *free, *z, *scale;  /* (wide,) */
  int *exchanges;                                    /* (wide,) */
};

static int make_room(struct room *room, int64_t states) {
  const int64_t wide = states + 1;
  double *all = malloc(sizeof(double) * (size_t)((4 * PHI + wide + 7) * wide));
  if (!all) return POISE_NO_MEMORY;
  double **rows[] = {&room->trial, &room->step, &room->offset, &room->free, &room->z, &room->scale};
  room->jacobian = all;
  room->freed = all + PHI * wide;
  room->root = all + 2 * PHI * wide;
  room->half = all + 3 * PHI * wide;
  room->seen = all + 4 * PHI * wide;
  for (int k = 0; k < 6; k++) *rows[k] = all + (4 * PHI + wide + k) * wide;
  room->exchanges = (int *)(all + (4 * PHI + wide + 6) * wide);
  return POISE_OK;
}

/* Minus the log of the prior of a state. */
static double penalty_of(const struct mass_model *model, const double *state, const double *variances, double *room) {
  const int64_t parts = model->parts;
  double number = 0.0, common = 0.0, apart = 0.0, bent = 0.0;
  for (int64_t k = 0; k < parts; k++) {
    double density = 0.0, one = 0.0;
    for (int64_t j = 0; j < parts; j++) {
      density += (state[j] - model->guess[j]) * model->unrooted[j * parts + k];
      one += model->unrooted[j * parts + k];
    }
    room[k] = density;
    number += one * one / fmax(variances[k], TINY);
    common += density * one / fmax(variances[k], TINY);
  }
  common /= number;
  for (int64_t k = 0; k < parts; k++) {
    double one = 0.0;
    for (int64_t j = 0; j < parts; j++) one += model->unrooted[j * parts + k];
    const double rest = room[k] - common * one;
    apart += rest * rest / fmax(variances[k], TINY);
  }
  for (int64_t k = parts; k < model->states; k++) bent += state[k] * state[k] / variances[k];
  const double together = common * common / (1.0 / number + model->any_mass);
  return (apart + together + bent) / 2.0;
}

/* The root (10, states + 1) of a prior of phi, the mass last, and (states + 1)^2 of 1 + root^T H root. */
static void seen_through(const struct mass_model *model, const double *jacobian, const double *variances,
                         const double *information, double *root, double *half, double *seen) {
  const int64_t n = model->states, wide = n + 1;
  double mass[PHI];
  rooted(model, jacobian, half);
  by_mass(model, jacobian, mass);
  for (int i = 0; i < PHI; i++) {
    for (int64_t k = 0; k < n; k++) root[i * wide + k] = half[i * n + k] * sqrt(variances[k]);
    root[i * wide + n] = sqrt(model->any_mass) * mass[i];
  }
  product(information, root, PHI, PHI, wide, half);
  for (int64_t j = 0; j < wide; j++)
    for (int64_t k = 0; k < wide; k++) {
      double sum = j == k ? 1.0 : 0.0;
      for (int i = 0; i < PHI; i++) sum += root[i * wide + j] * half[i * wide + k];
      seen[j * wide + k] = sum;
    }
}

int64_t prior_of(const struct mass_model *model, const double *state, const double *variances, double *mean,
                 double *covariance) {
  const int64_t n = model->states, wide = n + 1;
  const double nothing[PHI * PHI] = {0.0};
  double *jacobian = malloc(sizeof(double) * (size_t)(3 * PHI * wide + wide * wide + n));
  if (!jacobian) return POISE_NO_MEMORY;
  double *root = jacobian + PHI * wide, *half = root + PHI * wide, *seen = half + PHI * wide;
  double *offset = seen + wide * wide, phi[PHI];
  mass_at(model, state, phi, jacobian);
  for (int64_t k = 0; k < n; k++) offset[k] = model->guess[k] - state[k];
  apply(jacobian, offset, PHI, n, mean);
  for (int i = 0; i < PHI; i++) mean[i] += phi[i];
  seen_through(model, jacobian, variances, nothing, root, half, seen);
  for (int i = 0; i < PHI; i++)
    for (int j = 0; j < PHI; j++) {
      double sum = 0.0;
      for (int64_t k = 0; k < wide; k++) sum += root[i * wide + k] * root[j * wide + k];
      covariance[i * PHI + j] = sum;
    }
  free(jacobian);
  return POISE_OK;
}

/* Scale `seen` to a unit diagonal and factor it, because the common mass is seen far better than all else. */
static int factor_seen(struct room *room, int wide, double *determinant) {
  *determinant = 0.0;
  for (int j = 0; j < wide; j++) {
    room->scale[j] = sqrt(fmax(room->seen[j * (wide + 1)], 1.0)); /* less than 1 by rounding alone */
    *determinant += 2.0 * log(room->scale[j]);
  }
  for (int j = 0; j < wide; j++)
    for (int k = 0; k < wide; k++) room->seen[j * wide + k] /= room->scale[j] * room->scale[k];
  const int status = factor_rows(room->seen, wide, room->exchanges);
  if (!status) *determinant += log_determinant(room->seen, wide);
  return status;
}

/* The Gauss-Newton step of `ModelAverage._gauss_newton`, into room->step, and log |1 + C H| with the prior covariance C
   of phi. */
static int step_of(const struct mass_model *model, struct room *room, const double *state, const double *phi,
                   const double *variances, const double *square, const double *linear, double *determinant) {
  const int64_t n = model->states, parts = model->parts, wide = n + 1;
  double gradient[PHI], moved[PHI], mean[PHI], other;
  for (int64_t k = 0; k < n; k++) room->offset[k] = model->guess[k] - state[k], room->free[k] = 1.0;
  for (int turn = 0; turn < 2; turn++) {
    apply(room->jacobian, room->offset, PHI, n, mean);
    for (int i = 0; i < PHI; i++) mean[i] += phi[i];
    apply(square, mean, PHI, PHI, moved);
    for (int i = 0; i < PHI; i++) gradient[i] = linear[i] - moved[i];
    for (int i = 0; i < PHI; i++)
      for (int64_t k = 0; k < n; k++) room->freed[i * n + k] = room->jacobian[i * n + k] * room->free[k];
    seen_through(model, room->freed, variances, square, room->root, room->half, room->seen);
    const int status = factor_seen(room, (int)wide, turn ? &other : determinant);
    if (status) return status;
    for (int64_t k = 0; k < wide; k++) {
      room->z[k] = 0.0;
      for (int i = 0; i < PHI; i++) room->z[k] += room->root[i * wide + k] * gradient[i];
      room->z[k] /= room->scale[k];
    }
    solve_rows(room->seen, (int)wide, room->exchanges, room->z, 1);
    for (int64_t k = 0; k < wide; k++) room->z[k] /= room->scale[k];
    for (int64_t k = 0; k < n; k++) room->z[k] *= sqrt(variances[k]);
    int lost = 0;
    for (int64_t k = 0; k < n; k++) {
      double change = room->z[k];
      if (model->root && k < parts) {
        change = 0.0;
        for (int64_t j = 0; j < parts; j++) change += model->root[k * parts + j] * room->z[j];
      }
      if (k < parts) change += sqrt(model->any_mass) * room->z[n];
      room->step[k] = room->offset[k] + change * room->free[k];
    }
    for (int64_t k = 0; k < parts; k++)
      if (room->step[k] < -LARGEST_FALL) room->offset[k] = -LARGEST_FALL, room->free[k] = 0.0, lost = 1;
    if (!lost) break;
  }
  return POISE_OK;
}

/* A share of a step, short enough for masses to stay positive; `_moved` in Python. */
static void move(const struct mass_model *model, const double *state, const double *step, double length, double *out) {
  double least = INFINITY, most = 0.0;
  for (int64_t k = 0; k < model->parts; k++) least = step[k] < least || isnan(step[k]) ? step[k] : least;
  for (int64_t k = model->parts; k < model->states; k++)
    most = fabs(step[k]) > most || isnan(step[k]) ? fabs(step[k]) : most;
  const double fall = -least / LARGEST_FALL, turn = most / LARGEST_STEP;
  double longest = 1.0;
  if (!(fall <= longest)) longest = fall;
  if (!(turn <= longest)) longest = turn;
  for (int64_t k = 0; k < model->states; k++) {
    const double taken = step[k] * (length / longest);
    out[k] = state[k] + (k < model->parts ? log1p(taken) : taken);
  }
}

/* One hypothesis: state (states,) becomes the most probable one. */
static int climb(const struct mass_model *model, struct room *room, double *state, const double *variances,
                 const double *square, const double *linear, double tolerance, int64_t most, double *phi,
                 double *penalty, double *determinant) {
  const int64_t n = model->states;
  double log = -INFINITY, length = 1.0, there[PHI], pulled[PHI];
  memset(room->step, 0, sizeof(double) * (size_t)n);
  memset(phi, 0, sizeof(double) * PHI);
  *penalty = *determinant = 0.0;
  for (int64_t iteration = 0; iteration < most; iteration++) {
    move(model, state, room->step, length, room->trial);
    mass_at(model, room->trial, there, room->jacobian);
    const double cost = penalty_of(model, room->trial, variances, room->z);
    apply(square, there, PHI, PHI, pulled);
    double here = -cost;
    for (int i = 0; i < PHI; i++) here += there[i] * (linear[i] - pulled[i] / 2.0);
    const double gain = here - log;
    if (gain >= 0.0) {
      log = here, length = 1.0, *penalty = cost;
      memcpy(state, room->trial, sizeof(double) * (size_t)n);
      memcpy(phi, there, sizeof there);
      const int status = step_of(model, room, state, phi, variances, square, linear, determinant);
      if (status) return status;
    } else {
      length *= SHORTENING;
    }
    if (!(fabs(gain) > tolerance)) break;
  }
  return POISE_OK;
}

int64_t climb_all(const struct mass_model *model, int64_t count, double *states, const double *variances,
                  const int64_t *cases, const double *informations, const double *vectors, double tolerance,
                  int64_t most, double *phi, double *penalties, double *determinants) {
  struct room room;
  int status = make_room(&room, model->states);
  if (status) return status;
  for (int64_t h = 0; h < count && !status; h++) {
    const double *square = informations + PHI * PHI * cases[h], *own = variances + h * model->states;
    status = climb(model, &room, states + h * model->states, own, square, vectors + PHI * cases[h], tolerance, most,
                   phi + PHI * h, penalties + h, determinants + h);
  }
  free(room.jacobian);
  return status;
}

/* half (wide, 10) = (1 + root^T H root)^-1/2 root^T, from `seen` = 1 + root^T H root, which is lost. */
static void halved(double *seen, const double *root, int64_t wide, double *factor, double *values, double *half) {
  memcpy(factor, seen, sizeof(double) * (size_t)(wide * wide));
  if (!cholesky(factor, wide)) {
    for (int64_t k = 0; k < wide; k++) /* L^-1 root^T */
      for (int i = 0; i < PHI; i++) {
        double sum = root[i * wide + k];
        for (int64_t j = 0; j < k; j++) sum -= factor[k * wide + j] * half[j * PHI + i];
        half[k * PHI + i] = sum / factor[k * (wide + 1)];
      }
    return;
  }
  eigen(seen, wide, values, factor); /* rounding has made information negative that there is none of */
  for (int64_t k = 0; k < wide; k++)
    for (int i = 0; i < PHI; i++) {
      double sum = 0.0;
      for (int64_t j = 0; j < wide; j++) sum += factor[j * wide + k] * root[i * wide + j];
      half[k * PHI + i] = sum / sqrt(fmax(values[k], 1.0));
    }
}

int64_t narrowed(const struct mass_model *model, int64_t count, const double *states, const double *variances,
                 const int64_t *cases, const double *informations, double *covariances) {
  const int64_t wide = model->states + 1;
  double phi[PHI], *jacobian = malloc(sizeof(double) * (size_t)(3 * PHI * wide + 2 * wide * wide + wide));
  if (!jacobian) return POISE_NO_MEMORY;
  double *root = jacobian + PHI * wide, *half = root + PHI * wide, *seen = half + PHI * wide;
  double *factor = seen + wide * wide, *values = factor + wide * wide;
  for (int64_t h = 0; h < count; h++) {
    const double *own = variances + h * model->states;
    mass_at(model, states + h * model->states, phi, jacobian);
    seen_through(model, jacobian, own, informations + PHI * PHI * cases[h], root, half, seen);
    halved(seen, root, wide, factor, values, half);
    for (int i = 0; i < PHI; i++)
      for (int j = 0; j < PHI; j++) {
        double sum = 0.0;
        for (int64_t k = 0; k < wide; k++) sum += half[k * PHI + i] * half[k * PHI + j];
        covariances[(h * PHI + i) * PHI + j] = sum;
      }
  }
  free(jacobian);
  return POISE_OK;
}

/* Choose a basis among columns of vectors (wide, wide) whose eigenvalues are 1 but for rounding; `_settle`. */
static void settle(const double *values, double *vectors, int64_t wide, double *room) {
  double most = 0.0;
  int64_t count = 0;
  double *some = room, *weighed = some + wide * wide, *axes = weighed + wide * wide, *found = axes + wide * wide;
  for (int64_t k = 0; k < wide; k++) most = fmax(most, values[k]);
  const double limit = 1.0 + UNSEEN + PRECISION * most;
  for (int64_t k = 0; k < wide; k++)
    if (values[k] < limit) {
      for (int64_t j = 0; j < wide; j++) some[count * wide + j] = vectors[j * wide + k];
      count++;
    }
  for (int64_t a = 0; a < count; a++)
    for (int64_t b = 0; b < count; b++) {
      double sum = 0.0;
      for (int64_t j = 0; j < wide; j++) sum += some[a * wide + j] * (double)j * some[b * wide + j];
      weighed[a * count + b] = sum;
    }
  eigen(weighed, count, found, axes);
  for (int64_t k = 0, c = 0; k < wide; k++) {
    if (!(values[k] < limit)) continue;
    for (int64_t j = 0; j < wide; j++) {
      vectors[j * wide + k] = 0.0;
      for (int64_t a = 0; a < count; a++) vectors[j * wide + k] += some[a * wide + j] * axes[a * count + c];
    }
    c++;
  }
}

int64_t curved(const struct mass_model *model, int64_t count, const double *states, const double *variances,
               const int64_t *cases, const double *informations, double *covariances) {
  const int64_t n = model->states, wide = n + 1;
  const double distance = sqrt(3.0), heavy = sqrt(model->any_mass);
  double phi[PHI], there[PHI], first[PHI], deviation[PHI], system[PHI * PHI];
  int exchanges[PHI], status = POISE_OK;
  double *jacobian = malloc(sizeof(double) * (size_t)(3 * PHI * wide + 5 * wide * wide + 5 * wide));
  if (!jacobian) return POISE_NO_MEMORY;
  double *root = jacobian + PHI * wide, *half = root + PHI * wide, *seen = half + PHI * wide;
  double *vectors = seen + wide * wide, *values = vectors + wide * wide, *moved = values + wide;
  double *point = moved + wide, *column = point + wide, *rest = column + wide;
  memset(covariances, 0, sizeof(double) * (size_t)(count * PHI * PHI));
  for (int64_t h = 0; h < count && !status; h++) {
    const double *own = variances + h * n, *state = states + h * n, *information = informations + PHI * PHI * cases[h];
    double *total = covariances + h * PHI * PHI;
    mass_at(model, state, phi, jacobian);
    seen_through(model, jacobian, own, information, root, half, seen);
    eigen(seen, wide, values, vectors);
    for (int64_t j = 0; j < wide * wide; j++) vectors[j] /= sqrt(fmax(values[j % wide], 1.0));
    settle(values, vectors, wide, rest);
    for (int i = 0; i < PHI; i++)
      for (int j = 0; j < PHI; j++) {
        double sum = 0.0;
        for (int64_t k = 0; k < wide; k++) sum += root[i * wide + k] * root[j * wide + k];
        half[i * PHI + j] = sum;
      }
    product(half, information, PHI, PHI, PHI, system);
    for (int i = 0; i < PHI; i++) system[i * (PHI + 1)] += 1.0;
    status = factor_rows(system, PHI, exchanges);
    for (int64_t k = 0; k < wide && !status; k++) {
      for (int64_t j = 0; j < wide; j++) column[j] = vectors[j * wide + k];
      apply(root, column, PHI, wide, first);
      for (int64_t j = 0; j < n; j++) values[j] = sqrt(own[j]) * column[j];
      for (int64_t j = 0; j < n; j++) {
        moved[j] = values[j];
        if (model->root && j < model->parts) {
          moved[j] = 0.0;
          for (int64_t l = 0; l < model->parts; l++) moved[j] += model->root[j * model->parts + l] * values[l];
        }
      }
      for (int side = 0; side < 2; side++) {
        const double step = side ? -distance : distance, heavier = 1.0 + step * heavy * column[n];
        for (int64_t j = 0; j < n; j++) point[j] = state[j] + step * moved[j];
        mass_at(model, point, there, NULL);
        for (int i = 0; i < PHI; i++) deviation[i] = there[i] * heavier - phi[i] - step * first[i];
        solve_rows(system, PHI, exchanges, deviation, 1);
        for (int i = 0; i < PHI; i++) deviation[i] += step * first[i];
        for (int i = 0; i < PHI; i++)
          for (int j = 0; j < PHI; j++)
            total[i * PHI + j] += deviation[i] * deviation[j] / (2.0 * distance * distance);
      }
    }
  }
  free(jacobian);
  return status;
}
