"""What an object can rest on, or be rested upon: faces, convex edges and corners, each with its cone of normals."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from scipy.spatial import ConvexHull

from poise.assembly.scene import Polyhedron, Shape, merge_facets
from poise.geometry import cross, plane_axes, unit
from poise.types import Array, Indices


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


PARALLEL_SINE = 2e-3
"""Sine under which a direction counts as lying in a plane."""


@dataclass(frozen=True, eq=False)
class ContactFeatures:
    """Faces and edges of one object that can touch others."""

    faces: tuple[Face, ...]
    edges: tuple[Edge, ...]
    com: Array

    @cached_property
    def angles(self) -> Array:
        """(F, F) rad between the normals of the faces."""
        normals = np.array([face.normal for face in self.faces])
        return np.asarray(np.arccos(np.clip(normals @ normals.T, -1, 1)))

    @cached_property
    def odds(self) -> Array:
        """(F,) probability of choosing each face: steady faces more often, large ones more often."""
        weights = np.array([face.area * (4.0 if face.steady else 1.0) for face in self.faces])
        return np.asarray(weights / weights.sum())

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
        faces += _faces(_hull(polyhedron), middle, steady=True)
        faces.sort(key=lambda face: (not face.steady, -face.area))
        return cls(tuple(faces), tuple(convex_edges(polyhedron)), middle)


def steady_faces(shape: Shape, com: Array) -> list[Face]:
    """The faces of an object's hull that it stands on, the large ones first.

    Args:
        shape: in the object frame.
        com: (3,) m.
    """
    faces = [face for face in _faces(_hull(shape.polyhedron), com, steady=True) if face.steady]
    return sorted(faces, key=lambda face: -face.area)


def _hull(polyhedron: Polyhedron) -> Polyhedron:
    if polyhedron.convex:
        return polyhedron
    hull = ConvexHull(polyhedron.vertices)
    used, triangles = np.unique(hull.simplices, return_inverse=True)
    vertices, triangles = polyhedron.vertices[used], triangles.reshape(-1, 3).astype(np.int64)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", cross(b - a, c - a), hull.equations[:, :3]) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return merge_facets(vertices, triangles)


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
    edges = []
    for number, (ends, (first, second)) in enumerate(zip(polyhedron.edges, polyhedron.edge_facets, strict=True)):
        if is_convex(polyhedron, number):
            start, end = polyhedron.vertices[ends]
            edges.append(Edge(start, end, polyhedron.normals[[first, second]]))
    return edges


def is_convex(polyhedron: Polyhedron, edge: int) -> bool:
    """Whether the faces beside an edge (its number) fall back from it."""
    first, second = polyhedron.edge_facets[edge]
    ends = polyhedron.edges[edge]
    beside = polyhedron.vertices[_opposite(polyhedron, ends, int(second))]
    return bool(polyhedron.normals[first] @ (beside - polyhedron.vertices[ends[0]]) < 0)


def _opposite(polyhedron: Polyhedron, ends: Indices, facet: int) -> int:
    """A corner of the facet's triangle on this edge that is not on the edge."""
    for triangle in polyhedron.facet_triangles[facet]:
        rest = [corner for corner in triangle.tolist() if corner not in ends]
        if len(rest) == 1:
            return int(rest[0])
    return int(polyhedron.facet_vertices[facet][0])
