"""Points on the surface of an assembly, spread evenly, where something could push."""

from dataclasses import dataclass

import numpy as np

from poise.assembly.contact.graph import Structure
from poise.assembly.contact.placed import triangle_areas
from poise.errors import ErrorCode, InputError
from poise.geometry import plane_axes
from poise.types import Array, Indices, Mask


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Where something could push, and along which direction.

    Args:
        place: (N,) in `Assembly.objects`.
        points: (N, 3) m.
        directions: (N, 3) unit vectors.
    """

    place: Indices
    points: Array
    directions: Array


def sample_surface(structure: Structure, count: int) -> SurfacePoints:
    """About `count` points on the movable objects, evenly by area, with the inward normals; none where bodies touch.

    Raises:
        InputError: EMPTY when all objects are fixed.
    """
    if not len(structure.movable):
        raise InputError(ErrorCode.EMPTY, "a map shows movable objects, and all objects of this assembly are fixed")
    objects = structure.assembly.objects
    corners, places, normals = [], [], []
    for movable in structure.movable:
        item, polyhedron = objects[movable], objects[movable].shape.polyhedron
        corners.append(item.vertices[polyhedron.triangles])
        normals.append((polyhedron.normals @ item.pose.rotation.T)[polyhedron.facet_of_triangle])
        places.append(np.full(len(polyhedron.triangles), movable))
    triangles, normal, place = np.concatenate(corners), np.concatenate(normals), np.concatenate(places)
    # Points at equal steps of the area counted along the triangles, so that each gets its share to within one.
    ends = np.cumsum(triangle_areas(triangles))
    fixed = [item.fixed for item in objects]
    touched = sum(i.area * (2 - fixed[i.first] - fixed[i.second]) for i in structure.interfaces)
    tries = round(count / max(1 - touched / ends[-1], 0.05))
    steps = np.arange(tries) + 0.5
    which = np.minimum(np.searchsorted(ends, steps * (ends[-1] / tries)), len(triangles) - 1)
    # Powers of the inverse plastic number: the low-discrepancy sequence of Roberts (2018), folded into the triangle.
    square = np.stack([steps * 0.7548776662466927, steps * 0.5698402909980532])
    square -= np.floor(square)
    x, y = np.where(square[0] + square[1] > 1, 1 - square, square)[:, :, None]
    first, second, third = np.moveaxis(triangles, 1, 0)
    points = first[which] + x * (second - first)[which] + y * (third - first)[which]
    free = np.flatnonzero(~_covered(structure, points, place[which]))
    which = which[free]
    return SurfacePoints(place[which], points[free], -normal[which])


def _covered(structure: Structure, points: Array, place: Indices) -> Mask:
    """(N,) whether another body touches the surface there."""
    covered = np.zeros(len(points), dtype=bool)
    for interface in structure.interfaces:
        if not interface.area:
            continue
        rows = np.flatnonzero((place == interface.first) | (place == interface.second))
        low, high = interface.triangles.min(axis=(0, 1)), interface.triangles.max(axis=(0, 1))
        margin = structure.margin + abs(interface.gap)
        rows = rows[np.all((points[rows] >= low - margin) & (points[rows] <= high + margin), axis=1)]
        if not len(rows):
            continue
        axes = plane_axes(interface.normal)
        plane = points[rows] @ axes.T
        a, b, c = np.moveaxis(interface.triangles @ axes.T, 1, 0)
        inside = np.zeros(len(rows), dtype=bool)
        for p, q, r in zip(a, b, c, strict=True):
            turns = np.stack([_side(p, q, plane), _side(q, r, plane), _side(r, p, plane)])
            inside |= np.all(turns >= 0, axis=0) | np.all(turns <= 0, axis=0)
        covered[rows[inside]] = True
    return covered


def _side(start: Array, end: Array, points: Array) -> Array:
    """(N,) twice the area between an edge (2,), (2,) and points (N, 2), positive on its left."""
    run = end - start
    return np.asarray(run[0] * (points[:, 1] - start[1]) - run[1] * (points[:, 0] - start[0]))
