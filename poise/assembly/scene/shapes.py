"""Shapes of rigid objects: boxes, cylinders, spheres and meshes, as planar facets, and with their mass properties."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from poise.errors import ErrorCode, InputError
from poise.geometry import cross, distinct_numbers, row_order, unique_rows, unit, used_rows
from poise.ranges import check_range
from poise.types import Array, Indices

_CIRCLE_SIDES = 64
_BALL_STEPS = 12
"""Edges of the polyhedron in a ball between two axes."""
# Neighbouring triangles within this angle are one facet, rad.
_COPLANAR_ANGLE = 1e-3


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A closed surface of triangles, merged into planar facets, in the object frame.

    Args:
        vertices: (V, 3) m.
        triangles: (T, 3) vertex numbers, counter-clockwise from outside.
        facet_of_triangle: (T,) which facet each triangle belongs to.
        normals: (F, 3) outward unit normal of each facet.
        edges: (E, 2) vertex numbers of the edges between facets.
        edge_facets: (E, 2) the two facets of each edge.
        convex: no edge is re-entrant, and there is one piece.
    """

    vertices: Array
    triangles: Indices
    facet_of_triangle: Indices
    normals: Array
    edges: Indices
    edge_facets: Indices
    convex: bool

    @cached_property
    def by_facet(self) -> tuple[Indices, Indices]:
        """The (T, 3) triangles in the order of their facets, and the (F,) first of each facet among them."""
        order = np.argsort(self.facet_of_triangle, kind="stable")
        first = np.searchsorted(self.facet_of_triangle[order], np.arange(len(self.normals)))
        return self.triangles[order], first

    @cached_property
    def facet_triangles(self) -> list[Indices]:
        """For each facet, the (t, 3) triangles of it."""
        triangles, first = self.by_facet
        return [triangles[begin:end] for begin, end in pairwise([*first.tolist(), len(triangles)])]

    @cached_property
    def thickness(self) -> float:
        """m, the least side of the bounds in the object frame; of what is not convex, at most its mean wall."""
        if self.convex:
            return float(np.ptp(self.vertices, axis=0).min())
        a, b, c = np.moveaxis(self.vertices[self.triangles] - self.vertices[0], 1, 0)
        volume = float(np.einsum("ij,ij->", a, cross(b, c))) / 6
        return min(float(np.ptp(self.vertices, axis=0).min()), 2 * volume / float(self.facet_areas.sum()))

    @cached_property
    def facet_areas(self) -> Array:
        """(F,) m2."""
        return self._facet_moments[0]

    @cached_property
    def facet_centres(self) -> Array:
        """(F, 3) m, centroids of the facets."""
        areas, moments = self._facet_moments
        return np.asarray(moments / areas[:, None])

    @cached_property
    def _facet_moments(self) -> tuple[Array, Array]:
        """(F,) areas, m2, and (F, 3) their first moments, m3."""
        corners, count = self.vertices[self.triangles], len(self.normals)
        a, b, c = np.moveaxis(corners, 1, 0)
        areas = np.linalg.norm(cross(b - a, c - a), axis=1) / 2
        moments = areas[:, None] * (a + b + c) / 3
        return _sums(self.facet_of_triangle, areas[:, None], count)[:, 0], _sums(self.facet_of_triangle, moments, count)

    @cached_property
    def facet_vertices(self) -> list[Indices]:
        """For each facet, the numbers of its vertices, ascending."""
        pairs = np.repeat(self.facet_of_triangle, 3) * len(self.vertices) + self.triangles.ravel()
        facet, vertex = np.divmod(distinct_numbers(pairs), len(self.vertices))
        return _groups(facet, vertex, len(self.normals))

    @cached_property
    def neighbours(self) -> list[Indices]:
        """For each vertex, the vertices at the other ends of its edges between facets."""
        both = np.concatenate([self.edges, self.edges[:, ::-1]])
        both = both[np.argsort(both[:, 0], kind="stable")]
        return _groups(both[:, 0], both[:, 1], len(self.vertices))

    @cached_property
    def inward(self) -> Array:
        """(V, 3) steps from the vertices, in the object frame, that go one metre under each of their facets."""
        pairs = np.stack([self.triangles.ravel(), np.repeat(self.facet_of_triangle, 3)], axis=1)
        vertex, facet = pairs[unique_rows(pairs)[0]].T
        normals = self.normals[facet]
        squares = np.tile(1e-9 * np.eye(3), (len(self.vertices), 1, 1))
        np.add.at(squares, vertex, normals[:, :, None] * normals[:, None, :])
        sums = np.zeros((len(self.vertices), 3))
        np.add.at(sums, vertex, normals)
        return np.asarray(-np.linalg.solve(squares, sums[..., None])[..., 0])

    def polygon(self, facet: int, vertices: Array, origin: Array, axes: Array) -> shapely.Geometry:
        """A facet as a polygon in the plane of axes (2, 3) through origin (3,), with its vertices placed anywhere."""
        corners = (vertices[self.facet_triangles[facet]] - origin) @ axes.T
        triangles = shapely.polygons(corners)
        if len(triangles) == 1:
            return triangles[0]
        # Triangles of a plane share whole edges; the few that overlap, as bent facets do in projection, take longer.
        try:
            whole = shapely.coverage_union_all(triangles)
        except shapely.errors.GEOSException:  # their edges cross: a bent facet of a scanned mesh
            return shapely.union_all(triangles)
        areas = float(shapely.area(triangles).sum())
        if whole.is_valid and abs(whole.area - areas) <= 1e-9 * areas:
            return whole
        return shapely.union_all(triangles)


