"""Base tilt: the plane of odometry is not horizontal."""

from collections.abc import Iterable

import numpy as np

from poise.geometry import cross, rotation_of_vector
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import best_fit
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_NAMES = ("rotation_x", "rotation_y")


class BaseTilt(Effect):
    """Gravity is rotated: g = exp(-[r]) g0 in world axes, r horizontal. Exact in r."""

    name = "base_tilt"
    layer = "kinematics"
    equation = "g = exp(-[r]x) g0, r = (rx, ry, 0): dw = m dg, mc x dg"
    source = "thesis eq. 2.97 with gravity turned (Rodrigues' formula); a turn about the vertical does not show"
    excited_by = "weight in changing directions: the error is fixed in the world and turns in the sensor"
    separating_motion = (
        "turn the tool about the vertical and the first joint: a tilt is fixed in the world, a sensor rotation is not"
    )
    confused_with = ("joint_offset", "sensor_rotation", "world_force", "base_motion")
    needs = ("load",)
    widens = "tilt"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return tuple(
            EffectParameter(n, "rad", scale=0.01, low=-0.5, high=0.5, linear=False, peaked=True) for n in _NAMES
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """First order: least squares beside a constant in the sensor."""
        weight = np.repeat([1.0, 20.0], 3)
        columns = tilt_columns(recorded)
        columns = (columns - columns.mean(axis=0)) * weight[:, None]
        wanted = (residual - residual.mean(axis=0)) * weight
        turn = best_fit(columns.reshape(-1, 2), wanted.ravel())[0]
        yield dict(zip(_NAMES, np.clip(turn, -0.45, 0.45).tolist(), strict=True))

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        turn = rotation_of_vector([-values[_NAMES[0]], -values[_NAMES[1]], 0.0])
        gravity = recorded.to_world(recorded.gravity)
        return _weighed(recorded, (gravity @ turn.T - gravity)[:, None])[:, :, 0]

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        del recorded
        return {"tilt": (float(np.hypot(values[_NAMES[0]], values[_NAMES[1]])), "rad")}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        tilt = self.derived(recorded, values)["tilt"][0]
        about = "xy"[int(abs(values[_NAMES[1]]) > abs(values[_NAMES[0]]))]
        return (
            f"The floor is not level: gravity is rotated by {np.degrees(tilt):.2f} degrees, mostly about {about} of "
            "the world; the nominal model stands upright."
        )


def tilt_columns(recorded: RecordedMotion) -> Array:
    """(N, 6, 2) first-order response to the rotation of the base about x and y of the world."""
    return -_weighed(recorded, cross(np.eye(3)[:2], recorded.to_world(recorded.gravity)[:, None]))


def _weighed(recorded: RecordedMotion, gravity_in_world: Array) -> Array:
    """(N, 6, k) the payload's wrench under k changes of gravity, (N, k, 3)."""
    change = np.einsum("nji,nkj->nki", recorded.rotation_world_sensor, gravity_in_world)
    torque = cross(recorded.phi[1:4], change)
    return np.concatenate([recorded.phi[0] * change, torque], axis=2).swapaxes(1, 2)
