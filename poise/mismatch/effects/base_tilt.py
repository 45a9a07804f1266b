"""Base tilt: the floor that odometry calls level is not."""

from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from poise.geometry import cross
from poise.mismatch.effects.base import Effect, Parameter, Values
from poise.mismatch.effects.part_wrench import best_fit
from poise.mismatch.recorded import World
from poise.types import Array

NAMES = ("rotation_x", "rotation_y")


class BaseTilt(Effect):
    """Gravity points elsewhere: g = exp(-[r]) g0 in the world's axes, r level. Exact in r."""

    name = "base_tilt"
    layer = "kinematics"
    equation = "g = exp(-[r]x) g0, r = (rx, ry, 0): dw = m dg, mc x dg"
    source = "thesis eq. 2.97 with gravity turned (Rodrigues' formula); a turn about the vertical does not show"
    excited_by = "weight in changing directions: the error is fixed in the world and turns in the sensor"
    separating_motion = (
        "turn the tool about the vertical and the first joint: a tilt stays in the world, a sensor's turns"
    )
    confused_with = ("joint_offset", "sensor_rotation", "world_force", "base_motion")
    needs = ("load",)

    def parameters(self, world: World) -> tuple[Parameter, ...]:
        del world
        return tuple(Parameter(n, "rad", scale=0.01, low=-0.5, high=0.5, linear=False, peaked=True) for n in NAMES)

    def starts(self, world: World, residual: Array) -> Iterable[Values]:
        """First order: least squares beside a constant in the sensor."""
        weight = np.repeat([1.0, 20.0], 3)
        columns = self._weighed(world, cross(np.eye(3)[:2], world.to_world(world.gravity)[:, None]))
        columns = (columns - columns.mean(axis=0)) * weight[:, None]
        wanted = (residual - residual.mean(axis=0)) * weight
        turn = -best_fit(columns.reshape(-1, 2), wanted.ravel())[0]
        yield dict(zip(NAMES, np.clip(turn, -0.45, 0.45).tolist(), strict=True))

    def simulate(self, world: World, values: Values) -> Array:
        turn = Rotation.from_rotvec([-values[NAMES[0]], -values[NAMES[1]], 0.0]).as_matrix()
        gravity = world.to_world(world.gravity)
        return self._weighed(world, (gravity @ turn.T - gravity)[:, None])[:, :, 0]

    def derived(self, world: World, values: Values) -> dict[str, tuple[float, str]]:
        del world
        return {"tilt": (float(np.hypot(values[NAMES[0]], values[NAMES[1]])), "rad")}

    def sentence(self, world: World, values: Values) -> str:
        tilt = self.derived(world, values)["tilt"][0]
        about = "xy"[int(abs(values[NAMES[1]]) > abs(values[NAMES[0]]))]
        return (
            f"The floor is not level: gravity is turned by {np.degrees(tilt):.2f} degrees, mostly about {about} of the "
            "world; the nominal model stands upright."
        )

    @staticmethod
    def _weighed(world: World, gravity_in_world: Array) -> Array:
        """(N, 6, k) the payload's wrench under k changes of gravity, (N, k, 3)."""
        change = np.einsum("nji,nkj->nki", world.rotation_world_sensor, gravity_in_world)
        torque = cross(world.phi[1:4], change)
        return np.concatenate([world.phi[0] * change, torque], axis=2).swapaxes(1, 2)
