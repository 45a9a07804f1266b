"""Sensor rotation: the sensor is mounted rotated against the robot description."""

from collections.abc import Iterable

import numpy as np

from poise.geometry import cross, nearest_rotation, rotation_of_vector, vector_of_rotation
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_NAMES = ("rotation_x", "rotation_y", "rotation_z")
_LARGEST = 4.0
"""rad: half a turn, with room for the fit on both sides of it."""


class SensorRotation(Effect):
    """w_read = R(r)^T w: the true sensor axes are the described ones turned by the rotation vector r. Exact in r."""

    name = "sensor_rotation"
    layer = "sensor"
    equation = "f_read = R(r)^T f, tau_read = R(r)^T tau; r: rotation vector from described to true axes"
    source = "rotation of a wrench's axes (Featherstone 2008, section 2.8); second order in r matters from 2 degrees on"
    excited_by = "weight in changing directions, torques"
    separating_motion = "six attitudes, gravity along each sensor axis both ways"
    confused_with = ("sensor_gain", "joint_offset", "base_tilt")
    needs = ("load",)
    widens = "rotation"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return tuple(
            EffectParameter(name, "rad", 0.02, -_LARGEST, _LARGEST, linear=False, peaked=True) for name in _NAMES
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The rotation that turns the predicted wrench into the measured one best (Kabsch 1976)."""
        weight = np.repeat([1.0, 20.0], 3)
        expected = (recorded.prediction - recorded.prediction.mean(axis=0)) * weight
        read = expected + (residual - residual.mean(axis=0)) * weight
        turn = nearest_rotation(expected[:, :3].T @ read[:, :3] + expected[:, 3:].T @ read[:, 3:])
        yield dict(zip(_NAMES, vector_of_rotation(turn).tolist(), strict=True))

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        turn = rotation_of_vector([values[name] for name in _NAMES])
        read = np.hstack([recorded.prediction[:, :3] @ turn, recorded.prediction[:, 3:] @ turn])
        return np.asarray(read - recorded.prediction)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        turn = np.array([values[name] for name in _NAMES])
        return (
            f"The sensor's axes are turned by {np.degrees(np.linalg.norm(turn)):.2f} degrees, mostly about "
            f"{'xyz'[int(np.argmax(np.abs(turn)))]}, against the robot description."
        )


def rotation_columns(wrench: Array) -> Array:
    """(N, 6, 3) first-order response w x r to a rotation vector of the sensor's axes."""
    out = np.zeros((len(wrench), 6, 3))
    for axis, unit in enumerate(np.eye(3)):
        out[:, :3, axis] = cross(wrench[:, :3], unit)
        out[:, 3:, axis] = cross(wrench[:, 3:], unit)
    return out
