"""Where bodies may touch: flat faces on flat faces, and round sides along a line of a flat face."""

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import shapely

from poise.assembly.contact import patches_between, placed
from poise.assembly.scene import Cylinder, RigidObject, Sphere
from poise.assembly.settling.belief import POINTS, SeenBodies
from poise.assembly.settling.facets import Facets, Opposite, faces_in_line, facets_of, opposite_faces
from poise.assembly.settling.rows import DistanceRows
from poise.types import Array, Indices, Mask

_SIGMAS = 3.0
"""Independent errors of a pose, all at a time, that explain a distance."""
_SLACK = 5e-4
"""m by which a distance may miss what the poses' uncertainty explains."""
_THROUGH, _OTHER_SIDE = 2e-3, -0.9
"""m by which bodies overlap where a place may be on the wrong side of a wall, and the cosine to a place opposite."""
_EDGE_REACH = 0.02
"""m up to which edges and corners are looked for."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """C places where two bodies may touch, `POINTS` rows each, in order.

    Args:
        rows: (3 C,) distances, 0 where they touch.
        normal: (C, 3) from the first body into the second, as they were seen.
        narrow: (C,) whether the bodies may in truth be beside each other.
        in_line: (C,) no contacts, but faces of neighbours that may be in one plane: distances 0 where they are.
    """

    rows: DistanceRows
    normal: Array
    narrow: Mask
    in_line: Mask

    @classmethod
    def unmarked(cls, rows: DistanceRows, normal: Array) -> "Candidates":
        """Contacts that are not narrow."""
        none = np.zeros(len(normal), dtype=bool)
        return cls(rows, normal, none, none)

    def of(self, *numbers: int) -> DistanceRows:
        """The rows of some candidates, in their order."""
        places = POINTS * np.array(numbers, dtype=np.int64)
        return self.rows[(places[:, None] + np.arange(POINTS)).ravel()]

    def pair(self, number: int) -> tuple[int, int]:
        """The places of the first and of the second body."""
        return int(self.first[number]), int(self.second[number])

    def and_also(self, others: "Candidates") -> "Candidates":
        """These and others."""
        return Candidates(
            DistanceRows.joined([self.rows, others.rows]),
            np.concatenate([self.normal, others.normal]),
            np.concatenate([self.narrow, others.narrow]),
            np.concatenate([self.in_line, others.in_line]),
        )

    def chosen(self, numbers: Mask) -> "Candidates":
        """Some of them."""
        rows = self.rows[np.repeat(numbers, POINTS)]
        return Candidates(rows, self.normal[numbers], self.narrow[numbers], self.in_line[numbers])

    @property
    def first(self) -> Indices:
        """(C,) places."""
        return self.rows.first[::POINTS]

    @property
    def second(self) -> Indices:
        """(C,) places."""
        return self.rows.second[::POINTS]


def find_candidates(items: tuple[RigidObject, ...], bodies: SeenBodies, sigmas: float) -> Candidates:
    """All places where bodies may touch, when each may be off by some sigmas."""
    position, rotation = (np.zeros(len(items)) for _ in range(2))
    seen = bodies.slot >= 0
    variances = np.diagonal(bodies.covariance, axis1=1, axis2=2)[bodies.slot[seen]]
    position[seen], rotation[seen] = np.sqrt(variances[:, :3].max(axis=1)), np.sqrt(variances[:, 3:].max(axis=1))
    radius = np.array([np.linalg.norm(item.shape.polyhedron.vertices, axis=1).max() for item in items])
    reach, angle = sigmas * (2 * position + rotation * radius), 2 * sigmas * rotation + 0.01
    flat = opposite_faces([item.shape for item in items], bodies.poses, reach, angle, seen)
    found = _of_faces(items, bodies, flat, position)
    lines = _of_round_sides(items, bodies, reach, angle)
    if lines is not None:
        found = found.and_also(lines)
    found = _explained(found, bodies, sigmas)
    found = found.chosen(_not_through_walls(items, bodies, found))
    return found.and_also(_explained(_in_line(items, bodies, found, angle), bodies, sigmas))


def _in_line(items: tuple[RigidObject, ...], bodies: SeenBodies, found: Candidates, angle: Array) -> Candidates:
    """Faces that may be in one plane, of pairs that may touch: cartons of one size are mostly stacked so."""
    pairs = np.zeros((len(items), len(items)), dtype=bool)
    pairs[found.first, found.second] = True
    first, second, numbers = faces_in_line([item.shape for item in items], bodies.poses, pairs, angle)
    facets = [facets_of(cast(Hashable, item.shape)) for item in items]
    count = len(first)
    points = np.empty((count, POINTS, 3))
    for number, (place, facet) in enumerate(zip(second.tolist(), numbers[:, 1].tolist(), strict=True)):
        points[number] = facets[place].around[facet]
    found = _over_faces(facets, bodies, first, numbers[:, 0], second, points)
    return replace(found, in_line=np.ones(count, dtype=bool))


def _over_faces(
    facets: list[Facets], bodies: SeenBodies, first: Indices, numbers: Indices, second: Indices, points: Array
) -> Candidates:
    """Three points (C, 3, 3) in the frames of the second bodies over faces of the first ones."""
    normal, origin = np.empty((2, len(first), 3))
    for number, (place, facet) in enumerate(zip(first.tolist(), numbers.tolist(), strict=True)):
        normal[number], origin[number] = facets[place].normals[facet], facets[place].origins[facet]
    every = [np.repeat(value, POINTS, axis=0) for value in (first, second)]
    planes = [np.repeat(value, POINTS, axis=0) for value in (normal, origin)]
    rows = DistanceRows(every[0], every[1], planes[0], planes[1], points.reshape(-1, 3), np.zeros(len(every[0])))
    outward = np.einsum("cij,cj->ci", bodies.poses.rotation[first], normal)
    return Candidates.unmarked(rows, outward)


def edges_and_points(
    items: tuple[RigidObject, ...], bodies: SeenBodies, place: int, sigmas: float
) -> Candidates | None:
    """Edges, corners and round sides of one body on others, and of others on it, as they were seen."""
    parts, normals = [], []
    for other in range(len(items)):
        if other == place:
            continue
        first, second = min(place, other), max(place, other)
        for patch in patches_between(placed(items[first]), placed(items[second]), _EDGE_REACH):
            points = np.stack([patch.points[0], patch.points[-1], patch.points.mean(axis=0)])
            ends = [
                items[one].pose.undo(points + side * patch.gap / 2 * patch.normal)
                for one, side in ((first, -1), (second, 1))
            ]
            normal = np.repeat((patch.normal @ items[first].pose.rotation)[None], POINTS, axis=0)
            whole = [np.full(POINTS, one, dtype=np.int64) for one in (first, second)]
            parts.append(DistanceRows(whole[0], whole[1], normal, ends[0], ends[1], np.zeros(POINTS)))
            normals.append(patch.normal)
    if not parts:
        return None
    return _explained(Candidates.unmarked(DistanceRows.joined(parts), np.array(normals)), bodies, sigmas)


def _explained(found: Candidates, bodies: SeenBodies, sigmas: float) -> Candidates:
    """Those whose distances the uncertainty of the poses explains."""
    distance, *_ = found.rows.linearised(bodies.poses)
    deviation, largest = bodies.spread(found.rows)
    explained = np.abs(distance) <= np.maximum(sigmas * deviation, _SIGMAS * largest) + _SLACK
    near = np.all(explained.reshape(-1, POINTS), axis=1)
    return found.chosen(near)


def _not_through_walls(items: tuple[RigidObject, ...], bodies: SeenBodies, found: Candidates) -> Mask:
    """(C,) whether places are none that bodies could only reach through a wall.

    The inner sides of the walls of two trays beside each other look towards each other, too, through both walls. Of
    such a place and one on the outer side, that which is nearer to what was seen is left.
    """
    distances = found.rows.linearised(bodies.poses)[0].reshape(-1, POINTS).mean(axis=1)
    hollow = np.array([not item.shape.polyhedron.convex for item in items])
    kept = np.ones(len(distances), dtype=bool)
    for number in np.flatnonzero((distances < -_THROUGH) & (hollow[found.first] | hollow[found.second])).tolist():
        same = (found.first == found.first[number]) & (found.second == found.second[number])
        other = same & (found.normal @ found.normal[number] < _OTHER_SIDE)
        kept[number] = not np.any(other & (np.abs(distances) < -distances[number]))
    return kept


def _of_faces(items: tuple[RigidObject, ...], bodies: SeenBodies, flat: Opposite, position: Array) -> Candidates:
    facets = [facets_of(cast(Hashable, item.shape)) for item in items]
    rotation, translation = bodies.poses.rotation[flat.second], bodies.poses.translation[flat.second]
    points = np.einsum("cpi,cij->cpj", flat.points - translation[:, None], rotation)
    found = _over_faces(facets, bodies, flat.first, flat.facets[:, 0], flat.second, points)
    aside = np.hypot(position[flat.first], position[flat.second])
    return replace(found, narrow=flat.width < 3 * aside)


def _of_round_sides(
    items: tuple[RigidObject, ...], bodies: SeenBodies, reach: Array, angle: Array
) -> Candidates | None:
    """Sides of cylinders along lines of flat faces, and balls on flat faces."""
    parts, normals = [], []
    for second, item in enumerate(items):
        if not isinstance(item.shape, Cylinder | Sphere):
            continue
        length = item.shape.length if isinstance(item.shape, Cylinder) else 0.0
        size = float(np.hypot(item.shape.radius, length / 2))
        for first, other in enumerate(items):
            if first == second or (bodies.slot[first] < 0 and bodies.slot[second] < 0):
                continue
            facets = facets_of(cast(Hashable, other.shape))
            near = other.pose.rotation.T @ (item.pose.translation - other.pose.translation)
            axis = other.pose.rotation.T @ item.pose.rotation[:, 2]
            lean = np.abs(facets.normals @ axis) <= np.sin(min(angle[first] + angle[second], 0.5))
            lean |= length == 0
            height = np.einsum("fi,fi->f", facets.normals, near - facets.origins) - item.shape.radius
            for facet in np.flatnonzero(lean & (np.abs(height) <= reach[first] + reach[second] + size)):
                found = _line(item.shape.radius, length, near, axis, facets, int(facet), first, second)
                if found is not None:
                    parts.append(found)
                    normals.append(other.pose.rotation @ facets.normals[facet])
    if not parts:
        return None
    return Candidates.unmarked(DistanceRows.joined(parts), np.array(normals))


def _line(
    radius: float, length: float, centre: Array, axis: Array, facets: Facets, facet: int, first: int, second: int
) -> DistanceRows | None:
    """DistanceRows of a round side over a face: at both ends and in the middle of what the face covers of it.

    Of length 0 it is a ball, whose centre has all three distances.
    """
    along = np.array([-0.5, 0.5]) * length
    plane = (centre + np.outer(along, axis) - facets.origins[facet]) @ facets.axes[facet].T
    points = np.zeros((POINTS, 3))
    if length > 0:
        covered = shapely.intersection(shapely.LineString(plane), facets.outlines[facet])
        if covered.length < 0.02 * length:
            return None
        ends = shapely.get_coordinates(covered)[[0, -1]]
        run = plane[1] - plane[0]
        share = (ends - plane[0]) @ run / (run @ run)
        points[:, 2] = along[0] + length * np.array([share[0], share[1], share.mean()])
    elif not shapely.contains_xy(facets.outlines[facet], *plane[0]):
        return None
    same = [np.repeat(value[None], POINTS, axis=0) for value in (facets.normals[facet], facets.origins[facet])]
    whole = [np.full(POINTS, place, dtype=np.int64) for place in (first, second)]
    return DistanceRows(whole[0], whole[1], same[0], same[1], points, np.full(POINTS, radius))
