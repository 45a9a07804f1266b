"""Readings of the axes: a turned sensor frame, base axes, left-handed axes, signs."""

from collections.abc import Callable, Mapping

import numpy as np

from poise.errors import ErrorCode
from poise.geometry import nearest_rotation, rotation_of_vector, vector_of_rotation
from poise.inertia.model import signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, ReadingDesign
from poise.weighing.fixed_errors import (
    EXCHANGE_ERRORS,
    MIRROR_ERRORS,
    RARE_ERROR,
    SIGN_ERRORS,
    base_axes_sentence,
    on_both,
)
from poise.weighing.reading import Reading, Repair, Says, fixed_reading, shows_payload

_NEAR = np.radians(12.0)
"""A rotation this small beside a mirrored axis is not reported."""


def wrong_axes(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """Fixed rotations, mirrored axes, signs, and axes of the base instead of the sensor."""
    del plain
    fixed = map(fixed_reading, (*SIGN_ERRORS, *MIRROR_ERRORS, *EXCHANGE_ERRORS))
    return [*fixed, *_turned(samples), *_base_axes()]


def _said(sentence: str) -> Says:
    return lambda found: (sentence, {})


def _turned(samples: FitSamples) -> list[Reading]:
    """A fixed rotation of the sensor frame, also with a sign: starts by Kabsch's method on force and specific force."""
    found = []
    for force, torque, code, prior in (
        (1, 1, ErrorCode.SENSOR_ROTATED, 0.0),
        (-1, -1, ErrorCode.LEFT_HANDED_AXES, RARE_ERROR),
        (-1, 1, ErrorCode.LEFT_HANDED_AXES, RARE_ERROR),
        (1, -1, ErrorCode.SENSOR_ROTATED, RARE_ERROR),
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
        columns[:, :, :10] = (signs[:, None] * on_both(turn, turn)) @ columns[:, :, :10]
        return columns

    return design


def _unrotated(signs: Array) -> Callable[[Explanation], Repair]:
    def repair(found: Explanation) -> Repair:
        turn = rotation_of_vector(found.values[:3])
        return Repair(wrench=on_both(turn.T, turn.T) * signs)

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

    return [
        Reading(
            ErrorCode.WRONG_FRAME,
            design(bias_turns, sign),
            _said(base_axes_sentence(sign)),
            prior=0.0 if sign > 0 else RARE_ERROR,
            repair=_from_base(sign),
        )
        for bias_turns in (True, False)
        for sign in (1.0, -1.0)
    ]
