"""Primitive solids of worlds as shapes: what has no shape of its own in a scene becomes a mesh."""

import numpy as np
import trimesh

from poise.assembly import Box, Cylinder, Mesh, Sphere
from poise.types import Array

_SECTIONS = 64
_SPHERE = 4
_PLANE = (20.0, 20.0, 0.1)
"""m: of the box in place of an infinite plane."""
PLANE_DEPTH = _PLANE[2] / 2
"""m by which the middle of that box is below the plane."""


def plane() -> Box:
    """A plane, as a large box below it."""
    return Box(_PLANE)


def sphere(radius: float) -> Sphere:
    """A sphere about its frame."""
    return Sphere(float(radius))


def ellipsoid(radii: Array) -> Mesh:
    """An ellipsoid about its frame, with half axes along the axes of the frame."""
    ball = trimesh.creation.icosphere(subdivisions=_SPHERE)
    return _mesh(ball.apply_scale(np.asarray(radii)))


def capsule(radius: float, length: float) -> Mesh:
    """A cylinder of a length between two half spheres, along z, about its frame."""
    return _mesh(
        trimesh.creation.capsule(height=length, radius=radius, count=[_SECTIONS, _SECTIONS // 2]), centred=True
    )


def cone(radius: float, length: float) -> Mesh:
    """A cone along z whose frame is at half its height; its tip points upwards."""
    found = trimesh.creation.cone(radius=radius, height=length, sections=_SECTIONS)
    return _mesh(found.apply_translation([0, 0, -length / 2]))


def box(size: Array) -> Box:
    """A box about its frame, with edges of a size."""
    return Box((float(size[0]), float(size[1]), float(size[2])))


def cylinder(radius: float, length: float) -> Cylinder:
    """A cylinder along z about its frame."""
    return Cylinder(float(radius), float(length))


def _mesh(surface: trimesh.Trimesh, centred: bool = False) -> Mesh:
    vertices = np.asarray(surface.vertices)
    if centred:
        vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return Mesh(vertices, np.asarray(surface.faces, dtype=np.int64))
