"""Where two polyhedra touch: facet on facet, edge on facet, vertex on facet, edge across edge."""

import numpy as np
import shapely

from poise.assembly.contact.placed import ContactPatch, PlacedBody
from poise.geometry import cross, lengths, plane_axes, unit
from poise.types import Array, Indices, Mask

# Facets within this angle of opposite may lie flat on each other, rad (a scan's pose is not better).
FACE_ANGLE = np.radians(3.0)
NO_TRIANGLES = np.zeros((0, 3, 3))
_ACROSS = 1e-3
"""Sine between facets that bound each other."""
_SAME_PLANE = 1e-6
"""m by which edges of a face may be off its plane."""


def touching_patches(first: PlacedBody, second: PlacedBody, margin: float) -> list[ContactPatch]:
    """All places where two bodies touch, by their planar facets, their edges and their vertices.

    Convex bodies touch in one plane, so that facets lying flat on each other are all there is.
    Otherwise edges and vertices of each on facets of the other, and crossing edges, are looked for too.
    """
    near = overlap(first.bounds, second.bounds, margin)
    facets = first.facets_near(near), second.facets_near(near)
    flat, pairs = _facet_on_facet(first, second, facets, margin)
    convex = first.polyhedron.convex and second.polyhedron.convex
    if flat and convex:
        return flat
    tolerance = 1e-7 * min(first.size, second.size)
    edges = first.edges_near(near), second.edges_near(near)
    forward = _edges_on_facets(second, edges[1], first, facets[0], {(b, a) for a, b in pairs}, margin, tolerance)
    backward = _edges_on_facets(first, edges[0], second, facets[1], pairs, margin, tolerance)
    turned = [patch.turned() for patch in backward]
    return flat + forward + turned + _edge_across_edge(first, second, edges, margin)


def overlap(first: Array, second: Array, margin: float) -> Array:
    """(2, 3) where two bounds (2, 3) overlap, wider by the margin; low above high where they do not."""
    return np.stack([np.maximum(first[0], second[0]) - margin, np.minimum(first[1], second[1]) + margin])


def beside_faces(on_faces: list[ContactPatch], on_rims: list[ContactPatch]) -> list[ContactPatch]:
    """Of the contacts of a round side with edges and vertices, those that are not in the plane of a face it touches.

    Where the side touches a face, edges and vertices of that face within the margin are farther off than the face is.
    With them it would seem to rest on several points, on which it does not roll. Normals are out of the polyhedron.
    """
    if not on_faces:
        return on_rims
    normals = np.array([patch.normal for patch in on_faces])
    heights = np.array([_foot(patch) @ patch.normal for patch in on_faces])
    return [patch for patch in on_rims if not np.any(np.abs(normals @ _foot(patch) - heights) <= _SAME_PLANE)]


def _foot(patch: ContactPatch) -> Array:
    """(3,) a point on the body that the normal of a contact leaves."""
    return np.asarray(patch.points[0] - patch.gap / 2 * patch.normal)


def _facet_on_facet(
    first: PlacedBody, second: PlacedBody, facets: tuple[Indices, Indices], margin: float
) -> tuple[list[ContactPatch], set[tuple[int, int]]]:
    """Patches of facets that lie flat on each other, and the numbers of those facets."""
    a, b = facets
    opposite = first.normals[a] @ second.normals[b].T < -np.cos(FACE_ANGLE)
    low = np.maximum(first.facet_bounds[a, None, 0], second.facet_bounds[None, b, 0])
    high = np.minimum(first.facet_bounds[a, None, 1], second.facet_bounds[None, b, 1])
    patches, pairs = [], set()
    for i, j in np.argwhere(opposite & np.all(low <= high + margin, axis=2)):
        patch = _flat_patch(first, second, int(a[i]), int(b[j]), margin)
        if patch is not None:
            patches.append(patch)
            pairs.add((int(a[i]), int(b[j])))
    return patches, pairs


