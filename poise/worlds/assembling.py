"""Bodies of a world as the objects of an assembly: one shape each, masses, and friction of pairs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from poise.assembly import Assembly, Box, FrictionPair, Mesh, RigidObject
from poise.assembly.scene import Shape
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.shape import check_mesh
from poise.worlds.base import WorldBody, WorldContent

_FLOOR = "floor"
_FLOOR_SIZE = (20.0, 20.0, 0.1)


def assembled(
    world: WorldContent,
    masses: Mapping[str, float] | None = None,
    friction: float | None = None,
    floor: float | None = None,
) -> tuple[Assembly, tuple[str, ...]]:
    """An assembly of the bodies of a world.

    Args:
        world: the bodies.
        masses: kg, by name; they replace those of the file.
        friction: Coulomb coefficient of all pairs; None: that of the file.
        floor: m, height of a fixed floor that is added; None: none.

    Returns:
        The assembly, and what was assumed, one sentence each.

    Raises:
        InputError: OBJECT_UNKNOWN for a mass of no object; MESH_INVALID for shapes that form no solid; as `Assembly`.
    """
    masses = masses or {}
    if unknown := set(masses) - {body.name for body in world.bodies}:
        there = ", ".join(body.name for body in world.bodies[:8])
        what = f"masses: there is no {', '.join(sorted(unknown))}; there are {there}"
        raise InputError(ErrorCode.OBJECT_UNKNOWN, what)
    notes = list(world.notes)
    objects = [_object(body, masses.get(body.name), notes) for body in world.bodies]
    if floor is not None:
        middle = Pose(np.eye(3), np.array([0.0, 0.0, floor - _FLOOR_SIZE[2] / 2]))
        objects.append(RigidObject(_FLOOR, Box(_FLOOR_SIZE), middle, fixed=True))
    if not any(item.fixed for item in objects):
        what = "nothing in the file is fixed; add a floor: poise scene FILE --floor 0 --output scene.yaml"
        raise InputError(ErrorCode.BAD_INPUT, what)
    general, pairs = _friction(world, friction, notes, added=[] if floor is None else [_FLOOR])
    return Assembly(tuple(objects), world.gravity, general, pairs), tuple(notes)


def _object(body: WorldBody, mass: float | None, notes: list[str]) -> RigidObject:
    shape, pose_body_object = _shape(body)
    pose = body.pose @ pose_body_object
    if body.fixed and mass is None:
        return RigidObject(body.name, shape, pose, fixed=True)
    if body.inertial is None and mass is None:
        notes.append(f"{body.name}: the file has no mass for it, or 0; it is fixed")
        return RigidObject(body.name, shape, pose, fixed=True)
    com = inertia = None
    if body.inertial is not None:
        back = pose_body_object.inverse
        known = body.inertial.in_frame(back.rotation, back.translation)
        com = known.com if np.all(np.isfinite(known.com)) else None
        inertia = known.inertia if np.all(np.isfinite(known.inertia)) else None
        if mass is None:
            mass = known.mass
        elif inertia is not None and known.mass > 0:
            inertia = inertia * (mass / known.mass)
    return RigidObject(body.name, shape, pose, mass=float(mass or 0.0), com=com, inertia=inertia)


def _shape(body: WorldBody) -> tuple[Shape, Pose]:
    """The shape of a body, and the pose of its frame in the body's; several solids are united in the body's frame."""
    if len(body.solids) == 1:
        return body.solids[0].shape, body.solids[0].pose
    vertices, triangles, count = [], [], 0
    for solid in body.solids:
        surface = solid.shape.polyhedron
        vertices.append(solid.pose.apply(surface.vertices))
        triangles.append(surface.triangles + count)
        count += len(surface.vertices)
    whole = check_mesh(np.concatenate(vertices), np.concatenate(triangles), name=body.name)
    return Mesh(whole.vertices, whole.triangles, notes=whole.notes), Pose.identity()


def _friction(
    world: WorldContent, friction: float | None, notes: list[str], added: Sequence[str]
) -> tuple[float, tuple[FrictionPair, ...]]:
    """The coefficient of most pairs, and the pairs that have another; bodies have their own on what is added."""
    if friction is not None:
        return friction, ()
    found = {body.name: _coefficient(body, world.friction, notes) for body in world.bodies}
    if world.friction_note:
        notes.append(world.friction_note)
    elif not any(solid.friction is not None for body in world.bodies for solid in body.solids) and not world.pairs:
        notes.append(f"the file has no friction; {world.friction:g} is taken for all pairs")
        return world.friction, ()
    fixed = {body.name for body in world.bodies if body.fixed}
    between: dict[tuple[str, str], float] = {}
    for first, second in combinations(found, 2):
        if first in fixed and second in fixed:
            continue
        given = world.pairs.get((first, second), world.pairs.get((second, first)))
        between[first, second] = world.combine(found[first], found[second]) if given is None else given
    between |= {(name, other): found[name] for other in added for name in found if name not in fixed}
    general = Counter(between.values()).most_common(1)[0][0] if between else world.friction
    others = [FrictionPair(pair, value) for pair, value in between.items() if value != general]
    return general, tuple(others)


def _coefficient(body: WorldBody, default: float, notes: list[str]) -> float:
    """Of a body's surface: the least of its solids, which is on the safe side."""
    known = {default if solid.friction is None else solid.friction for solid in body.solids}
    if len(known) > 1:
        notes.append(
            f"{body.name}: its solids have several coefficients of friction; the least, {min(known):g}, is taken"
        )
    return min(known)


def combined(parts: Sequence[InertialParameters]) -> InertialParameters | None:
    """Parts that are fixed to each other, all in one frame; None for no part."""
    return sum(parts[1:], parts[0]) if parts else None


def inertial_of(item: RigidObject) -> InertialParameters:
    """Of an object, in its own frame."""
    inertia = item.pose.rotation.T @ item.inertia_in_world @ item.pose.rotation
    return InertialParameters(item.mass, item.pose.undo(item.com_in_world), (inertia + inertia.T) / 2)
