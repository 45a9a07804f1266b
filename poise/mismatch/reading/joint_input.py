"""Input checks of the joint positions against the wrench: directions, order, and zeros off by right angles."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading.wrench_input import WrenchMoments
from poise.mismatch.recorded import RecordedMotion, load_wrench
from poise.robot import RobotModel, frame_poses
from poise.types import Array

_SAMPLES = 400
"""Samples of the recording that are compared."""
_UNEXPLAINED, _EXPLAINED, _BETTER = 0.25, 0.2, 0.25
"""Shares of the variance of the force, or of the torque, that the recorded joints leave at least, others at most;
and the largest ratio of both."""


def check_joints(robot: RobotModel, recorded: RecordedMotion, phi: Array, gravity: float, name: str) -> None:
    """Refuse joint positions that no load explains, where those of other directions, order or zeros are explained.

    Weight alone is compared, since it follows from the positions. Joints of a base on the ground do not change it.

    Args:
        robot: of the description.
        recorded: with the wrench and the joints.
        phi: (10,) the load of the model.
        gravity: m/s2.
        name: of the recording.

    Raises:
        InputError: BAD_INPUT, with the joints.
    """
    joints = recorded.joints
    if joints is None or joints.names != robot.joint_names[robot.base_joints :]:
        return
    moments = WrenchMoments.of(recorded.wrench, recorded.prediction)
    # A sensor that is turned about the axis of the last joint is an effect of the library.
    if moments.unexplained.max() < _UNEXPLAINED or moments.turned.sum() < _EXPLAINED:
        return
    rows = slice(None, None, max(len(recorded) // _SAMPLES, 1))
    wrench, position = recorded.wrench[rows], joints.position[rows]

    def unexplained(position: Array) -> float:
        whole = np.hstack([np.zeros((len(position), robot.base_joints)), position])
        return float(WrenchMoments.of(wrench, _weight(robot, whole, phi, gravity)).unexplained.max())

    found = {sentence: unexplained(other) for sentence, other in _others(joints.names, position)}
    best = min(found, key=found.__getitem__)
    if found[best] <= min(_EXPLAINED, _BETTER * unexplained(position)):
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"{name}: the wrench does not follow from the joint positions; it would if {best}: correct the joint "
            "states, or the description of the robot",
        )


def _weight(robot: RobotModel, position: Array, phi: Array, gravity: float) -> Array:
    """(N, 6) the wrench of a load at rest."""
    rotation = frame_poses(robot, position)[0]
    still = np.zeros((len(position), 3))
    return load_wrench(phi, rotation.transpose(0, 2, 1) @ np.array([0.0, 0.0, -gravity]), still, still)


def _others(names: tuple[str, ...], position: Array) -> Iterator[tuple[str, Array]]:
    """Joint positions that a driver may have meant, in words."""
    count = len(names)
    for j, name in enumerate(names):
        one = np.eye(count)[j]
        yield f"{name} counted in the opposite direction", position * (1.0 - 2.0 * one)
        for angle in (90, -90, 180):
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
