"""Series elasticity: the gear of a joint bends, so that the link is not where the motor's encoder says."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import efforts, listed, numbers
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_BAND = 0.02
"""s: the bend is differentiated twice; faster changes of the torque are mostly noise of accelerations."""
_USUAL = 3e-3
"""rad that a joint bends under its usual torque."""


class SeriesElasticity(Effect):
    """e_j = -tau_j / k_j between motor and link; for any e(t) the efforts change by M e'' + dtau/dq e."""

    name = "series_elasticity"
    layer = "friction"
    signal = "effort"
    equation = "dtau = sum_j (M_.j e_j'' + dtau/dq_j e_j), e_j = -compliance_j tau_rigid_j"
    source = "Spong 1987 (flexible joints), to first order in the compliance"
    excited_by = "large torques that change quickly; postures in which a bend moves much weight"
    separating_motion = "quick strokes of one joint with the arm stretched: the bend grows with the torque"
    confused_with = ("joint_offset", "motor_inertia", "backlash", "link_parameters")
    needs = ("effort",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        if recorded.effort is None:
            return ()
        usual = np.quantile(np.abs(recorded.effort.rigid), 0.9, axis=0)
        usual = np.maximum(usual, 0.05 * usual.max(initial=1e-6))
        return tuple(
            EffectParameter(f"compliance_{i}", "rad/(N m)", float(_USUAL / size), positive=True)
            for i, size in zip(numbers(recorded), usual, strict=True)
        )

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        track = efforts(recorded)
        bend = -gaussian_filter1d(track.rigid, _BAND / track.period, axis=0, mode="nearest")
        rate = np.gradient(bend, track.seconds, axis=0)
        second = np.gradient(rate, track.seconds, axis=0)
        return np.asarray(track.by_acceleration * second[:, None, :] + track.by_position * bend[:, None, :])

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        largest = np.abs(efforts(recorded).rigid).max(axis=0)
        bends = [
            1e3 * values[f"compliance_{i}"] * size for i, size in zip(numbers(recorded), largest.tolist(), strict=True)
        ]
        return f"Gears bend under load, by up to {listed(recorded, bends, 'mrad')}: the nominal gears are stiff."
