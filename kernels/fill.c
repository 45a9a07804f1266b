/* Minimum degree on bits: the body that is coupled to the fewest others is eliminated next, and couples those. */
#include "fill.h"

#include <string.h>

enum { BITS = 64 };
static const int64_t GONE = INT64_MAX, ONE = (int64_t)1 << 32; /* of a key: a body more, above its number */

static int64_t words_of(const struct bodies *bodies) { return (bodies->count + BITS - 1) / BITS; }

int64_t fill_room(const struct bodies *bodies) {
  return bodies->count * (6 + words_of(bodies)) + 2 + 3 * bodies->pairs + 2 * bodies->below;
}

struct fill fill_laid_out(const struct bodies *bodies, int64_t *whole) {
  struct fill fill = {.bodies = *bodies, .lists = whole};
  fill.position = whole + 3 * bodies->pairs + bodies->below + bodies->count + 1;
  fill.keys = fill.position + bodies->count;
  fill.parents = fill.keys + bodies->count;
  fill.sizes = fill.parents + bodies->count;
  fill.before = fill.sizes + bodies->count;
  fill.rows = fill.before + bodies->count + 1;
  fill.near = (uint64_t *)(fill.rows + bodies->below);
  return fill;
}

static POISE_INLINE void set_bit(uint64_t *bits, int64_t at) { bits[at / BITS] |= (uint64_t)1 << (at % BITS); }

static POISE_INLINE int64_t count_bits(const uint64_t *bits, int64_t words) {
  int64_t sum = 0;
  for (int64_t w = 0; w < words; w++) sum += __builtin_popcountll(bits[w]);
  return sum;
}

/* Numbers of the bits that are set, ascending; returns how many, or -1 where those would be more than `most`. */
static POISE_INLINE int64_t list_bits(const uint64_t *bits, int64_t words, int64_t most, int64_t *out) {
  int64_t found = 0;
  for (int64_t w = 0; w < words; w++)
    for (uint64_t left = bits[w]; left; left &= left - 1) {
      if (found == most) return -1;
      out[found++] = BITS * w + __builtin_ctzll(left);
    }
  return found;
}

static POISE_INLINE int64_t least_of(const int64_t *keys, int64_t count) {
  int64_t least = GONE;
  for (int64_t i = 0; i < count; i++) least = keys[i] < least ? keys[i] : least;
  return least & (ONE - 1);
}

/* Eliminate all bodies: `starts` and `rows` are of bodies as numbered before. Returns 0 for too much fill. */
POISE_WIDE static int eliminate_all(const struct bodies *bodies, struct fill *fill, int64_t *starts, int64_t *rows) {
  const int64_t count = bodies->count, words = words_of(bodies);
  for (int64_t body = 0; body < count; body++)
    fill->keys[body] = ONE * count_bits(fill->near + words * body, words) + body;
  starts[0] = 0;
  for (int64_t k = 0; k < count; k++) {
    const int64_t body = least_of(fill->keys, count);
    const uint64_t *own = fill->near + words * body;
    const int64_t found = list_bits(own, words, bodies->below - starts[k], rows + starts[k]);
    if (found < 0) return 0;
    fill->position[body] = k;
    fill->keys[body] = GONE;
    starts[k + 1] = starts[k] + found;
    for (int64_t b = starts[k]; b < starts[k + 1]; b++) {
      uint64_t *other = fill->near + words * rows[b];
      for (int64_t w = 0; w < words; w++) other[w] |= own[w];
      other[body / BITS] &= ~((uint64_t)1 << (body % BITS));
      other[rows[b] / BITS] &= ~((uint64_t)1 << (rows[b] % BITS));
      fill->keys[rows[b]] = ONE * count_bits(other, words) + rows[b];
    }
  }
  return 1;
}

/* Columns in another order of the same fill: each right after those that it takes from, so that what is read and
   written next is near. `before` are the first blocks of the columns, and `fill->rows` the bodies of these, as
   eliminated. Rows become positions, ascending in each column. */
static void put_in_order(struct fill *fill, int64_t *starts, int64_t *rows, int64_t words) {
  const int64_t count = fill->bodies.count, *before = fill->before;
  int64_t *ends = fill->keys, *place = fill->sizes; /* of what is left below each column; of each column, in the end */
  for (int64_t k = 0; k < count; k++) {
    int64_t parent = count;
    for (int64_t b = before[k]; b < before[k + 1]; b++)
      parent = fill->position[fill->rows[b]] < parent ? fill->position[fill->rows[b]] : parent;
    fill->parents[k] = parent;
    fill->sizes[k] = 1;
  }
  for (int64_t k = 0; k < count; k++)
    if (fill->parents[k] < count) fill->sizes[fill->parents[k]] += fill->sizes[k];
  int64_t end = count;
  for (int64_t k = count - 1; k >= 0; k--) {
    int64_t *of = fill->parents[k] < count ? ends + fill->parents[k] : &end;
    const int64_t size = fill->sizes[k];
    ends[k] = *of - 1;
    place[k] = *of - 1;
    *of -= size;
  }
  for (int64_t k = 0; k < count; k++) starts[place[k] + 1] = before[k + 1] - before[k];
  starts[0] = 0;
  for (int64_t k = 0; k < count; k++) starts[k + 1] += starts[k];
  for (int64_t k = 0; k < count; k++) {
    uint64_t *bits = fill->near;
    memset(bits, 0, sizeof *bits * (size_t)words);
    for (int64_t b = before[k]; b < before[k + 1]; b++) set_bit(bits, place[fill->position[fill->rows[b]]]);
    list_bits(bits, words, before[k + 1] - before[k], rows + starts[place[k]]);
  }
  for (int64_t body = 0; body < count; body++) fill->position[body] = place[fill->position[body]];
}

static int64_t place_of(const int64_t *starts, const int64_t *rows, int64_t column, int64_t row) {
  int64_t low = starts[column], high = starts[column + 1] - 1;
  while (low < high) {
    const int64_t middle = (low + high) / 2;
    if (rows[middle] < row)
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

int fill_order(const struct bodies *bodies, const char *coupled, struct fill *fill) {
  const int64_t words = words_of(bodies);
  int64_t *sides = fill->lists, *place = sides + 2 * bodies->pairs, *starts = place + bodies->pairs;
  int64_t *rows = starts + bodies->count + 1;
  memset(fill->near, 0, sizeof *fill->near * (size_t)(words * bodies->count));
  for (int64_t pair = 0; pair < bodies->pairs; pair++)
    if (coupled[pair] && bodies->place[pair] >= 0) {
      const int64_t *side = bodies->sides + 2 * pair;
      set_bit(fill->near + words * side[0], side[1]);
      set_bit(fill->near + words * side[1], side[0]);
    }
  if (!eliminate_all(bodies, fill, fill->before, fill->rows)) return 0;
  put_in_order(fill, starts, rows, words);
  for (int64_t pair = 0; pair < bodies->pairs; pair++) {
    int64_t *side = sides + 2 * pair;
    for (int i = 0; i < 2; i++)
      side[i] = bodies->sides[2 * pair + i] < 0 ? -1 : fill->position[bodies->sides[2 * pair + i]];
    const int both = coupled[pair] && bodies->place[pair] >= 0;
    const int64_t low = side[0] < side[1] ? side[0] : side[1];
    place[pair] = both ? place_of(starts, rows, low, side[0] + side[1] - low) : -1;
  }
  fill->bodies = (struct bodies){bodies->count, bodies->pairs, starts[bodies->count], sides, starts, rows, place};
  return 1;
}
