"""The proof: a model fitted without some samples, compared with them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poise.mismatch.inference.coarse import thinned
from poise.mismatch.inference.fitting import HypothesisFit, fit
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.inference.unknown import Dependence
from poise.types import Array, Mask

_STEPS = 4
"""Steps of the fit without the held-out samples, which starts from the fit with them."""
_EQUAL = 1e-3
"""Relative difference up to which errors are equal."""
_ALLOWED = 0.15
"""Energy above that of noise that held-out samples may have, since calibration errors are extrapolated to them."""
_TAIL = 0.3
"""Share of a single recording, at its end, that is held out."""


@dataclass(frozen=True, eq=False)
class HeldOutProof:
    """Errors on held-out samples in units of the noise (root mean square; 1 is noise), without those of stuck joints.

    Args:
        floor: of the augmented model on the samples that it was fitted to.
        nominal, augmented: on the others; both with calibration errors fitted elsewhere, within their tolerances.
        as_given: of the nominal model without calibration.
        in_range: of the nominal model, where a reading at the end of the sensor's range is no error.
        by_channel: (3, C) nominal, augmented and as given, in the signal's units, of all samples.
        signal: (C,) root mean square of the measured signal on the same samples.
    """

    floor: float
    nominal: float
    augmented: float
    as_given: float
    in_range: float
    by_channel: Array
    signal: Array

    @property
    def nrmse(self) -> Array:
        """(3, C) `by_channel` relative to the measured signal; 0 for a signal of zero."""
        return relative_error(self.by_channel, self.signal)

    @property
    def worse(self) -> bool:
        """Whether the effects increase the error, by more than the resolution of its estimate."""
        return self.augmented / max(self.in_range, 1e-12) > 1.0 + _EQUAL

    @property
    def excess(self) -> float:
        """Energy that the effects leave above that which noise may have; NaN where no sample was held out."""
        return self.augmented**2 - 1.0 - _ALLOWED


def relative_error(error: Array, signal: Array) -> Array:
    """(..., C) errors relative to a signal (C,); 0 for a signal of zero."""
    return np.divide(error, signal, out=np.zeros_like(error), where=signal > 0)


def held_out(problem: Problem, best: HypothesisFit, last: Mask) -> HeldOutProof:
    """Fit the model without some samples, and measure its error there.

    Events among the held-out samples cannot be predicted: they are taken from the fit of the whole recording. Events
    that end before these samples do not act there. If the calibration errors beside them increase the error, the events
    are removed for both models. A free curve over a state shows that the residual depends on it; where it increases the
    error it is left out, since it is no part of the augmented model.

    Args:
        problem: with the noise that the best model leaves.
        best: the diagnosis.
        last: (N,) samples to hold out.
    """
    proof = _compared(problem, best, last, ())
    over = [part for part in best.parts if _is_over(problem, part, problem.seconds[last])]
    if proof.worse and over:
        proof = _compared(problem, best, last, over)
    named = tuple(part for part in best.parts if not isinstance(part.effect, Dependence))
    if proof.worse and named != best.parts:
        proof = _compared(problem, replace(best, parts=named), last, over)
    return proof


def _compared(problem: Problem, best: HypothesisFit, last: Mask, over: Sequence[FittedEffect]) -> HeldOutProof:
    seconds = problem.seconds
    fixed = [part for part in best.parts if _happens_in(problem, part, seconds[last])]
    learnt = [part for part in best.parts if part not in fixed and part not in over]
    gone = problem.predicted(problem.recorded) + _response(problem, over)
    known = gone + _response(problem, fixed)
    past, measured = (problem.measured - each + problem.predicted(problem.recorded) for each in (gone, known))
    before, train = (_reading(replace(problem, judged=~last, straight=True), each) for each in (past, measured))
    plain, full = fit(thinned(before.weighed()), ()), fit(thinned(train.weighed()), learnt, _STEPS)
    nominal = gone + plain.response + plain.calibrated
    errors = [
        problem.measured - nominal,
        problem.left_by(known + full.response + full.calibrated),
        problem.measured - problem.predicted(problem.recorded),
        problem.left_by(nominal),
    ]
    settled = problem.active & problem.settled(best.parts)
    rows = last & settled
    spread = problem.noise.total
    weight = problem.weight

    def size(error: Array, at: Mask) -> float:
        return float(np.sqrt(np.sum(weight[at] * (error[at] / spread[at]) ** 2) / max(weight[at].sum(), 1.0)))

    sizes = [size(error, rows) for error in errors]
    floor = size(errors[1], ~last & settled)
    by_channel = np.array([np.sqrt(np.mean(error[rows] ** 2, axis=0)) for error in errors[:3]])
    signal = np.sqrt(np.mean(problem.measured[rows] ** 2, axis=0))
    plain_size, full_size, given, in_range = sizes
    return HeldOutProof(floor, plain_size, full_size, given, in_range, by_channel, signal)


def _response(problem: Problem, parts: Sequence[FittedEffect]) -> Array | float:
    """(N, C) what some parts add to the prediction."""
    return problem.predicted(problem.compose(parts)[1]) - problem.predicted(problem.recorded) if parts else 0.0


def tail(problem: Problem) -> Mask:
    """(N,) the last 30 % of a recording."""
    seconds = problem.seconds
    return np.asarray(seconds > seconds[-1] - _TAIL * (seconds[-1] - seconds[0]))


def _reading(problem: Problem, measured: Array) -> Problem:
    """The problem with another measured signal."""
    recorded = problem.recorded
    if problem.signal == "wrench" or recorded.effort is None:
        return replace(problem, recorded=replace(recorded, wrench=measured))
    return replace(problem, recorded=replace(recorded, effort=replace(recorded.effort, measured=measured)))


def _happens_in(problem: Problem, part: FittedEffect, held: Array) -> bool:
    """Whether an event began among the held-out samples, or takes a free course there."""
    windows = _windows(problem, part) if len(held) else ()
    return bool(windows) and min(window[part.effect.free(part.values)] for window in windows) > held[0] - 0.5


def _is_over(problem: Problem, part: FittedEffect, held: Array) -> bool:
    """Whether an event ends before the held-out samples."""
    windows = _windows(problem, part) if len(held) else ()
    return bool(windows) and max(end for _, end in windows) < held[0]


def _windows(problem: Problem, part: FittedEffect) -> tuple[tuple[float, float], ...]:
    """When an event acts; empty for an effect that holds in other recordings."""
    if part.effect.transfers:
        return ()
    return part.effect.windows(problem.compose([part])[0][0], part.values)
