"""The hypotheses that a search has tried, with their fits, each under the noise that suits it best."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from poise.mismatch.effects import Effect
from poise.mismatch.inference.coarse import thinned
from poise.mismatch.inference.fitting import HypothesisFit, fit
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.inference.time_limit import TimeLimit
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

WARM_STEPS = 2
"""Steps of a fit from another fit."""


@dataclass
class HypothesisSearch:
    """The hypotheses that were tried, and their fits.

    Args:
        problem: the signal; its noise is that of the nominal model.
        fast: hypotheses are compared at the full rate, because fast effects are among them.
        fits: best fit of every hypothesis, by the names of its effects.
        gains: log evidence that an effect adds to a hypothesis, estimated without a full fit.
        untestable: effects that this recording cannot show, and why.
        late: names of effects that were not tried before the deadline.
        library: the effects that were searched for, free curves among them.
        replaced: answers that came from another one by replacing an effect.
        limit: time for the search. When it is over, the search ends with the best hypothesis so far.
    """

    problem: Problem
    fast: bool = False
    fits: dict[tuple[str, ...], HypothesisFit] = field(default_factory=dict)
    gains: dict[tuple[tuple[str, ...], str], float] = field(default_factory=dict)
    untestable: dict[str, str] = field(default_factory=dict)
    late: tuple[str, ...] = ()
    library: tuple[Effect, ...] = ()
    replaced: set[tuple[str, ...]] = field(default_factory=set)
    limit: TimeLimit = field(default_factory=TimeLimit)
    _under: dict[tuple[int, bool], tuple[HypothesisFit, Problem]] = field(default_factory=dict)
    _judged: dict[tuple[str, ...], Problem] = field(default_factory=dict)

    @property
    def judging(self) -> Problem:
        """The data of the comparison: the recording, thinned as long as all candidates are slow."""
        return self.problem if self.fast else thinned(self.problem)

    def under(self, best: HypothesisFit) -> Problem:
        """The data with the noise that a fit leaves."""
        if not best.parts:
            return self.judging
        key = id(best), self.fast
        if key not in self._under:
            problem = self.problem.with_noise(self.problem.fitted_noise(residual_of(self.problem, best)))
            self._under[key] = best, problem if self.fast else thinned(problem)
        return self._under[key][1]

    def quicken(self) -> None:
        """Compare at the full rate from now on."""
        self.fast = True
        known = list(self.fits.values())
        self.fits.clear()
        for each in known:
            self.fitted(self.under(each), each.parts, WARM_STEPS)

    def fitted(self, problem: Problem, parts: Sequence[FittedEffect], steps: int) -> HypothesisFit:
        """Fit a hypothesis and offer it; without evidence where the values are physically impossible."""
        found = fit(problem, parts, steps)
        if implausible(problem.recorded, found.parts):
            found = replace(found, log_evidence=-np.inf)
        self.offer(found)
        if self.fits[names(found)] is found:
            self._judged[names(found)] = problem
        return found

    def judged(self, best: HypothesisFit) -> Problem:
        """The data with the noise under which a hypothesis has its best evidence."""
        return self._judged.get(names(best), self.judging)

    def offer(self, found: HypothesisFit) -> None:
        """Keep a fit when it is the best of its hypothesis."""
        key = names(found)
        if key not in self.fits or self.fits[key].log_evidence < found.log_evidence:
            self.fits[key] = found


def implausible(recorded: RecordedMotion, parts: Sequence[FittedEffect]) -> str:
    """Why values of some effect are physically impossible, as a clause; "" when all are possible."""
    reasons = (part.effect.implausible(recorded, part.values) for part in parts)
    return next((reason for reason in reasons if reason), "")


def alike(one: Effect, other: Effect) -> bool:
    """Whether effects are the same, or produce nearly equal residuals on poor motions."""
    return one.name in (other.name, *other.confused_with) or other.name in one.confused_with


def names(found: HypothesisFit) -> tuple[str, ...]:
    """The effects of a fit, in alphabetical order."""
    return tuple(sorted(part.effect.name for part in found.parts))


def residual_of(problem: Problem, found: HypothesisFit) -> Array:
    """(N, C) residual of a fit, calibration errors removed."""
    return problem.unexplained(problem.predicted(problem.recorded) + found.response + found.calibrated)
