"""Linear systems of the stiffness between bodies: dense for few, banded along a chain or wall, otherwise sparse."""

from typing import Any

import numpy as np
from scipy.linalg.lapack import dgbsv
from scipy.sparse import coo_array, csc_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from poise.types import Array, Indices

_DENSE = 120
"""Systems up to this size are solved dense."""
_BAND = 72
"""Up to this many diagonals on either side, a band is solved faster than a sparse matrix: about 12 bodies."""


class BodyStiffness:
    """Where the stiffness of pairs of bodies goes in the matrix of all; solves for the displacements of the bodies.

    Args:
        sides: (I, 2) bodies of each pair; `count` is the ground, which does not move.
        count: number of bodies.
        band: more diagonals than this on either side are stored sparse.
    """

    def __init__(self, sides: Indices, count: int, band: int = _BAND) -> None:
        self._size = size = 6 * count
        place = _neighbours_near(sides, count)
        between = np.abs(np.diff(np.append(place, 0)[sides], axis=1))[np.all(sides < count, axis=1)]
        self._band = 6 * int(between.max(initial=0)) + 5
        self.kind = "dense" if size <= _DENSE else "band" if self._band <= band else "sparse"
        if self.kind != "band":
            place = np.arange(count)
        self._place = (6 * place[:, None] + np.arange(6)).ravel()
        self._lay_out(sides, np.append(place, count), count)

    def _lay_out(self, sides: Indices, place: Indices, count: int) -> None:
        """Prepare where the blocks (6, 6) of each pair, and the catch on the diagonal, go, and with which sign."""
        first, second = sides.T
        rows, columns, signs, source = [], [], [], []
        for row, column, sign in ((first, first, 1), (second, second, 1), (first, second, -1), (second, first, -1)):
            kept = np.flatnonzero((row < count) & (column < count))
            shape = (len(kept), 6, 6)
            rows.append(np.broadcast_to(6 * place[row[kept]][:, None, None] + np.arange(6)[:, None], shape).ravel())
            columns.append(np.broadcast_to(6 * place[column[kept]][:, None, None] + np.arange(6), shape).ravel())
            source.append((36 * kept[:, None] + np.arange(36)).ravel())
            signs.append(np.full(len(kept) * 36, float(sign)))
        diagonal = np.arange(self._size)
        row, column = np.concatenate([*rows, diagonal]), np.concatenate([*columns, diagonal])
        # The last entry of the data is the catch.
        self._source = np.concatenate([*source, np.full(self._size, 36 * len(sides))])
        self._signs = np.concatenate([*signs, np.ones(self._size)])
        if self.kind == "band":
            self._where = column * (3 * self._band + 1) + 2 * self._band + row - column
            self._entries = self._size * (3 * self._band + 1)
        elif self.kind == "dense":
            self._where, self._entries = row * self._size + column, self._size**2
        else:
            at, self._where = np.unique(column * self._size + row, return_inverse=True)
            self._entries = len(at)
            starts = np.searchsorted(at // self._size, np.arange(self._size + 1))
            self._pattern = (at % self._size).astype(np.int32), starts.astype(np.int32)

    def matrix(self, pairs: Array, catch: float) -> Array:
        """The entries of the stiffness, as `solve` takes them, of that of the pairs (I, 6, 6) and a catch."""
        values = np.append(pairs.ravel(), catch)[self._source] * self._signs
        return np.asarray(np.bincount(self._where, values, self._entries), dtype=np.float64)

    def solve(self, matrix: Array, right: Array) -> Array:
        """(6 n,) displacements under a load (6 n,)."""
        size, k = self._size, self._band
        if self.kind == "dense":
            return np.asarray(np.linalg.solve(matrix.reshape(size, size), right))
        if self.kind == "band":
            load = np.empty(size)
            load[self._place] = right
            _, _, found, failed = dgbsv(k, k, matrix.reshape(size, 3 * k + 1).T, load)
            if failed:
                raise np.linalg.LinAlgError(f"dgbsv: {failed}")
            return np.asarray(found[self._place])
        sparse: Any = csc_array((matrix, *self._pattern), shape=(size, size))
        # The places of the entries are symmetric, and the diagonal is large.
        options = {"SymmetricMode": True}
        factors = splu(sparse, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=1e-3, options=options)
        return np.asarray(factors.solve(right))


def _neighbours_near(sides: Indices, count: int) -> Indices:
    """(n,) place of each body in an order in which bodies that touch are near each other (Cuthill, McKee 1969)."""
    both = sides[np.all(sides < count, axis=1)]
    rows, columns = np.concatenate([both, both[:, ::-1]]).T
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    place = np.empty(count, dtype=np.int64)
    place[reverse_cuthill_mckee(graph, symmetric_mode=True)] = np.arange(count)
    return place
