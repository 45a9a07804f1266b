/* How a frame at the end of a chain of joints moves: pose, angular velocity, accelerations, for many samples. */
#include <math.h>

#include "poise_kernels.h"

/* out = a b, for row-major 3x3 matrices. */
static void multiply(const double *a, const double *b, double *out) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* out = a v */
static void turn(const double *a, const double *v, double *out) {
  for (int i = 0; i < 3; i++) out[i] = a[3 * i] * v[0] + a[3 * i + 1] * v[1] + a[3 * i + 2] * v[2];
}

/* out = a^T v */
static void turn_back(const double *a, const double *v, double *out) {
  for (int i = 0; i < 3; i++) out[i] = a[i] * v[0] + a[3 + i] * v[1] + a[6 + i] * v[2];
}

static void cross(const double *a, const double *b, double *out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

/* The rotation about a unit axis (Rodrigues). */
static void rotation_about(const double *axis, double angle, double *out) {
  const double c = cos(angle), s = sin(angle), d = 1.0 - c, x = axis[0], y = axis[1], z = axis[2];
  out[0] = c + d * x * x, out[1] = d * x * y - s * z, out[2] = d * x * z + s * y;
  out[3] = d * x * y + s * z, out[4] = c + d * y * y, out[5] = d * y * z - s * x;
  out[6] = d * x * z - s * y, out[7] = d * y * z + s * x, out[8] = c + d * z * z;
}

/* A frame: where it is in the world, and how it moves, in its own axes. `acceleration` is that of its origin. */
struct frame {
  double rotation[9], place[3], omega[3], alpha[3], acceleration[3];
};

/* Go to a frame at `offset` with axes `rotation`, both in the axes of `f` and fixed in it. */
static void shift(struct frame *f, const double *rotation, const double *offset) {
  double world[3], swing[3], spin[3], moved[3], turned[9];
  turn(f->rotation, offset, world);
  cross(f->alpha, offset, swing);
  cross(f->omega, offset, spin);
  cross(f->omega, spin, moved);
  for (int i = 0; i < 3; i++) {
    f->place[i] += world[i];
    moved[i] += f->acceleration[i] + swing[i];
  }
  turn_back(rotation, moved, f->acceleration);
  double omega[3], alpha[3];
  turn_back(rotation, f->omega, omega);
  turn_back(rotation, f->alpha, alpha);
  multiply(f->rotation, rotation, turned);
  for (int i = 0; i < 3; i++) f->omega[i] = omega[i], f->alpha[i] = alpha[i];
  for (int i = 0; i < 9; i++) f->rotation[i] = turned[i];
}

/* Go past a joint that turns about, or slides along, `axis` in its own axes. */
static void pass(struct frame *f, int slides, const double *placement, const double *axis, double q, double v,
                 double a) {
  double rotation[9], offset[3], own[9], gyration[3];
  if (slides) {
    turn(placement, axis, offset);
    for (int i = 0; i < 3; i++) offset[i] = placement[9 + i] + q * offset[i];
    shift(f, placement, offset);
    cross(f->omega, axis, gyration);
    for (int i = 0; i < 3; i++) f->acceleration[i] += 2.0 * v * gyration[i] + a * axis[i];
    return;
  }
  rotation_about(axis, q, own);
  multiply(placement, own, rotation);
  shift(f, rotation, placement + 9);
  cross(f->omega, axis, gyration);
  for (int i = 0; i < 3; i++) {
    f->omega[i] += v * axis[i];
    f->alpha[i] += v * gyration[i] + a * axis[i];
  }
}

/* Arguments:
     samples n, joints J of the chain, from the base outwards;
     placements (J + 1, 12): rotation (row-major) and translation of each joint in the one before, and of the frame;
     axes (J, 3): unit axis of each joint in its own axes; slides (J,): 1 for a prismatic joint;
     motion (3, n, J): positions, velocities, accelerations;
     base (n, 21), or NULL for a base at rest: rotation, place, angular velocity, angular and linear acceleration;
   Results: rotation (n, 9) world <- frame, place (n, 3) in the world; vectors (3, n, 3): angular velocity, angular
   acceleration, acceleration of the origin, in the axes of the frame. */
POISE_EXPORT void poise_chain_motion(int64_t samples, int64_t joints, const double *placements, const double *axes,
                                     const int64_t *slides, const double *motion, const double *base, double *rotation,
                                     double *place, double *vectors) {
  const int64_t block = samples * joints;
  for (int64_t n = 0; n < samples; n++) {
    struct frame f = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    if (base) {
      const double *b = base + 21 * n;
      for (int i = 0; i < 9; i++) f.rotation[i] = b[i];
      for (int i = 0; i < 3; i++)
        f.place[i] = b[9 + i], f.omega[i] = b[12 + i], f.alpha[i] = b[15 + i], f.acceleration[i] = b[18 + i];
    }
    for (int64_t j = 0; j < joints; j++) {
      const double *q = motion + n * joints + j;
      pass(&f, (int)slides[j], placements + 12 * j, axes + 3 * j, q[0], q[block], q[2 * block]);
    }
    shift(&f, placements + 12 * joints, placements + 12 * joints + 9);
    for (int i = 0; i < 9; i++) rotation[9 * n + i] = f.rotation[i];
    for (int i = 0; i < 3; i++) {
      place[3 * n + i] = f.place[i];
      vectors[3 * n + i] = f.omega[i];
      vectors[3 * (samples + n) + i] = f.alpha[i];
      vectors[3 * (2 * samples + n) + i] = f.acceleration[i];
    }
  }
}
