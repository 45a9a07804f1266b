"""Ways to break a perceived scene: what people and converters get wrong in units, conventions and numbers."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from poise.assembly import Assembly, Box, Cylinder, FrictionPair, Mesh, RigidObject
from poise.assembly.scene import with_pose_covariance
from poise.geometry import Pose, rotation_about
from poise.types import Array

_DEG = np.degrees


@dataclass(frozen=True, eq=False)
class Broken:
    """The true scene, and the one that is given."""

    truth: Assembly
    given: Assembly


Break = Callable[[Assembly, Assembly, np.random.Generator], Broken]
"""Of the true scene and the one seen."""


def _movable(scene: Assembly) -> list[int]:
    return [place for place, item in enumerate(scene.objects) if not item.fixed]


def _one(change: Callable[[RigidObject, np.random.Generator], RigidObject]) -> Break:
    """One random object is changed where it is seen."""

    def broken(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
        place, items = int(rng.choice(_movable(given))), list(given.objects)
        items[place] = change(items[place], rng)
        return Broken(truth, replace(given, objects=tuple(items)))

    return broken


def _each(change: Callable[[RigidObject], RigidObject]) -> Break:
    """All objects are changed where they are seen."""
    return lambda truth, given, _: Broken(truth, replace(given, objects=tuple(map(change, given.objects))))


def _scene(**changes: Callable[[Assembly], object]) -> Break:
    """Entries of the scene are changed."""

    def broken(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
        return Broken(truth, replace(given, **{name: change(given) for name, change in changes.items()}))

    return broken


def _moved(item: RigidObject, by: Array) -> RigidObject:
    return replace(item, pose=Pose(item.pose.rotation, item.pose.translation + by))


def _level(size: float) -> Callable[[RigidObject, np.random.Generator], RigidObject]:
    def moved(item: RigidObject, rng: np.random.Generator) -> RigidObject:
        angle = rng.uniform(-np.pi, np.pi)
        return _moved(item, size * np.array([np.cos(angle), np.sin(angle), 0.0]))

    return moved


def _scaled(item: RigidObject, factor: float) -> RigidObject:
    if isinstance(item.shape, Box):
        return replace(item, shape=Box(tuple(factor * side for side in item.shape.size)))
    if isinstance(item.shape, Cylinder):
        return replace(item, shape=Cylinder(factor * item.shape.radius, factor * item.shape.length))
    return item


def _mesh_in_mm(item: RigidObject, _: np.random.Generator) -> RigidObject:
    solid = item.shape.polyhedron
    return replace(item, shape=Mesh(1000 * np.asarray(solid.vertices), np.asarray(solid.triangles)))


def _in_mm(item: RigidObject) -> RigidObject:
    return replace(_scaled(item, 1000.0), pose=Pose(item.pose.rotation, 1000 * item.pose.translation))


def _w_first(item: RigidObject) -> RigidObject:
    vector = item.pose.vector
    return (
        item if item.fixed else replace(item, pose=Pose.from_vector(np.concatenate([vector[:3], vector[[6, 3, 4, 5]]])))
    )


def _turned(item: RigidObject) -> RigidObject:
    turn = rotation_about([1.0, 0.0, 0.0], -np.pi / 2)
    return replace(item, pose=Pose(turn @ item.pose.rotation, turn @ item.pose.translation))


def _at_bottom(item: RigidObject) -> RigidObject:
    half = np.ptp(item.vertices[:, 2]) / 2
    return item if item.fixed else _moved(item, np.array([0.0, 0.0, -half]))


def _solid(item: RigidObject, change: Callable[[Array], Array]) -> RigidObject:
    """The object as a mesh whose vertices (V, 3) are changed."""
    solid = item.shape.polyhedron
    return replace(item, shape=Mesh(change(np.asarray(solid.vertices)), np.asarray(solid.triangles)))


def _y_up_mesh(item: RigidObject, _: np.random.Generator) -> RigidObject:
    return _solid(item, lambda vertices: vertices @ rotation_about([1.0, 0.0, 0.0], -np.pi / 2).T)


def _from_corner(item: RigidObject, _: np.random.Generator) -> RigidObject:
    return _solid(item, lambda vertices: vertices - vertices.min(axis=0))


def _sides_reversed(item: RigidObject) -> RigidObject:
    if isinstance(item.shape, Box) and not item.fixed:
        return replace(item, shape=Box(item.shape.size[::-1]))
    return item


def _as_density(item: RigidObject) -> RigidObject:
    return item if item.fixed else replace(item, mass=item.mass / item.shape.volume)


def _com_from_corner(item: RigidObject, _: np.random.Generator) -> RigidObject:
    return replace(item, com=np.ptp(item.shape.polyhedron.vertices, axis=0) / 2)


def _inertia_from_corner(item: RigidObject, _: np.random.Generator) -> RigidObject:
    half = np.ptp(item.shape.polyhedron.vertices, axis=0) / 2
    about_corner = item.shape.inertia_per_mass + half @ half * np.eye(3) - np.outer(half, half)
    return replace(item, inertia=item.mass * about_corner)


def _in_a_camera(item: RigidObject) -> RigidObject:
    """Poses in the frame of a level camera: x to the right, y down, z forward."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return replace(item, pose=Pose(turn @ item.pose.rotation, turn @ item.pose.translation))


