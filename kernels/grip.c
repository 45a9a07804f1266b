/* A payload that turns in its grip; in Python: effects/grasp_compliance.py of poise/mismatch. */
#include <math.h>

#include "poise_kernels.h"

typedef struct {
  double mass, moment[3], inertia[9]; /* about the pivot; the inertia is symmetric */
} load;

static POISE_INLINE void crossed(const double a[3], const double b[3], double out[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static POISE_INLINE void times(const double inertia[9], const double v[3], double out[3]) {
  for (int i = 0; i < 3; i++) out[i] = inertia[3 * i] * v[0] + inertia[3 * i + 1] * v[1] + inertia[3 * i + 2] * v[2];
}

/* A vector turned by a rotation vector, or back (`sign` -1): Rodrigues' formula. */
static POISE_INLINE void turned(const double turn[3], double sine, double versine, double sign, const double v[3],
                                double out[3]) {
  double once[3], twice[3];
  crossed(turn, v, once);
  crossed(turn, once, twice);
  for (int i = 0; i < 3; i++) out[i] = v[i] + sign * sine * once[i] + versine * twice[i];
}

/* Force and torque (6,) about the pivot of the payload, in the axes of the sensor, whose angular velocity and
 * acceleration and whose specific force at the pivot are given; the payload is turned, with two derivatives. */
static POISE_INLINE void felt(const load *of, const double *omega0, const double *alpha0, const double *specific,
                              const double *turn, const double *rate, const double *second, double *wrench) {
  double spin[3], change[3], omega[3], alpha[3], moment[3], back[3], own[3], other[3], gyro[3], arm[3], twice[3];
  crossed(turn, rate, spin);
  crossed(turn, second, change);
  for (int i = 0; i < 3; i++) spin[i] = rate[i] + 0.5 * spin[i], omega[i] = omega0[i] + spin[i];
  crossed(omega0, spin, alpha);
  for (int i = 0; i < 3; i++) alpha[i] = alpha0[i] + (second[i] + 0.5 * change[i]) + alpha[i];
  const double angle = sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
  const double sine = angle > 0.0 ? sin(angle) / angle : 1.0;
  const double half = angle > 0.0 ? sin(0.5 * angle) / (0.5 * angle) : 1.0, versine = 0.5 * half * half;
  turned(turn, sine, versine, 1.0, of->moment, moment);
  crossed(omega, moment, twice);
  crossed(omega, twice, arm);
  crossed(alpha, moment, twice);
  for (int i = 0; i < 3; i++) wrench[i] = of->mass * specific[i] - (twice[i] + arm[i]);
  turned(turn, sine, versine, -1.0, omega, back);
  times(of->inertia, back, other);
  turned(turn, sine, versine, 1.0, other, own);
  turned(turn, sine, versine, -1.0, alpha, back);
  times(of->inertia, back, other);
  turned(turn, sine, versine, 1.0, other, gyro);
  crossed(omega, own, other);
  crossed(moment, specific, arm);
  for (int i = 0; i < 3; i++) wrench[3 + i] = arm[i] - (gyro[i] + other[i]);
}

/* Force and torque (n, 6) about the pivot of a payload (13,: mass, moment, inertia) in a motion (3, n, 3) of its turn,
 * with two derivatives; `moved` (3, n, 3): angular velocity and acceleration of the sensor, specific force. */
POISE_EXPORT void poise_turned_load(int64_t n, const double *body, const double *moved, const double *motion,
                                    double *wrench) {
  const load *of = (const load *)body;
  for (int64_t i = 0; i < 3 * n; i += 3)
    felt(of, moved + i, moved + 3 * n + i, moved + 6 * n + i, motion + i, motion + 3 * n + i, motion + 6 * n + i,
         wrench + 2 * i);
}

/* The motion (3, n, 3), zero at first, of a payload on `springs` equal springs about axes (springs, 3) with moments of
 * inertia (springs,). `transition` (springs, 4, n - 1) is that of each oscillator in each step (n - 1,). Rounds end
 * when the turn changes by less than `settled`. */
POISE_EXPORT void poise_turned_in_grip(int64_t n, int64_t springs, const double *body, const double *moved,
                                       const double *step, const double *transition, const double *axes,
                                       const double *moments, double stiffness, double damping, int64_t rounds,
                                       double settled, double largest, double *motion) {
  const load *of = (const load *)body;
  for (int64_t round = 0; round < rounds; round++) {
    double most = 0.0, x[3] = {0.0}, v[3] = {0.0}, before[3] = {0.0};
    for (int64_t i = 0; i < n; i++) {
      double *turn = motion + 3 * i, *rate = turn + 3 * n, *second = rate + 3 * n, wrench[6], slip[3], push[3];
      felt(of, moved + 3 * i, moved + 3 * (n + i), moved + 3 * (2 * n + i), turn, rate, second, wrench);
      crossed(turn, rate, slip);
      times(of->inertia, second, push);
      for (int c = 0; c < 3; c++) push[c] += wrench[3 + c] - 0.5 * damping * slip[c];
      double there[3][3] = {{0.0}};
      for (int64_t s = 0; s < springs; s++) {
        const double *axis = axes + 3 * s, k = stiffness / moments[s], d = damping / moments[s];
        const double force = (push[0] * axis[0] + push[1] * axis[1] + push[2] * axis[2]) / moments[s];
        if (i == 0) x[s] = force / k, v[s] = 0.0;
        else {
          const double *m = transition + 4 * s * (n - 1) + i - 1;
          const double slope = (force - before[s]) / (step[i - 1] * k), lag = d * slope;
          const double begin = x[s] - (before[s] - lag) / k, faster = v[s] - slope;
          x[s] = (force - lag) / k + m[0] * begin + m[n - 1] * faster;
          v[s] = slope + m[2 * (n - 1)] * begin + m[3 * (n - 1)] * faster;
        }
        before[s] = force;
        const double a = force - (d * v[s] + k * x[s]);
        for (int c = 0; c < 3; c++)
          there[0][c] += x[s] * axis[c], there[1][c] += v[s] * axis[c], there[2][c] += a * axis[c];
      }
      const double size = sqrt(there[0][0] * there[0][0] + there[0][1] * there[0][1] + there[0][2] * there[0][2]);
      const double kept = fmin(1.0, largest / fmax(size, 1e-9));
      for (int c = 0; c < 3; c++) {
        most = fmax(most, fabs(kept * there[0][c] - turn[c]));
        turn[c] = kept * there[0][c], rate[c] = there[1][c], second[c] = there[2][c];
      }
    }
    if (most < settled) return;
  }
}
