/* A heap of HEAP_ITEM, of which HEAP_SOONER(a, b) says whether *a comes before *b; a file defines both before it includes
   this. It begins as all zeros; `item` is freed by its owner. */
#include <stdint.h>
#include <stdlib.h>

typedef struct {
  HEAP_ITEM *item;
  int64_t count, room;
} heap;

/* 0 without memory. */
static int heap_push(heap *h, HEAP_ITEM own) {
  if (h->count == h->room) {
    HEAP_ITEM *larger = realloc(h->item, (size_t)(2 * h->room + 64) * sizeof *larger);
    if (!larger) return 0;
    h->item = larger;
    h->room = 2 * h->room + 64;
  }
  int64_t at = h->count++;
  for (; at > 0 && HEAP_SOONER(&own, h->item + (at - 1) / 2); at = (at - 1) / 2) h->item[at] = h->item[(at - 1) / 2];
  h->item[at] = own;
  return 1;
}

static HEAP_ITEM heap_pop(heap *h) {
  const HEAP_ITEM first = h->item[0], last = h->item[--h->count];
  int64_t at = 0;
  for (int64_t child = 1; child < h->count; child = 2 * at + 1) {
    if (child + 1 < h->count && HEAP_SOONER(h->item + child + 1, h->item + child)) child++;
    if (!HEAP_SOONER(h->item + child, &last)) break;
    h->item[at] = h->item[child];
    at = child;
  }
  h->item[at] = last;
  return first;
}
