"""Base tilt: the plane of odometry is not horizontal, or the arm stands tilted on its base."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.geometry import cross, rotation_of_vector
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import best_fit
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_NAMES = ("rotation_x", "rotation_y")
_ON_BASE = "on_base"
_TURNED = 0.1
"""Change of the base's rotation (an entry of its matrix) from which it matters in which axes a tilt is constant."""


class BaseTilt(Effect):
    """Gravity is rotated: g = exp(-[r]) g0, r horizontal in world axes, or in those of the base. Exact in r.

    A floor is tilted in the world, and an arm that is mounted with a tilt turns with its base.
    """

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
    defaults: ClassVar[Values] = {_ON_BASE: 0.0}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        rotations = tuple(
            EffectParameter(n, "rad", scale=0.01, low=-0.5, high=0.5, linear=False, peaked=True) for n in _NAMES
        )
        if recorded.base is None:
            return rotations
        return (*rotations, EffectParameter(_ON_BASE, "", low=0.0, high=1.0, linear=False, choice=True, hidden=True))

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """First order: least squares beside a constant in the sensor."""
        weight = np.repeat([1.0, 20.0], 3)
        wanted = (residual - residual.mean(axis=0)) * weight
        turns = recorded.base is not None and np.ptp(recorded.base.rotation_world_base, axis=0).max() > _TURNED
        for on_base in (0.0, 1.0) if turns else (0.0,):
            columns = tilt_columns(recorded, on_base)
            columns = (columns - columns.mean(axis=0)) * weight[:, None]
            turn = np.clip(best_fit(columns.reshape(-1, 2), wanted.ravel())[0], -0.45, 0.45)
            yield dict(zip(_NAMES, turn.tolist(), strict=True)) | ({_ON_BASE: on_base} if recorded.base else {})

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        turn = rotation_of_vector([-values[_NAMES[0]], -values[_NAMES[1]], 0.0])
        axes, felt = _axes(recorded, values.get(_ON_BASE, 0.0))
        within = np.einsum("nji,nj->ni", axes, felt)
        change = np.einsum("nij,nj->ni", axes, within @ turn.T - within)
        return _weighed(recorded, change[:, None])[:, :, 0]

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        del recorded
        return {"tilt": (float(np.hypot(values[_NAMES[0]], values[_NAMES[1]])), "rad")}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        tilt = self.derived(recorded, values)["tilt"][0]
        about = "xy"[int(abs(values[_NAMES[1]]) > abs(values[_NAMES[0]]))]
        if values.get(_ON_BASE, 0.0) > 0.5:
            return (
                f"The arm stands tilted on its base by {np.degrees(tilt):.2f} degrees, mostly about {about} of the "
                "base: the nominal model stands upright."
            )
        return (
            f"The floor is not level: gravity is rotated by {np.degrees(tilt):.2f} degrees, mostly about {about} of "
            "the world; the nominal model stands upright."
        )


def tilt_columns(recorded: RecordedMotion, on_base: float = 0.0) -> Array:
    """(N, 6, 2) first-order response to the rotation of the base about x and y of the world, or of the base."""
    axes, felt = _axes(recorded, on_base)
    return -_weighed(recorded, cross(axes[:, :, :2].swapaxes(1, 2), felt[:, None]))


def _axes(recorded: RecordedMotion, on_base: float) -> tuple[Array, Array]:
    """(N, 3, 3) rotation from the axes in which the tilt is constant to the world, and (N, 3) m/s2 what is tilted.

    An arm that is tilted on its base feels the accelerations of the base tilted as well.
    """
    gravity = recorded.to_world(recorded.gravity)
    if on_base > 0.5 and recorded.base is not None:
        return recorded.base.rotation_world_base, gravity - recorded.base.acceleration_in_world
    return np.broadcast_to(np.eye(3), (len(recorded), 3, 3)), gravity


def _weighed(recorded: RecordedMotion, gravity_in_world: Array) -> Array:
    """(N, 6, k) the payload's wrench under k changes of gravity, (N, k, 3)."""
    change = np.einsum("nji,nkj->nki", recorded.rotation_world_sensor, gravity_in_world)
    torque = cross(recorded.phi[1:4], change)
    return np.concatenate([recorded.phi[0] * change, torque], axis=2).swapaxes(1, 2)
