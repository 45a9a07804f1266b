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

_CHANGES = 0.05
"""Least share of the response that Coulomb friction does not have: no law of friction is exact."""


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

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """Where the load of the joints that rub hardly changes, as that of a lift, it is Coulomb friction as well."""
        refused = super().implausible(recorded, values)
        return refused or self._as_coulomb(recorded, values)

    def _as_coulomb(self, recorded: RecordedMotion, values: Values) -> str:
        # Sizes of joints in N m and N: all are relative to what each joint carries.
        size = np.maximum(efforts(recorded).sizes, 1e-9)
        response, sense = self.simulate(recorded, values) / size, reversal(recorded, values)
        steady = np.sum(response * sense, axis=0) / np.maximum(np.sum(sense**2, axis=0), 1e-9)
        left = float(np.sum((response - steady * sense) ** 2))
        hardly = left < _CHANGES**2 * float(np.sum(response**2))
        return "the load hardly changes: Coulomb friction has the same response" if hardly else ""

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [100.0 * values[f"ratio_{i}"] for i in numbers(recorded)], "%")
        return f"Joint friction is proportional to the load: {sizes} of it; the nominal gears lose nothing."
