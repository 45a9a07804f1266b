"""Pushes on a block, those that its symmetries carry into each other in one place."""

import math
from dataclasses import dataclass

import numpy as np

from poise.assembly.contact import SurfacePoints
from poise.assembly.statics import BlockAnalysis
from poise.types import Array, Indices

_TOWARDS = np.array([0.7548776662466927, 0.5698402909980532, 0.0])
"""Of the images of a point the one that reaches farthest along this is taken: the same part of the surface for all."""
_EQUAL = 1e-9
"""... if by more than this, per length of the block."""
_MANY = 1000
"""Pushes on a body on one interface for which symmetries are worth looking for: few are answered in less time."""


@dataclass(frozen=True, eq=False)
class FoldedPushes:
    """Unit pushes on a block, those that its symmetries carry into each other in one place: it holds them alike.

    Args:
        body: (n,) of the block.
        points, directions: (n, 3) m; unit vectors.
        wrenches: (n, 6) in the block's units.
        folded: (n,) number of the symmetry of the block that carried each push here; -1: none did.
    """

    body: Indices
    points: Array
    directions: Array
    wrenches: Array
    folded: Indices

    @classmethod
    def of(cls, block: BlockAnalysis, surface: SurfacePoints, rows: Indices, wrenches: Array) -> "FoldedPushes":
        """The images of pushes (rows), with wrenches (N, 6) of all, N and N m, in one part of the surface."""
        units, body = block.geometry.units, block.bodies_of(surface.place[rows])
        points, directions = surface.points[rows], surface.directions[rows]
        scaled, folded = units.of_wrench(wrenches[rows]), np.full(len(rows), -1)
        places = points - units.origin
        most = places @ _TOWARDS
        worth = len(rows) >= _MANY or not block.geometry.statically_determinate
        symmetries = block.solvers.symmetries if worth else ()
        for number, symmetry in enumerate(symmetries):
            reach = places @ (_TOWARDS @ symmetry.turn)  # of the images
            better = reach > most + _EQUAL * units.length
            np.copyto(most, reach, where=better)
            folded[better] = number
        for number, symmetry in enumerate(symmetries):
            part = np.flatnonzero(folded == number)
            points[part] = units.origin + symmetry.vectors(places[part])
            body[part] = symmetry.bodies[body[part]]
            directions[part], scaled[part] = symmetry.vectors(directions[part]), symmetry.wrenches(scaled[part])
        return cls(body, points, directions, scaled, folded)

    def split(self, length: float) -> list[Indices]:
        """Groups of one body, one direction of push and one plane, to 1e-6 of a length, m."""
        offset = np.einsum("ij,ij->i", self.points, self.directions) / length
        group = _group_rows(np.column_stack([self.body, np.round(self.directions, 7), np.round(offset, 6)]))
        return np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])


def _group_rows(key: Array) -> Indices:
    """(N,) group number of each row of a key (N, K <= 5); rows are equal to about 1e-6."""
    # One number for each row of the key: far faster to sort than rows.
    weights = np.array([1.0, math.e, math.pi, np.sqrt(2), np.sqrt(3)])[: key.shape[1]]
    return np.unique(np.round(key @ weights, 6), return_inverse=True)[1].ravel()