def _friction_of_pairs(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    names = [item.id for item in truth.objects]
    pairs = tuple(
        FrictionPair((one, other), float(truth.friction_between(one, other) * rng.uniform(0.7, 1.3)))
        for k, one in enumerate(names)
        for other in names[:k]
    )
    return Broken(replace(truth, friction_pairs=pairs), given)


def _without_support(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    """What lies lowest under the highest object is missing."""
    movable = _movable(given)
    heights = [given.objects[place].vertices[:, 2].min() for place in movable]
    missing = movable[int(np.argmin(heights))]
    return Broken(truth, replace(given, objects=tuple(item for k, item in enumerate(given.objects) if k != missing)))


def _twice(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    item = given.objects[int(rng.choice(_movable(given)))]
    again = replace(_moved(item, rng.normal(size=3) * 0.003), id=f"{item.id}_again")
    return Broken(truth, replace(given, objects=(*given.objects, again)))


def _noisier(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    """The errors are four times those stated."""
    bare = [replace(item, pose_covariance=None) for item in given.objects]
    stated = next(item.pose_covariance for item in given.objects if item.pose_covariance is not None)
    return Broken(truth, replace(given, objects=with_pose_covariance(bare, np.asarray(stated) / 16)))


def _mass_stated(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    """All masses have a deviation of 20 %, and one is 30 % off."""
    broken = BREAKS["one mass 30 % off"].change(truth, given, rng)
    items = [item if item.fixed else replace(item, covariance=_of_mass(item, 0.2)) for item in broken.given.objects]
    return Broken(truth, replace(broken.given, objects=tuple(items)))


def _of_mass(item: RigidObject, share: float) -> Array:
    """(10, 10) covariance where only the mass is uncertain, by a share of it; the centre of mass stays."""
    com = item.shape.centroid if item.com is None else item.com
    first = np.concatenate([[1.0], com, np.zeros(6)]) * share * item.mass
    return np.outer(first, first)


def _friction_stated(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    """All pairs have a deviation of 20 % of their friction, which is up to 30 % off."""
    broken = _friction_of_pairs(truth, given, rng)
    stated = float(truth.largest_friction)
    pairs = tuple(FrictionPair(pair.objects, stated, 0.2 * stated) for pair in broken.truth.friction_pairs)
    return Broken(broken.truth, replace(given, friction_pairs=pairs))


@dataclass(frozen=True)
class Kind:
    """One way to break a scene.

    Args:
        change: what is done.
        contradicted: whether the scene itself then contradicts it.
        cause: words of the sentence of `likely_cause` that is right; empty where none is.
    """

    change: Break
    contradicted: bool = False
    cause: str = ""


BREAKS: dict[str, Kind] = {
    "as stated": Kind(_scene()),
    "one mass 30 % off": Kind(
        _one(lambda item, rng: replace(item, mass=item.mass * float(rng.choice([0.7, 1.3])))),
    ),
    "the same, 20 % stated": Kind(_mass_stated),
    "friction of contacts 30 % off": Kind(_friction_of_pairs),
    "the same friction, 20 % stated": Kind(_friction_stated),
    "one pose 20 mm off": Kind(_one(_level(0.02)), cause="pose of"),
    "errors 4 times those stated": Kind(_noisier, cause="times as large"),
    "support missing": Kind(_without_support, True),
    "one object 5 mm too low": Kind(_one(lambda item, _: _moved(item, np.array([0, 0, -0.005]))), cause="pose of"),
    "one object 15 mm too low": Kind(_one(lambda item, _: _moved(item, np.array([0, 0, -0.015]))), True, "pose of"),
    "one mesh in mm": Kind(_one(_mesh_in_mm), True, "in mm"),
    "one half size": Kind(_one(lambda item, _: _scaled(item, 0.5)), True, "half as large"),
    "all in mm": Kind(_each(_in_mm), True, "in mm"),
    "half sizes": Kind(_each(lambda item: item if item.fixed else _scaled(item, 0.5)), True, "half as large"),
    "masses in g": Kind(_each(lambda item: replace(item, mass=1000 * item.mass)), True),
    "gravity along y": Kind(_scene(gravity=lambda _: np.array([0.0, -9.81, 0.0])), True, "gravity is along -z"),
    "gravity upwards": Kind(_scene(gravity=lambda _: np.array([0.0, 0.0, 9.81])), True, "gravity is along -z"),
    "poses with y up": Kind(_each(_turned), True, "y is up in all"),
    "quaternions w first": Kind(_each(_w_first), True, "w x y z"),
    "poses of the bottom": Kind(_each(_at_bottom), True, "bottoms"),
    "one object twice": Kind(_twice, True, "seen twice"),
    "friction in degrees": Kind(_scene(friction=lambda scene: float(_DEG(np.arctan(scene.friction)))), True, "degrees"),
    "one size in mm": Kind(_one(lambda item, _: _scaled(item, 1000.0)), True, "in mm"),
    "one object in mm": Kind(_one(lambda item, _: _in_mm(item)), True, "in mm"),
    "one position in mm": Kind(_one(lambda item, _: _moved(item, 999 * item.pose.translation)), True, "in mm"),
    "one mesh in cm": Kind(_one(lambda item, _: _solid(item, lambda vertices: 100 * vertices)), True, "in cm"),
    "one mesh in inches": Kind(_one(lambda item, _: _solid(item, lambda vertices: vertices / 0.0254)), True, "inches"),
    "one mesh scaled by 0.001": Kind(
        _one(lambda item, _: _solid(item, lambda vertices: vertices / 1000)), True, "1000 times"
    ),
    "one size twice as large": Kind(_one(lambda item, _: _scaled(item, 2.0)), True, "twice as large"),
    "sizes twice as large": Kind(
        _each(lambda item: item if item.fixed else _scaled(item, 2.0)), True, "twice as large"
    ),
    "one quaternion w first": Kind(_one(lambda item, _: _w_first(item)), cause="w x y z"),
    "one mesh with y up": Kind(_one(_y_up_mesh), True, "another order"),
    "one mesh from its corner": Kind(_one(_from_corner), True, "corner"),
    "one pose of the bottom": Kind(_one(lambda item, _: _at_bottom(item)), True, "bottom"),
    "sides in another order": Kind(_each(_sides_reversed), True, "another order"),
    "poses inverted": Kind(
        _each(lambda item: item if item.fixed else replace(item, pose=item.pose.inverse)), True, "inverse"
    ),
    "poses of a camera": Kind(_each(_in_a_camera), True, "-y is up"),
    "one pose missing": Kind(_one(lambda item, _: replace(item, pose=Pose.identity())), True, "0 0 0 0 0 0 1"),
    "no friction": Kind(_scene(friction=lambda _: 0.0), True, "friction is not 0"),
    "masses are densities": Kind(_each(_as_density)),
    "masses of 1 kg": Kind(_each(lambda item: replace(item, mass=1.0))),
    "one centre of mass from a corner": Kind(_one(_com_from_corner), True, "centre of mass"),
    "one inertia from a corner": Kind(_one(_inertia_from_corner), True),
    "gravity in g": Kind(_scene(gravity=lambda _: np.array([0.0, 0.0, -1.0])), True),
}
"""By name."""
