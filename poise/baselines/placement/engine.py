"""An assembly in MuJoCo: what would happen to it. MuJoCo is an extra (`pip install poise[sim]`)."""

import importlib
from typing import Any

import numpy as np

from poise.assembly import Assembly, Box, Cylinder, RigidObject, Sphere
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, quaternion_of_rotation
from poise.types import Array
from poise.worlds import MJCF_MEMORY, convex_pieces

_STIFF = (0.004, 1.0)
"""Time constant, s, and damping ratio of contacts."""


class Engine:
    """Bodies that move under gravity, friction and contact.

    Args:
        assembly: the objects; one coefficient of friction for all pairs.
        step: s.
        friction: instead of the assembly's.
        damping: 1/s, of all velocities.

    Raises:
        InputError: UNSUPPORTED without MuJoCo, with coefficients for single pairs, or for shapes too round to cut.
    """

    def __init__(self, assembly: Assembly, step: float, friction: float | None = None, damping: float = 0.0) -> None:
        if assembly.friction_pairs:
            raise InputError(ErrorCode.UNSUPPORTED, "MuJoCo gets one coefficient of friction; drop friction_pairs")
        self._mujoco = _mujoco()
        self.assembly, self._damping = assembly, damping
        self._moving = [item for item in assembly.objects if not item.fixed]
        friction = assembly.largest_friction if friction is None else friction
        self.model = self._spec(step, friction).compile()
        self.data = self._mujoco.MjData(self.model)
        self.step = step
        self.restart()

    def _spec(self, step: float, friction: float) -> Any:
        mujoco = self._mujoco
        spec = mujoco.MjSpec()
        spec.memory = MJCF_MEMORY
        spec.option.timestep = step
        spec.option.gravity = np.asarray(self.assembly.gravity, dtype=float)
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = 100.0
        spec.option.noslip_iterations = 5
        for item in self.assembly.objects:
            body = spec.worldbody.add_body(name=item.id, pos=item.pose.translation, quat=_wxyz(item.pose.rotation))
            if not item.fixed:
                body.add_freejoint()
                com = item.pose.undo(item.com_in_world)
                inertia = item.pose.rotation.T @ item.inertia_in_world @ item.pose.rotation
                body.explicitinertial = True
                body.mass, body.ipos = item.mass, com
                body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            self._add_shape(spec, body, item, friction)
        return spec

    def _add_shape(self, spec: Any, body: Any, item: RigidObject, friction: float) -> None:
        kinds = self._mujoco.mjtGeom
        common = {"friction": [friction, 0.0, 0.0], "condim": 3, "solref": _STIFF}
        shape = item.shape
        if isinstance(shape, Cylinder):
            body.add_geom(type=kinds.mjGEOM_CYLINDER, size=[shape.radius, shape.length / 2, 0], **common)
            return
        if isinstance(shape, Sphere):
            body.add_geom(type=kinds.mjGEOM_SPHERE, size=[shape.radius, 0, 0], **common)
            return
        pieces = [shape.polyhedron.vertices] if isinstance(shape, Box) else convex_pieces(shape.polyhedron)
        for number, corners in enumerate(pieces):
            low, high = corners.min(axis=0), corners.max(axis=0)
            upright = np.all((np.abs(corners - low) < 1e-9) | (np.abs(corners - high) < 1e-9))
            if upright and len(corners) == 8:
                body.add_geom(type=kinds.mjGEOM_BOX, size=(high - low) / 2, pos=(low + high) / 2, **common)
            else:
                name = f"{item.id}/{number}"
                spec.add_mesh(name=name, uservert=corners.ravel())
                body.add_geom(type=kinds.mjGEOM_MESH, meshname=name, **common)

    def run(self, seconds: float) -> None:
        """Let it happen for a while."""
        for _ in range(round(seconds / self.step)):
            if self._damping:
                self.data.qvel *= max(0.0, 1 - self._damping * self.step)
            self._mujoco.mj_step(self.model, self.data)

    def calm(self, damping: float) -> None:
        """Set the damping of all velocities, 1/s."""
        self._damping = damping

    def set_gravity(self, gravity: Array) -> None:
        self.model.opt.gravity[:] = gravity

    def restart(self) -> None:
        """All objects back where the assembly has them, at rest."""
        self._mujoco.mj_resetData(self.model, self.data)
        self._mujoco.mj_forward(self.model, self.data)

    def put(self, name: str, pose: Pose, velocity: Array) -> None:
        """Put one object at a pose, with a velocity (3,) m/s."""
        joint = self.model.body(name).jntadr[0]
        place, speed = self.model.jnt_qposadr[joint], self.model.jnt_dofadr[joint]
        self.data.qpos[place : place + 7] = np.concatenate([pose.translation, _wxyz(pose.rotation)])
        self.data.qvel[speed : speed + 6] = np.concatenate([velocity, np.zeros(3)])

    def pose(self, name: str) -> Pose:
        body = self.data.body(name)
        return Pose(np.array(body.xmat).reshape(3, 3), np.array(body.xpos))

    def speed(self, name: str) -> float:
        """m/s, of the object's fastest point, at most."""
        joint = self.model.body(name).jntadr[0]
        velocity = self.data.qvel[self.model.jnt_dofadr[joint] :][:6]
        item = self.assembly.objects[self.assembly.index[name]]
        reach = float(np.linalg.norm(item.shape.polyhedron.vertices, axis=1).max())
        return float(np.linalg.norm(velocity[:3]) + reach * np.linalg.norm(velocity[3:]))

    def moved(self, since: dict[str, Pose]) -> float:
        """m, the farthest that a corner of an object is from where it was."""
        farthest = 0.0
        for item in self._moving:
            corners, now = item.shape.polyhedron.vertices, self.pose(item.id)
            if item.id in since:
                apart = np.linalg.norm(now.apply(corners) - since[item.id].apply(corners), axis=1)
                farthest = max(farthest, float(apart.max()))
        return farthest

    @property
    def poses(self) -> dict[str, Pose]:
        """Of all movable objects."""
        return {item.id: self.pose(item.id) for item in self._moving}


def holds(
    assembly: Assembly, friction: float | None = None, settling: float = 0.25, seconds: float = 2.0, step: float = 1e-3
) -> float:
    """How far, m, any corner of an object moves in a dynamics simulation after it has settled; infinite if it fell.

    Args:
        assembly: with every object where it is to stay.
        friction: instead of the assembly's.
        settling: s in which soft contacts take up the weight.
        seconds: s watched.
        step: s.

    Raises:
        InputError: UNSUPPORTED, see `Engine`.
    """
    engine = Engine(assembly, step, friction)
    planned = {item.id: item.pose for item in assembly.objects if not item.fixed}
    engine.run(settling)
    if engine.moved(planned) > _FELL:
        return float("inf")
    settled = engine.poses
    engine.run(seconds)
    return engine.moved(settled)


_FELL = 5e-3
"""m: what moves farther while settling was not where it stays."""


def _wxyz(rotation: Array) -> Array:
    return np.roll(quaternion_of_rotation(rotation), 1)


def _mujoco() -> Any:
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise InputError(
            ErrorCode.UNSUPPORTED, "simulations need MuJoCo, which is not installed: pip install 'poise[sim]'"
        ) from error
