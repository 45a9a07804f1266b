"""Quantisation: the reading has steps that are coarser than the noise."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, lattice, white_level
from poise.types import Array

_FINEST = (1e-3, 1e-5)
"""N, N m: finer steps do not matter."""
_MATERIAL = 0.1
"""Share of the white noise's power from which rounding counts."""


class Quantisation(Effect):
    """w_read = step round(w / step), forces and torques each with one step; the last stage of a reading.

    A residual hardly shows it (rounding looks like noise), the readings do: all of them are whole multiples of the
    step. `starts` finds it there, and yields nothing without a common step.
    """

    name = "quantisation"
    layer = "sensor"
    fast = True
    direct = True
    equation = "w_read = step round(w / step)"
    source = "uniform quantiser; error step / sqrt(12) when it is busy (Widrow and Kollar 2008)"
    excited_by = "any motion: every reading is a multiple of the step"
    separating_motion = "none needed; a slow rotation under load shows each step"
    confused_with = ()
    order = 100

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return tuple(
            EffectParameter(
                f"{what}_step", unit, low=fine, high=1e4 * fine, linear=False, log=True, resolution=1e-3 * fine
            )
            for what, unit, fine in zip(("force", "torque"), ("N", "N m"), _FINEST, strict=True)
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del residual
        found = self.found(recorded)
        if found is not None:
            yield found

    def detected(self, recorded: RecordedMotion) -> Values | None:
        found = self.found(recorded)
        if found is None:
            return None
        # An axis that stands at a limit has no noise: the middle one of the three axes counts.
        level = np.median(white_level(recorded.wrench - recorded.nominal).reshape(2, 3), axis=1)
        rounding = np.array([found["force_step"], found["torque_step"]]) / np.sqrt(12.0)
        return found if bool((rounding**2 > _MATERIAL * level**2).any()) else None

    @staticmethod
    def found(recorded: RecordedMotion) -> dict[str, float] | None:
        """The steps that the readings are multiples of, or None when neither forces nor torques are on any grid."""
        steps = [lattice(recorded.wrench[:, part]) for part in (slice(0, 3), slice(3, 6))]
        if not any(steps):
            return None
        return {f"{what}_step": max(s, fine) for what, s, fine in zip(("force", "torque"), steps, _FINEST, strict=True)}

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        step = np.repeat([values["force_step"], values["torque_step"]], 3)
        return np.asarray(np.round(recorded.prediction / step) * step - recorded.prediction)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        return (
            f"The readings come in steps of {values['force_step']:.3g} N and {values['torque_step']:.3g} N m: "
            "the nominal sensor has none."
        )
