/* An order of elimination for those pairs of bodies that are coupled: which change from one Newton step to the next. */
#ifndef POISE_FILL_H
#define POISE_FILL_H

#include "bodies.h"

/* Coupled pairs of bodies in an order of little fill. */
struct fill {
  struct bodies bodies; /* numbered in this order; pairs that are not coupled have no block */
  int64_t *position;    /* (count) in this order, of bodies as numbered before */
  int64_t *lists;       /* arrays of `bodies` */
  uint64_t *near;       /* (count, words) bits: which bodies are coupled */
  int64_t *keys;        /* (count) number of coupled bodies and number of the body */
  int64_t *parents, *sizes; /* (count) of each column the one after it that needs it first, and how many it needs */
  int64_t *before, *rows;   /* (count + 1), (below) as `starts` and `rows` of `bodies`, in the order of elimination */
};

/* Numbers of integers that it needs for some bodies, and the same laid into them. */
int64_t fill_room(const struct bodies *bodies);
struct fill fill_laid_out(const struct bodies *bodies, int64_t *whole);

/* Find the order and its fill; `coupled` (pairs) is not 0 where a pair is coupled. Returns 0 where the fill would be
   more than that of `bodies`. */
int fill_order(const struct bodies *bodies, const char *coupled, struct fill *fill);

#endif
