"""Backlash: between a motor and its link there is play."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Array, Effect, Parameter, Values
from poise.mismatch.joint_friction import column_of, efforts, joint_called, numbers
from poise.mismatch.part_motion import between_stops
from poise.mismatch.world import World


class Backlash(Effect):
    """The link of one joint is free within a gap: no effort while it crosses, and a knock where it arrives.

    Encoder and effort are the motor's. With e the link's angle beyond the motor's: e'' = -tau_j / M_jj when free;
    whatever e does, the efforts change by M e'' and by dtau/dq e.
    """

    name = "backlash"
    layer = "friction"
    signal = "effort"
    equation = "dtau = M_.j e'' + (dtau/dq_j) e; e'' = -tau_j / M_jj while |e| < gap / 2, at rest on a flank otherwise"
    source = "dead zone with impacts (Nordin and Gutman 2002, section 2); M: joint-space inertia"
    excited_by = "a joint whose torque changes sign: a vertical axis that speeds up and slows down, a balanced wrist"
    separating_motion = "small strokes of the joint to and fro without load: the torque vanishes, then knocks"
    confused_with = ("coulomb_friction", "stribeck_friction", "motor_inertia")
    needs = ("effort",)

    def parameters(self, world: World) -> tuple[Parameter, ...]:
        if world.effort is None:
            return ()
        return (
            Parameter("joint", "", low=1.0, high=float(max(numbers(world))), linear=False, choice=True),
            Parameter("gap", "rad", low=2e-4, high=0.3, linear=False, log=True),
            Parameter("settling", "s", low=5e-4, high=0.1, linear=False, log=True, hidden=True),
        )

    def starts(self, world: World, residual: Array) -> Iterable[Values]:
        """Joint, gap and softness of the knock that fit best."""
        own = residual / np.maximum(residual.std(axis=0), 1e-12)
        scale = residual.std(axis=0)
        scores = []
        for number in numbers(world):
            for gap in (0.002, 0.008, 0.03):
                for settling in (0.004, 0.02):
                    values = {"joint": float(number), "gap": gap, "settling": settling}
                    response = self.simulate(world, values) / np.maximum(scale, 1e-12)
                    left = own - response
                    scores.append((float(np.sum((left - left.mean(axis=0)) ** 2)), values))
        for _, values in sorted(scores, key=lambda item: item[0])[:2]:
            yield values

    def simulate(self, world: World, values: Values) -> Array:
        track, column = efforts(world), column_of(world, values["joint"])
        inertia = track.by_acceleration[:, :, column]
        push = -track.rigid[:, column] / np.maximum(inertia[:, column], 1e-6)
        beyond, _, second = between_stops(track.seconds, push, values["gap"], values["settling"])
        return np.asarray(inertia * second[:, None] + track.by_position[:, :, column] * beyond[:, None])

    def sentence(self, world: World, values: Values) -> str:
        return (
            f"{joint_called(world, values['joint'])} has {np.degrees(values['gap']):.2f} degrees of backlash: its "
            "torque vanishes when it changes sign, then knocks; the nominal gear has no play."
        )