class Shape(Protocol):
    """What the assembly asks of a shape. Everything is in the object frame."""

    @property
    def polyhedron(self) -> Polyhedron: ...

    @property
    def volume(self) -> float:
        """m3."""

    @property
    def centroid(self) -> Array:
        """(3,) m."""

    @property
    def inertia_per_mass(self) -> Array:
        """(3, 3) about the centroid at uniform density, m2."""

    def check_size(self, where: str) -> None:
        """Raise an InputError, which begins with `where`, unless all lengths are in their range."""


@dataclass(frozen=True)
class Box:
    """A box centred on its frame, with edge lengths in m."""

    size: tuple[float, float, float]

    @cached_property
    def polyhedron(self) -> Polyhedron:
        cube = _unit_cube()
        return replace(cube, vertices=cube.vertices * np.array(self.size))

    @property
    def volume(self) -> float:
        return float(np.prod(self.size))

    @property
    def centroid(self) -> Array:
        return np.zeros(3)

    @property
    def inertia_per_mass(self) -> Array:
        squares = np.square(self.size)
        return np.diag(squares.sum() - squares) / 12

    def check_size(self, where: str) -> None:
        check_range("size", self.size, where)


@dataclass(frozen=True)
class Cylinder:
    """A round cylinder along z, centred on its frame; radius and length in m."""

    radius: float
    length: float

    @cached_property
    def polyhedron(self) -> Polyhedron:
        """The prism with `_CIRCLE_SIDES` sides inscribed in it; facets 0 and 1 are the bottom and the top."""
        prism = _unit_prism()
        return replace(prism, vertices=prism.vertices * [self.radius, self.radius, self.length])

    @property
    def volume(self) -> float:
        return float(np.pi * self.radius**2 * self.length)

    @property
    def centroid(self) -> Array:
        return np.zeros(3)

    @property
    def inertia_per_mass(self) -> Array:
        across = self.radius**2 / 4 + self.length**2 / 12
        return np.diag([across, across, self.radius**2 / 2])

    def check_size(self, where: str) -> None:
        check_range("size", (self.radius, self.length), where)


