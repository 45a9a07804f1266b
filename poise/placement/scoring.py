"""The score of a placement: least and median robustness, volume and compactness of the assembly."""

from dataclasses import dataclass, replace

import numpy as np

from poise.assembly import Analysis, robustness_map
from poise.assembly.contact import SurfacePoints
from poise.assembly.robustness import CHECKED_WEIGHTS
from poise.assembly.statics import NO_DEADLINE, BlockAnalysis, Deadline
from poise.errors import ErrorCode, InputError
from poise.geometry import plane_axes, unit, wrench_of_force
from poise.types import Array, Indices

_TOLERANCE = 0.02
"""Relative; between the certified bounds of a robustness."""
_ASKED = 16
"""Programs solved for each body of a block for an estimate, at most."""
_CONFIRMED = 128
"""Corners of one body that elastic contacts are asked about, at most."""
_MEDIAN_POINTS, _MEDIAN_TOLERANCE = 200, 0.1
CRITERIA = ("least", "median", "volume", "compactness")


@dataclass(frozen=True)
class PlacementScore:
    """Of an assembly after a placement.

    Args:
        least: N, robustness to pushes into the surface, over all movable objects; a certified lower bound.
        median: N, median robustness of points spread over the surface; NaN when it was not requested.
        volume: m3 of the box, aligned with gravity, around the movable objects.
        compactness: m, mean distance of the movable objects' centres of mass from their common one.
    """

    least: float
    median: float
    volume: float
    compactness: float

    def better_than(self, other: "PlacementScore", criterion: str) -> bool:
        """By one criterion; within 1 % of it the least robustness decides."""
        mine, theirs = self._score(criterion), other._score(criterion)
        if abs(mine - theirs) > 0.01 * max(abs(mine), abs(theirs)):
            return mine > theirs
        return self.least > other.least

    def _score(self, criterion: str) -> float:
        value: float = getattr(self, criterion)
        return value if criterion in ("least", "median") else -value


