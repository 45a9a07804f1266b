"""The diagnoses of a comparison: each once, within its time limit."""

import time
from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from poise.mismatch.answer import Diagnosis, NamedEffect, Quantity, diagnose
from poise.mismatch.comparing.presence import USUAL, own_values
from poise.mismatch.effects import Effect, all_effects
from poise.mismatch.inference import averaged_efforts
from poise.mismatch.reading import NominalModel
from poise.mismatch.recorded import RecordedMotion

_PER_RECORDING = ("bias_force", "bias_torque", "drift_force", "drift_torque", "clock_offset", "effort_offset")
"""Tolerances of what may differ at every start of a robot: two recordings may be at both edges."""
_OF_ROBOT, _LEFT = ("link_mass", "motor_gain", "sensor_gain", "sensor_rotation"), 0.2
"""Tolerances, with those of the payload, of what is the same in both recordings; this share of them may stay."""
_SPAN, _ROWS = 0.012, 1000
"""s over which joint efforts are averaged where slow effects are looked for, and averages that have to be left."""


class Stages:
    """What a comparison computes.

    Args:
        model: of both recordings; `for_two`: with the tolerances of a difference.
        deadline: s from now.
        progress: is called with the completed share.
    """

    def __init__(self, model: NominalModel, deadline: float, progress: Callable[[float], None]) -> None:
        self.model, self.for_two = model, _for_two(model)
        self._end, self._progress, self._done = time.perf_counter() + deadline, progress, 0.0
        self._alone = list[tuple[RecordedMotion, NominalModel, bool, Diagnosis]]()
        self._own = list[tuple[Effect, RecordedMotion, dict[str, Quantity]]]()

    def diagnose(
        self, recorded: RecordedMotion, model: NominalModel, *, usual: bool = False, without: Collection[str] = ()
    ) -> Diagnosis:
        """A quarter of the progress; `usual`: what most models lack alone, as a model; `without`: what is not tried."""
        done, left = self._done, max(self._end - time.perf_counter(), 0.1)
        self._done = min(done + 0.25, 0.75)
        tried = [e for e in all_effects() if e.name not in without and (not usual or e.name in USUAL)]
        library = tried if usual or without else None
        bar = lambda share: self._progress(done + 0.25 * share)  # noqa: E731
        return diagnose(recorded, model, library=library, rivals=not usual, deadline=left, progress=bar)

    def alone(self, recorded: RecordedMotion, model: NominalModel) -> Diagnosis:
        """What a model lacks in one recording: what most models lack, or more where that leaves something."""
        found = self.usual(recorded, model)
        return found if found.unknown is None else self._once(recorded, model, False)

    def usual(self, recorded: RecordedMotion, model: NominalModel) -> Diagnosis:
        """What a model lacks in one recording, of what most models lack: it is slow, so that averages show it."""
        return self._once(recorded, model, True)

    def _once(self, recorded: RecordedMotion, model: NominalModel, usual: bool) -> Diagnosis:
        for each, known, alike, found in self._alone:
            if each is recorded and known is model and alike == usual:
                return found
        found = self.diagnose(_slow(recorded) if usual else recorded, model, usual=usual)
        self._alone.append((recorded, model, usual, found))
        return found

    def own_values(self, finding: NamedEffect, recorded: RecordedMotion) -> dict[str, Quantity]:
        """The parameters of an effect in one recording by itself; empty where it does not show it."""
        for effect, each, values in self._own:
            if effect is finding.effect and each is recorded:
                return values
        self._own.append((finding.effect, recorded, own_values(finding, recorded, self.model)))
        return self._own[-1][2]


def _slow(recorded: RecordedMotion) -> RecordedMotion:
    """The recording with joint efforts averaged over `_SPAN`."""
    effort = recorded.effort
    together = 1 if effort is None else round(_SPAN / effort.period)
    if effort is None or together < 2 or len(effort.seconds) < _ROWS * together:
        return recorded
    rows = np.arange(len(effort.seconds) // together * together).reshape(-1, together)
    whole = effort.seconds[rows[:, -1]] - effort.seconds[rows[:, 0]] < 1.5 * _SPAN  # no gap
    return replace(recorded, effort=averaged_efforts(effort, rows[whole]))


def _for_two(model: NominalModel) -> NominalModel:
    tolerance = model.tolerance
    changed = {name: 2.0 * getattr(tolerance, name) for name in _PER_RECORDING}
    same = (*_OF_ROBOT, "payload_mass", "payload_com", "payload_inertia")
    changed |= {name: _LEFT * getattr(tolerance, name) for name in same}
    return replace(model, tolerance=replace(tolerance, **changed))
