"""Load-dependent friction: the friction of a gear grows with its load."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import EffectParameter, Values
from poise.mismatch.effects.joint_friction import (
    COULOMB_TRANSITION,
    REVERSAL_DEFAULTS,
    DryFriction,
    each_joint,
    efforts,
    listed,
    numbers,
    reversal,
    reversal_parameters,
    reversals_by_law,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_INERTIAL = EffectParameter("inertial", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True)


class LoadDependentFriction(DryFriction):
    """tau_j = r_j |load_j| s_j, s as in `reversal`: a gear's loss in proportion to what it transmits.

    The load is all of the rigid-body torque, or what is left of it at constant speed: where the inertia of the joint
    is that of its rotor, on the other side of the gear, the gear does not transmit it.
    """

    name = "load_dependent_friction"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = ratio_j |tau_j| s_j (see coulomb_friction), tau = tau_rigid or tau_rigid - M a"
    source = "Hamon, Gautier, Garrec 2010; Bittencourt and Gunnarsson 2012 (friction of a robot joint against its load)"
    excited_by = "reversals under a heavy and under a light load"
    separating_motion = "the same slow strokes with the arm stretched and folded: this friction grows with the reach"
    confused_with = ("coulomb_friction", "stribeck_friction", "viscous_friction")
    needs = ("effort",)
    defaults: ClassVar[Values] = {"transition": COULOMB_TRANSITION, "inertial": 1.0, **REVERSAL_DEFAULTS}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        ratios = (EffectParameter(f"ratio_{i}", "", 0.08, positive=True) for i in numbers(recorded))
        return (*reversal_parameters(recorded), _INERTIAL, *ratios)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        _, smooth, _, bent, soft = reversals_by_law(recorded, residual)
        for inertial in (1.0, 0.0):
            for law in (smooth, bent, soft):
                yield {**law, _INERTIAL.name: inertial}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        track = efforts(recorded)
        load = track.rigid if nonlinear[_INERTIAL.name] else track.rigid - track.accelerating
        return each_joint(np.abs(load) * reversal(recorded, nonlinear))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [100.0 * values[f"ratio_{i}"] for i in numbers(recorded)], "%")
        return f"Joint friction is proportional to the load: {sizes} of it; the nominal gears lose nothing."
