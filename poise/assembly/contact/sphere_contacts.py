"""Where balls touch: facets, edges and vertices of polyhedra; caps, rims and sides of cylinders; other balls."""

import numpy as np
import shapely

from poise.assembly.contact.placed import ContactPatch, PlacedBody, RoundTouch
from poise.assembly.contact.touching import NO_TRIANGLES, beside_faces, overlap
from poise.assembly.scene import Cylinder, Sphere
from poise.types import Array


def sphere_patches(first: PlacedBody, second: PlacedBody, margin: float) -> list[ContactPatch]:
    """All places where two bodies touch, at least one of them a ball; normals from the first into the second."""
    if isinstance(second.item.shape, Sphere):
        return _on_ball(first, second, second.item.shape.radius, margin)
    return [patch.turned() for patch in sphere_patches(second, first, margin)]


def _on_ball(base: PlacedBody, ball: PlacedBody, radius: float, margin: float) -> list[ContactPatch]:
    """Places where a body touches a ball, with normals out of the body."""
    centre, shape = ball.item.pose.translation, base.item.shape
    found = _on_facets(base, centre, radius, margin, overlap(base.bounds, ball.bounds, margin))
    if isinstance(shape, Sphere):
        found += _at(base.item.pose.translation, centre, radius, margin, base_radius=shape.radius)
    elif isinstance(shape, Cylinder):
        found += _on_cylinder(base, shape, centre, radius, margin)
    else:
        rims = _on_edges(base, centre, radius, margin, overlap(base.bounds, ball.bounds, margin))
        found += beside_faces(found, rims)
    return found


def _at(place: Array, centre: Array, radius: float, margin: float, base_radius: float = 0.0) -> list[ContactPatch]:
    """Contact of a ball with a ball of `base_radius` about a place (3,): with the place itself where that is 0."""
    run = centre - place
    distance = float(np.linalg.norm(run))
    gap = distance - radius - base_radius
    if abs(gap) > margin or distance == 0:
        return []
    normal = run / distance
    point = (place + (base_radius + gap / 2) * normal)[None]
    lever = radius * base_radius / (radius + base_radius)
    touch = RoundTouch(point, np.array([lever]), None) if lever > 0 else None
    return [ContactPatch(point, normal, gap, NO_TRIANGLES, touch)]


def _on_facets(base: PlacedBody, centre: Array, radius: float, margin: float, near: Array) -> list[ContactPatch]:
    found = []
    for facet in base.facets_near(near).tolist():
        normal, origin = base.normals[facet], base.origins[facet]
        gap = float((centre - origin) @ normal) - radius
        if abs(gap) > margin or not shapely.contains_xy(base.polygon(facet), *(base.axes[facet] @ (centre - origin))):
            continue
        point = (centre - (radius + gap / 2) * normal)[None]
        found.append(ContactPatch(point, normal, gap, NO_TRIANGLES, RoundTouch(point, np.array([radius]), None)))
    return found


def _on_edges(base: PlacedBody, centre: Array, radius: float, margin: float, near: Array) -> list[ContactPatch]:
    """Edges, along which a ball rolls as on two rails, and vertices, on which it does not."""
    found = []
    edges = base.edges_near(near)
    for edge in edges.tolist():
        first, last = base.vertices[base.edges[edge]]
        run = last - first
        share = float((centre - first) @ run / (run @ run))
        place = first + share * run
        if not 1e-6 < share < 1 - 1e-6 or not base.edge_pushes(edge, centre - place):
            continue
        for patch in _at(place, centre, radius, margin):
            touch = RoundTouch(patch.points, np.array([radius]), run / np.linalg.norm(run))
            found.append(ContactPatch(patch.points, patch.normal, patch.gap, NO_TRIANGLES, touch))
    for vertex in np.unique(base.edges[edges]).tolist():
        if base.vertex_pushes(vertex, centre - base.vertices[vertex]):
            found += _at(base.vertices[vertex], centre, radius, margin)
    return found


def _on_cylinder(base: PlacedBody, shape: Cylinder, centre: Array, radius: float, margin: float) -> list[ContactPatch]:
    """The side of a cylinder, and its rims; the caps are facets."""
    local = base.item.pose.undo(centre)
    aside = float(np.linalg.norm(local[:2]))
    if aside == 0:
        return []
    if abs(local[2]) < shape.length / 2:
        axis = base.item.pose.apply(np.array([0.0, 0.0, local[2]]))
        return _at(axis, centre, radius, margin, base_radius=shape.radius)
    if aside <= shape.radius:
        return []
    rim = np.append(local[:2] * (shape.radius / aside), np.sign(local[2]) * shape.length / 2)
    return _at(base.item.pose.apply(rim), centre, radius, margin)