def _flat_patch(first: PlacedBody, second: PlacedBody, a: int, b: int, margin: float) -> ContactPatch | None:
    """Where facet a lies on facet b with a gap or overlap of at most the margin, in the plane midway."""
    normal = unit(first.normals[a] - second.normals[b])
    origin, axes = first.origins[a], plane_axes(normal)

    def drawn(body: PlacedBody, facet: int) -> tuple[shapely.Geometry, Array]:
        # Height of the facet above the common plane: linear in the plane's coordinates.
        slope = -(axes @ body.normals[facet]) / (normal @ body.normals[facet])
        start = body.origins[facet] - origin
        height = np.append(slope, normal @ start - slope @ (axes @ start))
        return body.polyhedron.polygon(facet, body.vertices, origin, axes), height

    polygon_a, height_a = drawn(first, a)
    polygon_b, height_b = drawn(second, b)
    tiny = 1e-9 * min(first.size, second.size) ** 2
    region = _polygonal(shapely.intersection(polygon_a, polygon_b))
    gap = height_b - height_a
    if region.area > tiny and np.any(np.abs(_linear(gap, shapely.get_coordinates(region))) > margin):
        region = _polygonal(shapely.intersection(region, _band(gap, margin, region)))
    # A strip this narrow is two rims side by side but for rounding, and rims do not press on each other.
    if region.area <= tiny or 2 * region.area <= 1e-6 * min(first.size, second.size) * region.length:
        return None
    middle = (height_a + height_b) / 2

    def lifted(plane: Array) -> Array:
        return np.asarray(origin + plane @ axes + _linear(middle, plane)[..., None] * normal)

    corners = shapely.get_coordinates(region.convex_hull)[:-1]
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(region))
    plane = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    distance = float(_linear(gap, np.array(region.centroid.coords[0])))
    return ContactPatch(lifted(corners), normal, distance, lifted(plane))


def _linear(height: Array, plane: Array) -> Array:
    return np.asarray(plane @ height[:2] + height[2])


def _polygonal(region: shapely.Geometry) -> shapely.Geometry:
    """The part of a geometry that has area."""
    if region.geom_type in ("Polygon", "MultiPolygon"):
        return region
    parts = [part for part in shapely.get_parts(region) if part.geom_type in ("Polygon", "MultiPolygon")]
    return shapely.union_all(parts)


