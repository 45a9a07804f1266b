"""A block on elastic contacts: its state under a load, and the factor of a load up to which it stands."""

import math
from dataclasses import dataclass

import numpy as np

from poise.types import Array

_LEAST_LOAD = 1e-2
"""The load of a body counts as this share of all at least."""


@dataclass(frozen=True, eq=False)
class ElasticState:
    """The equilibrium of a block on elastic contacts.

    Args:
        stands: the contacts alone carry the load.
        unbalanced: share of the load of a body that they do not carry, at most.
        displacement: (6 n,) in units of load per mean stiffness.
        settled: the equations are solved; otherwise it does not stand.
        known: it was found, before the deadline; otherwise it is open whether the block stands.
    """

    stands: bool
    unbalanced: float
    displacement: Array
    settled: bool = True
    known: bool = True


@dataclass(frozen=True, eq=False)
class ElasticFactor:
    """Up to which factor a block stands under a load.

    Args:
        value: it stands at this factor.
        known: it collapses at a factor that is not much larger, or as much as was asked is held. Otherwise the deadline
            passed, or no next equilibrium was found and no collapse: it may stand at more.
        twist: (6 n,) the motion in which it collapses; None when it does not.
        displacement: (6 n,) in the state in which it stands; None when it does not.
        earlier: (6 n,) displacement on the way to that state, under a smaller factor; None where none is known.
    """

    value: float
    known: bool
    twist: Array | None = None
    displacement: Array | None = None
    earlier: Array | None = None


class LoadShares:
    """Which share of the load on a body something is.

    Args:
        gravity: (n, 6) loads at rest.
    """

    def __init__(self, gravity: Array) -> None:
        self._squares = _squares(gravity)
        self.weight = math.sqrt(float(self._squares.sum()))
        """Size of all loads at rest."""

    def of(self, part: Array, load: Array) -> float:
        """The share that a part (6 n,) is of the load on a body, or of its weight; the largest of all bodies."""
        squares = np.maximum(_squares(load), self._squares)
        least = _LEAST_LOAD**2 * float(squares.sum()) or 1.0
        return math.sqrt(float((_squares(part) / np.maximum(squares, least)).max()))


def _squares(load: Array) -> Array:
    """(n,) squared size of the part (6,) of each body in a load (6 n,)."""
    rows = load.reshape(-1, 6)
    return np.asarray(np.einsum("ij,ij->i", rows, rows))
