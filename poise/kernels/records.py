"""Where the records of a decompressed chunk of an mcap file are."""

import numpy as np
from numpy.typing import NDArray

from poise.kernels.arrays import address
from poise.kernels.library import library
from poise.types import Indices

_ROOM = 4096
"""Messages and definitions that a first pass has room for."""


def find_records(data: bytes) -> tuple[NDArray[np.uint64], Indices, int]:
    """Walk through the records as far as they are whole; needs `COMPILED`.

    Returns:
        Messages (M, 4): channel, log time in ns, first byte and size of the data. Schemas and channels (D, 3): opcode,
        first byte and end of the content. The offset behind the last whole record.
    """
    counts = np.full(2, _ROOM)
    while True:
        room = counts.copy()
        messages, definitions = np.empty((room[0], 4), dtype=np.uint64), np.empty((room[1], 3), dtype=np.int64)
        arrays = (room, counts, messages, definitions)
        end = library.poise_split_records(data, len(data), *map(address, arrays))
        if (counts <= room).all():
            return messages[: counts[0]], definitions[: counts[1]], end
