"""Places where a cylinder lies between two edges or faces that keep it from rolling: rails, tines, grooves.

In the plane across a level direction these are points and segments, and the cylinder is a circle that touches two of
them from above. Along the direction it is put where it meets nothing.
"""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import cast

import coal
import numpy as np

from poise.assembly import Assembly, Cylinder, RigidObject
from poise.assembly.contact import convex_geometry, convex_overlap
from poise.geometry import Pose, cross, unit
from poise.placement.features import PARALLEL_SINE, are_convex
from poise.types import Array, Indices

_PARALLEL = np.radians(0.3)
"""Between edges that one cylinder touches."""
_PRESSES = 0.05
"""Least force, of the weight, with which each of the two carries the cylinder."""
_STEPS = 64
"""Places tried along a line."""
_MEETS = 1e-4
"""m deep."""
_LOOKED, _FOUND = 300, 10
"""Pairs looked at in one draw, and lines found that end it."""
_MOST = 400
"""Edges and faces looked at."""


@dataclass(frozen=True, eq=False)
class _Part:
    """An edge, or a face, along a level direction.

    Args:
        body: number of the body.
        along: (3,) unit vector, the direction.
        ends: (N, 3) m, corners.
        normals: (K, 3) outwards: of a face one, of an edge those of the two faces beside it.
    """

    body: int
    along: Array
    ends: Array
    normals: Array


@dataclass(frozen=True, eq=False)
class _Line:
    """Where the axis of a cylinder may be: a point (3,) m and a direction (3,), from and to along it, m."""

    point: Array
    direction: Array
    begin: float
    end: float


