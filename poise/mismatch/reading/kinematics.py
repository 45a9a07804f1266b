"""From joint motion to a `RecordedMotion`: one pass of forward kinematics with its derivatives by each joint."""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from poise.geometry import STANDARD_GRAVITY, cross
from poise.mismatch.reading.link_efforts import link_track
from poise.mismatch.reading.motion_variance import AccelerationSigma, base_sources, wrench_variance
from poise.mismatch.recorded import BaseTrack, EffortTrack, JointTrack, RecordedMotion, load_wrench
from poise.robot import BaseMotion, RobotModel, inertia_of, pinocchio_state
from poise.simulation import JointMotion
from poise.types import Array, Mask

_STILL = 1e-3
"""m/s or rad/s below which a base is at rest."""


def recorded_from_motion(
    robot: RobotModel,
    seconds: Array,
    joints: JointMotion,
    phi: ArrayLike,
    wrench: Array | None = None,
    *,
    base: BaseMotion | None = None,
    gravity: float = STANDARD_GRAVITY,
    start: int = 0,
    effort: EffortTrack | None = None,
    errors: AccelerationSigma | None = None,
) -> RecordedMotion:
    """The recording of a known motion.

    Args:
        robot: with `base="floating"` when `base` is given.
        seconds: (N,).
        joints: (N, J) at these times, in the robot's order.
        phi: (10,) everything that the sensor carries.
        wrench: (N, 6) measured; None: NaN, for a motion that is only simulated.
        base: motion of the root link (N), when it moves.
        gravity: m/s2, downwards.
        start: ns, the stamp of second zero.
        effort: joint efforts, see `effort_track`.
        errors: of the accelerations; None: they are exact.
    """
    rows = _forward(robot, joints, base)
    down = np.array([0.0, 0.0, -gravity])
    payload = np.asarray(phi, dtype=np.float64)
    nominal = load_wrench(payload, down @ rows.rotation - rows.linear, rows.omega, rows.alpha)
    return RecordedMotion(
        start=start,
        seconds=seconds,
        wrench=np.full((len(seconds), 6), np.nan) if wrench is None else wrench,
        phi=payload,
        prediction=nominal,
        gravity=np.asarray(down @ rows.rotation),
        linear_acceleration=rows.linear,
        angular_velocity=rows.omega,
        angular_acceleration=rows.alpha,
        rotation_world_sensor=rows.rotation,
        position_in_world=rows.position,
        velocity_in_world=rows.velocity,
        joints=_joint_track(robot, joints, rows),
        base=rows.base if rows.base is not None and _moves(rows.base) else None,
        effort=effort,
        motion_variance=None if errors is None else _wrench_variance(robot, payload, rows, base, errors),
        place_noise=0.0 if errors is None else errors.place,
    )


def _wrench_variance(
    robot: RobotModel, phi: Array, rows: "_Rows", base: BaseMotion | None, errors: AccelerationSigma
) -> Array:
    found = wrench_variance(phi, rows.omega, rows.jacobian @ robot.coupling, errors.joints)
    if base is None or errors.base is None:
        return found
    sources = base_sources(base, rows.rotation, rows.position)
    return found + wrench_variance(phi, rows.omega, sources, errors.base)


def _joint_track(robot: RobotModel, joints: JointMotion, rows: "_Rows") -> JointTrack | None:
    """The joints of the arm, and the sensor's derivatives by them; None for a sensor on a base alone."""
    arm = slice(robot.base_joints, None)
    if not robot.joint_names[arm]:
        return None
    coupling = robot.coupling[:, arm]
    return JointTrack(
        robot.joint_names[arm],
        joints.position[:, arm],
        joints.velocity[:, arm],
        joints.acceleration[:, arm],
        rows.jacobian @ coupling,
        rows.by_position @ coupling,
    )


