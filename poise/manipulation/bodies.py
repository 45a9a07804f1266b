"""Rigid objects as coal's geometries, and poses as pinocchio's."""

from collections.abc import Hashable
from functools import lru_cache
from typing import cast

import coal
import numpy as np
import pinocchio as pin

from poise.assembly import Box, Cylinder, Sphere
from poise.assembly.contact import convex_geometry
from poise.assembly.scene import Shape
from poise.geometry import Pose


def se3_of(pose: Pose) -> pin.SE3:
    """The same pose, as pinocchio has it."""
    return pin.SE3(pose.rotation, pose.translation)


def pose_of(se3: pin.SE3) -> Pose:
    """The same pose, as the assembly has it."""
    return Pose(np.array(se3.rotation), np.array(se3.translation))


def geometry_of(shape: Shape) -> coal.CollisionGeometry:
    """What coal asks about: solid where the shape is convex, its surface otherwise."""
    if isinstance(shape, Box | Cylinder | Sphere) or shape.polyhedron.convex:
        return convex_geometry(cast(Hashable, shape))
    return _surface(cast(Hashable, shape))


@lru_cache(maxsize=256)
def _surface(shape: Hashable) -> coal.CollisionGeometry:
    polyhedron = cast(Shape, shape).polyhedron
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(polyhedron.triangles), len(polyhedron.vertices))
    surface.addVertices(polyhedron.vertices)
    surface.addTriangles(polyhedron.triangles)
    surface.endModel()
    return surface


def overlap(
    first: coal.CollisionGeometry, at_first: pin.SE3, second: coal.CollisionGeometry, at_second: pin.SE3, margin: float
) -> bool:
    """Whether two geometries come closer than a margin, m."""
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.security_margin = margin
    places = [coal.Transform3s(place.rotation, place.translation) for place in (at_first, at_second)]
    return bool(coal.collide(first, places[0], second, places[1], request, result))
