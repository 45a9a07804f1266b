"""The surface of a scanned object as one closed mesh with few facets, whose base lies in the plane of its support."""

from typing import NamedTuple

import manifold3d
import numpy as np

from poise.errors import ErrorCode, InputError
from poise.scanning.cans import StandingCylinder, standing_cylinder
from poise.scanning.faceted import counted, faceted
from poise.scanning.scan import SCANNED_FROM
from poise.shape import HIDDEN_OFF, check_mesh
from poise.types import Array, Indices, Mask

_ROUGH = 1e-3
"""m that the surface may move when its facets are made fewer: less than what a scan is off."""
_NARROW_BASE, _WIDE_BASE = 0.25, 1.3
"""Ratios of the base that flat sides have to that by the sections above it, outside of which the latter is believed."""
_SIDES = 64
"""Of the prism in the place of a cylinder."""
_SAME_VOLUME = 0.08
"""Share by which the volume of a cylinder may differ from that of the surface."""
_TINY = 1e-5
"""m over the support, where the base is measured."""
_FLARE = 0.015
"""m by which the lowest mm of a scan may be wider than the object (on one side 10 mm are); a wider plate is real."""
_SMALL_BASE = 0.5
"""Share of its outline seen from above that the base of an object has at least, without a note."""


class StandingMesh(NamedTuple):
    """A closed surface in the object frame, whose z points away from its support.

    Args:
        vertices: (V, 3) m; none below z = 0, and those at 0 are the base.
        triangles: (T, 3) vertex numbers, counter-clockwise from outside.
        notes: what to read it with, one sentence each.
        cylinder: that the object is, as far as the scan can say; the surface is then a prism inscribed in it.
    """

    vertices: Array
    triangles: Indices
    notes: tuple[str, ...]
    cylinder: StandingCylinder | None = None


def united_surfaces(surfaces: list[tuple[Array, Indices]]) -> tuple[Array, Indices]:
    """The surface (V, 3) m, (T, 3) around solids that share faces; the faces they share are left out.

    Args:
        surfaces: vertices and triangles of each; what is shared has equal vertices in both.
    """
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in surfaces)])
    numbered = zip(surfaces, offsets[:-1], strict=True)
    corners = np.concatenate([triangles + offset for (_, triangles), offset in numbered])
    points = np.concatenate([vertices for vertices, _ in surfaces])
    points, number = np.unique(points, axis=0, return_inverse=True)
    corners = number.reshape(-1)[corners]
    _, same, count = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True, return_counts=True)
    return points, corners[count[same.reshape(-1)] % 2 == 1]


def standing_mesh(
    vertices: Array,
    triangles: Indices,
    name: str = "object",
    points: Array | None = None,
    seen: Mask | None = None,
) -> StandingMesh:
    """Clean the surface of a scanned object.

    With the points of the scan, an upright can becomes a cylinder. Planar patches of another surface become one facet
    each, and its sides go on along their planes down to the support. Without points, or where neither explains the
    surface, its facets are made fewer, what reaches below the support is cut off, and the base is the cross-section a
    little above it. Unless it is a cylinder, the base is narrowed as the sections above it say that it narrows: a ball
    does not stand on a disc.

    Args:
        vertices: (V, 3) m in the object frame; its origin is on the support, its z points away from it.
        triangles: (T, 3) vertex numbers.
        name: of the object, for errors.
        points: (N, 3) m of the scan, in the object frame.
        seen: (N,) False for the points that were completed.

    Raises:
        InputError: MESH_INVALID when it is no closed surface, or does not reach its support.
    """
    checked = check_mesh(vertices, triangles, name=name)
    mesh = manifold3d.Mesh(np.asarray(checked.vertices, np.float32), np.asarray(checked.triangles, np.uint32))
    body = manifold3d.Manifold(mesh)
    if body.status() != manifold3d.Error.NoError:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: its parts make no closed surface: scan it again")
    simple = body.simplify(_ROUGH)
    base = _base(simple)
    if base.is_empty():
        raise InputError(
            ErrorCode.MESH_INVALID, f"{name}: it does not reach the plane on which it stands: scan it again, from lower"
        )
    whole = None
    if points is not None and seen is not None:
        rows = counted(body, points, SCANNED_FROM)
        points, seen = points[rows], seen[rows]
        can = standing_cylinder(points, seen)
        if can is not None and abs(body.volume() / can.volume - 1) < _SAME_VOLUME:
            return _prism(can, name)
        whole = faceted(body, points, seen, SCANNED_FROM, _ROUGH)
    if whole is None:
        whole = _on_foot(simple, base)
    elif not _NARROW_BASE < whole.slice(_TINY).area() / base.area() < _WIDE_BASE:
        whole = _on_foot(whole, base)
    return _standing(whole, name)


def _prism(can: StandingCylinder, name: str) -> StandingMesh:
    """The prism in a cylinder."""
    body = manifold3d.Manifold.cylinder(can.height, can.radius, circular_segments=_SIDES)
    return _standing(body.translate((*can.middle.tolist(), 0.0)), name)._replace(cylinder=can)


def _base(body: manifold3d.Manifold) -> manifold3d.CrossSection:
    """What the sections a little above the support have in common, narrower by as much as the lower is narrower.

    The lowest few mm of a scan are completed, and often wider than the object. A thin plate at the foot is no such
    error, nor is the floor of a cup.
    """
    low, higher, highest = (body.slice(height * HIDDEN_OFF) for height in (1, 2, 3))
    narrows = np.sqrt(max(higher.area(), 0.0) / np.pi) - np.sqrt(max(low.area(), 0.0) / np.pi)
    above = _filled(higher) ^ _filled(highest)
    base = low ^ above if (low - above.offset(_FLARE)).is_empty() else low
    return base.offset(-max(float(narrows), 0.0)).simplify(_ROUGH / 2)


def _filled(section: manifold3d.CrossSection) -> manifold3d.CrossSection:
    """A section without its holes, whose outlines run clockwise."""
    outlines = [manifold3d.CrossSection([each], manifold3d.FillRule.Positive) for each in section.to_polygons()]
    return manifold3d.CrossSection.batch_boolean(outlines, manifold3d.OpType.Add)


def _on_foot(body: manifold3d.Manifold, base: manifold3d.CrossSection) -> manifold3d.Manifold:
    """The body with that base."""
    foot = manifold3d.Manifold.extrude(base, 1.5 * HIDDEN_OFF)
    return body.trim_by_plane((0.0, 0.0, 1.0), HIDDEN_OFF) + foot


def _standing(body: manifold3d.Manifold, name: str) -> StandingMesh:
    """Its surface, with notes."""
    cut = body.to_mesh64()
    points = np.array(cut.vert_properties, dtype=np.float64)[:, :3]
    points[np.abs(points[:, 2]) < 1e-6, 2] = 0.0
    whole = check_mesh(points, np.asarray(cut.tri_verts, dtype=np.int64), name=name)
    base = body.slice(_TINY).area()
    notes = []
    if base < _SMALL_BASE * body.project().area():
        notes.append(f"it stands on {1e4 * base:.2g} cm2 only: it may roll or topple")
    return StandingMesh(whole.vertices, whole.triangles, (*notes, *whole.notes))
