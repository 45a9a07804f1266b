"""Readings of the axes: a turned sensor frame, base axes, left-handed axes, signs."""

from collections.abc import Callable, Mapping

import numpy as np

from poise.errors import ErrorCode
from poise.geometry import nearest_rotation, rotation_of_vector, vector_of_rotation
from poise.inertia.model import signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, ReadingDesign
from poise.weighing.reading import Reading, Repair, Says, shows_payload

_NEAR = np.radians(12.0)
"""A rotation this small beside a mirrored axis is not reported."""
_RARE = -4.0
"""Log prior of two errors at once."""


def wrong_axes(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """Fixed rotations, mirrored axes, signs, and axes of the base instead of the sensor."""
    del plain
    found = [*_signs(), *_mirrored(), *_exchanged(), *_turned(samples)]
    return [*found, *_base_axes()]


def _both(force: Array, torque: Array) -> Array:
    matrix = np.zeros((6, 6))
    matrix[:3, :3], matrix[3:, 3:] = force, torque
    return matrix


def _fixed(matrix: Array) -> ReadingDesign:
    """The load's wrench seen through a fixed matrix (6, 6); the bias is in the axes of the reading."""

    def design(samples: FitSamples, values: Array) -> Array:
        del values
        columns = signal_columns(samples.signals)
        columns[:, :, :10] = matrix @ columns[:, :, :10]
        return columns

    return design


def _repaired(matrix: Array) -> Callable[[Explanation], Repair]:
    return lambda found: Repair(wrench=matrix.T)


def _said(sentence: str, **evidence: float) -> Says:
    return lambda found: (sentence, evidence)


def _signs() -> list[Reading]:
    one = np.eye(3)
    kinds = [
        (ErrorCode.FORCE_SIGN, -1, -1, "force and torque have the opposite sign: negate the wrench", 0.0),
        (ErrorCode.FORCE_SIGN, -1, 1, "the force has the opposite sign, the torque has not: negate the force", 0.0),
        (ErrorCode.TORQUE_SIGN, 1, -1, "the torque has the opposite sign, the force has not: negate the torque", 0.0),
    ]
    return [
        Reading(
            code,
            _fixed(_both(force * one, torque * one)),
            _said(f"{text}; the contract is what the load exerts on the sensor, at rest f = m g"),
            prior=prior,
            repair=_repaired(_both(force * one, torque * one)),
        )
        for code, force, torque, text, prior in kinds
    ]


def _mirrored() -> list[Reading]:
    kinds = {
        "the x axis is mirrored": np.diag([-1.0, 1, 1]),
        "the y axis is mirrored": np.diag([1.0, -1, 1]),
        "the z axis is mirrored": np.diag([1.0, 1, -1]),
        "the x and y axes are exchanged": np.eye(3)[[1, 0, 2]],
        "the y and z axes are exchanged": np.eye(3)[[0, 2, 1]],
        "the x and z axes are exchanged": np.eye(3)[[2, 1, 0]],
    }
    return [
        Reading(
            ErrorCode.LEFT_HANDED_AXES,
            _fixed(_both(matrix, sign * matrix)),
            _said(f"the wrench is in left-handed axes, {words}: {what} in the driver", torque_sign=float(sign)),
            repair=_repaired(_both(matrix, sign * matrix)),
        )
        for words, matrix in kinds.items()
        for sign, what in ((1, "turn that axis of force and torque back"), (-1, "turn that axis of the force back"))
    ]


def _exchanged() -> list[Reading]:
    """Two channels of the force alone, or of the torque alone, are exchanged."""
    return [
        Reading(
            ErrorCode.LEFT_HANDED_AXES,
            _fixed(matrix),
            _said(
                f"{what} {'xyz'[a]} and {what} {'xyz'[b]} are exchanged: change the order of the channels in the driver"
            ),
            prior=_RARE,
            repair=_repaired(matrix),
        )
        for a, b in ((0, 1), (1, 2), (0, 2))
        for what, order in (("force", 0), ("torque", 3))
        for matrix in (_exchange(order + a, order + b),)
    ]


def _exchange(first: int, second: int) -> Array:
    matrix = np.eye(6)
    matrix[[first, second]] = matrix[[second, first]]
    return matrix


def _turned(samples: FitSamples) -> list[Reading]:
    """A fixed rotation of the sensor frame, also with a sign: starts by Kabsch's method on force and specific force."""
    found = []
    for force, torque, code, prior in (
        (1, 1, ErrorCode.SENSOR_ROTATED, 0.0),
        (-1, -1, ErrorCode.LEFT_HANDED_AXES, _RARE),
        (-1, 1, ErrorCode.LEFT_HANDED_AXES, _RARE),
        (1, -1, ErrorCode.SENSOR_ROTATED, _RARE),
    ):
        starts = _kabsch(samples, force)
        signs = np.repeat([float(force), float(torque)], 3)
        found.append(
            Reading(
                code,
                _rotated(signs),
                _rotation_sentence(force, torque),
                starts=starts,
                prior=prior,
                holds=shows_payload if force == torque == 1 else _turned_far,
                repair=_unrotated(signs),
            )
        )
    return found


def _rotated(signs: Array) -> ReadingDesign:
    def design(samples: FitSamples, values: Array) -> Array:
        columns = signal_columns(samples.signals)
        turn = rotation_of_vector(values)
        columns[:, :, :10] = (signs[:, None] * _both(turn, turn)) @ columns[:, :, :10]
        return columns

    return design


def _unrotated(signs: Array) -> Callable[[Explanation], Repair]:
    def repair(found: Explanation) -> Repair:
        turn = rotation_of_vector(found.values[:3])
        return Repair(wrench=_both(turn.T, turn.T) * signs)

    return repair


def _rotation_sentence(force: int, torque: int) -> Says:
    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        angle = float(np.linalg.norm(found.values))
        axis = found.values / max(angle, 1e-9)
        deviation = float(np.sqrt(axis @ found.covariance[-3:, -3:] @ axis))
        about = ", ".join(f"{value:.2f}" for value in axis)
        evidence = {
            "angle": angle,
            "angle_std": deviation,
            **dict(zip(("axis_x", "axis_y", "axis_z"), axis.tolist(), strict=True)),
        }
        signs = {
            (1, 1): "",
            (-1, -1): " and force and torque have the opposite sign",
            (-1, 1): " and the force has the opposite sign",
            (1, -1): " and the torque has the opposite sign",
        }[(force, torque)]
        return (
            f"the wrench is in axes that are turned by {np.degrees(angle):.1f} +- {np.degrees(deviation):.1f} degrees"
            f" about ({about}) of the sensor frame{signs}: set --sensor-frame to the frame of the wrench, or correct"
            " the mounting in the URDF or tf",
            evidence,
        )

    return says


def _kabsch(samples: FitSamples, sign: int) -> tuple[tuple[float, ...], ...]:
    """Rotations that best turn specific forces into measured ones (Kabsch 1976), and none."""
    specific, force = samples.signals[:, :3], sign * samples.wrench[:, :3]
    starts = []
    for robust in (False, True):
        weight = np.ones(len(force))
        turn = np.eye(3)
        for _ in range(4 if robust else 1):
            share = weight / weight.sum()
            about, target = specific - share @ specific, force - share @ force
            turn = nearest_rotation((target * share[:, None]).T @ about)
            mass = np.sum(share[:, None] * target * (about @ turn.T)) / np.sum(share[:, None] * about**2)
            off = np.linalg.norm(target - mass * about @ turn.T, axis=1)
            weight = np.minimum(1.0, np.median(off) / np.maximum(off, 1e-9))
        starts.append(tuple(vector_of_rotation(turn).tolist()))
    return tuple(starts)


def _turned_far(found: Explanation) -> bool:
    return shows_payload(found) and float(np.linalg.norm(found.values)) > _NEAR


def _from_base(sign: float) -> Callable[[Explanation], Repair]:
    return lambda found: Repair(wrench=sign * np.eye(6), base_axes=True)


def _base_axes() -> list[Reading]:
    def design(bias_turns: bool, sign: float) -> ReadingDesign:
        def columns_of(samples: FitSamples, values: Array) -> Array:
            del values
            columns = signal_columns(samples.signals)
            turn = np.zeros((len(samples), 6, 6))
            turn[:, :3, :3] = turn[:, 3:, 3:] = samples.rotation_world_sensor
            turned = sign * turn @ columns[:, :, :10]
            return np.concatenate([turned, turn if bias_turns else columns[:, :, 10:]], axis=2)

        return columns_of

    text = (
        "the wrench is in the axes of the base, and its messages name the sensor frame: publish it in the axes of the"
        " sensor, or stamp it with the frame that it is in"
    )
    return [
        Reading(
            ErrorCode.WRONG_FRAME,
            design(bias_turns, sign),
            _said(text if sign > 0 else f"{text}; its sign is opposite as well"),
            prior=0.0 if sign > 0 else _RARE,
            repair=_from_base(sign),
        )
        for bias_turns in (True, False)
        for sign in (1.0, -1.0)
    ]
