"""A rigid object at its place in the world: facets, edges and vertices as the search for contacts needs them."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import shapely
from scipy.spatial import ConvexHull, QhullError

from poise.assembly.scene import Cylinder, Polyhedron, RigidObject, Sphere
from poise.geometry import cross, plane_axes
from poise.types import Array, Indices, Mask


@dataclass(frozen=True, eq=False)
class RoundTouch:
    """The line or point at which a round side touches.

    Args:
        points: (K, 3) m, both ends of a line, or one point.
        radii: (K,) m, of the round side there; 1 / (1 / a + 1 / b) where both are round.
        across: (3,) unit vector in which it rolls; None: every way in the plane.
    """

    points: Array
    radii: Array
    across: Array | None


@dataclass(frozen=True, eq=False)
class ContactPatch:
    """Where two bodies touch in one plane.

    Args:
        points: (K, 3) corners of the region touched, m; two for a line, one for a point.
        normal: (3,) from the first body into the second.
        gap: m, negative where they overlap.
        triangles: (T, 3, 3) the region touched, m; empty for lines and points.
        touch: where a round side touches; None for flat ones, and for sharp edges and vertices.
    """

    points: Array
    normal: Array
    gap: float
    triangles: Array
    touch: RoundTouch | None = None

    def turned(self) -> "ContactPatch":
        """The same, from the second body into the first."""
        return replace(self, normal=-self.normal)

    @cached_property
    def area(self) -> float:
        """m2."""
        return float(triangle_areas(self.triangles).sum()) if len(self.triangles) else 0.0


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """An object with everything in the assembly's frame."""

    item: RigidObject

    @property
    def polyhedron(self) -> Polyhedron:
        return self.item.shape.polyhedron

    @property
    def cylinder(self) -> Cylinder | None:
        """The shape, when it is a cylinder: then only its two caps are planar facets, and it has no edges."""
        return self.item.shape if isinstance(self.item.shape, Cylinder) else None

    @property
    def sphere(self) -> Sphere | None:
        """The shape, when it is a ball, which has no planar facets and no edges."""
        return self.item.shape if isinstance(self.item.shape, Sphere) else None

    @property
    def facet_count(self) -> int:
        """Number of planar facets, which come first among those of the polyhedron."""
        return 0 if self.sphere else 2 if self.cylinder else len(self.polyhedron.normals)

    @property
    def vertices(self) -> Array:
        return self.item.vertices

    @cached_property
    def bounds(self) -> Array:
        """(2, 3) least and greatest coordinates; a round body's own, not its polyhedron's."""
        if self.sphere is not None:
            return self.item.pose.translation + self.sphere.radius * np.array([[-1.0], [1.0]])
        if self.cylinder is None:
            return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])
        axis = self.item.pose.rotation[:, 2]
        half = np.abs(axis) * self.cylinder.length / 2 + self.cylinder.radius * np.sqrt(np.clip(1 - axis**2, 0, 1))
        return np.stack([self.item.pose.translation - half, self.item.pose.translation + half])

    @cached_property
    def size(self) -> float:
        """Longest side of the bounds, m."""
        return float(np.ptp(self.bounds, axis=0).max())

    @cached_property
    def normals(self) -> Array:
        """(F, 3) outward normals of the planar facets."""
        return self.polyhedron.normals[: self.facet_count] @ self.item.pose.rotation.T

    @cached_property
    def facet_bounds(self) -> Array:
        """(F, 2, 3) bounds of each planar facet."""
        triangles, starts = self.polyhedron.by_facet
        corners = self.vertices[triangles]
        low = np.minimum.reduceat(corners.min(axis=1), starts)
        high = np.maximum.reduceat(corners.max(axis=1), starts)
        return np.stack([low, high], axis=1)[: len(self.normals)]

    @cached_property
    def corners(self) -> Array:
        """(T, 3, 3) of the surface's triangles."""
        return np.asarray(self.vertices[self.polyhedron.triangles])

    @cached_property
    def triangle_bounds(self) -> Array:
        """(2, T, 3) bounds of each triangle."""
        return bounds_of(self.corners)

    @cached_property
    def edge_bounds(self) -> Array:
        """(2, E, 3) bounds of each edge of the polyhedron."""
        first, last = (self.vertices[self.polyhedron.edges[:, end]] for end in (0, 1))
        return np.stack([np.minimum(first, last), np.maximum(first, last)])

    @cached_property
    def origins(self) -> Array:
        """(F, 3) a point on each planar facet."""
        triangles, starts = self.polyhedron.by_facet
        return np.asarray(self.vertices[triangles[starts[: self.facet_count], 0]])

    @cached_property
    def axes(self) -> Array:
        """(F, 2, 3) axes in the plane of each facet."""
        return plane_axes(self.normals)

    @cached_property
    def edges(self) -> Indices:
        """(E, 2) vertex numbers; none for a round body."""
        return self.polyhedron.edges[: 0 if self.cylinder or self.sphere else None]

    @cached_property
    def edge_normals(self) -> Array:
        """(E, 2, 3) the normals on both sides of each edge."""
        return (self.polyhedron.normals @ self.item.pose.rotation.T)[self.polyhedron.edge_facets[: len(self.edges)]]

    @cached_property
    def _polygons(self) -> dict[int, shapely.Geometry]:
        return {}

    def polygon(self, facet: int) -> shapely.Geometry:
        """A facet as a polygon in its own `axes`, from its own origin."""
        if facet not in self._polygons:
            self._polygons[facet] = self.polyhedron.polygon(facet, self.vertices, self.origins[facet], self.axes[facet])
        return self._polygons[facet]

    def facets_near(self, bounds: Array) -> Indices:
        """Numbers of the facets whose bounds meet these (2, 3)."""
        return np.flatnonzero(meeting((self.facet_bounds[:, 0], self.facet_bounds[:, 1]), bounds))

    def edges_near(self, bounds: Array) -> Indices:
        """Numbers of the edges whose bounds meet these (2, 3)."""
        return np.flatnonzero(meeting(self.edge_bounds[:, : len(self.edges)], bounds))

    def edge_pushes(self, edge: int, direction: Array) -> bool:
        """The direction leaves the body through this edge: between the normals on its two sides, on a ridge."""
        return bool(self.edges_push(np.array([edge]), direction)[0])

    def edges_push(self, edges: Indices, direction: Array) -> Mask:
        """(N,) whether the direction leaves the body through each of these edges, as `edge_pushes`."""
        along = self.vertices[self.edges[edges, 1]] - self.vertices[self.edges[edges, 0]]
        weights = np.linalg.pinv(np.swapaxes(self.edge_normals[edges], 1, 2)) @ direction
        off = np.abs(along @ direction) / np.linalg.norm(along, axis=1)
        return np.asarray(np.all(weights >= -1e-3, axis=1) & (off < 1e-2))

    def vertex_pushes(self, vertex: int, direction: Array) -> bool:
        """The direction leaves the body through this vertex: all its edges run back."""
        runs = self.vertices[self.polyhedron.neighbours[vertex]] - self.vertices[vertex]
        return bool(np.all(runs @ direction <= 1e-3 * np.linalg.norm(runs, axis=1)))


