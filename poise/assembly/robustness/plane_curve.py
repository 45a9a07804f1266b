"""The boundary of a convex set around the origin of a plane, from some of its points: bounds between these."""

from bisect import bisect_right, insort
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from poise.types import Array

_PARALLEL = 1e-9
"""Sine of an angle below which two lines do not meet."""


class Chord(NamedTuple):
    """Where a ray meets the chord between the known points on both sides of it.

    Args:
        reach: how far from the origin, which a convex set holds.
        azimuths: of both points, rad.
        weights: of both points, which add up to 1.
    """

    reach: float
    azimuths: tuple[float, float]
    weights: tuple[float, float]


@dataclass(eq=False)
class PlaneCurve:
    """Points on the boundary of a convex set with the origin inside.

    Args:
        reach: distance of each point from the origin, by azimuth, rad, in [0, 2 pi).
    """

    reach: dict[float, float] = field(default_factory=dict)
    _azimuths: list[float] = field(default_factory=list)

    def add(self, azimuth: float, reach: float) -> None:
        """Put a point on the boundary, or move the one at this azimuth."""
        if azimuth not in self.reach:
            insort(self._azimuths, azimuth)
        self.reach[azimuth] = reach

    def chord(self, azimuth: float) -> Chord | None:
        """The chord that a ray meets between its neighbours on the boundary, itself left out.

        None where these are half a turn apart or more, or at the origin.
        """
        sides = self._sides(azimuth)
        if sides is None:
            return None
        first, second = self._point(sides[1]), self._point(sides[2])
        turn = _cross(first, second)
        ray = _ray(azimuth)
        if turn <= _PARALLEL * float(np.linalg.norm(first) * np.linalg.norm(second)):
            return None
        weights = _cross(ray, second) / turn, _cross(first, ray) / turn
        total = sum(weights)
        return Chord(1 / total, (sides[1], sides[2]), (weights[0] / total, weights[1] / total))

    def beyond(self, azimuth: float) -> float:
        """How far a convex set reaches along a ray at most: to the lines through two points on either side of it."""
        sides = self._sides(azimuth)
        if sides is None or len({*sides}) < len(sides):
            return np.inf
        ray, least = _ray(azimuth), np.inf
        for far, near in ((sides[0], sides[1]), (sides[3], sides[2])):
            point = self._point(near)
            along = point - self._point(far)
            meets, apart = _cross(ray, along), _cross(point, along)
            if abs(meets) > _PARALLEL * float(np.linalg.norm(along)) and apart / meets > 0:
                least = min(least, apart / meets)
        return least

    def _sides(self, azimuth: float) -> tuple[float, float, float, float] | None:
        """Two known azimuths before a ray and two after it; None where there is none on one of the sides."""
        known = [one for one in self._azimuths if one != azimuth]
        if len(known) < 2:
            return None
        at = bisect_right(known, azimuth)
        return known[at - 2], known[at - 1], known[at % len(known)], known[(at + 1) % len(known)]

    def _point(self, azimuth: float) -> Array:
        return self.reach[azimuth] * _ray(azimuth)


def _ray(azimuth: float) -> Array:
    return np.array([np.cos(azimuth), np.sin(azimuth)])


def _cross(first: Array, second: Array) -> float:
    return float(first[0] * second[1] - first[1] * second[0])
