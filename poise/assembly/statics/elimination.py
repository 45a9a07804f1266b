"""In which order the bodies of a block are eliminated from linear systems, and which blocks of 6 by 6 that fills."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.sparse import coo_array, csc_array, eye_array
from scipy.sparse.linalg import splu

from poise.kernels import CompiledBodies
from poise.types import Indices

_MANY = 3
"""Up to this many bodies any order will do."""


@dataclass(frozen=True, eq=False)
class Elimination:
    """An order of elimination, and the blocks below the diagonal of the factors, column after column.

    Args:
        position: (n,) of each body in the order.
        sides: (I, 2) positions of the bodies of each pair; -1 for the ground.
        starts: (n + 1,) first block of each column.
        rows: (B,) position of the row of each block, ascending within a column.
        place: (I,) block in which the bodies of a pair meet; -1 where one of them is the ground.
    """

    position: Indices
    sides: Indices
    starts: Indices
    rows: Indices
    place: Indices

    @classmethod
    def of(cls, sides: Indices, count: int) -> "Elimination":
        """Find an order of little fill (minimum degree).

        Args:
            sides: (I, 2) bodies of each pair; negative, or `count`: the ground.
            count: number of bodies.
        """
        if count == 1:
            return _alone(len(sides), tuple((sides == 0).ravel().tolist()))
        moves = (sides >= 0) & (sides < count)
        both = sides[moves.all(axis=1)]
        position = _least_fill(both, count)
        there = np.where(moves, position[np.where(moves, sides, 0)], -1)
        below: list[set[int]] = [set() for _ in range(count)]
        for low, high in np.sort(position[both], axis=1).tolist():
            below[low].add(high)
        for rows in below:
            if rows:  # what is below a column couples through it, first with the nearest
                nearest = min(rows)
                below[nearest] |= rows - {nearest}
        starts = np.concatenate([[0], np.cumsum([len(rows) for rows in below])]).astype(np.int64)
        filled = np.array([row for column in below for row in sorted(column)], dtype=np.int64)
        low, high = there.min(axis=1), there.max(axis=1)
        column = np.repeat(np.arange(count), np.diff(starts))
        place = np.where(low >= 0, np.searchsorted(column * count + filled, low * count + high), -1)
        return cls(position, np.ascontiguousarray(there), starts, filled, place.astype(np.int64))

    @cached_property
    def compiled(self) -> CompiledBodies:
        """As the compiled kernels take it."""
        arrays = {"sides": self.sides, "starts": self.starts, "rows": self.rows, "place": self.place}
        return CompiledBodies(len(self.position), **arrays)

    @property
    def work(self) -> float:
        """Multiplications that one factorisation takes, of systems with six unknowns for each body."""
        below = np.diff(self.starts) + 1
        return float(6**3 * (below * (below + 1)).sum())

    @cached_property
    def entries(self) -> Indices:
        """(6 n,) where each entry of vectors (6 n,) in the order of elimination is among those of the bodies."""
        order = np.argsort(self.position)
        return np.asarray((6 * order[:, None] + np.arange(6)).ravel())


@lru_cache(maxsize=64)
def _alone(pairs: int, moves: tuple[bool, ...]) -> Elimination:
    """Of one body on the ground, in so many pairs, by which side of each it is."""
    sides = np.where(np.array(moves, dtype=bool).reshape(pairs, 2), 0, -1)
    none = np.zeros(0, dtype=np.int64)
    return Elimination(np.zeros(1, dtype=np.int64), sides, np.zeros(2, dtype=np.int64), none, np.full(pairs, -1))


def _least_fill(pairs: Indices, count: int) -> Indices:
    """(n,) position of each body in an order of minimum degree of the graph of pairs (P, 2)."""
    if count <= _MANY or not len(pairs):
        return np.arange(count)
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = coo_array((np.full(len(rows), -1.0), (rows, columns)), shape=(count, count))
    heavy = csc_array(graph + (4.0 * len(pairs)) * eye_array(count))
    options = {"SymmetricMode": True}
    return np.asarray(splu(heavy, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).perm_c, np.int64)
