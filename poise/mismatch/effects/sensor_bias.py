"""Sensor bias: the sensor reads a constant wrench without load."""

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, directed
from poise.types import Array

BIAS_PARAMETERS = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")


class SensorBias(Effect):
    """w_read = w + b; left by the last zeroing, or by zeroing under load."""

    name = "sensor_bias"
    layer = "sensor"
    equation = "w_read = w + b, b constant in sensor axes"
    source = "thesis eq. 3.2 with an offset; ATI manual 9620-05-DAQ, section on biasing"
    excited_by = "any motion; best one in which gravity turns in the sensor, so that weight does not resemble it"
    separating_motion = "hold the tool in six attitudes, gravity along each sensor axis both ways"
    confused_with = ("bias_drift", "payload_parameters", "world_force", "sensor_creep")
    widens = "bias"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return tuple(EffectParameter(axis, "N", 2.0) for axis in BIAS_PARAMETERS[:3]) + tuple(
            EffectParameter(axis, "N m", 0.15) for axis in BIAS_PARAMETERS[3:]
        )

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        return np.broadcast_to(np.eye(6), (len(recorded), 6, 6))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        force, torque = (
            directed([values[axis] for axis in BIAS_PARAMETERS[:3]], "N"),
            np.array([values[a] for a in BIAS_PARAMETERS[3:]]),
        )
        return (
            f"Without load the sensor would read {force} and {np.linalg.norm(torque):.3f} N m: "
            "the nominal model has no such bias."
        )