def evaluate(analysis: Analysis, median: bool = False) -> PlacementScore:
    """Judge an assembly that stands: the least robustness by `limit`, `patch` and elastic contacts, at every corner.

    Args:
        analysis: with the object in it.
        median: also ask for the median, which takes a map; otherwise it is NaN.

    Raises:
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    surface = _corners(analysis)
    least = min(float(robustness_map(analysis, surface, _TOLERANCE, model).lower.min()) for model in ("limit", "patch"))
    return replace(_rest(analysis, median), least=_held(analysis, surface, least, NO_DEADLINE))


def confirm_least(analysis: Analysis, least: float, deadline: Deadline = NO_DEADLINE) -> float:
    """The least robustness, N, lowered to what elastic contacts hold where contact forces have a choice.

    Every corner is asked whether it holds what the weakest one before it holds; of a body with more than
    `_CONFIRMED` corners, that many, evenly chosen.

    Args:
        analysis: of an assembly that stands.
        least: N; what no corner is asked to exceed.
        deadline: when it passes, corners that are left are not asked.
    """
    return _held(analysis, _corners(analysis), least, deadline)


def _held(analysis: Analysis, surface: SurfacePoints, least: float, deadline: Deadline) -> float:
    wrenches = wrench_of_force(surface.directions, surface.points)
    most = CHECKED_WEIGHTS * sum(block.geometry.units.weight for block in analysis.blocks)
    held = min(least, most)
    for block in analysis.blocks:
        if block.geometry.statically_determinate:
            continue
        body, scaled = _on_block(block, surface, wrenches)
        chosen = np.concatenate([_thinned(np.flatnonzero(body == number)) for number in np.unique(body)])
        for load in _loads(block, body[chosen], scaled[chosen]):
            found = block.solvers.coulomb.factor(load, held, deadline)
            if not found.known and deadline.passed:
                break
            held = min(held, found.value)
    return held if held < most else least


def _thinned(rows: Indices) -> Indices:
    """At most `_CONFIRMED` of some rows, evenly chosen."""
    count = min(len(rows), _CONFIRMED)
    return np.asarray(rows[np.linspace(0, len(rows) - 1, count).astype(int)])


def _rest(analysis: Analysis, median: bool) -> PlacementScore:
    """All but the least robustness, which is left at 0."""
    objects = [analysis.assembly.objects[i] for i in analysis.structure.movable]
    middling = float("nan")
    if median:
        middling = float(np.median(robustness_map(analysis, _MEDIAN_POINTS, _MEDIAN_TOLERANCE, "limit").lower))
    corners = np.concatenate([item.vertices for item in objects])
    coms = np.array([item.com_in_world for item in objects])
    spread = float(np.linalg.norm(coms - coms.mean(axis=0), axis=1).mean())
    volume = _box_volume(corners, analysis.assembly.gravity)
    return PlacementScore(0.0, middling, volume, spread)


def estimate_score(analysis: Analysis, median: bool = False) -> PlacementScore:
    """As `evaluate`, in a fraction of the time: an upper bound of the least robustness by `limit`, most often exact."""
    score = _rest(analysis, median)
    surface = _corners(analysis)
    wrenches = wrench_of_force(surface.directions, surface.points)
    inverse = max((_largest_inverse(block, surface, wrenches) for block in analysis.blocks), default=0.0)
    return replace(score, least=1 / inverse if inverse > 0 else float("inf"))


def _largest_inverse(block: BlockAnalysis, surface: SurfacePoints, wrenches: Array) -> float:
    """1/N of the corner that brings a block nearest to collapse, as far as a few programs show.

    Every collapse mechanism found bounds all corners from below; the corner with the largest bound is solved next.
    """
    body, scaled = _on_block(block, surface, wrenches)
    loads = _loads(block, body, scaled)
    extremes: list[int] = []
    for number in np.unique(body):
        on = np.flatnonzero(body == number)
        extremes += [*on[scaled[on].argmax(axis=0)].tolist(), *on[scaled[on].argmin(axis=0)].tolist()]
    known, best, asked = np.zeros(len(body)), 0.0, set[int]()
    wanted = list(dict.fromkeys(extremes))
    while wanted:
        asked |= set(wanted)
        found = block.solvers.rough_limit.inverse_factors(loads[wanted], np.zeros(len(wanted)))
        best = max(best, float(found.upper.max()))
        if not np.isfinite(best):
            return best
        known = np.maximum(known, (loads @ found.twist.T).max(axis=1))
        weakest = int(known.argmax())
        wanted = [weakest] if weakest not in asked and len(asked) < _ASKED * block.geometry.count else []
    return best


def _on_block(block: BlockAnalysis, surface: SurfacePoints, wrenches: Array) -> tuple[Indices, Array]:
    """(q,) bodies of the block that are pushed, and (q, 6) the wrenches on them in its units."""
    bodies = block.bodies_of(surface.place)
    rows = np.flatnonzero(bodies >= 0)
    return bodies[rows], block.geometry.units.of_wrench(wrenches[rows])


def _loads(block: BlockAnalysis, body: Indices, scaled: Array) -> Array:
    """(q, 6 n) loads on the block of wrenches (q, 6) on bodies (q,)."""
    on_bodies = np.zeros((len(body), block.geometry.count, 6))
    on_bodies[np.arange(len(body)), body] = scaled
    return on_bodies.reshape(len(body), -1)


def _corners(analysis: Analysis) -> SurfacePoints:
    """The corners of all faces of all movable objects, pushed into the face.

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
    return SurfacePoints(np.concatenate(places), np.concatenate(points), np.concatenate(directions))


def check_criterion(criterion: str) -> None:
    """Raise InputError BAD_INPUT for an unknown criterion."""
    if criterion not in CRITERIA:
        raise InputError(ErrorCode.BAD_INPUT, f"criterion {criterion!r}: choose one of {', '.join(CRITERIA)}")


def _outline(plane: Array) -> list[int]:
    """Corners of the hull of points (N, 2), in order: a monotone chain."""
    chain: list[int] = []
    there = plane.tolist()
    order = np.lexsort(plane.T[::-1]).tolist()
    for way in (order, order[::-1]):
        begin = len(chain)
        for k in way:
            x, y = there[k]
            while len(chain) > begin + 1:
                (x0, y0), (x1, y1) = there[chain[-2]], there[chain[-1]]
                if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):
                    break
                chain.pop()
            chain.append(k)
        chain.pop()
    return chain or order[:1]


def _box_volume(corners: np.ndarray, gravity: np.ndarray) -> float:
    """m3 of the smallest upright box around points (N, 3): the least rectangle has a side on an edge of the hull."""
    up = -unit(gravity)
    plane = corners @ plane_axes(up).T
    hull = plane[_outline(plane)]
    sides = np.concatenate([hull[1:], hull[:1]]) - hull
    angles = np.unique(np.round(np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2), 6))
    cosines, sines, (x, y) = np.cos(angles)[:, None], np.sin(angles)[:, None], hull.T
    areas = np.ptp(cosines * x + sines * y, axis=1) * np.ptp(cosines * y - sines * x, axis=1)
    return float(areas.min() * np.ptp(corners @ up))