def effort_track(
    robot: RobotModel,
    seconds: Array,
    joints: JointMotion,
    measured: Array,
    phi: ArrayLike,
    base: BaseMotion | None = None,
    *,
    gravity: float = STANDARD_GRAVITY,
    errors: AccelerationSigma | None = None,
) -> EffortTrack:
    """Measured joint efforts, those of a rigid arm with its payload (Featherstone 2008, 5.3), and derivatives of these.

    Args:
        robot: with `base="floating"` when `base` is given.
        seconds: (M,).
        joints: (M, J) at these times.
        measured: (M, J) N m of all the robot's joints; columns with NaN are left out.
        phi: (10,) the payload, in addition to the links that the URDF fixes beyond the sensor.
        base: motion of the root link (M), when it moves.
        gravity: m/s2, downwards.
        errors: of the accelerations; None: they are exact.
    """
    loaded = robot.pinocchio.copy()
    frame = loaded.frames[robot.frame_id(robot.sensor_frame)]
    loaded.inertias[frame.parentJoint] += frame.placement.act(inertia_of(phi))
    loaded.gravity.linear = np.array([0.0, 0.0, -gravity])
    data = loaded.createData()
    whole = pinocchio_state(robot, *joints, base)
    moving = len(robot.coupling)
    torque, by_q, inertia = (np.empty((len(seconds), moving, *more)) for more in ((), (moving,), (moving,)))
    by_base = np.empty((len(seconds), len(whole.v[0]) - moving, moving))
    for i, (q, v, a) in enumerate(zip(whole.q, whole.v, whole.a, strict=True)):
        slopes = pin.computeRNEADerivatives(loaded, data, q, v, a)
        torque[i] = data.tau[-moving:]
        by_q[i] = slopes[0][-moving:, -moving:]
        inertia[i], by_base[i] = slopes[2][-moving:, -moving:], slopes[2][:-moving, -moving:]
    # pinocchio fills the upper triangle only.
    rows, columns = np.tril_indices(moving, -1)
    inertia[:, rows, columns] = inertia[:, columns, rows]
    known = np.asarray(np.isfinite(measured).all(axis=0) & (np.arange(measured.shape[1]) >= robot.base_joints))
    rigid = (torque @ robot.coupling)[:, known]
    by_q, inertia = ((robot.coupling.T @ matrix @ robot.coupling)[:, known][:, :, known] for matrix in (by_q, inertia))
    names = tuple(name for name, there in zip(robot.joint_names, known.tolist(), strict=True) if there)
    parts = (joints.position[:, known], joints.velocity[:, known], joints.acceleration[:, known])
    links = link_track(robot, whole.q, whole.v, whole.a, gravity, known)
    variance = None if errors is None else _variance(errors, inertia, (by_base @ robot.coupling)[:, :, known], known)
    felt = np.einsum("nik,ij->njk", _by_gravity(loaded, whole.q, moving), robot.coupling)[:, known]
    track = EffortTrack(seconds, names, *parts, measured[:, known], rigid, rigid, by_q, inertia, links, felt, variance)
    return replace(track, prismatic=robot.prismatic)


def _variance(errors: AccelerationSigma, inertia: Array, by_base: Array, known: Mask) -> Array:
    """(M, J) of the torque by the errors of the accelerations."""
    variance = np.einsum("mij,mj->mi", inertia**2, errors.joints[:, known] ** 2)
    if errors.base is not None:
        variance += np.einsum("mbj,mb->mj", by_base**2, errors.base**2)
    return np.asarray(variance)


def _by_gravity(model: pin.Model, positions: Array, moving: int) -> Array:
    """(M, V, 3) derivative of the torque by gravity along x, y and z of the world."""
    data = model.createData()
    out = np.empty((len(positions), moving, 3))
    for axis, along in enumerate(np.eye(3)):
        model.gravity.linear = along
        for i, q in enumerate(positions):
            out[i, :, axis] = pin.computeGeneralizedGravity(model, data, q)[-moving:]
    return out


@dataclass(frozen=True, eq=False)
class _Rows:
    rotation: Array
    position: Array
    velocity: Array
    omega: Array
    alpha: Array
    linear: Array
    jacobian: Array
    by_position: Array
    base: BaseTrack | None


