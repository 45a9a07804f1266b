/* Where the messages and the definitions of a chunk of an mcap file are. */
#include <string.h>

#include "poise_kernels.h"

enum { SCHEMA = 3, CHANNEL = 4, MESSAGE = 5, HEAD = 9, MESSAGE_HEAD = 31 };

static uint64_t little(const unsigned char *at, int bytes) {
  uint64_t value = 0;
  for (int i = bytes - 1; i >= 0; i--) value = value << 8 | at[i];
  return value;
}

/* Walks through the records of a chunk, as far as they are whole; returns the offset behind the last one.
   counts (2,): messages, and schemas with channels; the arrays take no more than there is room for by `room` (2,).
   messages (., 4): channel, log time, first byte and size of the data. definitions (., 3): opcode, first byte, end. */
POISE_EXPORT int64_t poise_split_records(const unsigned char *data, int64_t size, const int64_t *room, int64_t *counts,
                                         uint64_t *messages, int64_t *definitions) {
  int64_t position = 0;
  counts[0] = counts[1] = 0;
  while (size - position >= HEAD) {
    const unsigned char *record = data + position;
    const int opcode = record[0];
    const uint64_t length = little(record + 1, 8);
    if (opcode == 0 || length > (uint64_t)(size - position - HEAD)) break;
    const int64_t behind = position + HEAD + (int64_t)length;
    if (opcode == MESSAGE) {
      if (behind - position < MESSAGE_HEAD) break;
      if (counts[0] < room[0]) {
        uint64_t *row = messages + 4 * counts[0];
        row[0] = little(record + HEAD, 2);
        row[1] = little(record + HEAD + 6, 8);
        row[2] = (uint64_t)(position + MESSAGE_HEAD);
        row[3] = (uint64_t)(behind - position - MESSAGE_HEAD);
      }
      counts[0]++;
    } else if (opcode == SCHEMA || opcode == CHANNEL) {
      if (counts[1] < room[1]) {
        int64_t *row = definitions + 3 * counts[1];
        row[0] = opcode, row[1] = position + HEAD, row[2] = behind;
      }
      counts[1]++;
    }
    position = behind;
  }
  return position;
}

POISE_EXPORT int64_t poise_kernels_version(void) { return POISE_KERNELS_VERSION; }
