"""Where cylinders touch: caps on facets, the round side along a line or at a point, the rim at a point of a facet."""

import numpy as np
import shapely

from poise.assembly.contact.placed import ContactPatch, PlacedBody, RoundTouch
from poise.assembly.contact.rim_contacts import PARALLEL, rim_patches, rims_on_rims
from poise.assembly.contact.touching import NO_TRIANGLES, beside_faces, overlap, touching_patches
from poise.assembly.scene import Cylinder
from poise.geometry import unit
from poise.types import Array

# A side within this angle of a facet lies on it along a line, rad.
_LINE_ANGLE = np.radians(1.0)
_CLOSED = 1e-5
"""m: a gap beside a line of contact that pressing closes."""


def round_patches(first: PlacedBody, second: PlacedBody, margin: float) -> list[ContactPatch]:
    """All places where two bodies touch, at least one of them a cylinder."""
    if first.cylinder is None:
        return [patch.turned() for patch in round_patches(second, first, margin)]
    flat = touching_patches(first, second, margin)  # the caps are facets
    if flat and second.polyhedron.convex:
        return flat
    # The normals found below leave the other body towards this cylinder.
    lying = _on_facets(first, second, margin)
    found = [patch.turned() for patch in lying]
    if second.cylinder is not None:
        found += _on_facets(second, first, margin) + _side_on_side(first, second, margin)
        found += rim_patches(second, first, margin) + rims_on_rims(second, first, margin)
        found += [patch.turned() for patch in rim_patches(first, second, margin)]
    else:
        edges = _side_on_edges(first, second, margin) + rim_patches(first, second, margin)
        found += [patch.turned() for patch in beside_faces(lying, edges)]
    return flat + found


def _frame(body: PlacedBody) -> tuple[Array, Array, float, float]:
    """Centre, axis, radius and half length."""
    shape, pose = body.item.shape, body.item.pose
    if not isinstance(shape, Cylinder):
        raise TypeError(f"object {body.item.id} is not a cylinder")
    return pose.translation, pose.rotation[:, 2], shape.radius, shape.length / 2


def _on_facets(body: PlacedBody, base: PlacedBody, margin: float) -> list[ContactPatch]:
    """The side or the rim of a cylinder on planar facets of the base, normals out of the base."""
    centre, axis, radius, half = _frame(body)
    patches = []
    for facet in base.facets_near(overlap(body.bounds, base.bounds, margin)):
        normal = base.normals[facet]
        lean = float(axis @ normal)
        if abs(lean) > np.cos(_LINE_ANGLE):
            continue
        down = -unit(normal - lean * axis)
        # A long cylinder that leans a little stands on its rim: the other end is too far away.
        lying = abs(lean) < np.sin(_LINE_ANGLE) and 2 * half * abs(lean) <= margin
        along = (-1, 1) if lying else (-np.sign(lean),)
        lowest = np.array([centre + radius * down + sign * half * axis for sign in along])
        gaps = (lowest - base.origins[facet]) @ normal
        if np.any(np.abs(gaps) > margin):
            continue
        plane = (lowest - base.origins[facet]) @ base.axes[facet].T
        shape = shapely.LineString(plane) if lying else shapely.Point(plane[0])
        inside = base.polygon(int(facet)).buffer(-1e-7 * min(body.size, base.size))
        if not inside.intersects(shape):
            continue
        ends = shapely.get_coordinates(shapely.intersection(shape, base.polygon(int(facet))))
        gap = float(gaps.mean())
        points = base.origins[facet] + ends[[0, -1] if lying else [0]] @ base.axes[facet] + gap / 2 * normal
        # A rim rolls along itself, and tips over it.
        touch = RoundTouch(points, np.full(len(points), radius), unit(np.cross(normal, axis)))
        patches.append(ContactPatch(points, normal, gap, NO_TRIANGLES, touch))
    return patches


