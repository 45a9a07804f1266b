"""Model `pybullet`: a physics engine and a binary search, push by push (thesis Algorithm 3). PyBullet is an extra."""

import importlib
from typing import Any

import numpy as np

from poise.assembly import Analysis, Assembly, Box, Cylinder, RigidObject
from poise.assembly.robustness import LimitLoads, PlainMovement, RobustnessModel
from poise.assembly.statics import Deadline, Loads
from poise.errors import ErrorCode, InputError
from poise.geometry import quaternion_of_rotation
from poise.types import Array

_MOST = 100.0
"""N: the upper bound of the thesis' search."""
_SEARCHED = 100
"""Halvings."""
_MOVES = 1e-4
"""J of kinetic energy after one step: more is motion."""
_SETTLING = 200
"""Steps in which the assembly comes to rest before it is pushed."""


def pybullet(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """Robustness as the force at which the engine's kinetic energy after one step passes a threshold.

    Its own error: a threshold on energy lets heavy objects move more slowly unnoticed, few contact points turn the
    patches, and 100 N count as without limit (22-67 % in the thesis' Table 4.1).

    Raises:
        InputError: UNSUPPORTED for meshes that are not convex, and for coefficients of friction that
            are no products of one per object, which is what the engine takes.
    """
    engine: Any = importlib.import_module("pybullet")
    assembly = analysis.assembly
    rough = _roughness(analysis)
    limit_loads = LimitLoads.start(loads.count)
    client = engine.connect(engine.DIRECT)
    try:
        bodies = _build(engine, client, assembly, rough)
        for _ in range(_SETTLING):
            engine.stepSimulation(physicsClientId=client)
        state = engine.saveState(physicsClientId=client)
        for question in range(loads.count):
            if deadline.passed:
                limit_loads.give_up(np.arange(question, loads.count))
                break
            rows = np.flatnonzero(loads.question == question).tolist()
            pushes = [(int(loads.place[row]), loads.wrench[row]) for row in rows]
            value, velocities = _search(engine, client, bodies, state, assembly, pushes)
            if np.isfinite(value):
                limit_loads.limit_by(question, value, value, PlainMovement(velocities, "mixed"))
    finally:
        engine.disconnect(client)
    return limit_loads


def _roughness(analysis: Analysis) -> Array:
    """(N,) friction of each object such that products are the coefficients of pairs that touch."""
    interfaces = analysis.structure.interfaces
    rows = np.zeros((len(interfaces) + 1, len(analysis.assembly.objects)))
    for row, interface in zip(rows, interfaces, strict=False):
        row[[interface.first, interface.second]] += 1.0
    logs = np.log([max(interface.friction, 1e-9) for interface in interfaces] + [1.0])
    found = np.linalg.lstsq(rows, logs, rcond=None)[0]
    off = np.abs(rows @ found - logs)
    if off.max() > 1e-6:
        interface = interfaces[int(off.argmax())]
        names = (analysis.assembly.objects[place].id for place in (interface.first, interface.second))
        raise InputError(
            ErrorCode.UNSUPPORTED,
            f"model pybullet multiplies one friction per object; that of {' and '.join(names)} does not fit the others",
        )
    return np.asarray(np.exp(found))


def _build(engine: Any, client: int, assembly: Assembly, rough: Array) -> list[int]:
    """Bodies in the engine, whose frames are at the centres of mass, in the axes of the objects."""
    engine.setGravity(*np.asarray(assembly.gravity, dtype=float).tolist(), physicsClientId=client)
    bodies = []
    for item, friction in zip(assembly.objects, rough.tolist(), strict=True):
        com = item.pose.undo(item.com_in_world)
        body = engine.createMultiBody(
            baseMass=0.0 if item.fixed else item.mass,
            baseCollisionShapeIndex=_shape(engine, client, item, com),
            basePosition=item.com_in_world.tolist(),
            baseOrientation=quaternion_of_rotation(item.pose.rotation).tolist(),
            physicsClientId=client,
        )
        engine.changeDynamics(
            body,
            -1,
            lateralFriction=friction,
            restitution=0.0,
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=client,
        )
        bodies.append(body)
    engine.setPhysicsEngineParameter(enableConeFriction=1, physicsClientId=client)
    return bodies


def _shape(engine: Any, client: int, item: RigidObject, com: Array) -> int:
    place = (-com).tolist()
    if isinstance(item.shape, Box):
        return int(
            engine.createCollisionShape(
                engine.GEOM_BOX,
                halfExtents=(np.array(item.shape.size) / 2).tolist(),
                collisionFramePosition=place,
                physicsClientId=client,
            )
        )
    if isinstance(item.shape, Cylinder):
        return int(
            engine.createCollisionShape(
                engine.GEOM_CYLINDER,
                radius=item.shape.radius,
                height=item.shape.length,
                collisionFramePosition=place,
                physicsClientId=client,
            )
        )
    polyhedron = item.shape.polyhedron
    if not polyhedron.convex:
        raise InputError(ErrorCode.UNSUPPORTED, f"model pybullet takes convex meshes only; {item.id} is not")
    vertices = (polyhedron.vertices - com).tolist()
    return int(engine.createCollisionShape(engine.GEOM_MESH, vertices=vertices, physicsClientId=client))


def _search(
    engine: Any,
    client: int,
    bodies: list[int],
    state: int,
    assembly: Assembly,
    pushes: list[tuple[int, Array]],
) -> tuple[float, dict[int, Array]]:
    """Algorithm 3 for pushes (place, wrench (6,) of 1 N about the world's origin) that grow together."""
    low, high = 0.0, _MOST
    velocities: dict[int, Array] = {}
    for _ in range(_SEARCHED):
        middle = (low + high) / 2
        engine.restoreState(stateId=state, physicsClientId=client)
        for place, wrench in pushes:
            force, moment = wrench[:3], wrench[3:]
            point = (np.cross(force, moment) / (force @ force)).tolist()  # on the line of action, nearest to the origin
            engine.applyExternalForce(
                bodies[place], -1, (middle * force).tolist(), point, engine.WORLD_FRAME, physicsClientId=client
            )
        engine.stepSimulation(physicsClientId=client)
        energies, found = _energies(engine, client, bodies, assembly)
        if sum(energies.values()) > _MOVES:
            high = middle
            velocities = {place: found[place] for place in found if energies[place] > _MOVES / 10}
        else:
            low = middle
    middle = (low + high) / 2
    return (np.inf, {}) if middle > 0.999 * _MOST else (middle, velocities)


def _energies(
    engine: Any, client: int, bodies: list[int], assembly: Assembly
) -> tuple[dict[int, float], dict[int, Array]]:
    """J of each movable object, and its (6,) velocity of the centre of mass and angular velocity."""
    energies, velocities = {}, {}
    for place, (body, item) in enumerate(zip(bodies, assembly.objects, strict=True)):
        if not item.fixed:
            linear, angular = (np.array(part) for part in engine.getBaseVelocity(body, physicsClientId=client))
            energies[place] = float(item.mass * linear @ linear + angular @ item.inertia_in_world @ angular) / 2
            velocities[place] = np.append(linear, angular)
    return energies, velocities


entry = RobustnessModel(
    "pybullet",
    "one step of a physics engine per halving of the force (thesis Algorithm 3)",
    pybullet,
    needs=("pybullet",),
    extra="baselines",
)
