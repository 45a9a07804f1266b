"""Which of the objects that a scan sees are known already, so that they keep their names."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from poise.types import Array

_SAME_PLACE = 0.02
"""m between the centres of two scans of one object that was not moved, at most."""
_SAME_VOLUME = 0.1
"""Share by which the volumes of two scans of one object that was moved differ at most."""


class ScannedBody(NamedTuple):
    """By what objects are recognised.

    Args:
        centre: (3,) m, of its volume; None: where it is, is not known.
        volume: m3.
    """

    centre: Array | None
    volume: float


def names_of(
    found: Sequence[ScannedBody], known: dict[str, ScannedBody], name: str, taken: Sequence[str] = ()
) -> list[str]:
    """A name for each object that was found: that of the known one which stands there, or which was lost and is alike.

    Args:
        found: all with a centre, in the frame of the known ones.
        known: by name; those that stand have a centre, those that were lost have none.
        name: of the first new one; the others are NAME_2, NAME_3, ...
        taken: names that nothing found may get.
    """
    given: dict[int, str] = {}
    for _, row, own in sorted(_likeness(found, known)):
        if row not in given and own not in given.values():
            given[row] = own
    new = (each for each in _numbered(name) if each not in known and each not in taken)
    return [given.get(row) or next(new) for row in range(len(found))]


def _likeness(found: Sequence[ScannedBody], known: dict[str, ScannedBody]) -> Iterator[tuple[float, int, str]]:
    """How unlike, row and name of each pair that may be one object; what stands comes before what was lost."""
    for row, body in enumerate(found):
        for own, other in known.items():
            if body.centre is not None and other.centre is not None:
                unlike, most, rank = float(np.linalg.norm(body.centre - other.centre)), _SAME_PLACE, 0.0
            else:
                unlike, most, rank = abs(body.volume / other.volume - 1), _SAME_VOLUME, 1.0
            if unlike <= most:
                yield rank + unlike, row, own


def _numbered(name: str) -> Iterator[str]:
    yield name
    number = 2
    while True:
        yield f"{name}_{number}"
        number += 1
