"""World force: something pulls on the load with a constant force, fixed in the world."""

from collections.abc import Iterable

import numpy as np

from poise.geometry import cross
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, directed
from poise.types import Array

_POINT = ("x", "y", "z")
_FORCE = ("force_x", "force_y", "force_z")
_REACH = 0.5
"""m from the sensor within which the force acts."""


class WorldForce(Effect):
    """f = R^T F, tau = p x f: F constant in the world, p constant in the sensor's axes."""

    name = "world_force"
    layer = "load"
    equation = "f = R_world_sensor^T F, tau = p x f; F constant in the world, p fixed to the tool"
    source = "a weight over a pulley, a balloon, a spring balancer (constant-force tool support)"
    excited_by = "turning the tool: the force turns against the sensor as gravity does"
    separating_motion = "turn the tool about horizontal axes; a vertical force needs accelerations to differ from mass"
    confused_with = ("payload_parameters", "base_tilt", "cable", "sensor_bias")

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        points = (EffectParameter(name, "m", low=-_REACH, high=_REACH, linear=False) for name in _POINT)
        return (*points, *(EffectParameter(name, "N", 3.0) for name in _FORCE))

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The mean force in the world beside a bias in the sensor; the point from its torque."""
        columns = self.columns(recorded, dict.fromkeys(_POINT, 0.0))[:, :3]
        centred = columns - columns.mean(axis=0)
        wanted = residual - residual.mean(axis=0)
        force = np.linalg.lstsq(centred.reshape(-1, 3), wanted[:, :3].ravel(), rcond=None)[0]
        felt = columns @ force
        felt = felt - felt.mean(axis=0)
        lever = np.stack([cross(unit, felt) for unit in np.eye(3)], axis=2)
        ridge = 1e-3 * float(np.sum(felt**2)) / 3 * np.eye(3)
        normal = np.einsum("nci,ncj->ij", lever, lever) + ridge
        point = np.linalg.solve(normal + 1e-12 * np.eye(3), np.einsum("nci,nc->i", lever, wanted[:, 3:]))
        yield dict(zip(_POINT, np.clip(point, -0.9 * _REACH, 0.9 * _REACH).tolist(), strict=True))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        point = np.array([nonlinear[name] for name in _POINT])
        force = recorded.rotation_world_sensor.swapaxes(1, 2)
        return np.concatenate([force, cross(point[None, :, None], force, axis=1)], axis=1)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        force = directed([values[name] for name in _FORCE], "N")
        return (
            f"Something pulls on the tool with {force} of the world, all the time: the nominal model has no such force."
        )