def _band(gap: Array, margin: float, region: shapely.Geometry) -> shapely.Geometry:
    """The strip of the plane where |gap| <= margin, as long as the region needs."""
    slope = np.linalg.norm(gap[:2])
    if slope < 1e-12:
        return shapely.Polygon()
    along = gap[:2] / slope
    across = np.array([-along[1], along[0]])
    centre = np.array(region.centroid.coords[0])
    reach = region.length + 1.0
    foot = centre - along * (_linear(gap, centre) / slope)
    half = margin / slope
    ends = [foot + s * half * along + t * reach * across for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return shapely.Polygon(ends)


def _edges_on_facets(
    body: PlacedBody,
    edges: Indices,
    base: PlacedBody,
    facets: Indices,
    flat: set[tuple[int, int]],
    margin: float,
    tolerance: float,
) -> list[ContactPatch]:
    """Edges and vertices of a body that lie on facets of the base; the normals point out of the base.

    `flat` holds the (facet of body, facet of base) that lie flat on each other already.
    """
    patches: list[ContactPatch] = []
    if not len(edges):
        return patches
    corners = np.unique(body.edges[edges])
    heights = np.einsum("vfk,fk->vf", body.vertices[corners, None] - base.origins[facets], base.normals[facets])
    close = np.abs(heights) <= margin
    for k in np.flatnonzero(close.any(axis=0)):
        facet = int(facets[k])
        height = dict(zip(corners[close[:, k]].tolist(), heights[close[:, k], k].tolist(), strict=True))
        covered = {int(v) for a, b in flat if b == facet for v in body.polyhedron.facet_vertices[a]}
        patches += _on_facet(body, edges, base, facet, height, covered, tolerance)
    return patches


def _on_facet(
    body: PlacedBody,
    edges: Indices,
    base: PlacedBody,
    facet: int,
    height: dict[int, float],
    covered: set[int],
    tolerance: float,
) -> list[ContactPatch]:
    """Contacts with one facet of those vertices whose heights above it are given, unless covered already."""
    patches = []
    normal, lying = base.normals[facet], set(covered)
    marked = np.zeros((2, len(body.vertices)), dtype=bool)
    marked[0, list(height)] = True
    marked[1, list(covered)] = True
    ends_high, ends_covered = (each[body.edges[edges]].all(axis=1) for each in marked)
    open_edges = edges[ends_high & ~ends_covered]
    if base.polyhedron.convex:
        high = np.array(sorted(height))
        beside = np.zeros((len(body.vertices), len(base.normals)), dtype=bool)
        beside[high] = _beside_facet(base, facet, body.vertices[high], tolerance)
        if beside[high].any(axis=1).all():
            lying |= set(height)
        open_edges = open_edges[~np.any(beside[body.edges[open_edges]].all(axis=1), axis=1)]
        if not len(open_edges) and not height.keys() - lying:
            return []
    pushing = body.edges[open_edges[body.edges_push(open_edges, -normal)]].tolist() if len(open_edges) else []
    pressing = [vertex for vertex in height.keys() - lying if body.vertex_pushes(vertex, -normal)]
    if not pushing and not pressing:
        return []
    polygon, origin, axes = base.polygon(facet), base.origins[facet], base.axes[facet]
    inside = polygon.buffer(-tolerance)
    for i, j in pushing:
        line = shapely.LineString((body.vertices[[i, j]] - origin) @ axes.T)
        part = shapely.intersection(line, polygon)
        # Within the facet, not along its rim: blocks that share only an edge do not press on each other.
        if part.length > tolerance and inside.intersects(line):
            ends = shapely.get_coordinates(part)[[0, -1]]
            gap = (height[i] + height[j]) / 2
            patches.append(ContactPatch(origin + ends @ axes + gap / 2 * normal, normal, gap, NO_TRIANGLES))
            lying |= {i, j}
    for vertex in [vertex for vertex in pressing if vertex not in lying]:
        place = (body.vertices[vertex] - origin) @ axes.T
        if inside.covers(shapely.Point(place)):
            gap = height[vertex]
            point = body.vertices[vertex] - gap / 2 * normal
            patches.append(ContactPatch(point[None], normal, gap, NO_TRIANGLES))
    return patches


def _beside_facet(base: PlacedBody, facet: int, points: Array, tolerance: float) -> Mask:
    """(N, F) whether points (N, 3), moved along its normal onto a facet of a convex body, are beyond others of it.

    A point that is beyond one of them, and an edge both ends of which are beyond the same one, do not lie in the facet.
    """
    normal = base.normals[facet]
    flat = points - np.outer((points - base.origins[facet]) @ normal, normal)
    over = flat @ base.normals.T - np.einsum("fi,fi->f", base.normals, base.origins)
    sine = np.sqrt(np.maximum(1 - (base.normals @ normal) ** 2, 0.0))
    return np.asarray((over > -tolerance * sine) & (sine > _ACROSS))


def _edge_across_edge(
    first: PlacedBody, second: PlacedBody, edges: tuple[Indices, Indices], margin: float
) -> list[ContactPatch]:
    """Points where an edge of one body crosses an edge of the other."""
    if not len(edges[0]) or not len(edges[1]):
        return []
    a = first.vertices[first.edges[edges[0]]]
    b = second.vertices[second.edges[edges[1]]]
    run_a, run_b = (a[:, 1] - a[:, 0])[:, None], (b[:, 1] - b[:, 0])[None]
    across = cross(run_a, run_b)
    length = lengths(across)
    crossing = length > 1e-3 * lengths(run_a) * lengths(run_b)
    square = np.where(crossing, length, 1.0) ** 2
    between = b[None, :, 0] - a[:, None, 0]
    s = np.einsum("ijk,ijk->ij", cross(between, run_b), across) / square
    t = np.einsum("ijk,ijk->ij", cross(between, run_a), across) / square
    distance = np.abs(np.einsum("ijk,ijk->ij", between, across)) / np.sqrt(square)
    inner = (s > 1e-6) & (s < 1 - 1e-6) & (t > 1e-6) & (t < 1 - 1e-6)
    patches = []
    for i, j in np.argwhere(crossing & inner & (distance <= margin)):
        normal = across[i, j] / length[i, j]
        for n in (normal, -normal):
            if first.edge_pushes(int(edges[0][i]), n) and second.edge_pushes(int(edges[1][j]), -n):
                point_a, point_b = a[i, 0] + s[i, j] * run_a[i, 0], b[j, 0] + t[i, j] * run_b[0, j]
                gap = float(n @ (point_b - point_a))
                patches.append(ContactPatch((point_a + point_b)[None] / 2, n, gap, NO_TRIANGLES))
    return patches