class Chocks:
    """Places between chocks.

    Args:
        assembly: what is there.
        carriers: numbers of the bodies that may carry the cylinder.
        item: the cylinder.
        com: (3,) m, its centre of mass, in its frame.
    """

    def __init__(self, assembly: Assembly, carriers: Indices, item: RigidObject, com: Array) -> None:
        self._shape, self._com, self._up = item.shape, com, -unit(np.asarray(assembly.gravity))
        self._bodies = [body for body in assembly.objects if body.shape.polyhedron.convex]
        self._bounds = [(body.vertices.min(axis=0), body.vertices.max(axis=0)) for body in self._bodies]
        self._lines: list[_Line] = []
        self._parts: list[_Part] = []
        self._pairs: list[tuple[int, int]] = []
        self._free: dict[_Line, Array] = {}
        if not isinstance(item.shape, Cylinder):
            return
        self._radius, self._length = item.shape.radius, item.shape.length
        parts = [part for k in carriers.tolist() for part in _parts(assembly.objects[k], k, self._up)]
        parts = sorted(parts, key=lambda part: -float(np.linalg.norm(np.ptp(part.ends, axis=0))))[:_MOST]
        self._parts, self._pairs = parts, self._near(parts)

    def _near(self, parts: list[_Part]) -> list[tuple[int, int]]:
        """Pairs of parallel parts of two bodies that one cylinder can reach, the longest last."""
        if not parts:
            return []
        along = np.array([part.along for part in parts])
        reach = self._radius
        low, high = (np.array([f(part.ends, axis=0) for part in parts]) for f in (np.min, np.max))
        bodies = np.array([part.body for part in parts])
        near = np.abs(along @ along.T) > np.cos(_PARALLEL)
        near &= bodies[:, None] != bodies
        for axis in range(3):
            near &= low[:, None, axis] - reach < high[:, axis] + reach
            near &= low[:, axis] - reach < high[:, None, axis] + reach
        pairs = np.argwhere(np.triu(near, 1))
        lengths = np.linalg.norm(high - low, axis=1)[pairs].min(axis=1)
        order = np.argsort(lengths, kind="stable")
        return [(int(a), int(b)) for a, b in pairs[order]]

    def __bool__(self) -> bool:
        return bool(self._lines or self._pairs)

    def _between(self, first: _Part, second: _Part) -> Iterator[_Line]:
        """Where a circle across touches both from above, and each carries some of it."""
        along = first.along if len(first.normals) == 2 else second.along
        across = cross(along, self._up)
        spans = [part.ends @ along for part in (first, second)]
        begin, end = max(float(span.min()) for span in spans), min(float(span.max()) for span in spans)
        if begin >= end:
            return
        frame = np.stack([across, self._up])
        shapes = [(part.ends @ frame.T, part.normals @ frame.T) for part in (first, second)]
        for centre in _touching(shapes, self._radius):
            pushes = [_push(*shape, centre, self._radius) for shape in shapes]
            if any(push is None for push in pushes):
                continue
            forces = np.linalg.lstsq(np.array(pushes).T, np.array([0.0, 1.0]), rcond=None)[0]
            if abs(np.linalg.det(np.array(pushes))) > _PRESSES and forces.min() > _PRESSES:
                yield _Line(centre @ frame, along, begin, end)

    def poses(self, rng: np.random.Generator) -> Iterator[Pose]:
        """A pose on one of the lines, the x axis or the y axis up or down; none where it is taken."""
        self._look()
        if not self._lines:
            return
        lengths = np.array([line.end - line.begin for line in self._lines])
        number = int(rng.choice(len(lengths), p=lengths / lengths.sum()))
        line = self._lines[number]
        if line not in self._free:
            self._free[line] = self._open(line)
        if len(self._free[line]):
            yield self._pose(line, float(rng.choice(self._free[line])), int(rng.integers(4)), bool(rng.integers(2)))
        else:
            del self._lines[number]

    def _look(self) -> None:
        """Look at some more pairs of parts."""
        known = len(self._lines)
        for _ in range(min(_LOOKED, len(self._pairs))):
            self._lines += self._between(*(self._parts[k] for k in self._pairs.pop()))
            if len(self._lines) > known + _FOUND:
                return

    def _open(self, line: _Line) -> Array:
        """(N,) m along a line where the cylinder meets nothing: of each free stretch its middle, the others too."""
        places = np.linspace(line.begin, line.end, _STEPS + 2)[1:-1]
        ends = [self._pose(line, at).translation for at in (line.begin, line.end)]
        reach = float(np.hypot(self._radius, self._length / 2))
        low, high = np.min(ends, axis=0) - reach, np.max(ends, axis=0) + reach
        bodies = [
            (convex_geometry(cast(Hashable, body.shape)), coal.Transform3s(body.pose.rotation, body.pose.translation))
            for body, (least, most) in zip(self._bodies, self._bounds, strict=True)
            if np.all(least < high) and np.all(most > low)
        ]
        shape, rotation = convex_geometry(cast(Hashable, self._shape)), self._pose(line, line.begin).rotation
        poses = [coal.Transform3s(rotation, self._pose(line, float(at)).translation) for at in places]
        free = np.array([all(convex_overlap(shape, pose, *body) <= _MEETS for body in bodies) for pose in poses])
        numbers = np.flatnonzero(free)
        if not len(numbers):
            return places[:0]
        runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
        middles = np.array([(places[run[0]] + places[run[-1]]) / 2 for run in runs])
        return np.concatenate([np.repeat(middles, max(len(numbers) // len(middles), 1)), places[numbers]])

    def _pose(self, line: _Line, at: float, quarter: int = 0, turned: bool = False) -> Pose:
        """The cylinder with its centre of mass at a place along a line."""
        along = -line.direction if turned else line.direction
        side = cross(self._up, along)
        x = (self._up, side, -self._up, -side)[quarter]
        rotation = np.stack([x, cross(along, x), along], axis=1)
        axis = line.point + (at - line.point @ line.direction) * line.direction
        return Pose(rotation, axis - rotation @ (self._com * [0.0, 0.0, 1.0]))


def _parts(body: RigidObject, number: int, up: Array) -> Iterator[_Part]:
    """Level convex edges, and faces that look up, once along each direction of their level edges."""
    polyhedron, vertices = body.shape.polyhedron, body.vertices
    normals = polyhedron.normals @ body.pose.rotation.T
    run = vertices[polyhedron.edges[:, 1]] - vertices[polyhedron.edges[:, 0]]
    run /= np.linalg.norm(run, axis=1)[:, None]
    upward = normals @ up > PARALLEL_SINE
    edges = np.flatnonzero((np.abs(run @ up) < PARALLEL_SINE) & upward[polyhedron.edge_facets].any(axis=1))
    seen: dict[int, list[Array]] = {}
    for edge in edges[are_convex(polyhedron, edges)].tolist():
        beside = polyhedron.edge_facets[edge]
        yield _Part(number, run[edge], vertices[polyhedron.edges[edge]], normals[beside])
        for facet in beside[upward[beside]].tolist():
            known = seen.setdefault(facet, [])
            if all(abs(run[edge] @ other) < np.cos(_PARALLEL) for other in known):
                known.append(run[edge])
                yield _Part(number, run[edge], vertices[polyhedron.facet_vertices[facet]], normals[[facet]])


def _touching(shapes: list[tuple[Array, Array]], radius: float) -> Iterator[Array]:
    """(2,) centres of circles that touch two points or lines."""
    points = [len(normals) == 2 for _, normals in shapes]
    (a, first), (b, second) = shapes
    if all(points):
        apart = b[0] - a[0]
        half = float(np.linalg.norm(apart)) / 2
        if 1e-6 < half < radius:
            rise = np.sqrt(radius**2 - half**2) / (2 * half)
            yield (a[0] + b[0]) / 2 + rise * np.array([-apart[1], apart[0]]) * (1 if apart[0] > 0 else -1)
        return
    if not any(points):
        sides = np.stack([unit(first[0]), unit(second[0])])
        if abs(np.linalg.det(sides)) > _PRESSES:
            yield np.linalg.solve(sides, [sides[0] @ a[0] + radius, sides[1] @ b[0] + radius])
        return
    (point, _), (corner, normals) = ((a[0], first), (b[0], second)) if points[0] else ((b[0], second), (a[0], first))
    normal = unit(normals[0])
    height = radius - (point - corner) @ normal
    if abs(height) < radius:
        along = np.array([-normal[1], normal[0]])
        for sign in (1.0, -1.0):
            yield point + height * normal + sign * np.sqrt(radius**2 - height**2) * along


def _push(corners: Array, normals: Array, centre: Array, radius: float) -> Array | None:
    """(2,) unit vector from where a circle touches an edge or a face, to its centre; None where it does not."""
    if len(normals) == 2:
        push = (centre - corners[0]) / radius
        turn = normals[0][0] * normals[1][1] - normals[0][1] * normals[1][0]
        sides = [n[0] * push[1] - n[1] * push[0] for n in normals]
        return push if sides[0] * turn > -1e-6 and sides[1] * turn < 1e-6 else None
    normal = unit(normals[0])
    along = np.array([-normal[1], normal[0]])
    spread = corners @ along
    return normal if spread.min() < centre @ along < spread.max() else None
