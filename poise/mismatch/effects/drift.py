"""What drifts of a sensor have in common: a course over the recording, along a line or as a body that warms up."""

import itertools
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_FASTEST, _STRAIGHT = 0.05, 5.0
"""Time constants of the drift, relative to the recording: the fastest, and one that is as good as a line."""
_WARMS = 0.3
"""A time constant from which a fit reaches others, relative to the recording."""
_SHOWN = 2.0
"""Time constant below which it is reported, relative to the recording."""
_ENDLESS = 1e9
"""s, of a model without a time constant: a line."""


class Drift(Effect):
    """Something of the sensor changes by d (c(t) - c(t0)): d is the change over the recording.

    The course c goes from 0 to 1 along a line, or as a body that warms up does, with a time constant. At t0 the sensor
    is within its tolerance: in the middle of the recording, at its start or at its end.
    """

    layer = "sensor"
    source = "Robotiq FT 300-S manual, section 7 (drift); a body that warms up (first order), or a line"
    separating_motion = "visit the same pose at the start, in the middle and at the end"
    defaults: ClassVar[Values] = {"zero": 0.5, "time_constant": _ENDLESS}

    @abstractmethod
    def changes(self) -> Sequence[EffectParameter]:
        """What changes: linear parameters."""

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        fastest, slowest = _FASTEST * recorded.duration, _STRAIGHT * recorded.duration
        return (
            EffectParameter("zero", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True),
            EffectParameter("time_constant", "s", low=fastest, high=slowest, linear=False, log=True, hidden=True),
            *self.changes(),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del residual
        for zero, share in itertools.product((0.5, 0.0, 1.0), (_STRAIGHT, _WARMS)):
            yield {"zero": zero, "time_constant": share * recorded.duration}

    def course(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        """c(t) - c(t0), (N,)."""
        passed = recorded.seconds - recorded.seconds[0]
        slowness = nonlinear.get("time_constant", _ENDLESS)
        course = np.expm1(-passed / slowness) / np.expm1(-recorded.duration / slowness)
        return np.asarray(course - nonlinear.get("zero", 0.5))

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        slowness = values.get("time_constant", _ENDLESS)
        return {"time_constant": (slowness, "s")} if slowness < _SHOWN * recorded.duration else {}
