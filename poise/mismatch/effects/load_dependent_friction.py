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
    transitions,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class LoadDependentFriction(Effect):
    """tau_j = r_j |tau_rigid_j| tanh(v_j / width): a gear's loss in proportion to what it transmits."""

    name = "load_dependent_friction"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = ratio_j |tau_rigid_j| tanh(v_j / transition)"
    source = "Hamon, Gautier, Garrec 2010; Bittencourt and Gunnarsson 2012 (friction of a robot joint against its load)"
    excited_by = "reversals under a heavy and under a light load"
    separating_motion = "the same slow strokes with the arm stretched and folded: this friction grows with the reach"
    confused_with = ("coulomb_friction", "stribeck_friction", "viscous_friction")
    needs = ("effort",)
    defaults: ClassVar[Values] = {"transition": COULOMB_TRANSITION}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        ratios = (EffectParameter(f"ratio_{i}", "", 0.08, positive=True) for i in numbers(recorded))
        return (TRANSITION, *ratios)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del recorded, residual
        yield from transitions()

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return each_joint(np.abs(efforts(recorded).rigid) * sense(recorded, nonlinear["transition"]))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [100.0 * values[f"ratio_{i}"] for i in numbers(recorded)], "%")
        return f"Joint friction is proportional to the load: {sizes} of it; the nominal gears lose nothing."
