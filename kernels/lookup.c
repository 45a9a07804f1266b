/* Points looked up in depth images, as in poise/scanning/looking.py: the same operations in single precision. */
#include <math.h>

#include "poise_kernels.h"

enum { VIEW = 16 };

/* Depth images: `depths` (views,) rows of pixels, m, 0 where nothing is known, `sizes` (views, 2) width and height,
   `numbers` (views, 16): rotation (row-major) and translation of the camera in the world, fx, fy, cx, cy. */
struct image {
  const float *depth;
  float width, height, turn[9], fx, fy, cx, cy;
  const double *eye;
  int64_t stride;
};

static struct image image_of(int64_t view, const float *const *depths, const int64_t *sizes, const double *numbers) {
  const double *own = numbers + VIEW * view;
  struct image image = {.depth = depths[view],
                        .width = (float)sizes[2 * view] - 0.5f,
                        .height = (float)sizes[2 * view + 1] - 0.5f,
                        .fx = (float)own[12],
                        .fy = (float)own[13],
                        .cx = (float)own[14],
                        .cy = (float)own[15],
                        .eye = own + 9,
                        .stride = sizes[2 * view]};
  for (int i = 0; i < 9; i++) image.turn[i] = (float)own[i];
  return image;
}

/* m along the optical axis from a point to what the camera sees in its direction, NaN where it sees nothing. `ray` is
   the direction from the camera in its own axes, of length 1 along the optical axis. */
static inline float beyond(const struct image *image, const double *point, float *ray) {
  const float x = (float)(point[0] - image->eye[0]), y = (float)(point[1] - image->eye[1]),
              z = (float)(point[2] - image->eye[2]), *turn = image->turn;
  const float ahead = turn[2] * x + turn[5] * y + turn[8] * z;
  if (!(ahead > 1e-3f)) return NAN;
  ray[0] = (turn[0] * x + turn[3] * y + turn[6] * z) / ahead;
  ray[1] = (turn[1] * x + turn[4] * y + turn[7] * z) / ahead;
  ray[2] = 1.0f;
  const float u = image->fx * ray[0] + image->cx, v = image->fy * ray[1] + image->cy;
  if (!(u > -0.5f && v > -0.5f && u < image->width && v < image->height)) return NAN;
  const float seen = image->depth[(int64_t)(v + 0.5f) * image->stride + (int64_t)(u + 0.5f)];
  return seen > 0.0f ? seen - ahead : NAN;
}

static void in_world(const struct image *image, const float *ray, float *out) {
  for (int i = 0; i < 3; i++)
    out[i] = image->turn[3 * i] * ray[0] + image->turn[3 * i + 1] * ray[1] + image->turn[3 * i + 2] * ray[2];
}

/* found (views, count), m, of points (count, 3) in the world. */
POISE_EXPORT void poise_lookup_beyond(int64_t views, const float *const *depths, const int64_t *sizes,
                                     const double *numbers, int64_t count, const double *points, float *found) {
  float ray[3];
  for (int64_t view = 0; view < views; view++) {
    const struct image image = image_of(view, depths, sizes, numbers);
    for (int64_t i = 0; i < count; i++) found[view * count + i] = beyond(&image, points + 3 * i, ray);
  }
}

/* Add to agree and through (count,) the views that see something within `band`, m, of a point, and behind that; and to
   toward (count, 3) unit vectors to the cameras of those that agree. */
POISE_EXPORT void poise_lookup_agreement(int64_t views, const float *const *depths, const int64_t *sizes,
                                        const double *numbers, int64_t count, const double *points, float band,
                                        int64_t *agree, int64_t *through, double *toward) {
  float ray[3], out[3];
  for (int64_t view = 0; view < views; view++) {
    const struct image image = image_of(view, depths, sizes, numbers);
    for (int64_t i = 0; i < count; i++) {
      const float off = beyond(&image, points + 3 * i, ray);
      through[i] += off > band;
      if (!(fabsf(off) < band)) continue;
      agree[i]++;
      in_world(&image, ray, out);
      const double length = sqrt((double)(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]));
      for (int k = 0; k < 3; k++) toward[3 * i + k] -= out[k] / length;
    }
  }
}

/* Add to weight and step (count,), m: of the views that face the surface at each point, with unit normals (count, 3),
   by more than `slant`, the cosine, and the cosine times what they measure before or behind it along the normal. */
POISE_EXPORT void poise_lookup_offsets(int64_t views, const float *const *depths, const int64_t *sizes,
                                      const double *numbers, int64_t count, const double *points,
                                      const double *normals, float band, float slant, double *weight, double *step) {
  float ray[3], out[3];
  for (int64_t view = 0; view < views; view++) {
    const struct image image = image_of(view, depths, sizes, numbers);
    for (int64_t i = 0; i < count; i++) {
      const float off = beyond(&image, points + 3 * i, ray);
      if (!(fabsf(off) < band)) continue;
      in_world(&image, ray, out);
      const double *normal = normals + 3 * i;
      const float along = out[0] * (float)normal[0] + out[1] * (float)normal[1] + out[2] * (float)normal[2];
      const float facing = -along / sqrtf(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
      if (!(facing > slant)) continue;
      weight[i] += facing;
      step[i] += (double)(facing * off * along);
    }
  }
}

/* Which pixels of a part of a depth image, every `step` of its rows and columns without the outermost, show something
   between two heights, m, and no edge: found (rows * columns of these) their numbers row * width + column. The height
   of a pixel is depth * (down . (x, y, 1)) + start, with x and y of `rays` (2, height, width), laid out as the image.
   Depth beside it differs by less than `jump`, m. `part`: left, right, top, bottom. Returns how many there are. */
POISE_EXPORT int64_t poise_lookup_pixels(const float *depth, const float *rays, int64_t height, int64_t width,
                                         const int64_t *part, int64_t step, const float *down, float start, float low,
                                         float high, float jump, int64_t *found) {
  int64_t count = 0;
  for (int64_t row = part[2] + 1; row < part[3] - 1; row += step)
    for (int64_t column = part[0] + 1; column < part[1] - 1; column += step) {
      const int64_t at = row * width + column;
      const float own = depth[at], *x = rays + at, *y = x + height * width;
      if (!(own > 0.0f)) continue;
      const float over = own * (down[0] * *x + down[1] * *y + down[2]) + start;
      if (over > low && over < high && fabsf(depth[at - width] - own) < jump && fabsf(depth[at + width] - own) < jump &&
          fabsf(depth[at - 1] - own) < jump && fabsf(depth[at + 1] - own) < jump)
        found[count++] = at;
    }
  return count;
}
