"""Which poses of an odometry are used: rotations, each stamp once, without those that another node sends."""

from dataclasses import replace

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import are_rotations, quaternion_of_rotation
from poise.recording import PoseStream
from poise.robot.sample_checks import each_stamp_once, interpolated, left_out, stands_alone
from poise.types import Array

_LEVEL, _TILTS = np.radians(10.0), np.radians(10.0)
"""rad that a base on wheels is tilted at most, and by which the tilt of one with a wrong quaternion changes."""


def usable_odometry(odometry: PoseStream) -> tuple[PoseStream, list[str]]:
    """Odometry without poses that are none, repeated stamps, and single jumps; and what was left out.

    Raises:
        InputError: TOO_FEW_SAMPLES; BAD_INPUT for quaternions in the order w x y z.
    """
    given = len(odometry)
    valid = are_rotations(odometry.rotation_parent_child) & np.isfinite(odometry.translation_parent_child).all(axis=1)
    if odometry.twist_in_child is not None:
        finite = np.isfinite(odometry.twist_in_child).all(axis=1)
        valid &= finite | ~finite.any()
        odometry = odometry if finite.any() else replace(odometry, twist_in_child=None)
    odometry, invalid = left_out(odometry, ~valid, "odometry messages have no valid pose or twist")
    odometry = each_stamp_once(odometry)
    alone = stands_alone(odometry.translation_parent_child, np.zeros(3, dtype=bool))
    odometry, single = left_out(odometry, alone, "poses of the odometry are single outliers")
    between = interpolated(odometry, odometry.translation_parent_child, 2)
    odometry, drawn = left_out(odometry, between, "poses of the odometry lie on lines between others")
    if len(odometry) < 2:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES, f"{len(odometry)} of {given} poses of the odometry can be used: record more"
        )
    _check_quaternions(odometry)
    return odometry, [*invalid, *single, *drawn]


def _check_quaternions(odometry: PoseStream) -> None:
    """Refuse a base whose tilt changes as it drives, and that stays level if its quaternions came in another order."""
    x, y, z, _ = quaternion_of_rotation(odometry.rotation_parent_child).T
    tilt, other = _tilt(x, y), _tilt(y, z)  # w x y z, read as x y z w
    if np.ptp(tilt) > _TILTS and tilt.max() > 3.0 * _LEVEL and other.max() < _LEVEL:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"the odometry tilts the base by {np.degrees(tilt.max()):.0f} degrees; it stays level if the quaternions "
            "came in the order w x y z: publish x y z w",
        )


def _tilt(x: Array, y: Array) -> Array:
    """(N,) rad between the vertical and the z axis of quaternions with these components (N,)."""
    return np.asarray(np.arccos(np.clip(1.0 - 2.0 * (x**2 + y**2), -1.0, 1.0)))
