"""Where bodies come to rest: they fall until they touch, and tip over until their weight is supported."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import coal
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from poise.assembly import RigidObject
from poise.assembly.scene import Shape
from poise.geometry import Pose, rotation_about
from poise.types import Array

_FAR = 3.0
"""m: what falls farther has left the world."""
_STEP = 0.005
"""m of a fall between two looks."""
_CLOSE = 1e-6
"""m to which contact is found."""
_TOUCH = 2e-4
"""m by which a body is lowered to see where it touches."""
_INSET = 5e-4
"""m by which the centre of mass has to be inside its support."""
_TILT = 0.05
"""rad of a tipping motion between two looks."""
_FINEST = 1e-5
"""rad to which the angle is found at which a tipping body touches again."""
_LIFT = 5e-5
"""m by which a body is raised before it tips, because its pivot is known to `_TOUCH`."""
_SLIDE = 0.002
"""m that a body slides where it can neither stand nor tip."""
_MOST_TILTS = 400
_MOST_POINTS = 400


@lru_cache(maxsize=256)
def _surface(shape: Shape) -> "coal.BVHModelOBBRSS":
    polyhedron = shape.polyhedron
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(polyhedron.triangles), len(polyhedron.vertices))
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    vertices.extend(list(polyhedron.vertices))
    triangles.extend([coal.Triangle(*(int(corner) for corner in each)) for each in polyhedron.triangles])
    model.addSubModel(vertices, triangles)
    model.endModel()
    return model


class Surroundings:
    """Bodies that do not move, against which one is moved.

    Args:
        bodies: at their poses.
    """

    def __init__(self, bodies: Sequence[RigidObject]) -> None:
        self._bodies = [
            (_surface(body.shape), coal.Transform3s(body.pose.rotation, body.pose.translation)) for body in bodies
        ]
        self._low = np.array([body.vertices.min(axis=0) for body in bodies]).reshape(-1, 3)
        self._high = np.array([body.vertices.max(axis=0) for body in bodies]).reshape(-1, 3)

    def touched(self, item: RigidObject, pose: Pose, most: int = 1) -> Array:
        """(N, 3) points, at most so many for each body, at which the surface of a body at a pose meets the others."""
        vertices = pose.apply(item.shape.polyhedron.vertices)
        near = np.flatnonzero(
            np.all((self._low <= vertices.max(axis=0)) & (self._high >= vertices.min(axis=0)), axis=1)
        )
        request, place = coal.CollisionRequest(), coal.Transform3s(pose.rotation, pose.translation)
        request.enable_contact, request.num_max_contacts = most > 1, most
        points: list[Array] = []
        for number in near:
            result = coal.CollisionResult()
            if coal.collide(_surface(item.shape), place, *self._bodies[number], request, result):
                found = range(result.numContacts()) if most > 1 else ()
                points += [result.getContact(i).pos for i in found] or [pose.translation]
        return np.reshape(points, (-1, 3))

    def free(self, item: RigidObject, pose: Pose) -> bool:
        """The surface of the body meets no other."""
        return not len(self.touched(item, pose))

    def gap(self, item: RigidObject, most: float) -> float:
        """m that a body can be lowered until it touches; negative: that it has to be raised. Within +-most."""
        height = next(
            (up for up in (0.0, most / 8, most / 4, most / 2) if self.free(item, _moved(item.pose, up))), most
        )
        return self._fall(item, _moved(item.pose, height), height + most) - height

    def drop(self, item: RigidObject) -> RigidObject | None:
        """The body lowered until it touches; None when it touches nothing."""
        way = self._fall(item, item.pose, _FAR)
        return None if way >= _FAR else replace(item, pose=_moved(item.pose, -way))

    def _fall(self, item: RigidObject, pose: Pose, most: float) -> float:
        """m of a fall that is free, at most `most`."""
        free, blocked = 0.0, most
        if not self._low.size:
            return most
        for step in range(1, int(np.ceil(most / _STEP)) + 1):
            blocked = min(step * _STEP, most)
            if not self.free(item, _moved(pose, -blocked)):
                break
            free = blocked
            if pose.apply(item.shape.polyhedron.vertices)[:, 2].max() - free < self._low[:, 2].min():
                return most
        else:
            return most
        while blocked - free > _CLOSE:
            middle = (free + blocked) / 2
            free, blocked = (middle, blocked) if self.free(item, _moved(pose, -middle)) else (free, middle)
        return free


def come_to_rest(item: RigidObject, bodies: Sequence[RigidObject]) -> RigidObject | None:
    """Where a body comes to rest among others that stay.

    It falls straight down until it touches. While its centre of mass is beside the hull of the points where it
    touches, it tips over the nearest point of that hull. There is no bouncing, sliding or rolling on.

    Args:
        item: released at its pose, in a frame whose z axis points up.
        bodies: all others.

    Returns:
        The body at its last pose; None when it leaves the world.
    """
    around = Surroundings(bodies)
    item = _raised(item, around)
    for _ in range(_MOST_TILTS):
        lowered = around.drop(item)
        if lowered is None:
            return None
        item = lowered
        touched = around.touched(item, _moved(item.pose, -_TOUCH), _MOST_POINTS)
        pivot = _pivot(item.com_in_world, touched)
        if pivot is None:
            return item
        item = _tilted(item, around, pivot)
    return item


def _raised(item: RigidObject, around: Surroundings) -> RigidObject:
    """Free of what it was pressed against."""
    for height in (0.0, _CLOSE, *np.geomspace(1e-4, 0.02, 8)):
        pose = _moved(item.pose, height)
        if around.free(item, pose):
            return replace(item, pose=pose)
    return item


def _pivot(com: Array, touched: Array) -> Array | None:
    """(3,) over which a body tips; None when its centre of mass is over the hull of the points where it touches."""
    flat = touched[:, :2]
    try:
        hull = ConvexHull(flat)
        if np.all(hull.equations[:, :2] @ com[:2] + hull.equations[:, 2] <= -_INSET):
            return None
        ends = np.stack([flat[hull.simplices[:, 0]], flat[hull.simplices[:, 1]]])
    except (QhullError, ValueError):  # a point, or a line
        ends = np.stack([flat, flat[::-1]])
    run = ends[1] - ends[0]
    share = np.einsum("ij,ij->i", com[:2] - ends[0], run) / np.maximum(np.einsum("ij,ij->i", run, run), 1e-18)
    nearest = ends[0] + np.clip(share, 0, 1)[:, None] * run
    beside = nearest[np.argmin(np.linalg.norm(nearest - com[:2], axis=1))]
    return np.array([*beside, touched[np.argmin(np.linalg.norm(flat - beside, axis=1)), 2]])


def _tilted(item: RigidObject, around: Surroundings, pivot: Array) -> RigidObject:
    """A little tipped over a point, as far as it is free there."""
    lever = item.com_in_world - pivot
    out = np.array([lever[0], lever[1], 0.0])
    length = np.linalg.norm(out)
    out = out / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    axis = np.array([-out[1], out[0], 0.0])
    pose = _moved(item.pose, _LIFT)

    def turned(angle: float) -> Pose:
        turn = rotation_about(axis, angle)
        return Pose(turn @ pose.rotation, turn @ (pose.translation - pivot) + pivot)

    free, blocked = 0.0, _TILT
    if around.free(item, turned(blocked)):
        free = blocked
    while blocked - free > _FINEST:
        middle = (free + blocked) / 2
        free, blocked = (middle, blocked) if around.free(item, turned(middle)) else (free, middle)
    if free > 10 * _FINEST:
        return replace(item, pose=turned(free))
    # It cannot turn: it slides off, or over what it is caught on.
    slides = (Pose(pose.rotation, pose.translation + _SLIDE * out + [0.0, 0.0, height]) for height in (0.0, 1e-3, 4e-3))
    return replace(item, pose=next((slid for slid in slides if around.free(item, slid)), _moved(pose, _STEP)))


def _moved(pose: Pose, height: float) -> Pose:
    return Pose(pose.rotation, pose.translation + np.array([0.0, 0.0, height]))
