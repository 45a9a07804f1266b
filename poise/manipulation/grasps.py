"""Antipodal grasps: two opposite faces that fit between the fingers, in many places and from many sides."""

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import shapely

from poise.assembly.scene import Polyhedron, Shape
from poise.geometry import plane_axes
from poise.manipulation.hand import Grasp, Hand
from poise.types import Array

_FACETS = 64
"""The largest facets are looked at."""
_OPPOSITE = np.cos(np.radians(4.0))
_PLACES, _SPACING, _RIM = 6, 0.012, 0.004
"""Places tried on each pair of faces, at least so far apart and from the rim, m."""
_LEAST_AREA = 2e-5
"""m2 that have to lie opposite each other."""
APPROACH_SIDES = 8
"""Directions from which each place is approached."""
_BEYOND = 0.004
"""m that the finger tips reach beyond the place that is grasped."""


def antipodal_grasps(shape: Shape, hand: Hand, sides: int = APPROACH_SIDES) -> tuple[Grasp, ...]:
    """All grasps of a shape by flat opposite faces, from a number of sides; room for the hand is not checked."""
    polyhedron = shape.polyhedron
    areas = [shapely.area(_outline(polyhedron, facet, facet)) for facet in range(len(polyhedron.normals))]
    largest = np.argsort(areas, kind="stable")[::-1][:_FACETS]
    grasps: list[Grasp] = []
    for number, i in enumerate(largest.tolist()):
        for j in largest[number + 1 :].tolist():
            grasps.extend(_grasps_of_pair(polyhedron, i, j, hand, sides))
    return tuple(grasps)


def _outline(polyhedron: Polyhedron, facet: int, plane: int) -> shapely.Geometry:
    """A facet, as seen along the normal of another."""
    origin = polyhedron.vertices[polyhedron.facet_vertices[plane][0]]
    return polyhedron.polygon(facet, polyhedron.vertices, origin, plane_axes(polyhedron.normals[plane]))


def _grasps_of_pair(polyhedron: Polyhedron, i: int, j: int, hand: Hand, sides: int) -> Iterator[Grasp]:
    normal = polyhedron.normals[i]
    if normal @ polyhedron.normals[j] > -_OPPOSITE:
        return
    origin, other = (polyhedron.vertices[polyhedron.facet_vertices[k][0]] for k in (i, j))
    width = float((origin - other) @ normal)
    if not 0 < width <= hand.widest:
        return
    axes = plane_axes(normal)
    both = shapely.intersection(_outline(polyhedron, i, i), _outline(polyhedron, j, i))
    for spot in _spots(both):
        middle = origin + spot @ axes - normal * width / 2
        for angle in 2 * np.pi * np.arange(sides) / sides:
            approach = np.cos(angle) * axes[0] + np.sin(angle) * axes[1]
            rotation = np.stack([np.cross(normal, approach), normal, approach], axis=1)
            yield Grasp(pin.SE3(rotation, middle + _BEYOND * approach), width)


def _spots(region: shapely.Geometry) -> Array:
    """(N, 2) places in a region: a grid away from its rim, or a row where it is narrow."""
    if region.area < _LEAST_AREA:
        return np.zeros((0, 2))
    inner = region.buffer(-_RIM)
    if not inner.is_empty:
        low, high = np.reshape(inner.bounds, (2, 2))
        step = max(_SPACING, float(np.sqrt(inner.area / _PLACES)))
        lines = [np.arange(a, b + 1e-9, step) + (b - a) % step / 2 for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
        grid = grid[shapely.contains_xy(inner, grid[:, 0], grid[:, 1])]
        if len(grid):
            return np.asarray(grid)
    corners = np.array(region.minimum_rotated_rectangle.exterior.coords)[:4]
    sides = np.roll(corners, -1, axis=0) - corners
    long = int(np.linalg.norm(sides[:2], axis=1).argmax())
    middle = corners.mean(axis=0)
    rim = min(_RIM / max(float(np.linalg.norm(sides[long])), 1e-12), 0.5)
    row = middle + np.linspace(rim - 0.5, 0.5 - rim, _PLACES)[:, None] * sides[long]
    return np.asarray(row[shapely.contains_xy(region, row[:, 0], row[:, 1])])
