"""A scanned object on the surface that supports it: what a scan and a scene disagree about is taken from its pose."""

from dataclasses import replace

import numpy as np
import shapely

from poise.assembly import Assembly, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, plane_axes, rotation_between, unit
from poise.types import Array

_LEVEL = np.radians(3.0)
"""Angle up to which a base and the surface below it are parallel."""
_LEAST_SUPPORT = 1e-3
"""Share of a base that lies over a surface, for it to be supported by that."""


def settled(item: RigidObject, assembly: Assembly, tolerance: float) -> RigidObject:
    """The object moved along gravity and turned by at most 3 degrees, so that its base lies on what is under it.

    Args:
        item: in the frame of the assembly; its base is its lowest facet.
        assembly: without the object.
        tolerance: m, how far scan and assembly may disagree.

    Raises:
        InputError: FLOATING when no surface is that near.
    """
    up = -unit(np.asarray(assembly.gravity))
    middle, base_normal, outline, axes = _base(item, up)
    near = [
        (point, normal)
        for other in assembly.objects
        if other.id != item.id
        for point, normal in _tops(other, up, outline, axes)
        if abs(up @ (point - middle)) <= tolerance
    ]
    if not near:
        raise InputError(
            ErrorCode.FLOATING,
            f"object {item.id} stands on nothing: no surface of the assembly is within {1e3 * tolerance:.0f} mm of its "
            "base; add the table, or correct the transform between the robot and the assembly",
            object=item.id,
        )
    point, normal = max(near, key=lambda each: float(up @ each[0]))
    turn = rotation_between(-base_normal, normal)
    lift = normal @ (point - middle) / (normal @ up) * up
    return replace(item, pose=Pose(turn, middle + lift - turn @ middle) @ item.pose)


def _base(item: RigidObject, up: Array) -> tuple[Array, Array, shapely.Geometry, Array]:
    """The middle, m, and normal of the facet on which an object stands, its outline from above and the axes of that."""
    polyhedron = item.shape.polyhedron
    normals = polyhedron.normals @ item.pose.rotation.T
    down = np.flatnonzero(normals @ up < -np.cos(_LEVEL)).tolist()
    if not down:
        raise InputError(ErrorCode.FLOATING, f"object {item.id} has no base that is level", object=item.id)
    middles = [item.vertices[polyhedron.facet_vertices[facet]].mean(axis=0) for facet in down]
    lowest = int(np.argmin([up @ middle for middle in middles]))
    axes = plane_axes(up)
    outline = polyhedron.polygon(down[lowest], item.vertices, np.zeros(3), axes)
    return middles[lowest], normals[down[lowest]], outline, axes


def _tops(other: RigidObject, up: Array, outline: shapely.Geometry, axes: Array) -> list[tuple[Array, Array]]:
    """A point under an outline, m, and the normal, of each level facet of an object that is below it."""
    polyhedron = other.shape.polyhedron
    normals = polyhedron.normals @ other.pose.rotation.T
    found = []
    for facet in np.flatnonzero(normals @ up > np.cos(_LEVEL)).tolist():
        common = shapely.intersection(polyhedron.polygon(facet, other.vertices, np.zeros(3), axes), outline)
        if common.area <= _LEAST_SUPPORT * outline.area:
            continue
        place = np.array(common.centroid.coords[0]) @ axes
        corner = other.vertices[polyhedron.facet_vertices[facet][0]]
        height = float(normals[facet] @ (corner - place) / (normals[facet] @ up))
        found.append((place + height * up, normals[facet]))
    return found
