"""What an object can rest on, or be rested upon: faces, convex edges and corners, each with its cone of normals."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from poise.assembly.scene import Polyhedron, Shape, hull_of
from poise.geometry import cross, plane_axes, unit
from poise.types import Array, Indices, Mask


@dataclass(frozen=True, eq=False)
class Face:
    """A planar face of an object, in its frame.

    Args:
        normal: (3,) outwards.
        point: (3,) m, on it.
        area: m2.
        along: (3,) unit vector of its longest extent (thesis eq. 5.27).
        steady: the object stands on this face by itself on a level plane.
    """

    normal: Array
    point: Array
    area: float
    along: Array
    steady: bool


@dataclass(frozen=True, eq=False)
class Edge:
    """A convex edge of an object, in its frame.

    Args:
        start, end: (3,) m.
        normals: (2, 3) of the faces beside it, outwards.
    """

    start: Array
    end: Array
    normals: Array

    @cached_property
    def direction(self) -> Array:
        """(3,) unit vector."""
        return unit(self.end - self.start)

    def affords(self, normal: Array) -> bool:
        """Whether a plane that faces the object with this normal (3,), seen from the object, can touch the edge alone.

        Erratum to thesis eq. 5.21-5.23, which look at z only: here the test is made in the plane across the edge,
        where the plane's opposed normal has to lie between the normals of the two faces.
        """
        outwards = -normal
        if abs(outwards @ self.direction) > PARALLEL_SINE:
            return False
        first, second = self.normals
        turn = cross(first, second)
        return bool(cross(first, outwards) @ turn > 0 and cross(outwards, second) @ turn > 0)


_FEW_FACES, _DRAWN = 500, 64
"""All pairs of up to so many faces are compared; of more, so many faces with all."""
PARALLEL_SINE = 2e-3
"""Sine under which a direction counts as lying in a plane."""


@dataclass(frozen=True, eq=False)
class ContactFeatures:
    """Faces and edges of one object that can touch others."""

    faces: tuple[Face, ...]
    edges: tuple[Edge, ...]
    com: Array

    @cached_property
    def normals(self) -> Array:
        """(F, 3) of the faces."""
        return np.array([face.normal for face in self.faces])

    @cached_property
    def _angles(self) -> Array:
        """(F, F) rad between the normals of the faces."""
        return self._angles_of(np.arange(len(self.faces)))

    def _angles_of(self, rows: Indices) -> Array:
        """(R, F) rad between the normals of faces (R,) and those of all."""
        return np.asarray(np.arccos(np.clip(self.normals[rows] @ self.normals.T, -1, 1)))

    def pair_at(self, angle: float, within: float, rng: np.random.Generator) -> tuple[Face, Face] | None:
        """Two faces whose normals are at an angle, within some rad, if there are any.

        Of many faces, as a scan has, some are drawn by their `odds`, and one is looked for beside these alone.
        """
        few = len(self.faces) <= _FEW_FACES
        rows = np.arange(len(self.faces)) if few else rng.choice(len(self.faces), _DRAWN, p=self.odds)
        found = np.argwhere(np.abs((self._angles if few else self._angles_of(rows)) - angle) < within)
        if not len(found):
            return None
        chosen = rng.integers(len(found)) if few else rng.choice(len(found), p=_shares(self.odds[found[:, 1]]))
        row, other = found[chosen].tolist()
        return self.faces[int(rows[row])], self.faces[other]

    @cached_property
    def odds(self) -> Array:
        """(F,) probability of choosing each face: steady faces more often, large ones more often."""
        weights = np.array([face.area * (4.0 if face.steady else 1.0) for face in self.faces])
        return _shares(weights)

    @classmethod
    def of(cls, shape: Shape, com: Array | None) -> "ContactFeatures":
        """Faces of the object and of its hull (feet, rims), the steady and large ones first, and its convex edges.

        Args:
            shape: in the object frame.
            com: (3,) m; None: the centroid.
        """
        polyhedron = shape.polyhedron
        middle = np.asarray(shape.centroid if com is None else com)
        faces = _faces(polyhedron, middle, steady=False) if not polyhedron.convex else []
        faces += _faces(hull_of(polyhedron), middle, steady=True)
        faces.sort(key=lambda face: (not face.steady, -face.area))
        return cls(tuple(faces), tuple(convex_edges(polyhedron)), middle)


def _shares(weights: Array) -> Array:
    return np.asarray(weights / weights.sum())


def steady_faces(shape: Shape, com: Array) -> list[Face]:
    """The faces of an object's hull that it stands on, the large ones first.

    Args:
        shape: in the object frame.
        com: (3,) m.
    """
    faces = [face for face in _faces(hull_of(shape.polyhedron), com, steady=True) if face.steady]
    return sorted(faces, key=lambda face: -face.area)


def _faces(polyhedron: Polyhedron, com: Array, steady: bool) -> list[Face]:
    faces = []
    for facet, normal in enumerate(polyhedron.normals):
        axes = plane_axes(normal)
        corners = polyhedron.vertices[polyhedron.facet_vertices[facet]]
        outline = polyhedron.polygon(facet, polyhedron.vertices, corners[0], axes)
        under = shapely.Point(axes @ (com - corners[0]))
        flat = (corners - corners.mean(axis=0)) @ axes.T
        along = np.linalg.svd(flat, full_matrices=False)[2][0] @ axes
        holds = steady and bool(outline.convex_hull.contains(under))
        faces.append(Face(normal, corners[0], float(outline.area), along, holds))
    return faces


def convex_edges(polyhedron: Polyhedron) -> list[Edge]:
    """The convex edges: those of which a plane can touch the line without cutting the faces beside it."""
    numbers = np.flatnonzero(are_convex(polyhedron, np.arange(len(polyhedron.edges))))
    ends, beside = polyhedron.vertices[polyhedron.edges[numbers]], polyhedron.normals[polyhedron.edge_facets[numbers]]
    return [Edge(start, end, normals) for (start, end), normals in zip(ends, beside, strict=True)]


def are_convex(polyhedron: Polyhedron, edges: Indices) -> Mask:
    """(E,) whether the faces beside edges (E,) of these numbers fall back from them."""
    first, second = polyhedron.edge_facets[edges].T
    ends = polyhedron.edges[edges]
    to_beside = polyhedron.vertices[_opposite(polyhedron, ends, second)] - polyhedron.vertices[ends[:, 0]]
    return np.asarray(np.einsum("ij,ij->i", polyhedron.normals[first], to_beside) < 0)


def _opposite(polyhedron: Polyhedron, ends: Indices, facets: Indices) -> Indices:
    """(E,) of edges with these ends (E, 2), the third corner of a triangle of a facet (E,) beside each."""
    around = polyhedron.triangles[:, [[0, 1, 2], [1, 2, 0], [2, 0, 1]]].reshape(-1, 3)
    given = _keys(polyhedron, np.repeat(polyhedron.facet_of_triangle, 3), around[:, :2])
    order = np.argsort(given, kind="stable")
    wanted = _keys(polyhedron, facets, ends)
    return np.asarray(around[order[np.searchsorted(given, wanted, sorter=order)], 2])


def _keys(polyhedron: Polyhedron, facets: Indices, ends: Indices) -> Indices:
    """(N,) one number for each side (N, 2) of a triangle of a facet (N,), whichever end comes first."""
    count = len(polyhedron.vertices)
    return np.asarray((facets * count + ends.min(axis=1)) * count + ends.max(axis=1))
