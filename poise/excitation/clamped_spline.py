"""Quintic B-splines that begin and end at rest in one place, as matrices: what an optimiser turns, and its bounds."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from poise.simulation import WaypointTrajectory
from poise.types import Array

_DEGREE = 5
_KNOT_SPACING = 0.125
"""s between knots: motions up to about 4 Hz, as much as arms follow."""
FEWEST, MOST = 6, 48
"""Intervals between knots."""


@dataclass(frozen=True, eq=False)
class ClampedSpline:
    """Joint displacements d(t) = B(t) c on [0, duration], with d, its velocity and acceleration zero at both ends.

    Args:
        duration: s.
        knots: (K + 1,) s.
        values: three (N, F) matrices of the displacement and its first two derivatives at N evenly spaced times.
        polygons: control points (., F) of the displacement, velocity and acceleration; each curve stays between the
            least and its greatest.
    """

    duration: float
    knots: Array
    values: tuple[Array, Array, Array]
    polygons: tuple[Array, Array, Array]

    @classmethod
    def make(cls, duration: float, samples: int) -> "ClampedSpline":
        """A spline with evenly spaced knots, sampled at the middles of `samples` equal stretches."""
        intervals = int(np.clip(round(duration / _KNOT_SPACING), FEWEST, MOST))
        knots = np.linspace(0.0, duration, intervals + 1)
        middles = (np.arange(samples) + 0.5) * duration / samples
        values = tuple(_basis(knots, middles, order) for order in range(3))
        return cls(duration, knots, (values[0], values[1], values[2]), _polygons(knots))

    @property
    def size(self) -> int:
        """F, free coefficients of each joint."""
        return int(self.values[0].shape[1])

    def trajectory(self, start: Array, coefficients: Array) -> WaypointTrajectory:
        """The motion start + d(t), coefficients (F, J); waypoints at the knots, the same quintics between."""
        rows = [_basis(self.knots, self.knots, order) @ coefficients for order in range(3)]
        for row in rows:
            row[[0, -1]] = 0.0
        return WaypointTrajectory(self.knots, start + rows[0], rows[1], rows[2])


def _full(knots: Array) -> Array:
    return np.concatenate([[knots[0]] * _DEGREE, knots, [knots[-1]] * _DEGREE])


def _basis(knots: Array, seconds: Array, derivative: int) -> Array:
    """(N, F) of the coefficients that are not held at zero: three at either end are, for rest in place."""
    spline = BSpline(_full(knots), np.eye(len(knots) + _DEGREE - 1), _DEGREE)
    return np.asarray(spline(seconds, derivative))[:, 3:-3]


def _polygons(knots: Array) -> tuple[Array, Array, Array]:
    """Control points of a spline and its derivatives (de Boor 1978, chapter X)."""
    full, points = _full(knots), np.eye(len(knots) + _DEGREE - 1)
    out = [points[:, 3:-3]]
    for degree in (_DEGREE, _DEGREE - 1):
        span = full[degree + 1 : -1] - full[1 : -degree - 1]
        points = degree * np.diff(points, axis=0) / span[: len(points) - 1, None]
        full = full[1:-1]
        out.append(points[:, 3:-3])
    return out[0], out[1], out[2]
