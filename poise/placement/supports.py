"""Where the scene may carry something: places on its surface, and how likely each is tried (thesis eq. 5.10-5.14)."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from poise.assembly import Analysis, Push, RigidObject, assess
from poise.assembly.contact import SurfacePoints
from poise.assembly.robustness import rough_robustness
from poise.errors import ErrorCode, InputError, PoiseError
from poise.geometry import cross, unit
from poise.placement.features import PARALLEL_SINE, are_convex
from poise.placement.matching import SupportPoint
from poise.types import Array, Mask

_FACES_UP = 0.02
"""Least cosine between a carrying surface's normal and up."""
_TOLERANCE = 0.3
"""Relative; of the robustness that only guides."""
_GUIDES = ("limit", "approx", "thesis", "uniform")
_GUIDE_SECONDS = 5.0
"""s for guides that ask every place by itself; what they have not reached by then is held for weak."""
_FIRST_SHARE = 0.1
"""Probability of the set of strongest points at the first draw (thesis section 5.6.1)."""
_DECAY = 0.99
_FAILED = 0.6
"""What is left of a place's weight after a pose on it has failed."""
_SHARP_SHARE = 0.4
"""Of the draws, at least, where there are ridges or peaks: they are few, but reach highest."""
_STEEP = 0.1
"""Weight of slopes on which nothing would stay without another support."""
_REACH = 1.5
"""Sizes of the object within which the places of one draw lie."""
_ABOVE = 2e-3
"""m over a place, where nothing else may be."""


@dataclass(eq=False)
class Supports:
    """Places of the scene, with weights that change as they are tried.

    Args:
        places: (N,) in `Assembly.objects`.
        points, normals: (N, 3) m and outward unit normals, in the world.
        robustness: (N,) N, of pushes into the surface; infinite on what is fixed.
        nearness: (N,) 0..1, eq. 5.13.
        sharp: (N,) on ridges and peaks.
        reach: m, within which the places of one draw lie.
    """

    places: NDArray[np.int64]
    points: Array
    normals: Array
    robustness: Array
    nearness: Array
    sharp: Mask
    reach: float
    trust: Array = field(init=False)
    draws: int = 0

    def __post_init__(self) -> None:
        self.trust = np.ones(len(self.points))
        finite = self.robustness[np.isfinite(self.robustness)]
        top = float(finite.max(initial=1.0))
        # The cap at which the strongest finite set of points has its share of the probability, before it decays.
        rest = float(np.minimum(self.robustness, top).sum()) or 1.0
        self._cap = top * max(1.0, _FIRST_SHARE * rest / top)

    def outside(self, rooms: Sequence[tuple[Array, Array]]) -> "Supports":
        """Those outside boxes, given by two corners, m; all of them when none is."""
        within = [np.all((self.points >= low) & (self.points <= high), axis=1) for low, high in rooms]
        kept = ~np.any(within, axis=0) if rooms else np.ones(len(self.points), dtype=bool)
        if kept.all() or not kept.any():
            return self
        found = Supports(
            self.places[kept],
            self.points[kept],
            self.normals[kept],
            self.robustness[kept],
            self.nearness[kept],
            self.sharp[kept],
            self.reach,
        )
        found.trust = self.trust[kept]
        return found

    @property
    def weights(self) -> Array:
        """(N,) probability of each place at the next draw (eq. 5.10, with the cap decayed, and 5.13)."""
        cap = max(self._cap * _DECAY**self.draws, 1e-9)
        weights = np.minimum(self.robustness, cap) * self.nearness ** (_DECAY**self.draws) * self.trust
        share = weights[self.sharp].sum() / (weights.sum() or 1.0)
        if 0 < share < _SHARP_SHARE:
            weights[self.sharp] *= _SHARP_SHARE * (1 - share) / (share * (1 - _SHARP_SHARE))
        total = weights.sum()
        return weights / total if total > 0 else np.full(len(weights), 1 / len(weights))

    def draw(self, rng: np.random.Generator) -> list[int]:
        """Numbers of up to three places near each other; all sharp, or none."""
        weights = self.weights
        self.draws += 1
        first = int(rng.choice(len(weights), p=weights))
        near = np.linalg.norm(self.points - self.points[first], axis=1) < self.reach
        near &= self.sharp == self.sharp[first]
        near[first] = False
        others = np.flatnonzero(near & (weights > 0))
        if len(others) < 2:
            return [first, *others.tolist()]
        share = weights[others] / weights[others].sum()
        return [first, *rng.choice(others, size=2, replace=False, p=share).tolist()]

    def contact(self, number: int) -> SupportPoint:
        return SupportPoint(self.points[number], self.normals[number])

    def distrust(self, point: Array, reach: float) -> None:
        """Try places near a failure less often (as thesis section 5.8.2 proposes)."""
        near = np.linalg.norm(self.points - point, axis=1) < reach
        self.trust[near] = np.maximum(self.trust[near] * _FAILED, 0.02)