@lru_cache(maxsize=256)
def placed(item: RigidObject) -> PlacedBody:
    """The body of an object; kept, for most objects are asked about again where they are."""
    return PlacedBody(item)


def bounds_of(corners: Array) -> Array:
    """(2, T, 3) bounds of triangles (T, 3, 3)."""
    return np.stack([corners.min(axis=1), corners.max(axis=1)])


def meeting(bounds: Array | tuple[Array, Array], others: Array) -> Mask:
    """(N,) which of the bounds (2, N, 3) meet others (2, 3)."""
    (low, high), (floor, top) = bounds, others
    meets = (low[:, 0] <= top[0]) & (high[:, 0] >= floor[0])
    for axis in (1, 2):
        meets &= (low[:, axis] <= top[axis]) & (high[:, axis] >= floor[axis])
    return np.asarray(meets)


def triangle_areas(triangles: Array) -> Array:
    """(T,) areas of triangles (T, 3, 3)."""
    normals = cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray(np.linalg.norm(normals, axis=1) / 2)


def hull_corners(points: Array, normal: Array) -> Array:
    """Corners of the convex hull of points in a plane, in order; the two ends when they are in line."""
    plane = (points - points[0]) @ plane_axes(normal).T
    spread = float(np.ptp(plane, axis=0).max())
    if spread <= 1e-9:
        return points[:1]
    try:
        corners = points[ConvexHull(plane).vertices]
        # Corners that clipping has left side by side are one.
        apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > 1e-5 * spread
        return np.asarray(corners[apart])
    except QhullError:
        along = plane @ np.linalg.svd(plane - plane.mean(axis=0))[2][0]
        return points[[int(along.argmin()), int(along.argmax())]]
