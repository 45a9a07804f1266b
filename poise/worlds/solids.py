"""Primitive solids of worlds as shapes: what has no shape of its own in a scene becomes a mesh."""

import numpy as np
import trimesh

from poise.assembly import Box, Cylinder, Mesh, Sphere
from poise.geometry import Pose, plane_axes, unit
from poise.types import Array

_SECTIONS = 64
_SPHERE = 4
_PLANE = (20.0, 20.0, 0.1)
"""m: of the box in place of an infinite plane."""


def plane() -> Box:
    """A plane, as a large box below it; see `below_plane`."""
    return Box(_PLANE)


def below_plane(normal: Array | None = None) -> Pose:
    """Where that box is in the frame of the plane, which goes through its origin; None: the normal is z."""
    upwards = np.array([0.0, 0.0, 1.0]) if normal is None else unit(np.asarray(normal))
    return Pose(np.vstack([plane_axes(upwards), upwards]).T, -_PLANE[2] / 2 * upwards)


def sphere(radius: float) -> Sphere:
    """A sphere about its frame."""
    return Sphere(float(radius))


def ellipsoid(radii: Array) -> Mesh:
    """An ellipsoid about its frame, with half axes along the axes of the frame."""
    ball = trimesh.creation.icosphere(subdivisions=_SPHERE)
    return _mesh(ball.apply_scale(np.asarray(radii)))


def capsule(radius: float, length: float) -> Mesh:
    """A cylinder of a length between two half spheres, along z, about its frame."""
    # Of radius 1: trimesh drops triangles of capsules of a few millimetres.
    found = trimesh.creation.capsule(height=length / radius, radius=1.0, count=[_SECTIONS, _SECTIONS // 2])
    return _mesh(found, centred=True, scale=radius)


def cone(radius: float, length: float) -> Mesh:
    """A cone along z whose frame is at half its height; its tip points upwards."""
    found = trimesh.creation.cone(radius=1.0, height=length / radius, sections=_SECTIONS)
    return _mesh(found.apply_translation([0, 0, -length / radius / 2]), scale=radius)


def box(size: Array) -> Box:
    """A box about its frame, with edges of a size."""
    return Box((float(size[0]), float(size[1]), float(size[2])))


def cylinder(radius: float, length: float) -> Cylinder:
    """A cylinder along z about its frame."""
    return Cylinder(float(radius), float(length))


def _mesh(surface: trimesh.Trimesh, centred: bool = False, scale: float = 1.0) -> Mesh:
    vertices = scale * np.asarray(surface.vertices)
    if centred:
        vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return Mesh(vertices, np.asarray(surface.faces, dtype=np.int64))