def _forward(robot: RobotModel, joints: JointMotion, moving_base: BaseMotion | None) -> _Rows:
    """Everything about the sensor's frame, in one pass."""
    whole = pinocchio_state(robot, joints.position, joints.velocity, joints.acceleration, moving_base)
    model, frame = robot.pinocchio, robot.frame_id(robot.sensor_frame)
    data, n, moving = model.createData(), len(whole.q), len(robot.coupling)
    rotation, position = np.empty((n, 3, 3)), np.empty((n, 3))
    velocity, acceleration = np.empty((n, 6)), np.empty((n, 6))
    by_q, jacobian, a_by_q = (np.empty((n, 6, moving)) for _ in range(3))
    base = _BaseRows(robot, n) if robot.base_joints or moving_base is not None else None
    for i, (q, v, a) in enumerate(zip(whole.q, whole.v, whole.a, strict=True)):
        pin.computeForwardKinematicsDerivatives(model, data, q, v, a)
        pose = pin.updateFramePlacement(model, data, frame)
        rotation[i], position[i] = pose.rotation, pose.translation
        velocity[i] = pin.getFrameVelocity(model, data, frame, pin.LOCAL).vector
        acceleration[i] = pin.getFrameAcceleration(model, data, frame, pin.LOCAL).vector
        found = pin.getFrameAccelerationDerivatives(model, data, frame, pin.LOCAL)
        if len(v) == 1:  # pinocchio gives rows for a single joint
            found = [np.reshape(each, (6, 1)) for each in found]
        v_by_q, a_by_position, _, a_by_a = found
        by_q[i], a_by_q[i], jacobian[i] = v_by_q[:, -moving:], a_by_position[:, -moving:], a_by_a[:, -moving:]
        if base is not None:
            base.take(i, model, data)
    linear, omega = velocity[:, :3], velocity[:, 3:]
    # A spatial acceleration lacks omega x v of the classical one (Featherstone 2008, section 2.11).
    by_position = np.empty((n, 9, moving))
    by_position[:, :3] = (
        a_by_q[:, :3] + cross(by_q[:, 3:], linear[:, :, None], axis=1) + cross(omega[:, :, None], by_q[:, :3], axis=1)
    )
    by_position[:, 3:6], by_position[:, 6:] = by_q[:, 3:], a_by_q[:, 3:]
    return _Rows(
        rotation,
        position,
        np.asarray(np.einsum("nij,nj->ni", rotation, linear)),
        omega,
        acceleration[:, 3:],
        acceleration[:, :3] + cross(omega, linear),
        jacobian,
        by_position,
        None if base is None else base.track(),
    )


class _BaseRows:
    """The base link's motion: behind the joints of a mobile base, or the root link that moves."""

    def __init__(self, robot: RobotModel, n: int) -> None:
        first = robot.pinocchio.njoints - len(robot.coupling)
        self._joint = first - 1 + robot.base_joints
        self._rotation, self._place = np.empty((n, 3, 3)), np.empty((n, 3))
        self._rates = np.empty((2, n, 6))

    def take(self, i: int, model: pin.Model, data: pin.Data) -> None:
        pose = data.oMi[self._joint]
        self._rotation[i], self._place[i] = pose.rotation, pose.translation
        self._rates[0, i], self._rates[1, i] = data.v[self._joint].vector, data.a[self._joint].vector

    def track(self) -> BaseTrack:
        linear, angular = self._rates[..., :3], self._rates[..., 3:]
        classical = linear[1] + cross(angular[0], linear[0])

        def in_world(vectors: Array) -> Array:
            return np.asarray(np.einsum("nij,nj->ni", self._rotation, vectors))

        return BaseTrack(self._rotation, self._place, in_world(linear[0]), in_world(classical), angular[0], angular[1])


def _moves(base: BaseTrack) -> bool:
    fastest = max(np.abs(base.velocity_in_world).max(), np.abs(base.angular_velocity_in_base).max())
    return bool(fastest > _STILL)
