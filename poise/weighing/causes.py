"""The search for what is wrong with a wrench that no payload explains: every reading is tried on the same samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from poise.errors import ErrorCode
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.model import EstimateFinding, RejectedInterval
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.axes import wrong_axes
from poise.weighing.families import FAMILIES, in_contact, late_or_filtered
from poise.weighing.fitting import (
    Explanation,
    block_levels,
    explain,
    impossible,
    plain_design,
    plausibility,
)
from poise.weighing.gravity import with_free_weight
from poise.weighing.reading import Reading, Repair
from poise.weighing.units import wrong_units

_WIDTH, _BINS = 0.04, (150.0, 300.0)
"""s over which samples are averaged, and limits of the number of averages."""
_PER_PARAMETER = 3.0
"""Nats that a further parameter has to gain."""
_LEAST_GAIN, _LEAST_FIXED_GAIN = 8.0, 4.0
"""Nats that a cause has to gain; less where it has nothing to fit, and so cannot follow noise."""
_AS_WELL = 0.7
"""A cause precedes contact, which explains any residual, when it reduces the log of the residual by this share of what
contact does."""
_SPEAKS_FOR = 1.0
"""Nats from which on the samples speak for a cause, though chance may gain as much."""
_CHANCE = 0.01
"""Prior probability of each kind of trouble: of what is weighed, most is healthy."""
_CLEAR = 10.0
"""Nats by which the best cause is ahead of others that is certain."""
_LEFT = 1.5
"""Nats (force and torque) that a partly explained part may have above the rest."""
_IMPROVED = 0.8
"""Share of the blocks that a certain cause explains better."""


@dataclass(frozen=True, eq=False)
class Cause:
    """What is wrong with a wrench.

    Args:
        code: what kind.
        sentence: what it is, the evidence in numbers, and how to fix it.
        evidence: the numbers by name, SI units.
        gain: nats by which it explains the samples better, less what its parameters cost.
        fixed: it has nothing to fit: a unit, a sign, an exchange of axes.
        certain: no other cause explains the samples nearly as well, and it explains most of the recording.
        repair: how to make the wrench right; None: that is not possible.
        explanation: the fit.
        phi: (10,) of its payload, at the end of the recording.
        partial: it leaves out a part of the recording, and so explains any residual there.
        open_pull: N of a constant vertical force that may pull as well, and cannot be distinguished from weight.
        shown: its gain is more than that of chance.
        besides: it explains what the likeliest cause leaves: there are two errors.
    """

    code: ErrorCode
    sentence: str
    evidence: Mapping[str, float]
    gain: float
    fixed: bool
    certain: bool
    repair: Repair | None
    explanation: Explanation
    phi: Array
    partial: bool = False
    open_pull: float = 0.0
    shown: bool = True
    besides: bool = False

    @property
    def finding(self) -> EstimateFinding:
        """As a finding of the estimate."""
        return EstimateFinding(self.code, self.sentence, self.evidence)


def find_causes(samples: FitSamples, delay: float = 0.0, pushed: Sequence[RejectedInterval] = ()) -> tuple[Cause, ...]:
    """The causes that `possible_causes` shows."""
    return tuple(cause for cause in possible_causes(samples, delay, pushed) if cause.shown)


def possible_causes(
    samples: FitSamples, delay: float = 0.0, pushed: Sequence[RejectedInterval] = ()
) -> tuple[Cause, ...]:
    """Find what explains samples that a payload with a constant bias does not; the likeliest first.

    Those that the samples speak for, but do not show, come last.

    Args:
        samples: of the weighing.
        delay: s that the weighing found the wrench to be late.
        pushed: spans in which the weighing found contact.
    """
    samples = _averaged(samples.delayed(delay))
    if len(samples) < 8:
        return ()
    plain = explain(samples, plain_design)
    families = (*FAMILIES, late_or_filtered(delay), in_contact(pushed))
    tried = [
        cause
        for family in families
        for reading in family(samples, plain)
        if (cause := _tried(reading, samples, plain)) is not None
    ]
    tried.sort(key=lambda cause: -cause.gain)
    found, others = ([cause for cause in tried if cause.shown is shown] for shown in (True, False))
    free = next((_level(cause) for cause in found if cause.partial), np.nan)
    if np.isfinite(free):
        begin = float(plain.levels.mean(axis=0).sum())
        most = begin - _AS_WELL * (begin - free)
        found.sort(key=lambda cause: 1 if cause.partial else 2 * (_level(cause) > most))
    named = {(cause.code, cause.partial) for cause in found}
    others = [cause for cause in others if (cause.code, cause.partial) not in named]
    second = _besides(found[0], samples) if found else ()
    return (*_distinct(found), *second, *_distinct(others))


def chances(causes: Sequence[Cause]) -> Array:
    """(C,) posterior probabilities of causes, beside that of a healthy wrench."""
    odds = np.array([cause.gain for cause in causes]) + np.log(_CHANCE)
    most = float(odds.max(initial=0.0))
    weights = np.exp(odds - most)
    return np.asarray(weights / (weights.sum() + np.exp(-most)))


def _besides(first: Cause, samples: FitSamples) -> tuple[Cause, ...]:
    """An axis, a sign or a unit that explains what the likeliest cause leaves: the samples may have two errors.

    Others than these have parameters, and would follow what the first fit did not. Nor is anything sought beside
    a cause that leaves out a part of the recording: an axis may explain by chance what is left there.
    """
    if first.partial:
        return ()
    found = first.explanation
    left = replace(samples, wrench=plain_design(samples, found.values) @ found.unknowns[:16] + found.residual)
    plain = explain(left, plain_design)
    readings = [each for family in (wrong_axes, wrong_units) for each in family(left, plain) if each.starts == ((),)]
    causes = [cause for each in readings if (cause := _tried(each, left, plain)) is not None and cause.gain > _CLEAR]
    best = max(causes, key=lambda cause: cause.gain, default=None)
    if best is None or best.code is first.code:
        return ()
    return (replace(best, sentence=f"a second error: {best.sentence}", certain=False, besides=True),)


def inertial_mass(samples: FitSamples, delay: float = 0.0) -> tuple[float, float]:
    """The mass that inertial forces show beside any weight, and one sigma, kg, with the arguments of `find_causes`.

    Infinite: the motion shows none.
    """
    samples = _averaged(samples.delayed(delay))
    if len(samples) < 8:
        return np.nan, np.inf
    found = explain(samples, with_free_weight(4))
    return float(found.phi[0]), found.mass_std


def _tried(reading: Reading, samples: FitSamples, plain: Explanation) -> Cause | None:
    """A reading fitted from the best of its starts, where it explains more than it costs."""
    first = [
        explain(samples, reading.design, start, reading.usable, quick=len(reading.starts) > 1)
        for start in reading.starts
    ]
    best = min(first, key=lambda fit: _levels(reading, samples, fit).sum())
    if len(first) > 1:
        best = explain(samples, reading.design, best.values.tolist(), reading.usable)
    pull = reading.open_pull(best)
    opened = best.with_pull(pull / STANDARD_GRAVITY)
    if impossible(opened) or not reading.holds(opened):
        return None
    levels = _levels(reading, samples, best)
    if reading.reduced is not None and reading.excluded is not None:
        left = np.median(levels[reading.excluded].sum(axis=1)) - np.median(levels[~reading.excluded].sum(axis=1))
        if left > _LEFT:
            return None
    improvement = (plain.levels - levels).sum(axis=1)
    n_free = best.n_free + (0 if reading.excluded is None else 2 * int(reading.excluded.sum()))
    gain = 3 * float(improvement.sum()) - _PER_PARAMETER * n_free + reading.prior
    gain += plausibility(opened) - plausibility(plain)
    fixed = n_free == 0 and reading.usable is None and reading.reduced is None and reading.censored is None
    shown = gain >= (_LEAST_FIXED_GAIN if fixed else _LEAST_GAIN) or (gain > 0 and bool(impossible(plain)))
    if not shown and gain < _SPEAKS_FOR:
        return None
    share = float(np.mean(improvement > 0.05))
    sentence, evidence = _evidence(reading, best, plain.rms, np.exp(levels.mean(axis=0)), share)
    repair = None if reading.repair is None else reading.repair(best)
    partial = reading.excluded is not None and reading.reduced is None
    certain, evidence = share >= _IMPROVED, evidence | {"gain": gain}
    phi = reading.last(best)
    return Cause(reading.code, sentence, evidence, gain, fixed, certain, repair, best, phi, partial, pull, shown)


def _evidence(
    reading: Reading, found: Explanation, before: Array, after: Array, share: float
) -> tuple[str, dict[str, float]]:
    """The sentence of a reading and its numbers, with residuals (2,) before and after in N and N m."""
    sentence, numbers = reading.says(found)
    residuals = {
        "residual_force_before": float(before[0]),
        "residual_force_after": float(after[0]),
        "residual_torque_before": float(before[1]),
        "residual_torque_after": float(after[1]),
        "blocks_improved": share,
    }
    explained = (
        f"{sentence} (it reduces the residual from {before[0]:.2g} N and {before[1]:.2g} N m to {after[0]:.2g} N and"
        f" {after[1]:.2g} N m, in {100 * share:.0f} % of the recording)"
    )
    return explained, {**numbers, **residuals}


def _level(cause: Cause) -> float:
    """Sum of the mean logs of the force and the torque that a cause leaves."""
    return float(np.log(cause.evidence["residual_force_after"] * cause.evidence["residual_torque_after"]))


def _levels(reading: Reading, samples: FitSamples, found: Explanation) -> Array:
    """(B, 2) log levels of what a reading leaves."""
    residual = found.residual
    if reading.censored is not None:
        predicted = (samples.wrench - residual).clip(*reading.censored)
        residual = samples.wrench - predicted
    if reading.reduced is not None:
        residual = reading.reduced(found)
    levels = block_levels(residual, reading.usable if reading.ignores else None)
    if reading.excluded is not None and reading.reduced is None:
        levels[reading.excluded] = np.median(levels[~reading.excluded], axis=0)
    return levels


def _distinct(found: list[Cause]) -> tuple[Cause, ...]:
    """One cause of each kind; the first is certain only where no other kind comes near."""
    kinds: dict[tuple[ErrorCode, bool], Cause] = {}
    for cause in found:
        kinds.setdefault((cause.code, cause.partial), cause)
    ranked = list(kinds.values())
    clear = len(ranked) < 2 or ranked[0].gain - ranked[1].gain > _CLEAR
    return tuple(replace(cause, certain=cause.certain and clear and cause is ranked[0]) for cause in ranked)


def _averaged(samples: FitSamples) -> FitSamples:
    """Averages over a few hundredths of a second: they are linear as samples are, with less noise and vibration."""
    if not len(samples):
        return samples
    last = max(float(samples.seconds[-1]), 1e-9)
    return samples.averaged(np.floor(samples.seconds * np.clip(last / _WIDTH, *_BINS) / last))
