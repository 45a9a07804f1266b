"""Other readings of a scene: by another unit, convention or origin, of all objects or of a single one."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice, permutations
from typing import NamedTuple

import numpy as np

from poise.assembly.scene import MATTER, Assembly, Box, Cylinder, Mesh, RigidObject, Sphere
from poise.geometry import Pose, rotation_about
from poise.types import Array

_UNITS = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254}
"""m."""
_FAR = 3.0
"""m from the origin; what is farther may be given in mm."""
_SAME = 0.02
"""m between two equal objects that may be one, seen twice."""
_TURNED = 0.05
"""Entry of a quaternion other than w from which its order matters."""

_TALL = 0.04
"""Share of a height by which those of bodies that are equally tall may differ, as a camera measures them."""
_UPRIGHT = 0.95
"""Cosine of the angle of a side to the vertical from which its length is the height."""

_Change = Callable[[RigidObject], RigidObject]


class SceneReading(NamedTuple):
    """What else may be meant, in words after "the scene stands if"; and the assembly that is then meant."""

    words: str
    read: Callable[[], Assembly]


def readings_of_all(assembly: Assembly) -> Iterator[SceneReading]:
    """One convention for all objects."""
    movable = [item for item in assembly.objects if not item.fixed]
    if assembly.largest_friction == 0:
        yield SceneReading("friction is not 0 but 0.5", lambda: replace(assembly, friction=0.5, friction_pairs=()))
    for pair in islice(_twice(movable), len(assembly.objects)):
        yield _once(assembly, pair)
    yield from _frames(assembly)
    yield from _equally_tall(assembly, movable)
    light = [item.id for item in movable if _may_be(item, _UNITS["mm"])]
    if light:
        if len(light) == len(movable):
            yield _read(assembly, "all lengths are in mm", [item.id for item in assembly.objects], _in_mm)
        yield _read(assembly, f"sizes of {', '.join(light[:3])} are in mm", light, _times(1e-3))
    names = [item.id for item in movable]
    for words, change in _CONVENTIONS:
        yield _read(assembly, words, names, change)
    for order in _ORDERS:
        yield _read(assembly, f"sides are in another order ({_named(order)})", names, _in_order(order))


def readings_of_one(assembly: Assembly, name: str) -> Iterator[SceneReading]:
    """Another unit, convention or origin of one object."""
    item = assembly.objects[assembly.index[name]]
    for words, change in (*_units_of(item), *_conventions_of(item), *_shapes_of(item)):
        yield _read(assembly, words, [name], change)


def _read(assembly: Assembly, words: str, names: Sequence[str], change: _Change) -> SceneReading:
    return SceneReading(words, lambda: _changed(assembly, names, change))


def _units_of(item: RigidObject) -> Iterator[tuple[str, _Change]]:
    for unit, metres in _UNITS.items():
        if _may_be(item, metres):
            yield f"sizes of {item.id} are in {unit}", _times(metres)
        if _may_be(item, 1 / metres):
            words = f"sizes of {item.id} are {1 / metres:.4g} times too small, as {unit} that were scaled twice"
            yield words, _times(1 / metres)
    if _may_be(item, _UNITS["mm"]):
        yield f"all lengths of {item.id} are in mm", _in_mm
    if float(np.linalg.norm(item.pose.translation)) > _FAR:
        yield f"the position of {item.id} is in mm", _position_in_mm


def _conventions_of(item: RigidObject) -> Iterator[tuple[str, _Change]]:
    if item.com is not None:
        yield f"the centre of mass of {item.id} is that of its shape", lambda item: replace(item, com=None)
    if np.abs(item.pose.vector[3:6]).max() > _TURNED:
        yield f"the quaternion of {item.id} is w x y z", _w_first
    yield f"the pose of {item.id} is that of its bottom", _from_bottom
    yield f"the pose of {item.id} is that of its middle, and its shape begins at a corner", _centred


def _shapes_of(item: RigidObject) -> Iterator[tuple[str, _Change]]:
    yield f"sizes of {item.id} are half as large as they should be", _times(2.0)
    yield f"sizes of {item.id} are twice as large as they should be", _times(0.5)
    if isinstance(item.shape, Cylinder):
        radius, length = item.shape.radius, item.shape.length
        yield f"radius and length of {item.id} are in the other order", _as_cylinder(length, radius)
        yield f"the radius of {item.id} is its diameter", _as_cylinder(radius / 2, length)
        yield f"the length of {item.id} is half of it", _as_cylinder(radius, 2 * length)
        yield f"the axis of {item.id} is its x", _about([0.0, 1.0, 0.0])
        yield f"the axis of {item.id} is its y", _about([1.0, 0.0, 0.0])
    for order in _ORDERS if isinstance(item.shape, Box | Mesh) else ():
        yield f"sides of {item.id} are in another order ({_named(order)})", _in_order(order)


def _frames(assembly: Assembly) -> Iterator[SceneReading]:
    """With other directions that are up."""
    strength = float(np.linalg.norm(assembly.gravity))
    for word, axis in _AXES.items():
        gravity = -strength * np.array(axis, dtype=np.float64)
        if assembly.gravity @ gravity < 0.5 * strength**2 and _over_support(assembly, gravity):
            yield _under(assembly, "gravity is along -z" if word == "z" else f"{word} is up in all poses", gravity)


def _under(assembly: Assembly, words: str, gravity: Array) -> SceneReading:
    return SceneReading(words, lambda: replace(assembly, gravity=gravity))


def _over_support(assembly: Assembly, gravity: Array) -> bool:
    """Whether the common centre of mass of what may move is over or under the bounds of what is fixed."""
    movable = [item for item in assembly.objects if not item.fixed]
    points = np.concatenate([item.vertices for item in assembly.objects if item.fixed])
    com = np.average([item.com_in_world for item in movable], axis=0, weights=[item.mass for item in movable])
    level = gravity == 0
    return bool(np.all((points.min(axis=0) <= com)[level]) and np.all((points.max(axis=0) >= com)[level]))


_AXES = {"z": (0, 0, 1), "y": (0, 1, 0), "-y": (0, -1, 0), "x": (1, 0, 0), "-x": (-1, 0, 0)}
_ORDERS = [order for order in permutations(range(3)) if order != (0, 1, 2)]


def _named(order: Sequence[int]) -> str:
    return " ".join("xyz"[axis] for axis in order)


def _may_be(item: RigidObject, factor: float) -> bool:
    """Whether an object has the density of no matter, but one of matter if its sizes are larger by a factor."""
    density = item.mass / abs(item.shape.volume)
    least, most = MATTER
    return not least < density < most and least < density / factor**3 < most


def _changed(assembly: Assembly, names: Sequence[str], change: _Change) -> Assembly:
    return replace(assembly, objects=tuple(change(item) if item.id in names else item for item in assembly.objects))


def _moved(item: RigidObject, by: Array) -> RigidObject:
    return replace(item, pose=Pose(item.pose.rotation, item.pose.translation + by))


def _half(vertices: Array) -> Array:
    return np.asarray(np.ptp(vertices, axis=0) / 2)


def _w_first(item: RigidObject) -> RigidObject:
    return replace(item, pose=Pose.from_vector(item.pose.vector[[0, 1, 2, 4, 5, 6, 3]]))


def _position_in_mm(item: RigidObject) -> RigidObject:
    return _moved(item, -0.999 * item.pose.translation)


def _times(factor: float) -> _Change:
    return lambda item: _sized(item, factor)


def _in_order(order: Sequence[int]) -> _Change:
    return lambda item: _turned(item, order)


def _as_cylinder(radius: float, length: float) -> _Change:
    return lambda item: _uniform(replace(item, shape=Cylinder(radius, length)))


def _about(axis: Sequence[float]) -> _Change:
    turn = Pose(rotation_about(axis, np.pi / 2), np.zeros(3))
    return lambda item: replace(item, pose=item.pose @ turn)


def _from_bottom(item: RigidObject) -> RigidObject:
    return _moved(item, _half(item.vertices) * [0, 0, 1])


def _in_mm(item: RigidObject) -> RigidObject:
    return _position_in_mm(_sized(item, 1e-3))


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
    return _uniform(replace(item, shape=shape))


def _turned(item: RigidObject, order: Sequence[int]) -> RigidObject:
    """The object with the sides of its box, or the axes of its mesh, in another order; of uniform density."""
    shape = item.shape
    if isinstance(shape, Box):
        x, y, z = (shape.size[axis] for axis in order)
        return _uniform(replace(item, shape=Box((x, y, z))))
    turn = np.eye(3)[list(order)]
    if isinstance(shape, Mesh):
        turn = turn * np.linalg.det(turn)
        vertices, triangles = np.asarray(shape.polyhedron.vertices), np.asarray(shape.polyhedron.triangles)
        return _uniform(replace(item, shape=Mesh(vertices @ turn.T, triangles)))
    return item


def _centred(item: RigidObject) -> RigidObject:
    """The object whose pose is that of the middle of its bounding box."""
    vertices = item.shape.polyhedron.vertices
    return _moved(item, -item.pose.rotation @ (vertices.min(axis=0) + _half(vertices)))


def _uniform(item: RigidObject) -> RigidObject:
    return replace(item, com=None, inertia=None, covariance=None)


def _equally_tall(assembly: Assembly, movable: Sequence[RigidObject]) -> Iterator[SceneReading]:
    """Boxes and cylinders of nearly one height, as supports of a board, have the same one."""
    up = -np.asarray(assembly.gravity) / np.linalg.norm(assembly.gravity)
    upright = {item.id: found for item in movable if (found := _upright(item, up)) is not None}
    heights = {name: length for name, (_, length) in upright.items()}
    groups: list[list[str]] = []
    for name in sorted(heights, key=heights.__getitem__):
        if groups and heights[name] < (1.0 + _TALL) * heights[groups[-1][0]]:
            groups[-1].append(name)
        else:
            groups.append([name])
    near = [group for group in groups if heights[group[-1]] > 1.001 * heights[group[0]]]
    if near:
        means = {name: float(np.mean([heights[one] for one in group])) for group in near for name in group}
        known = ", ".join(f"{1e3 * heights[name]:.1f}" for name in near[0][:3])
        words = f"{', '.join(near[0][:3])} are equally tall (not {known} mm)"
        yield _read(assembly, words, list(means), lambda item: _as_long(item, upright[item.id][0], means[item.id]))


def _upright(item: RigidObject, up: Array) -> tuple[int, float] | None:
    """Which side of a box, or the axis of a cylinder, is upright, and its length; None for other shapes and poses."""
    along = np.abs(item.pose.rotation.T @ up)
    side = int(np.argmax(along))
    if isinstance(item.shape, Box):
        length = item.shape.size[side]
    elif isinstance(item.shape, Cylinder) and side == 2:
        length = item.shape.length
    else:
        return None
    return (side, float(length)) if along[side] > _UPRIGHT else None


def _as_long(item: RigidObject, side: int, length: float) -> RigidObject:
    """A box with another side, or a cylinder with another length."""
    if isinstance(item.shape, Cylinder):
        return replace(item, shape=Cylinder(item.shape.radius, length))
    if isinstance(item.shape, Box):
        x, y, z = (length if axis == side else size for axis, size in enumerate(item.shape.size))
        return replace(item, shape=Box((x, y, z)))
    return item


_CONVENTIONS: tuple[tuple[str, _Change], ...] = (
    ("quaternions are w x y z", _w_first),
    ("sizes are half as large as they should be", _times(2.0)),
    ("poses are those of the bottoms of objects", _from_bottom),
    ("sizes are twice as large as they should be", _times(0.5)),
    ("positions are in mm", _position_in_mm),
    ("poses are the inverse ones, of the world in the object", lambda item: replace(item, pose=item.pose.inverse)),
    ("poses are those of the lowest corners of objects", lambda item: _moved(item, _half(item.vertices))),
)
"""Of all objects."""


def _twice(movable: Sequence[RigidObject]) -> Iterator[tuple[str, str]]:
    """Ids of equal objects in nearly one place."""
    for k, item in enumerate(movable):
        for other in movable[:k]:
            near = float(np.linalg.norm(item.pose.translation - other.pose.translation)) < _SAME
            if near and np.allclose(np.ptp(item.vertices, axis=0), np.ptp(other.vertices, axis=0), atol=_SAME):
                yield other.id, item.id


def _once(assembly: Assembly, pair: tuple[str, str]) -> SceneReading:
    words = f"{pair[0]} and {pair[1]} are one object that was seen twice"
    return SceneReading(words, lambda: assembly.without(pair[1]))
