"""Load-dependent friction: the friction of a gear grows with its load."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import (
    COULOMB_TRANSITION,
    TRANSITION,
    each_joint,
    efforts,
    listed,
    numbers,
    sense,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_INERTIAL = EffectParameter("inertial", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True)


class LoadDependentFriction(Effect):
    """tau_j = r_j |load_j| tanh(v_j / width): a gear's loss in proportion to what it transmits.

    The load is all of the rigid-body torque, or what is left of it at constant speed: where the inertia of the joint
    is that of its rotor, on the other side of the gear, the gear does not transmit it.
    """

    name = "load_dependent_friction"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = ratio_j |tau_j| tanh(v_j / transition), tau = tau_rigid or tau_rigid - M a"
    source = "Hamon, Gautier, Garrec 2010; Bittencourt and Gunnarsson 2012 (friction of a robot joint against its load)"
    excited_by = "reversals under a heavy and under a light load"
    separating_motion = "the same slow strokes with the arm stretched and folded: this friction grows with the reach"
    confused_with = ("coulomb_friction", "stribeck_friction", "viscous_friction")
    needs = ("effort",)
    dry = True
    defaults: ClassVar[Values] = {"transition": COULOMB_TRANSITION, "inertial": 1.0}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        ratios = (EffectParameter(f"ratio_{i}", "", 0.08, positive=True) for i in numbers(recorded))
        return (TRANSITION, _INERTIAL, *ratios)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del recorded, residual
        for inertial in (1.0, 0.0):
            for width in (0.006, 0.03):
                yield {_INERTIAL.name: inertial, TRANSITION.name: width}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        track = efforts(recorded)
        load = track.rigid if nonlinear[_INERTIAL.name] else track.rigid - track.accelerating
        return each_joint(np.abs(load) * sense(recorded, nonlinear["transition"]))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [100.0 * values[f"ratio_{i}"] for i in numbers(recorded)], "%")
        return f"Joint friction is proportional to the load: {sizes} of it; the nominal gears lose nothing."
