"""Input checks of the joint positions against the wrench: directions, order, and zeros that are far off."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.geometry import rotation_of_vector
from poise.mismatch.reading.wrench_input import WrenchMoments
from poise.mismatch.recorded import RecordedMotion, load_wrench
from poise.robot import RobotModel, frame_poses, pinocchio_state
from poise.types import Array

_SAMPLES = 400
"""Samples of the recording that are compared."""
_UNEXPLAINED, _EXPLAINED, _BETTER = 0.25, 0.2, 0.25
"""Shares of the variance of the force, or of the torque, that the recorded joints leave at least, others at most;
and the largest ratio of both."""
_TURNED = 0.5
"""Largest ratio of what other joints leave to what a turned sensor leaves."""
_SAME_AXIS = 0.99
"""Share of the turning about an axis, from which on it is the axis of the joint."""
_LEAST_ZERO = 20.0
"""degrees by which the zero of a joint is off at least; smaller errors are effects of the library."""


def check_joints(robot: RobotModel, recorded: RecordedMotion, phi: Array, name: str) -> None:
    """Refuse joint positions that no load explains, where those of other directions, order or zeros are explained.

    Only the attitude of the sensor is taken to be another one: what the load feels is that of the description, or
    gravity alone where its accelerations are wrong as well.

    Args:
        robot: of the description.
        recorded: with the wrench and the joints.
        phi: (10,) the load of the model.
        name: of the recording.

    Raises:
        InputError: BAD_INPUT, with the joints.
    """
    joints = recorded.joints
    if joints is None or joints.names != robot.joint_names[robot.base_joints :]:
        return
    moments = WrenchMoments.of(recorded.wrench, recorded.prediction)
    if moments.unexplained.max() < _UNEXPLAINED:
        return
    # A sensor that is turned against its load is an effect of the library.
    turned = float(moments.turned.sum())
    angle, left = _on_the_flange(recorded, phi, joints.jacobian_in_sensor[0, 3:, -1])
    if left < min(_EXPLAINED, _TURNED * turned) and abs(angle) > _LEAST_ZERO:
        what = f"the zero of {joints.names[-1]} was {angle:.0f} degrees off"
        raise _refused(name, f"{what}, or if the sensor and its load were turned as far on the flange")
    rows = slice(None, None, max(len(recorded) // _SAMPLES, 1))
    wrench, position = recorded.wrench[rows], joints.position[rows]

    def turns(position: Array) -> Array:
        return frame_poses(robot, _with_base(robot, position))[0]

    own = turns(position)
    turning, still = (recorded.angular_velocity[rows], recorded.angular_acceleration[rows]), np.zeros((len(own), 3))
    in_base = [
        [np.einsum("nij,nj->ni", own, values) for values in felt]
        for felt in ((recorded.specific[rows], *turning), (recorded.gravity[rows], still, still))
    ]

    def unexplained(rotation: Array) -> float:
        in_sensor = ([np.einsum("nji,nj->ni", rotation, values) for values in felt] for felt in in_base)
        return min(float(WrenchMoments.of(wrench, load_wrench(phi, *felt)).unexplained.max()) for felt in in_sensor)

    found = {sentence: unexplained(turns(other)) for sentence, other in _others(joints.names, position)}
    found |= {sentence: unexplained(rotation) for sentence, rotation in _other_axes(robot, position, own)}
    best = min(found, key=found.__getitem__)
    if found[best] <= min(_EXPLAINED, _BETTER * unexplained(own), _TURNED * turned):
        raise _refused(name, best)


def _with_base(robot: RobotModel, position: Array) -> Array:
    """(N, J) of all joints, those of a base at zero: joints of a base on the ground do not change the weight."""
    return np.hstack([np.zeros((len(position), robot.base_joints)), position])


def _refused(name: str, otherwise: str) -> InputError:
    return InputError(
        ErrorCode.BAD_INPUT,
        f"{name}: the wrench does not follow from the joint positions; it would if {otherwise}: correct the joint "
        "states, or the description of the robot",
    )


def _on_the_flange(recorded: RecordedMotion, phi: Array, axis: Array) -> tuple[float, float]:
    """degrees about an axis (3,) of the sensor by which sensor and load are turned, and what that leaves."""

    def left(degrees: float) -> float:
        turn = rotation_of_vector(-np.radians(degrees) * axis)
        turned = (recorded.specific @ turn, recorded.angular_velocity @ turn, recorded.angular_acceleration @ turn)
        return float(WrenchMoments.of(recorded.wrench, load_wrench(phi, *turned)).unexplained.sum())

    near = min(range(-180, 180, 30), key=left)
    best = minimize_scalar(left, bounds=(near - 30.0, near + 30.0), method="bounded", options={"xatol": 0.1})
    return float((best.x + 180.0) % 360.0 - 180.0), float(best.fun)


def _other_axes(robot: RobotModel, position: Array, rotation: Array) -> Iterator[tuple[str, Array]]:
    """Rotations (N, 3, 3) of the sensor if a joint turns about another axis than that of the description, in words."""
    model, data = robot.pinocchio, robot.pinocchio.createData()
    names = robot.joint_names[robot.base_joints :]
    numbers = [model.getJointId(name) for name in names]
    above, turned = (np.empty((len(names), len(position), 3, 3)) for _ in range(2))
    whole = _with_base(robot, position)
    still = np.zeros_like(whole)
    for n, row in enumerate(pinocchio_state(robot, whole, still, still).q):
        pin.forwardKinematics(model, data, row)
        for j, number in enumerate(numbers):
            turned[j, n] = data.oMi[number].rotation
            own = model.jointPlacements[number].rotation.T @ data.liMi[number].rotation
            above[j, n] = turned[j, n] @ own.T
    for j, name in enumerate(names):
        beyond = turned[j].transpose(0, 2, 1) @ rotation
        own = np.abs(Rotation.from_matrix(above[j].transpose(0, 2, 1) @ turned[j]).as_rotvec()).sum(axis=0)
        for axis, unit in zip("xyz", np.eye(3), strict=True):
            if own @ unit > _SAME_AXIS * own.sum() > 0.0:
                continue
            other = Rotation.from_rotvec(position[:, j, None] * unit).as_matrix()
            yield f"{name} turned about the {axis} axis of its frame", above[j] @ other @ beyond
        yield f"{name} did not turn, but slid", above[j] @ beyond


def _others(names: tuple[str, ...], position: Array) -> Iterator[tuple[str, Array]]:
    """Joint positions that a driver may have meant, in words."""
    count = len(names)
    for j, name in enumerate(names):
        one = np.eye(count)[j]
        yield f"{name} counted in the opposite direction", position * (1.0 - 2.0 * one)
        for angle in range(-165, 195, 15):
            if abs(angle) > _LEAST_ZERO:
                yield f"the zero of {name} was {angle} degrees off", position - np.radians(angle) * one
    for sentence, order in orders(names):
        yield sentence, position[:, order]


def orders(names: tuple[str, ...]) -> Iterator[tuple[str, NDArray[np.intp]]]:
    """Other orders of joints, in words, with the column (J,) that then holds each joint."""
    count = len(names)
    for a, b in combinations(range(count), 2):
        order = np.arange(count)
        order[[a, b]] = b, a
        yield f"{names[a]} and {names[b]} were exchanged", order
    if count < 3:
        return
    for shift in range(1, count):
        order = np.roll(np.arange(count), shift)
        yield f"the joints came in the order {' '.join(names[k] for k in order)}", np.argsort(order)
    reverse = np.arange(count)[::-1]
    yield f"the joints came in the order {' '.join(reversed(names))}", reverse
