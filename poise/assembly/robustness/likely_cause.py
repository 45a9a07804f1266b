"""Why a scene is refused or falls, where one wrong convention explains it: read otherwise, the scene stands."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from poise.assembly.scene import Assembly, Box, Cylinder, Mesh, RigidObject, Sphere
from poise.assembly.settling import settle
from poise.assembly.statics import Analysis, Deadline
from poise.errors import PoiseError
from poise.geometry import Pose, rotation_about
from poise.threads import in_one_thread

_MOST = 60
"""Objects of scenes that are read otherwise: each reading is settled by itself."""
_LIGHT = 0.1
"""kg/m3; what is lighter may be given in mm."""
_SAME = 0.02
"""m between two equal objects that may be one, seen twice."""
_TURN = Pose(rotation_about([1.0, 0.0, 0.0], np.pi / 2), np.zeros(3))


@in_one_thread
def likely_cause(assembly: Assembly, seconds: float = 5.0) -> str | None:
    """A sentence about the convention under which a scene that is refused or falls would stand; None: none was found.

    Args:
        assembly: the objects as they were given, with the uncertainty of their poses.
        seconds: after which no other reading is begun.
    """
    deadline = Deadline.after(seconds)
    for words, read in _readings(assembly) if len(assembly.objects) <= _MOST else ():
        if not deadline.passed and _stands(read):
            return f"{words}, the scene stands"
    return None


def _stands(read: Callable[[], Assembly]) -> bool:
    try:
        settled = settle(read())
        return settled.strain <= 1 and Analysis.of(settled.assembly).stability().stable
    except PoiseError:
        return False


def _readings(assembly: Assembly) -> Iterator[tuple[str, Callable[[], Assembly]]]:
    """Other readings of a scene, in words that begin its sentence."""
    gravity = float(np.linalg.norm(assembly.gravity)) * np.array([0.0, 0.0, -1.0])
    if assembly.gravity @ gravity <= 0:
        yield "with gravity along -z", lambda: replace(assembly, gravity=gravity)
    yield "with quaternions read as w x y z", lambda: _each(assembly, _w_first)
    yield "with poses whose y is up", lambda: _each(assembly, _from_y_up, fixed=True)
    yield "with sizes that are half as large as they should be", lambda: _each(assembly, lambda item: _sized(item, 2.0))
    yield "with poses of the bottoms of objects", lambda: _each(assembly, _from_bottom)
    light = {item.id for item in assembly.objects if not item.fixed and item.mass < _LIGHT * abs(item.shape.volume)}
    if light:
        names = ", ".join(sorted(light)[:3])
        yield f"with lengths of {names} in mm", lambda: _each(assembly, lambda item: _in_mm(item, light))
    for pair in islice(_twice(assembly), len(assembly.objects)):
        yield _once(assembly, pair)


def _each(assembly: Assembly, change: Callable[[RigidObject], RigidObject], fixed: bool = False) -> Assembly:
    """With all objects that may move changed, and fixed ones if so asked."""
    return replace(
        assembly, objects=tuple(change(item) if fixed or not item.fixed else item for item in assembly.objects)
    )


def _w_first(item: RigidObject) -> RigidObject:
    return replace(item, pose=Pose.from_vector(item.pose.vector[[0, 1, 2, 4, 5, 6, 3]]))


def _from_y_up(item: RigidObject) -> RigidObject:
    return replace(item, pose=_TURN @ item.pose)


def _from_bottom(item: RigidObject) -> RigidObject:
    half = np.array([0.0, 0.0, np.ptp(item.vertices[:, 2]) / 2])
    return replace(item, pose=Pose(item.pose.rotation, item.pose.translation + half))


def _in_mm(item: RigidObject, names: set[str]) -> RigidObject:
    return _sized(item, 1e-3) if item.id in names else item


def _sized(item: RigidObject, factor: float) -> RigidObject:
    """The object, larger by a factor about the origin of its frame; of uniform density."""
    shape = item.shape
    if isinstance(shape, Box):
        x, y, z = shape.size
        shape = Box((factor * x, factor * y, factor * z))
    elif isinstance(shape, Cylinder):
        shape = Cylinder(factor * shape.radius, factor * shape.length)
    elif isinstance(shape, Sphere):
        shape = Sphere(factor * shape.radius)
    elif isinstance(shape, Mesh):
        shape = Mesh(factor * np.asarray(shape.polyhedron.vertices), np.asarray(shape.polyhedron.triangles))
    return replace(item, shape=shape, com=None, inertia=None, covariance=None)


def _twice(assembly: Assembly) -> Iterator[tuple[str, str]]:
    """Ids of equal objects in nearly one place."""
    movable = [item for item in assembly.objects if not item.fixed]
    for k, item in enumerate(movable):
        for other in movable[:k]:
            near = float(np.linalg.norm(item.pose.translation - other.pose.translation)) < _SAME
            if near and np.allclose(np.ptp(item.vertices, axis=0), np.ptp(other.vertices, axis=0), atol=_SAME):
                yield other.id, item.id


def _once(assembly: Assembly, pair: tuple[str, str]) -> tuple[str, Callable[[], Assembly]]:
    objects = tuple(item for item in assembly.objects if item.id != pair[1])
    friction = tuple(each for each in assembly.friction_pairs if pair[1] not in each.objects)
    changed = replace(assembly, objects=objects, friction_pairs=friction)
    return f"with {pair[0]} and {pair[1]} as one object that was seen twice", lambda: changed
