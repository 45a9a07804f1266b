"""The boundary of a convex set around the origin of a plane, from some of its points: bounds between these."""

import math
from bisect import bisect_right, insort
from dataclasses import dataclass, field
from typing import NamedTuple

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
        if turn <= _PARALLEL * math.hypot(*first) * math.hypot(*second):
            return None
        weights = _cross(ray, second) / turn, _cross(first, ray) / turn
        total = sum(weights)
        return Chord(1 / total, (sides[1], sides[2]), (weights[0] / total, weights[1] / total))

    def beyond(self, azimuth: float) -> float:
        """How far a convex set reaches along a ray at most: to the lines through two points on either side of it."""
        sides = self._sides(azimuth)
        if sides is None or len({*sides}) < len(sides):
            return math.inf
        ray, least = _ray(azimuth), math.inf
        for far, near in ((sides[0], sides[1]), (sides[3], sides[2])):
            point = self._point(near)
            beyond = self._point(far)
            along = point[0] - beyond[0], point[1] - beyond[1]
            meets, apart = _cross(ray, along), _cross(point, along)
            if abs(meets) > _PARALLEL * math.hypot(*along) and apart / meets > 0:
                least = min(least, apart / meets)
        return least

    def _sides(self, azimuth: float) -> tuple[float, float, float, float] | None:
        """Two known azimuths before a ray and two after it; None where there is none on one of the sides."""
        known = [one for one in self._azimuths if one != azimuth]
        if len(known) < 2:
            return None
        at = bisect_right(known, azimuth)
        return known[at - 2], known[at - 1], known[at % len(known)], known[(at + 1) % len(known)]

    def _point(self, azimuth: float) -> tuple[float, float]:
        x, y = _ray(azimuth)
        return self.reach[azimuth] * x, self.reach[azimuth] * y


def _ray(azimuth: float) -> tuple[float, float]:
    return math.cos(azimuth), math.sin(azimuth)


def _cross(first: tuple[float, float], second: tuple[float, float]) -> float:
    return first[0] * second[1] - first[1] * second[0]
