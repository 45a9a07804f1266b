"""Temperature drift: the friction of joints falls as their gears warm up."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import (
    each_joint,
    efforts,
    listed,
    numbers,
    per,
    sense,
    torque_sizes,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_QUICKEST = 20.0
"""s: least time constant of a gear that warms up."""


class TemperatureDrift(Effect):
    """tau_j = (d_j v_j + c_j sign(v_j)) exp(-t / T), beside the friction of the warm gear."""

    name = "temperature_drift"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = (damping_j v_j + torque_j sign(v_j)) exp(-t / time_constant)"
    source = "Bittencourt and Gunnarsson 2012 (friction of a robot joint against its temperature)"
    excited_by = "the same motion for minutes, from a cold start"
    separating_motion = "one cycle, repeated until the torques of two cycles are equal"
    confused_with = ("viscous_friction", "coulomb_friction", "stribeck_friction")
    needs = ("effort",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        joints, sizes = numbers(recorded), torque_sizes(recorded)
        rates = per(recorded, "velocity") if recorded.effort is not None else sizes
        longest = max(1.5 * recorded.duration, 3.0 * _QUICKEST)
        made = [EffectParameter("time_constant", "s", low=_QUICKEST, high=longest, linear=False, log=True)]
        for kind, unit, scales in (("damping", "N m s/rad", rates), ("torque", "N m", sizes)):
            pairs = zip(joints, scales, strict=True)
            made += [EffectParameter(f"{kind}_{i}", unit, 0.5 * scale, positive=True) for i, scale in pairs]
        return tuple(made)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del residual
        for share in (0.1, 0.4):
            yield {"time_constant": max(share * recorded.duration, 1.3 * _QUICKEST)}

    def untestable(self, recorded: RecordedMotion) -> str:
        short = f"it lasts {recorded.duration:.0f} s, and gears warm up in minutes"
        return super().untestable(recorded) or (short if recorded.duration < 0.9 * _QUICKEST else "")

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        track = efforts(recorded)
        cold = np.exp(-(track.seconds - track.seconds[0]) / nonlinear["time_constant"])[:, None]
        return np.concatenate([each_joint(cold * part) for part in (track.velocity, sense(recorded))], axis=2)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        fastest = np.abs(efforts(recorded).velocity).max(axis=0)
        lost = [
            values[f"damping_{i}"] * speed + values[f"torque_{i}"]
            for i, speed in zip(numbers(recorded), fastest, strict=True)
        ]
        return (
            f"Joint friction falls as the gears warm up, within {values['time_constant']:.0f} s: "
            f"{listed(recorded, lost, 'N m')}; the nominal friction is constant."
        )
