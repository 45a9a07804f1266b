"""How good a placement is: what the weakest push has to be, what the middling one, and how much room is taken."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from poise.assembly.analysis import Analysis
from poise.assembly.assess import assess
from poise.assembly.geometry import plane_axes, unit
from poise.assembly.maps import robustness_map
from poise.assembly.pushes import Push
from poise.assembly.surface import SurfacePoints
from poise.errors import ErrorCode, InputError

TOLERANCE = 0.02
"""Relative; between the certified bounds of a robustness."""
VERIFIED = 8
"""How many of the weakest corners are asked of another model than the guide's."""
MEDIAN_POINTS, MEDIAN_TOLERANCE = 200, 0.1
CRITERIA = ("least", "median", "volume", "compactness")


@dataclass(frozen=True)
class Merit:
    """Of an assembly after a placement.

    Args:
        least: N, robustness to pushes into the surface, over all movable objects; a certified lower bound.
        median: the same, of points spread over the surface; NaN when it was not asked for.
        volume: m3 of the box, aligned with gravity, around the movable objects.
        compactness: m, mean distance of the movable objects' centres of mass from their common one.
    """

    least: float
    median: float
    volume: float
    compactness: float

    def better_than(self, other: "Merit", criterion: str) -> bool:
        """By one criterion; within 1 % of it the least robustness decides."""
        mine, theirs = self._score(criterion), other._score(criterion)
        if abs(mine - theirs) > 0.01 * max(abs(mine), abs(theirs)):
            return mine > theirs
        return self.least > other.least

    def _score(self, criterion: str) -> float:
        value: float = getattr(self, criterion)
        return value if criterion in ("least", "median") else -value


def judge(analysis: Analysis, median: bool = False, model: str = "limit") -> Merit:
    """Judge an assembly that stands.

    Args:
        analysis: with the object in it.
        median: also ask for the median, which takes a map; otherwise it is NaN.
        model: see `robustness_map`.

    Raises:
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    objects = [analysis.assembly.objects[i] for i in analysis.structure.movable]
    middling = float("nan")
    if median:
        middling = float(np.median(robustness_map(analysis, MEDIAN_POINTS, MEDIAN_TOLERANCE, model).lower))
    corners = np.concatenate([item.vertices for item in objects])
    coms = np.array([item.com_in_world for item in objects])
    spread = float(np.linalg.norm(coms - coms.mean(axis=0), axis=1).mean())
    volume = _box_volume(corners, analysis.assembly.gravity)
    return Merit(_least(analysis, model), middling, volume, spread)


def _least(analysis: Analysis, model: str) -> float:
    """N, the least robustness of the whole surface to pushes into it.

    On a flat face 1 / robustness is a convex function of the point, so the weakest point of a face is one of its
    corners: asking the corners is exact.
    """
    places, points, directions = [], [], []
    for place in analysis.structure.movable:
        item = analysis.assembly.objects[place]
        polyhedron = item.shape.polyhedron
        corner = np.concatenate(polyhedron.facet_vertices)
        facet = np.repeat(np.arange(len(polyhedron.normals)), [len(v) for v in polyhedron.facet_vertices])
        points.append(item.vertices[corner])
        directions.append(-(polyhedron.normals @ item.pose.rotation.T)[facet])
        places.append(np.full(len(corner), place))
    surface = SurfacePoints(np.concatenate(places), np.concatenate(points), np.concatenate(directions))
    found = robustness_map(analysis, surface, TOLERANCE, "limit")
    if model == "limit":
        return float(found.lower.min())
    weakest = np.argsort(found.lower)[:VERIFIED]
    ids = [item.id for item in analysis.assembly.objects]
    pushes = [Push(ids[surface.place[i]], surface.points[i], surface.directions[i]) for i in weakest]
    return min(result.lower for result in assess(analysis, pushes, model).results)


def check_criterion(criterion: str) -> None:
    """Raise InputError BAD_INPUT for an unknown criterion."""
    if criterion not in CRITERIA:
        raise InputError(ErrorCode.BAD_INPUT, f"criterion {criterion!r}: choose one of {', '.join(CRITERIA)}")


def _box_volume(corners: np.ndarray, gravity: np.ndarray) -> float:
    """m3 of the smallest upright box around points (N, 3): the least rectangle has a side on an edge of the hull."""
    up = -unit(gravity)
    plane = corners @ plane_axes(up).T
    hull = plane[ConvexHull(plane).vertices]
    sides = np.roll(hull, -1, axis=0) - hull
    angles = np.unique(np.round(np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2), 6))
    turned = [hull @ np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in angles]
    return float(min(np.prod(np.ptp(t, axis=0)) for t in turned) * np.ptp(corners @ up))