def find_supports(
    analysis: Analysis, on: str, guide: str, count: int, scale: float, rng: np.random.Generator
) -> Supports:
    """Sample places on upward faces, ridges and peaks, with the robustness of each.

    Args:
        analysis: of the assembly; it has to stand.
        on: objects, fixed, or any: what may carry.
        guide: source of the robustness of places: limit (uniform pressure, and limit analysis where forces have a
            choice), approx or thesis (the models of that name, place by place), or uniform (none).
        count: places to spread.
        scale: m, of the object to place; nearness falls off over it and the size of the scene.
        rng: of the spread.

    Raises:
        InputError: BAD_INPUT for an unknown guide; OBJECT_INVALID when nothing of the kind could carry anything.
    """
    if guide not in _GUIDES:
        raise InputError(ErrorCode.BAD_INPUT, f"guide {guide!r}: choose one of {', '.join(_GUIDES)}")
    objects = analysis.assembly.objects
    up = -unit(analysis.assembly.gravity)
    chosen = carriers(objects, on)
    found = [_places(objects[i], up, max(count // max(len(chosen), 1), 8), rng) for i in chosen]
    places = np.repeat(chosen, [len(points) for points, _, _ in found])
    if not len(places):
        raise InputError(ErrorCode.OBJECT_INVALID, f"the scene has no surface that looks up to carry something ({on})")
    points, normals = (np.concatenate([part[k] for part in found]) for k in (0, 1))
    sharp = np.concatenate([part[2] for part in found])
    free = _uncovered(objects, places, points, normals)
    if free.any():
        places, points, normals, sharp = places[free], points[free], normals[free], sharp[free]
    robustness = np.ones(len(points)) if guide == "uniform" else _guide(analysis, guide, places, points, normals)
    middle, reach = _extent(analysis, points, scale)
    nearness = np.exp(-np.sum((points - middle) ** 2, axis=1) / reach**2)
    supports = Supports(places, points, normals, robustness, nearness, sharp, _REACH * scale)
    assembly = analysis.assembly
    friction = assembly.largest_friction if assembly.friction is None else assembly.friction
    supports.trust[normals @ up < 1 / np.hypot(1, friction)] = _STEEP
    return supports


def carriers(objects: Sequence[RigidObject], on: str) -> NDArray[np.int64]:
    """Numbers of what may carry: objects, fixed, or any."""
    chosen = [i for i, item in enumerate(objects) if on == "any" or item.fixed == (on == "fixed")]
    return np.array(chosen, dtype=np.int64)


def _uncovered(objects: Sequence[RigidObject], places: NDArray[np.int64], points: Array, normals: Array) -> Mask:
    """(N,) whether a place is open: not inside a convex body that lies on it."""
    over = points + _ABOVE * normals
    free = np.ones(len(points), dtype=bool)
    for place, item in enumerate(objects):
        near = (places != place) & np.all(over > item.vertices.min(axis=0), axis=1)
        near &= np.all(over < item.vertices.max(axis=0), axis=1)
        rows = np.flatnonzero(near)
        polyhedron = item.shape.polyhedron
        if len(rows) and polyhedron.convex:
            on_facets = polyhedron.vertices[[triangles[0, 0] for triangles in polyhedron.facet_triangles]]
            heights = item.pose.undo(over[rows]) @ polyhedron.normals.T - np.sum(on_facets * polyhedron.normals, axis=1)
            free[rows] &= heights.max(axis=1) > 0
    return free


def _places(item: RigidObject, up: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array, Mask]:
    """Points and normals on one body, faces by area, every ridge and peak that looks straight up; which are sharp."""
    polyhedron = item.shape.polyhedron
    normals = polyhedron.normals @ item.pose.rotation.T
    vertices = item.vertices
    triangles = np.flatnonzero((normals @ up > _FACES_UP)[polyhedron.facet_of_triangle])
    points, directions = [np.zeros((0, 3))], [np.zeros((0, 3))]
    if len(triangles):
        corners = vertices[polyhedron.triangles[triangles]]
        areas = np.linalg.norm(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        picked = rng.choice(len(triangles), size=count, p=areas / areas.sum())
        square = rng.random((count, 2))
        square = np.where(square.sum(axis=1, keepdims=True) > 1, 1 - square, square)
        a, b, c = (corners[picked, k] for k in range(3))
        points.append(a + square[:, :1] * (b - a) + square[:, 1:] * (c - a))
        directions.append(normals[polyhedron.facet_of_triangle[triangles[picked]]])
    sharp = _sharp(item, up)
    points.append(sharp)
    directions.append(np.tile(up, (len(sharp), 1)))
    count = sum(map(len, points))
    return np.concatenate(points), np.concatenate(directions), np.arange(count) >= count - len(sharp)


def _sharp(item: RigidObject, up: Array) -> Array:
    """(P, 3) middles of ridges and peaks: a level plate could rest there without touching the faces beside them."""
    polyhedron, vertices = item.shape.polyhedron, item.vertices
    heights = vertices @ up
    ends, beside = polyhedron.edges, (polyhedron.normals @ item.pose.rotation.T)[polyhedron.edge_facets]
    run = vertices[ends[:, 1]] - vertices[ends[:, 0]]
    level = np.abs(run @ up) < PARALLEL_SINE * np.linalg.norm(run, axis=1)
    # The faces beside a level ridge fall away on different hands; so they do beside a valley.
    hands = np.einsum("esk,ek->es", beside, cross(run, up))
    apart = hands.prod(axis=1) < -1e-12 * np.einsum("ij,ij->i", run, run)
    edges = np.flatnonzero(level & apart & np.all(beside @ up > -PARALLEL_SINE, axis=1))
    ridge = edges[are_convex(polyhedron, edges)].tolist()
    shares = np.linspace(0, 1, 5)[:, None, None]
    along = (vertices[ends[ridge, 0]] + shares * run[ridge]).reshape(-1, 3)
    highest = np.full(len(vertices), -np.inf)
    np.maximum.at(highest, ends.ravel(), heights[ends[:, ::-1]].ravel())
    scale = float(np.ptp(heights)) or 1.0
    peaks = vertices[np.isfinite(highest) & (highest < heights - 1e-6 * scale)]
    return np.concatenate([along, peaks])


def _guide(analysis: Analysis, guide: str, places: NDArray[np.int64], points: Array, normals: Array) -> Array:
    """(N,) robustness of pushes into the surface; infinite on fixed bodies."""
    robustness = np.full(len(points), np.inf)
    movable = np.flatnonzero(np.isin(places, analysis.structure.movable))
    if len(movable):
        surface = SurfacePoints(places[movable], points[movable], -normals[movable])
        try:
            if guide == "limit":
                robustness[movable] = rough_robustness(analysis, surface, _TOLERANCE)
            else:
                robustness[movable] = _asked(analysis, guide, surface)
        except PoiseError:
            robustness[movable] = 1.0  # without a guide all places are equal
    return np.asarray(robustness)


def _asked(analysis: Analysis, model: str, surface: SurfacePoints) -> list[float]:
    """N, by a model that gives no map."""
    rows = zip(surface.place, surface.points, surface.directions, strict=True)
    pushes = [Push(analysis.assembly.objects[place].id, point, direction) for place, point, direction in rows]
    return [found.lower for found in assess(analysis, pushes, model, _GUIDE_SECONDS).results]


def _extent(analysis: Analysis, points: Array, scale: float) -> tuple[Array, float]:
    """Centroid and size, m, of what is already there: of the movable objects, else of the carrying surfaces."""
    objects = [analysis.assembly.objects[i] for i in analysis.structure.movable]
    if not objects:
        return points.mean(axis=0), max(float(np.ptp(points, axis=0).max()), scale)
    corners = np.concatenate([item.vertices for item in objects])
    return corners.mean(axis=0), float(np.linalg.norm(np.ptp(corners, axis=0))) / 2 + scale
