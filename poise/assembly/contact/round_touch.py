"""Lines and points at which round sides touch: on these bodies roll, against a small resistance."""

from collections.abc import Sequence

import numpy as np
import shapely

from poise.assembly.contact.facet_curves import SMOOTH, FacetCurve, facet_curve
from poise.assembly.contact.placed import ContactPatch, PlacedBody, RoundTouch, hull_corners
from poise.assembly.contact.touching import FACE_ANGLE
from poise.assembly.scene import Mesh
from poise.geometry import plane_axes, unit
from poise.types import Array

_AROUND = 8
"""Corners of the region around a point: resistance is up to 8 % less between them than towards them."""
_STRAIGHT = 0.9
"""Least cosine between an edge on which a round side lies and the direction in which it is straight."""
_NEAR = 1e-3
"""Cosines from 1 within which a facet is that of a patch (2.6 degrees)."""


def widened(touch: RoundTouch, normal: Array, rolling: float) -> Array:
    """(K, 3) corners of the region in which the contact force may act, in order: rolling resistance is its lever.

    A body that rolls on a plane is held by a moment of up to coefficient * radius * normal force: the contact force
    acts at most coefficient * radius ahead of the line or point of contact.
    """
    if rolling == 0:
        return touch.points
    levers = rolling * touch.radii[:, None]
    if touch.across is not None:
        first, last = touch.points - levers * touch.across, touch.points + levers * touch.across
        corners = np.concatenate([first, last[::-1]])
        return np.asarray(corners[np.append(True, np.linalg.norm(np.diff(corners, axis=0), axis=1) > 0)])
    angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ plane_axes(normal)
    return np.asarray(touch.points + levers * circle)


def joint_touch(group: Sequence[ContactPatch], normal: Array) -> RoundTouch | None:
    """Where round sides touch along one line or at one point, of patches in one plane; None when it is not so.

    Bodies on two lines or on scattered points, such as a mesh with several wheels, do not roll on them.
    """
    touches = [patch.touch for patch in group if patch.touch is not None]
    if len(touches) < len(group):
        return None
    if len(touches) == 1:
        return touches[0]
    points = np.concatenate([touch.points for touch in touches])
    radii = np.concatenate([touch.radii for touch in touches])
    corners = hull_corners(points, normal)
    if len(corners) > 2:
        return None
    nearest = [int(np.argmin(np.linalg.norm(points - corner, axis=1))) for corner in corners]
    across = unit(np.cross(normal, corners[1] - corners[0])) if len(corners) == 2 else touches[0].across
    return RoundTouch(corners, radii[nearest], across)


def mesh_touch(
    bodies: tuple[PlacedBody, PlacedBody], group: Sequence[ContactPatch], normal: Array, corners: Array
) -> RoundTouch | None:
    """Where the round sides touch that meshes stand for by flat facets; None where neither body is round there.

    Such a mesh may touch with a facet, or with an edge or a vertex between facets of its round side.

    Args:
        bodies: both, the first pressing on the second along the normal.
        group: patches in one plane, the largest first.
        normal: (3,) of that plane.
        corners: (K, 3) m, of the hull of all patches.
    """
    found: list[RoundTouch] = []
    at_edge = len(corners) < 3
    if not at_edge and not all(patch.area > 0 for patch in group):
        return None
    for body, outwards in zip(bodies, (1.0, -1.0), strict=True):
        curves = [_curve(body, outwards * patch.normal, patch.points[0]) for patch in group]
        if curves[0] is None or None in curves:
            continue
        touch = (_over_edge if at_edge else _under)(curves[0], body, outwards * normal, corners)
        if touch is not None:
            found.append(touch)
    if len(found) < 2:
        return found[0] if found else None
    # Two round sides are as one on a plane whose curvature is the sum.
    radii = 1 / (1 / found[0].radii.mean() + 1 / found[1].radii.mean())
    lead = found[0] if len(found[0].points) <= len(found[1].points) else found[1]
    return RoundTouch(lead.points, np.full(len(lead.points), radii), lead.across)