def _side_on_edges(body: PlacedBody, base: PlacedBody, margin: float) -> list[ContactPatch]:
    """The round side across or along edges and over vertices of a polyhedron, normals out of the polyhedron."""
    centre, axis, radius, half = _frame(body)
    patches = []
    near = base.edges_near(overlap(body.bounds, base.bounds, margin))
    for edge in near:
        ends = base.vertices[base.edges[edge]] - centre
        points = _nearest_to_axis(ends, axis, half, radius)
        if points is None:
            continue
        foot = points - np.outer(points @ axis, axis)
        distance = np.linalg.norm(foot, axis=1)
        normal = -unit(foot.mean(axis=0))
        gap = float(distance.mean()) - radius
        if np.all(np.abs(distance - radius) <= margin) and base.edge_pushes(int(edge), normal):
            places = centre + points + gap / 2 * normal
            # Across an edge the side rolls as on a rail; over an edge along its axis it turns as over a corner.
            rail = RoundTouch(places, np.array([radius]), unit(ends[1] - ends[0])) if len(points) == 1 else None
            patches.append(ContactPatch(places, normal, gap, NO_TRIANGLES, rail))
    for vertex in np.unique(base.edges[near]):
        point = base.vertices[vertex] - centre
        foot = point - (point @ axis) * axis
        distance = float(np.linalg.norm(foot))
        if abs(point @ axis) < half and abs(distance - radius) <= margin and base.vertex_pushes(int(vertex), -foot):
            normal, gap = -foot / distance, distance - radius
            patches.append(ContactPatch((centre + point + gap / 2 * normal)[None], normal, gap, NO_TRIANGLES))
    return patches


def _nearest_to_axis(ends: Array, axis: Array, half: float, distance: float) -> Array | None:
    """Where a segment (2, 3) is nearest to the axis through the origin, inside both; two points if nearly parallel.

    Nearly parallel ones touch at more than a point: along the part on which they come apart by what pressing closes.

    Args:
        ends: of the segment.
        axis: unit vector.
        half: m, length of the axis to either side.
        distance: m, between axis and segment where they touch.
    """
    run = ends[1] - ends[0]
    across = np.cross(axis, run)
    square = float(across @ across)
    share = float(np.cross(-ends[0], axis) @ np.cross(run, axis)) / max(square, 1e-300)
    if square < (PARALLEL * np.linalg.norm(run)) ** 2:
        slide = ends @ axis
        low, high = max(slide.min(), -half), min(slide.max(), half)
        if square > (1e-9 * np.linalg.norm(run)) ** 2:
            crossing = slide[0] + share * (slide[1] - slide[0])
            nearest = float(np.clip(crossing, low, high)) - crossing
            reach = np.hypot(nearest, np.linalg.norm(run) * np.sqrt(2 * distance * _CLOSED / square))
            low, high = max(low, crossing - reach), min(high, crossing + reach)
        if high - low <= 1e-7 * half:
            return None
        shares = (np.array([low, high]) - slide[0]) / (slide[1] - slide[0])
        return np.asarray(ends[0] + np.outer(shares, run))
    point = ends[0] + share * run
    if not 1e-6 < share < 1 - 1e-6 or abs(point @ axis) >= half * (1 - 1e-6):
        return None
    return np.asarray(point)[None]


def _side_on_side(first: PlacedBody, second: PlacedBody, margin: float) -> list[ContactPatch]:
    """Two round sides: along a line where the axes are parallel, at a point where they cross."""
    centre_a, axis_a, radius_a, half_a = _frame(first)
    centre_b, axis_b, radius_b, half_b = _frame(second)
    ends = centre_b - centre_a + np.outer([-half_b, half_b], axis_b)
    points = _nearest_to_axis(ends, axis_a, half_a, radius_a + radius_b)
    if points is None:
        return []
    foot = points - np.outer(points @ axis_a, axis_a)
    distance = np.linalg.norm(foot, axis=1)
    if np.any(np.abs(distance - radius_a - radius_b) > margin):
        return []
    normal = unit(foot.mean(axis=0))
    gap = float(distance.mean()) - radius_a - radius_b
    places = centre_a + points - (radius_b + gap / 2) * normal
    if len(points) == 2:
        lever = radius_a * radius_b / (radius_a + radius_b)
        touch = RoundTouch(places, np.full(2, lever), unit(np.cross(normal, axis_a)))
    else:  # each rolls along the other
        touch = RoundTouch(places, np.array([min(radius_a, radius_b)]), None)
    return [ContactPatch(places, normal, gap, NO_TRIANGLES, touch)]
