"""How far apart the points of a cloud are, from place to place: a camera shows near things in more points."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.shape.nearest import nearest
from poise.types import Array

_NEIGHBOURS, _AROUND = 6, 25
"""Of a point; and points that the spacing around one is a mean over."""
_COARSE_FROM, _MOST_COARSE = 1.35, 3.0
"""Spacing around a point, over the usual one, from which on the ball is larger there, and the largest ball, over the
usual one. Random sampling alone reaches 1.2 to 1.3 on even surfaces."""


@dataclass(frozen=True, eq=False)
class Spacing:
    """Distances between neighbouring points.

    Args:
        usual: m, the median of the mean over six neighbours.
        around: (N,) m, the mean of the same around each point; the usual one where there are few points.
    """

    usual: float
    around: Array

    @cached_property
    def coarseness(self) -> Array:
        """(N,) how much larger a ball has to be around each point than for the usual spacing."""
        return np.asarray(np.clip(self.around / (_COARSE_FROM * self.usual), 1.0, _MOST_COARSE))


def spacing_of(points: Array) -> Spacing:
    """Spacing of points (N, 3) m, on a surface; 0 for a single point."""
    if len(points) < 2:
        return Spacing(0.0, np.zeros(len(points)))
    enough = len(points) > _AROUND
    distances, near = nearest(points, points, _AROUND if enough else min(_NEIGHBOURS + 1, len(points)))
    own = distances[:, 1 : _NEIGHBOURS + 1].mean(axis=1)
    usual = float(np.median(own))
    return Spacing(usual, own[near].mean(axis=1) if enough else np.full(len(points), usual))
