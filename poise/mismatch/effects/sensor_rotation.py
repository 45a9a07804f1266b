"""Sensor rotation: the sensor is mounted rotated against the robot description."""

from collections.abc import Iterable

import numpy as np

from poise.geometry import cross, rotation_of_vector
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_NAMES = ("rotation_x", "rotation_y", "rotation_z")


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
        return tuple(EffectParameter(name, "rad", 0.02, -0.5, 0.5, linear=False, peaked=True) for name in _NAMES)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """First order: the residual is w x r, for force and torque alike."""
        weight = np.repeat([1.0, 20.0], 3)
        columns = rotation_columns(recorded.prediction) * weight[:, None]
        centred = columns - columns.mean(axis=0)
        wanted = (residual - residual.mean(axis=0)) * weight
        turn = np.linalg.lstsq(centred.reshape(-1, 3), wanted.ravel(), rcond=None)[0]
        yield dict(zip(_NAMES, np.clip(turn, -0.45, 0.45).tolist(), strict=True))

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
