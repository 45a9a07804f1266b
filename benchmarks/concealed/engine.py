"""MuJoCo moves the robot along the command, integrates what moves freely, and measures the wrench on the sensor."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.concealed.changes.base import Change
from benchmarks.concealed.motions import DURATION, Motion
from benchmarks.concealed.payload import Payload
from benchmarks.concealed.robot import ARM_LINKS, ARMATURE, DRIVEN, LOAD, SENSOR, build
from poise.geometry import STANDARD_GRAVITY
from poise.types import Array

SETTLING = 1.5  # s at rest before the recording, with heavy damping, in which what hangs loose finds its place
HEAVY = 30.0  # rad/s (or 1/s), damping over inertia while settling


@dataclass(frozen=True)
class Log:
    """What was measured at each step, without noise.

    Args:
        seconds: (K,).
        wrench: (K, 6) what the load exerts on the sensor, sensor axes.
        imu: (K, 6) angular velocity and specific force in imu_link.
        effort: (K, 6) what the arm's links need of their motors.
        rotation_world_sensor: (K, 3, 3).
        position_in_world: (K, 3) m, of the sensor.
        arm: position, velocity, acceleration (K, 6) of the arm's joints.
    """

    seconds: Array
    wrench: Array
    imu: Array
    effort: Array
    rotation_world_sensor: Array
    position_in_world: Array
    arm: tuple[Array, Array, Array]

    @property
    def velocity_in_world(self) -> Array:
        """(K, 3) m/s, of the sensor."""
        return np.asarray(np.gradient(self.position_in_world, self.seconds, axis=0))


class Engine:
    """A world with some changes.

    Args:
        payload: all that the robot carries, moving parts included.
        motion: what the robot does.
        changes: what is not as nominal.
        step: s; None: as fine as the changes ask.
    """

    def __init__(
        self, payload: Payload, motion: Motion, changes: Sequence[Change] = (), step: float | None = None
    ) -> None:
        self.motion, self.changes = motion, changes
        self.step = step or min([1e-3, *(change.step for change in changes)])
        gravity = np.array([0.0, 0.0, -STANDARD_GRAVITY])
        for change in changes:
            gravity, payload = change.gravity(gravity), change.carry(payload)
        spec = build(payload, gravity, self.step)
        for change in changes:
            change.shape(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.load = self.model.body(LOAD).id
        self._twist = np.zeros(6)

    def run(self, duration: float = DURATION) -> Log:
        """Let it happen, from rest."""
        seconds = np.asarray(np.arange(round(duration / self.step) + 1) * self.step, dtype=np.float64)
        position, velocity, acceleration = self._driven(seconds)
        self._settle(position[0])
        for change in self.changes:
            change.begin(self)
        model, data, site = self.model, self.data, self.model.site(SENSOR).id
        log = _empty_log(seconds, (position[:, 6:], velocity[:, 6:], acceleration[:, 6:]))
        links = [model.body(name).id for name in ARM_LINKS]
        at, rate, force = data.qpos[:DRIVEN], data.qvel[:DRIVEN], data.qfrc_applied[:DRIVEN]
        drive, sensors = acceleration * ARMATURE, data.sensordata
        axes, inner = data.cdof[6:DRIVEN], data.cfrc_int
        pushing = [change for change in self.changes if type(change).push is not Change.push]
        rotations = log.rotation_world_sensor.reshape(-1, 9)
        for k, t in enumerate(seconds.tolist()):
            at[:], rate[:], force[:] = position[k], velocity[k], drive[k]
            if pushing:
                data.xfrc_applied[self.load] = 0.0
                _update_places(model, data)
                for change in pushing:
                    change.push(self, t)
            mujoco.mj_step(model, data)
            # MuJoCo says what the sensor exerts on the load.
            log.wrench[k], log.imu[k] = -sensors[:6], sensors[6:12]
            # cfrc_int is what a parent exerts on a link; its part along the joint's axis is what the motor gives.
            log.effort[k] = np.einsum("ij,ij->i", axes, inner[links])
            rotations[k], log.position_in_world[k] = data.site_xmat[site], data.site_xpos[site]
        for change in self.changes:
            change.finish(self, log)
        return log

    def force_at(self, point: Array, force_in_world: Array) -> None:
        """Apply a force on the load in this step, at a point of the world."""
        applied, lever = self.data.xfrc_applied[self.load], point - self.data.xipos[self.load]
        applied[:3] += force_in_world
        applied[3] += lever[1] * force_in_world[2] - lever[2] * force_in_world[1]
        applied[4] += lever[2] * force_in_world[0] - lever[0] * force_in_world[2]
        applied[5] += lever[0] * force_in_world[1] - lever[1] * force_in_world[0]

    def set_mass(self, body: int, mass: float) -> None:
        """Change the mass of a body that is fixed to the load, while the engine runs."""
        gained = mass - self.model.body_mass[body]
        self.model.body_mass[body] = mass
        while body:
            self.model.body_subtreemass[body] += gained
            body = int(self.model.body_parentid[body])

    def point(self, place_in_load: Array) -> Array:
        """(3,) m of a place of the load in the world."""
        return np.asarray(self.data.xpos[self.load] + self.data.xmat[self.load].reshape(3, 3) @ place_in_load)

    def velocity(self, place_in_load: Array) -> Array:
        """(3,) m/s of a place of the load in the world."""
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_XBODY, self.load, self._twist, 0)
        (wx, wy, wz), linear = self._twist[:3].tolist(), self._twist[3:]
        x, y, z = (self.data.xmat[self.load].reshape(3, 3) @ place_in_load).tolist()
        return np.asarray(linear + np.array([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x]))

    def joint_inertia(self, position: Array) -> Array:
        """(K, 6) kg m2 that each joint of the arm would turn alone, at (K, 6) rad."""
        own = self.model.dof_armature.copy()
        self.model.dof_armature[:] = 0.0
        scratch, inertia = mujoco.MjData(self.model), np.empty_like(position)
        for k, row in enumerate(position):
            scratch.qpos[6:DRIVEN] = row
            mujoco.mj_forward(self.model, scratch)
            inertia[k] = np.diag(_mass_matrix(self.model, scratch))[6:DRIVEN]
        self.model.dof_armature[:] = own
        return inertia

    def _driven(self, seconds: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration (K, DRIVEN) of the command, unreported motion included."""
        arm, base = self.motion.arm(seconds), self.motion.base(seconds)
        driven = []
        for order in range(3):
            whole = np.zeros((len(seconds), DRIVEN))
            whole[:, [0, 1, 3]], whole[:, 6:] = base[order], arm[order]
            driven.append(whole)
        for change in self.changes:
            extra = change.shift(seconds)
            for whole, more in zip(driven, extra or (), strict=False):
                whole[:, :6] += more
        return driven[0], driven[1], driven[2]

    def _settle(self, position: Array) -> None:
        """Wait at rest until loose parts hang still."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        data.qpos[:DRIVEN] = position
        mujoco.mj_forward(model, data)
        if model.nv == DRIVEN:
            return
        damping = model.dof_damping.copy()
        inertia = np.diag(_mass_matrix(model, data))[DRIVEN:]
        model.dof_damping[DRIVEN:] = np.maximum(damping[DRIVEN:], HEAVY * inertia)
        for _ in range(round(SETTLING / self.step)):
            data.qpos[:DRIVEN], data.qvel[:DRIVEN] = position, 0.0
            mujoco.mj_step(model, data)
        model.dof_damping[:] = damping


def _update_places(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Where bodies are and how they move, for forces that depend on it."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)


def _mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    return matrix


def _empty_log(seconds: Array, arm: tuple[Array, Array, Array]) -> Log:
    n = len(seconds)
    return Log(
        seconds, np.empty((n, 6)), np.empty((n, 6)), np.empty((n, 6)), np.empty((n, 3, 3)), np.empty((n, 3)), arm
    )