@dataclass(frozen=True)
class Sphere:
    """A ball about its frame; radius in m."""

    radius: float

    @cached_property
    def polyhedron(self) -> Polyhedron:
        """Inscribed in it, for maps and pictures; contacts are those of the round surface."""
        ball = _unit_ball()
        return replace(ball, vertices=ball.vertices * self.radius)

    @property
    def volume(self) -> float:
        return float(4 / 3 * np.pi * self.radius**3)

    @property
    def centroid(self) -> Array:
        return np.zeros(3)

    @property
    def inertia_per_mass(self) -> Array:
        return 0.4 * self.radius**2 * np.eye(3)

    def check_size(self, where: str) -> None:
        check_range("size", self.radius, where)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed triangle mesh. `source` and `scale` say where it came from, for writing the scene again.

    `notes`: what was repaired when it was read, one sentence each.

    Raises:
        InputError: MESH_INVALID when it is not closed or encloses no volume.
    """

    vertices: Array
    triangles: Indices
    source: str = ""
    scale: float = 1.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        name = self.source or "mesh"
        edges = np.sort(self._welded[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        if np.any(np.bincount(unique_rows(edges)[1]) % 2):
            raise InputError(ErrorCode.MESH_INVALID, f"{name}: the surface has holes; close it and try again")
        if abs(self.volume) <= 1e-12 * np.ptp(self.vertices, axis=0).max() ** 3:
            raise InputError(ErrorCode.MESH_INVALID, f"{name}: the surface encloses no volume")
        if self.volume < 0:  # inside out
            object.__setattr__(self, "triangles", self.triangles[:, ::-1].copy())
            for cached in ("volume", "_moments", "_welded"):
                self.__dict__.pop(cached, None)

    @cached_property
    def polyhedron(self) -> Polyhedron:
        used, triangles = used_rows(self._welded, len(self.vertices))
        return merge_facets(self.vertices[used], triangles)

    @cached_property
    def _welded(self) -> Indices:
        """Triangles renumbered so that vertices at one place are one vertex (STL files repeat every corner)."""
        grid = 1e-7 * max(float(np.ptp(self.vertices, axis=0).max()), 1e-12)
        first, number = unique_rows(np.round(self.vertices / grid))
        triangles: Indices = first[number][self.triangles]
        distinct = np.all(triangles != np.roll(triangles, 1, axis=1), axis=1)
        return triangles[distinct]

    @cached_property
    def _moments(self) -> tuple[float, Array, Array]:
        """Volume, its first (3,) and second moments (3, 3) about the origin, by tetrahedra that share the origin."""
        a, b, c = np.moveaxis(self.vertices[self.triangles], 1, 0)
        volumes = np.einsum("ij,ij->i", a, cross(b, c)) / 6
        total = a + b + c
        second = np.einsum("i,ij,ik->jk", volumes, total, total)
        second += sum(np.einsum("i,ij,ik->jk", volumes, p, p) for p in (a, b, c))
        return float(volumes.sum()), volumes @ total / 4, second / 20

    @cached_property
    def volume(self) -> float:
        return self._moments[0]

    @property
    def centroid(self) -> Array:
        return self._moments[1] / self.volume

    @property
    def inertia_per_mass(self) -> Array:
        second = self._moments[2] / self.volume - np.outer(self.centroid, self.centroid)
        return np.asarray(np.trace(second) * np.eye(3) - second)

    def check_size(self, where: str) -> None:
        check_range("mesh vertex", self.vertices, where)


def _groups(number: Indices, rows: Indices, count: int) -> list[Indices]:
    """Rows (N, ...) in groups by their ascending numbers (N,), from 0 to `count` - 1."""
    ends = np.searchsorted(number, np.arange(count + 1)).tolist()
    return [rows[begin:end] for begin, end in pairwise(ends)]


def merge_facets(vertices: Array, triangles: Indices) -> Polyhedron:
    """Merge the coplanar triangles of a closed surface into facets."""
    normals, areas = _triangle_normals(vertices, triangles)
    triangles, normals, areas = triangles[areas > 0], normals[areas > 0], areas[areas > 0]
    pairs, ends = _shared_edges(triangles)
    flat = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) > np.cos(_COPLANAR_ANGLE)
    links = coo_array((np.ones(flat.sum()), pairs[flat].T), shape=(len(triangles), len(triangles)))
    count, facet = connected_components(links, directed=False)
    facet = facet.astype(np.int64)
    facet_normals = _sums(facet, normals * areas[:, None], count)
    sharp = facet[pairs[:, 0]] != facet[pairs[:, 1]]
    edges, edge_facets = ends[sharp], facet[pairs[sharp]]
    polyhedron = Polyhedron(vertices, triangles, facet, unit(facet_normals), edges, edge_facets, False)
    return replace(polyhedron, convex=_is_convex(polyhedron))


def _is_convex(polyhedron: Polyhedron) -> bool:
    """No vertex lies outside any facet's plane; facets from all over come first, to find out soon."""
    vertices = polyhedron.vertices[distinct_numbers(polyhedron.triangles)]
    triangles, starts = polyhedron.by_facet
    first = triangles[starts, 0]
    offsets = np.einsum("ij,ij->i", polyhedron.normals, polyhedron.vertices[first])
    tolerance = 1e-6 * np.ptp(vertices, axis=0).max()
    step = -(-len(offsets) * len(vertices) // 2_000_000)
    for start in range(step):
        part = slice(start, None, step)
        if np.any(vertices @ polyhedron.normals[part].T > offsets[part] + tolerance):
            return False
    return True


def _triangle_normals(vertices: Array, triangles: Indices) -> tuple[Array, Array]:
    """Unit normals (T, 3) and twice the areas (T,), zero where a triangle is degenerate."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normals = cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    areas[areas < 1e-14 * np.ptp(vertices, axis=0).max() ** 2] = 0
    return normals / np.where(areas > 0, areas, 1)[:, None], areas


def _sums(groups: Indices, values: Array, count: int) -> Array:
    """(count, C) sums of the rows of values (N, C) in each group."""
    return np.stack([np.bincount(groups, column, count) for column in values.T], axis=1).astype(np.float64)


def _shared_edges(triangles: Indices) -> tuple[Indices, Indices]:
    """Pairs of triangles (P, 2) that share an edge, and the ends (P, 2) of that edge."""
    ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = row_order(ends[:, ::-1])
    same = np.all(ends[order][1:] == ends[order][:-1], axis=1)
    first, second = order[:-1][same], order[1:][same]
    return np.stack([first, second], axis=1) // 3, ends[first]


@cache
def _unit_cube() -> Polyhedron:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return merge_facets(corners, np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)]))


@cache
def _unit_prism() -> Polyhedron:
    angles = 2 * np.pi * np.arange(_CIRCLE_SIDES) / _CIRCLE_SIDES
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.concatenate([np.insert(ring, 2, -0.5, axis=1), np.insert(ring, 2, 0.5, axis=1)])
    i = np.arange(_CIRCLE_SIDES)
    j, n = (i + 1) % _CIRCLE_SIDES, _CIRCLE_SIDES
    fan = np.arange(1, _CIRCLE_SIDES - 1)
    bottom = np.stack([0 * fan, fan + 1, fan], axis=1)
    sides = np.concatenate([np.stack([i, j, j + n], axis=1), np.stack([i, j + n, i + n], axis=1)])
    return merge_facets(vertices, np.concatenate([bottom, bottom[:, ::-1] + n, sides]))


@cache
def _unit_ball() -> Polyhedron:
    """An octahedron whose faces are divided into triangles, with its vertices moved onto the unit sphere."""
    n = _BALL_STEPS
    steps = np.stack(np.meshgrid(*[np.arange(-n, n + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    vertices = unit(steps[np.abs(steps).sum(axis=1) == n].astype(float))
    triangles = ConvexHull(vertices).simplices.astype(np.int64)
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    triangles[inwards] = triangles[inwards, ::-1]
    return merge_facets(vertices, triangles)