def resting_normal(bodies: tuple[PlacedBody, PlacedBody], group: Sequence[ContactPatch], normal: Array) -> Array:
    """(3,) normal of a contact of small facets of a round side with a flat facet: that of the flat one."""
    if not any(isinstance(body.item.shape, Mesh) for body in bodies):
        return normal
    for body, outwards in zip(bodies, (1.0, -1.0), strict=True):
        if len(body.normals) and _curve(body, outwards * normal, group[0].points[0]) is None:
            cosines = body.normals @ (outwards * normal)
            if cosines.max() > np.cos(FACE_ANGLE):
                return np.asarray(outwards * body.normals[cosines.argmax()])
    return normal


def _curve(body: PlacedBody, normal: Array, point: Array) -> FacetCurve | None:
    """The round side for which the facet of a body at a contact stands; None where no facet faces the contact."""
    if not isinstance(body.item.shape, Mesh):
        return None
    cosines = body.normals @ normal
    facing = np.flatnonzero(cosines > max(cosines.max() - _NEAR, 0.5))
    if not len(facing):  # the tip of a steep pyramid, or an edge
        return None
    heights = np.abs(np.einsum("fi,fi->f", body.origins[facing] - point, body.normals[facing]))
    return facet_curve(body.polyhedron, int(facing[heights.argmin()]))


def _over_edge(curve: FacetCurve, body: PlacedBody, normal: Array, corners: Array) -> RoundTouch | None:
    """Where a round side touches with an edge or a vertex between two of its facets.

    Facets say no better where that is than they are wide: within that it is where the centre of mass rests. None where
    the normal is farther off those of the facets: the edge is at the end of the round side.
    """
    facing = body.item.pose.rotation @ curve.normal
    cosine = float(facing @ normal)
    if cosine < np.cos(SMOOTH / 2):
        return None
    half = curve.radius * float(np.sqrt(max(1 - cosine**2, 0.0)))
    rests = body.item.com_in_world - corners.mean(axis=0)
    rests -= (rests @ normal) * normal
    if curve.along is None:
        shift = rests * min(1.0, half / max(float(np.linalg.norm(rests)), 1e-12))
        return RoundTouch((corners.mean(axis=0) + shift)[None], np.array([curve.radius]), None)
    along = body.item.pose.rotation @ curve.along
    run = along if len(corners) == 1 else unit(corners[1] - corners[0])
    if abs(run @ along) < _STRAIGHT:
        return None
    across = unit(np.cross(normal, run))
    middle = body.item.pose.apply(curve.middle)
    radii = np.maximum(curve.radius + curve.slope * ((corners - middle) @ along), 0.0)
    shift = np.clip(rests @ across, -half, half) * radii / curve.radius
    return RoundTouch(corners + shift[:, None] * across, radii, across)


def _under(curve: FacetCurve, body: PlacedBody, normal: Array, corners: Array) -> RoundTouch | None:
    """The line or point of a round side that is farthest along a normal, as far as it is within the corners.

    Facets say no better where that is than they are wide: within them it is where the centre of mass rests.
    """
    pose = body.item.pose
    foot = pose.apply(curve.middle) + curve.radius * (normal - pose.rotation @ curve.normal)
    axes, origin = plane_axes(normal), corners[0]
    region = shapely.convex_hull(shapely.multipoints((corners - origin) @ axes.T))
    middle, rests = axes @ (foot - origin), axes @ (body.item.com_in_world - origin)
    flat = rests if curve.along is None or shapely.contains_xy(region, *rests) else middle
    if curve.along is None:
        if not shapely.contains_xy(region, *flat):
            return None
        return RoundTouch((origin + flat @ axes)[None], np.array([curve.radius]), None)
    along = unit(axes @ (pose.rotation @ curve.along))
    size = float(np.linalg.norm(np.ptp(corners, axis=0)) + np.linalg.norm(flat))
    covered = shapely.intersection(region, shapely.LineString([flat - size * along, flat + size * along]))
    if covered.geom_type != "LineString" or covered.is_empty:
        return None
    ends = shapely.get_coordinates(covered)[[0, -1]]
    radii = np.maximum(curve.radius + curve.slope * ((ends - middle) @ along), 0.0)
    points = origin + ends @ axes
    return RoundTouch(points, radii, unit(np.cross(normal, points[1] - points[0])))
