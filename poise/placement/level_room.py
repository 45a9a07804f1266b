"""Room on level surfaces: poses of an object on one of its faces at which its outline meets nothing.

Draws of support points seldom hit a narrow gap. Here, for a surface, a face and an angle, the places at which the
object meets other bodies are subtracted from the surface, and a pose is drawn from what is left.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from poise.assembly import Assembly, RigidObject
from poise.geometry import Pose, plane_axes, rotation_about, rotation_between, unit
from poise.placement.features import Face
from poise.placement.matching import SupportPoint
from poise.placement.outlines import convex_outline, directions, meeting_region, parts_between
from poise.placement.validation import KeptFree
from poise.types import Array, Indices

_LEVEL = np.cos(np.radians(0.3))
_SAME = 2e-4
"""m between facets of one surface."""
_OVER = 3e-4
"""m over a surface, from where other bodies are in the way."""
_CLEAR = (2e-3, 1e-4)
"""m to other bodies: more than what is taken as touching, and, if there is not so much room, next to nothing."""
_INSIDE = 1e-3
"""m by which the centre of mass is inside the region of contact."""
_EMPTY = 0.5
"""What is left of the weight of a surface and a face between which there was no room."""
_SMALL = 1e-3
"""Of the square of the object's size: smaller surfaces carry nothing by themselves."""
_PLACES = 6
"""Drawn in one free region, until the centre of mass is over the contact."""
_BINS = 90
_KNOWN = 256
"""Free regions kept."""


@dataclass(eq=False)
class _Surface:
    """Level facets at one height.

    Args:
        height: m.
        region: of the facets, in the level plane.
        angles, lengths: of sides along it and of bodies on it.
    """

    height: float
    region: shapely.Geometry
    sides: tuple[Array, Array] = field(default=(np.zeros(0), np.zeros(0)))


