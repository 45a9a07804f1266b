"""Errors of a wrench that a fixed matrix describes: signs, mirrored and exchanged axes, units."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from poise.errors import ErrorCode
from poise.types import Array

RARE_ERROR = -4.0
"""Log prior of an error that few drivers have, or of two at once."""
_COMMON = ("kgf", "N mm", "lbf")
_ONE_OF_MANY = -2.0
_CONTRACT = "the contract is what the load exerts on the sensor, at rest f = m g"
_FORCES = {"kgf": 1 / 9.80665, "lbf": 1 / 4.4482216, "kN": 1e-3, "daN": 0.1, "mN": 1e3, "gf": 1e3 / 9.80665}
_TORQUES = {
    "N mm": 1e3,
    "N cm": 1e2,
    "kgf m": 1 / 9.80665,
    "kgf cm": 100 / 9.80665,
    "lbf in": 8.8507457,
    "lbf ft": 0.7375621,
}
"""Numbers that a driver gives for 1 N and 1 N m."""


@dataclass(frozen=True, eq=False)
class FixedError:
    """A wrench that is read through a fixed matrix.

    Args:
        code: what kind.
        sentence: what it is, and how to fix it.
        matrix: (6, 6), the wrench that is read is this times the true one.
        prior: log odds relative to a common error.
        evidence: its own numbers by name.
    """

    code: ErrorCode
    sentence: str
    matrix: Array
    prior: float = 0.0
    evidence: Mapping[str, float] = field(default_factory=dict)


def on_both(force: Array, torque: Array) -> Array:
    """(6, 6) of a matrix (3, 3) for the force and one for the torque."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3], matrix[3:, 3:] = force, torque
    return matrix


def _exchange(first: int, second: int) -> Array:
    matrix = np.eye(6)
    matrix[[first, second]] = matrix[[second, first]]
    return matrix


SIGN_ERRORS = tuple(
    FixedError(code, f"{text}; {_CONTRACT}", on_both(force * np.eye(3), torque * np.eye(3)))
    for code, force, torque, text in (
        (ErrorCode.FORCE_SIGN, -1.0, -1.0, "force and torque have the opposite sign: negate the wrench"),
        (ErrorCode.FORCE_SIGN, -1.0, 1.0, "the force has the opposite sign, the torque has not: negate the force"),
        (ErrorCode.TORQUE_SIGN, 1.0, -1.0, "the torque has the opposite sign, the force has not: negate the torque"),
    )
)
MIRROR_ERRORS = tuple(
    FixedError(
        ErrorCode.LEFT_HANDED_AXES,
        f"the wrench is in left-handed axes, {words}: {what} in the driver",
        on_both(matrix, sign * matrix),
        evidence={"torque_sign": sign},
    )
    for words, matrix in (
        ("the x axis is mirrored", np.diag([-1.0, 1.0, 1.0])),
        ("the y axis is mirrored", np.diag([1.0, -1.0, 1.0])),
        ("the z axis is mirrored", np.diag([1.0, 1.0, -1.0])),
        ("the x and y axes are exchanged", np.eye(3)[[1, 0, 2]]),
        ("the y and z axes are exchanged", np.eye(3)[[0, 2, 1]]),
        ("the x and z axes are exchanged", np.eye(3)[[2, 1, 0]]),
    )
    for sign, what in ((1.0, "turn that axis of force and torque back"), (-1.0, "turn that axis of the force back"))
)
EXCHANGE_ERRORS = tuple(
    FixedError(
        ErrorCode.LEFT_HANDED_AXES,
        f"{what} {'xyz'[a]} and {what} {'xyz'[b]} are exchanged: change the order of the channels in the driver",
        _exchange(order + a, order + b),
        prior=RARE_ERROR,
    )
    for a, b in ((0, 1), (1, 2), (0, 2))
    for what, order in (("force", 0), ("torque", 3))
)


def _unit_error(unit: str, factor: float) -> FixedError:
    what, good = ("force", "N") if unit in _FORCES else ("torque", "N m")
    fix = f"set the driver to {good}, or divide its {what} by {factor:.6g}"
    return FixedError(
        ErrorCode.FORCE_UNIT if unit in _FORCES else ErrorCode.TORQUE_UNIT,
        f"the driver's {what} is in {unit}, not in {good}: {fix}",
        np.diag(np.repeat([factor, 1.0] if unit in _FORCES else [1.0, factor], 3)),
        prior=_ONE_OF_MANY if unit in _COMMON else RARE_ERROR,
        evidence={"factor": factor},
    )


def both_units(force: FixedError, torque: FixedError) -> FixedError:
    """Force and torque each in another unit."""
    what = f"{force.sentence}; {torque.sentence}"
    return FixedError(force.code, what, force.matrix @ torque.matrix, _ONE_OF_MANY)


FORCE_UNIT_ERRORS = tuple(_unit_error(*each) for each in _FORCES.items())
TORQUE_UNIT_ERRORS = tuple(_unit_error(*each) for each in _TORQUES.items())
IMPERIAL_ERRORS = tuple(
    both_units(_unit_error("lbf", _FORCES["lbf"]), _unit_error(unit, _TORQUES[unit])) for unit in ("lbf in", "lbf ft")
)


def base_axes_sentence(sign: float) -> str:
    """Of a wrench in the axes of the base, or of its opposite."""
    text = (
        "the wrench is in the axes of the base, and its messages name the sensor frame: publish it in the axes of the"
        " sensor, or stamp it with the frame that it is in"
    )
    return text if sign > 0 else f"{text}; its sign is opposite as well"
