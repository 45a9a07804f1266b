/* The first slip of one body on one patch under growing loads: `SinglePatch._first_slip` in
   poise/assembly/statics/single_patch.py, with the same steps. */
#include <math.h>

#include "poise_kernels.h"

/* As in single_patch.py, where they are explained. */
static const double OVER = 1e-9, ROOT = 1e-14, FAR = 0.99, PI = 3.14159265358979323846;
enum { COARSE = 8, FINE = 9, PARTS = 6 };

/* A patch, and the load at rest on it: normal force, two moments of pressure, two of friction, and the moment about the
   normal, all about its centroid. */
struct patch {
  const double *rest;  /* (6) */
  double *table; /* (side, side) normal force that unit loads of friction need, by azimuth and elevation; NaN: unknown */
  const double *motions; /* (count, 3) of unit dissipation: that force is the largest power on one */
  int64_t side, count;
  double radius, size, handed, friction, weight;
};

static double table_at(const struct patch *patch, int64_t i, int64_t j) {
  double *at = patch->table + i * patch->side + j;
  if (!isnan(*at)) return *at;
  const double azimuth = 2.0 * PI / (double)(patch->side - 1) * (double)i;
  const double lift = PI / 2.0 / (double)(patch->side - 1) * (double)j;
  const double x = cos(lift) * cos(azimuth), y = cos(lift) * sin(azimuth), z = sin(lift);
  double most = -INFINITY;
  for (int64_t m = 0; m < patch->count; m++) {
    const double *motion = patch->motions + 3 * m, power = x * motion[0] + y * motion[1] + z * motion[2];
    most = power > most ? power : most;
  }
  return *at = most;
}

/* `PatchFriction.normal_force_needed` of one force and moment. */
static double needed(const struct patch *patch, double along, double across, double moment) {
  const double turning = moment / patch->radius, flat = sqrt(along * along + across * across);
  double azimuth = atan2(across, along) + (turning < 0.0 ? PI : 0.0);
  if (azimuth < 0.0) azimuth += 2.0 * PI;
  const int64_t side = patch->side, most = side - 2;
  const double column = azimuth * ((double)(side - 1) / (2.0 * PI));
  const double row = atan2(fabs(turning), flat) * ((double)(side - 1) / (PI / 2.0));
  const int64_t i = (int64_t)column < most ? (int64_t)column : most, j = (int64_t)row < most ? (int64_t)row : most;
  const double a = column - (double)i, b = row - (double)j;
  const double below = table_at(patch, i, j) * (1.0 - b) + table_at(patch, i, j + 1) * b;
  const double above = table_at(patch, i + 1, j) * (1.0 - b) + table_at(patch, i + 1, j + 1) * b;
  return fmax(sqrt(flat * flat + turning * turning) * (below * (1.0 - a) + above * a), flat);
}

/* What friction has to bear at rest + way t. */
struct supply {
  double normal, along, across, moment;
};

static struct supply supply_at(const struct patch *patch, const double *way, double t) {
  double part[PARTS];
  for (int i = 0; i < PARTS; i++) part[i] = way[i] * t + patch->rest[i];
  const double normal = fmax(part[0], 1e-12 * patch->weight);
  const double lever = patch->handed * (part[1] * part[4] - part[2] * part[3]) / normal;
  return (struct supply){normal, part[3], part[4], patch->handed * (part[5] - lever) / patch->size};
}

static double excess_of(const struct patch *patch, const struct supply *at) {
  const double force = needed(patch, at->along, at->across, at->moment);
  return (force - patch->friction * at->normal) / patch->weight;
}

static double excess(const struct patch *patch, const double *way, double t) {
  const struct supply at = supply_at(patch, way, t);
  return excess_of(patch, &at);
}

/* Whether the excess may be above 0: friction for the force and for the moment, one by one, is too much. */
static int near_slip(const struct patch *patch, const struct supply *at) {
  const double flat = sqrt(at->along * at->along + at->across * at->across);
  return flat + fabs(at->moment) / patch->radius > FAR * patch->friction * at->normal;
}

/* The last t found without excess, between one without and one with it: Illinois regula falsi. */
static double root(const struct patch *patch, const double *way, double low, double high, double f_high) {
  double f_low = excess(patch, way, low);
  for (int step = 0; step < FINE; step++) {
    double middle = low - f_low * (high - low) / (f_high > f_low ? f_high - f_low : 1.0);
    middle = fmin(fmax(middle, low), high);
    const double f_middle = excess(patch, way, middle);
    if (f_middle > 0.0) {
      f_low /= 2.0;
      f_high = f_middle;
      high = middle;
      continue;
    }
    low = middle;
    f_low = f_middle;
    f_high /= 2.0;
    if (!(f_middle < -ROOT)) break;
  }
  return low;
}

/* `end` (count) of loads: the first t up to `top` (count) at which friction is exhausted along way (6, count); `top`
   where there is none. */
POISE_EXPORT void poise_first_slips(const struct patch *patch, int64_t count, const double *ways, const double *top,
                                    double *end) {
  for (int64_t q = 0; q < count; q++) {
    double way[PARTS], low = 0.0;
    for (int i = 0; i < PARTS; i++) way[i] = ways[i * count + q];
    end[q] = top[q];
    for (int step = 1; step <= COARSE; step++) {
      const double share = (double)step / COARSE;
      const double t = step < COARSE ? share * top[q] : top[q] < 1.0 ? top[q] * (1.0 - 1e-9) : 1.0;
      const struct supply at = supply_at(patch, way, t);
      const double over = near_slip(patch, &at) ? excess_of(patch, &at) : 0.0;
      if (over > OVER) {
        end[q] = root(patch, way, low, t, over);
        break;
      }
      low = t;
    }
  }
}