class LevelRoom:
    """Free places on level surfaces.

    Args:
        assembly: what is there.
        carriers: numbers of the bodies that may carry the object.
        item: the object, at any pose.
        com: (3,) m, its centre of mass, in its frame.
        faces: those it may be put on.
        kept: rooms that stay empty.
    """

    def __init__(
        self,
        assembly: Assembly,
        carriers: Indices,
        item: RigidObject,
        com: Array,
        faces: Sequence[Face],
        kept: Sequence[KeptFree],
    ) -> None:
        self._up = -unit(np.asarray(assembly.gravity))
        self._axes = plane_axes(self._up)
        self._frame = np.vstack([self._axes, self._up])
        self._bodies = [(body.shape.polyhedron, body.vertices @ self._frame.T) for body in assembly.objects]
        self._kept = [np.array([look.low, look.high]) for look in kept]
        self._vertices, self._com, self._faces = item.shape.polyhedron.vertices, com, list(faces)
        self._surfaces = self._level_surfaces(assembly, carriers)
        areas = np.array([surface.region.convex_hull.area for surface in self._surfaces])
        self._weights = np.sqrt(areas)[:, None] * np.ones(len(self._faces))
        self._obstacles: dict[tuple[int, int], list[Array]] = {}
        self._free: dict[tuple[int, int, float], shapely.Geometry] = {}

    def _level_surfaces(self, assembly: Assembly, carriers: Indices) -> list[_Surface]:
        facets: list[tuple[float, shapely.Geometry]] = []
        for number in carriers.tolist():
            item = assembly.objects[number]
            polyhedron, vertices = item.shape.polyhedron, item.vertices
            for facet in np.flatnonzero(polyhedron.normals @ item.pose.rotation.T @ self._up > _LEVEL).tolist():
                height = float((vertices[polyhedron.facet_vertices[facet]] @ self._up).max())
                facets.append((height, polyhedron.polygon(facet, vertices, np.zeros(3), self._axes)))
        groups: list[list[tuple[float, shapely.Geometry]]] = []
        for height, polygon in sorted(facets, key=lambda facet: -facet[0]):
            if groups and groups[-1][0][0] - height < _SAME:
                groups[-1].append((height, polygon))
            else:
                groups.append([(height, polygon)])
        found = [_Surface(group[0][0], shapely.union_all([polygon for _, polygon in group])) for group in groups]
        least = _SMALL * float(np.sum(np.ptp(self._vertices, axis=0) ** 2))
        return [surface for surface in found if surface.region.area > least]

    def poses(self, rng: np.random.Generator, trust: Array) -> Iterator[tuple[Pose, SupportPoint]]:
        """Poses on one surface, face and angle, each with the plane it rests on; none where there is no room.

        Args:
            rng: chooses.
            trust: (F,) weights of the faces.
        """
        if not self._weights.size:
            return
        weights = (self._weights * trust).ravel()
        chosen = int(rng.choice(weights.size, p=weights / weights.sum()))
        place, number = divmod(chosen, len(self._faces))
        surface, face = self._surfaces[place], self._faces[number]
        down = rotation_between(face.normal, -self._up)
        yaw, known = self._yaw(place, number, down, rng)
        rotation = rotation_about(self._up, yaw) @ down
        key = place, number, round(yaw, 6)
        free = self._free.get(key)
        if free is None:
            free = self._room(place, number, rotation)
            if known and len(self._free) < _KNOWN:
                self._free[key] = free
        if free.is_empty:
            self._weights[place, number] *= _EMPTY
            return
        base = self._base(rotation)
        for _ in range(_PLACES):
            at = _place_in(free, rng)
            contact = shapely.intersection(surface.region, shapely.polygons(base + at)) if len(base) > 2 else None
            if contact is not None and contact.convex_hull.buffer(-_INSIDE).contains(shapely.Point(at)):
                rise = surface.height - float((rotation @ face.point) @ self._up)
                over = at - self._axes @ (rotation @ self._com)
                point = at @ self._axes + surface.height * self._up
                yield Pose(rotation, over @ self._axes + rise * self._up), SupportPoint(point, self._up)

    def _base(self, rotation: Array) -> Array:
        """(K, 2) outline of what is lowest, from the centre of mass."""
        corners = (self._vertices - self._com) @ rotation.T @ self._frame.T
        return convex_outline(corners[corners[:, 2] < corners[:, 2].min() + _SAME][:, :2])

    def _room(self, place: int, number: int, rotation: Array) -> shapely.Geometry:
        """Where the centre of mass may be over a surface."""
        corners = (self._vertices - self._com) @ rotation.T @ self._frame.T
        outline = convex_outline(corners[:, :2])
        met = [meeting_region(part, outline) for part in self._in_the_way(place, number, float(np.ptp(corners[:, 2])))]
        met += self._regions_kept(place, corners)
        taken = shapely.union_all([shapely.polygons(region) for region in met if len(region) > 2])
        free = shapely.difference(self._surfaces[place].region.convex_hull, taken)
        left = [free.buffer(-clear, quad_segs=2) for clear in _CLEAR]
        return next((room for room in left if not room.is_empty), left[-1])

    def _in_the_way(self, place: int, number: int, height: float) -> list[Array]:
        """Outlines of what bodies have beside the object when it is on a surface."""
        if (place, number) not in self._obstacles:
            low = self._surfaces[place].height
            bounds = low + _OVER, low + height
            parts = [part for body in self._bodies for part in parts_between(*body, *bounds)]
            self._obstacles[place, number] = parts
        return self._obstacles[place, number]

    def _regions_kept(self, place: int, corners: Array) -> list[Array]:
        """Where the object would reach into a room that is kept free; bounds of both along the world's axes."""
        turned = corners @ self._frame
        low, high = turned.min(axis=0), turned.max(axis=0)
        rise = self._surfaces[place].height - corners[:, 2].min()
        found = []
        for room in self._kept:
            sizes = np.array([room[0] - high, room[1] - low])
            box = np.array([[x, y, z] for x in sizes[:, 0] for y in sizes[:, 1] for z in sizes[:, 2]]) @ self._frame.T
            if box[:, 2].min() < rise < box[:, 2].max():
                found.append(convex_outline(box[:, :2]))
        return found

    def _yaw(self, place: int, number: int, down: Array, rng: np.random.Generator) -> tuple[float, bool]:
        """An angle, rad: one at which a side of the object is along a side of the scene, mostly; whether it is."""
        angles, weights = self._sides(place, number)
        own, lengths = directions([convex_outline(((self._vertices @ down.T) @ self._frame.T)[:, :2])])
        if not len(angles) or not len(own) or rng.random() < 0.2:
            return float(rng.uniform(0, 2 * np.pi)), False
        along = angles[rng.choice(len(angles), p=weights / weights.sum())]
        side = own[rng.choice(len(own), p=lengths**2 / (lengths**2).sum())]
        return float(along - side + rng.integers(4) * np.pi / 2), True

    def _sides(self, place: int, number: int) -> tuple[Array, Array]:
        """Angles of the sides of a surface and of what is on it, those nearly the same as one; their weights."""
        surface = self._surfaces[place]
        if not len(surface.sides[0]):
            rings = [shapely.get_coordinates(ring)[:-1] for ring in _rings(surface.region)]
            height = float(
                np.ptp(self._vertices @ rotation_between(self._faces[number].normal, -self._up).T @ self._up)
            )
            angles, lengths = directions([*rings, *self._in_the_way(place, number, height)])
            bins = (angles / (np.pi / 2) * _BINS).astype(int) % _BINS
            sums = np.bincount(bins, lengths, _BINS)
            largest = np.zeros(_BINS)
            np.maximum.at(largest, bins, lengths)
            first = {int(b): a for b, a, size in zip(bins, angles, lengths, strict=True) if size == largest[b]}
            surface.sides = np.array(list(first.values())), np.array([sums[b] for b in first])
        return surface.sides


def _rings(region: shapely.Geometry) -> list[shapely.Geometry]:
    return [
        ring for part in shapely.get_parts(region) if part.geom_type == "Polygon" for ring in shapely.get_rings(part)
    ]


def _place_in(free: shapely.Geometry, rng: np.random.Generator) -> Array:
    """(2,) a place in a region: anywhere, or the middle of a part of it, with equal probability."""
    parts = shapely.get_parts(free)
    areas = shapely.area(parts)
    if rng.random() < 0.5 or areas.sum() <= 0:
        part = parts[int(rng.choice(len(parts), p=None if areas.sum() <= 0 else np.sqrt(areas) / np.sqrt(areas).sum()))]
        return np.asarray(shapely.get_coordinates(shapely.maximum_inscribed_circle(part))[0])
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(free))
    sizes = shapely.area(triangles)
    corners = shapely.get_coordinates(triangles[int(rng.choice(len(triangles), p=sizes / sizes.sum()))])[:3]
    return np.asarray(rng.dirichlet(np.ones(3)) @ corners)
