"""The proof of each effect of a model: the error falls with it on samples that no fit saw, again and again.

The recording is cut into `_BLOCKS` blocks in which the effect acts equally strongly. Every block is cut into as many
pieces. The model with the effect and the best one without it are fitted to all pieces but one of each block, and
predict these. The fits solve for all linear parameters and the calibration errors; other parameters keep their values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.effects import within
from poise.mismatch.inference.box import box_minimum
from poise.mismatch.inference.cancelling import cancelling
from poise.mismatch.inference.converters import below_rounding
from poise.mismatch.inference.fitting import HypothesisFit, fit
from poise.mismatch.inference.hypotheses import WARM_STEPS, HypothesisSearch, alike, implausible, names, residual_of
from poise.mismatch.inference.problem import BRIEF, FittedEffect, Problem
from poise.mismatch.inference.unknown import Dependence
from poise.types import Array

_BLOCKS = 6
_LEAST_IMPROVED = 5
"""Blocks in which the error must fall: an effect without truth reaches as many with a probability of 11 %."""
_LEAST_GAIN = 3.0
"""log likelihood that an effect must win in all blocks together."""
_LEAST_OF_REST = 0.5
"""Energy of an effect in units of the energy that remains unexplained in the samples and channels where it acts: what
remains there can imitate a smaller one. What remains in other joints or axes cannot."""
_LEAST_SHARE = 0.003
"""Least fall of the squared error that is material, of the whole recording."""
_LEAST_OF_BASE = 0.1
"""Least fall of the squared error by a curve over the base's acceleration: splines through odometry round corners."""
MATERIAL_EXCESS = 0.05
"""Energy above that of the noise, as its share, from which a residual is structure."""
_MOTION = 0.5
"""Share of the variance by errors of the measured motion that may be missing in it: splines round corners of the
acceleration, which noise hides (benchmarks.foreign: errors of the base's acceleration up to twice as large)."""
_ERRORS = 2.0
"""Standard errors of the energy of noise that its excess may have."""
_LEAST_LOCAL = 5.0
"""Least energy of a brief event in a sample, in units of the noise of a channel: a smaller one may be an error of the
measured motion, which a brief event finds anywhere in a recording. Where nothing is left at other times, the energy of
the whole residual during the event counts."""
_SURE = 200.0
"""log evidence from which a brief event with a law, as a vibration, is no noise: healthy cases of benchmarks.foreign
imitate vibrations with up to 60 nats, and a wrong payload with 100."""
_LEAST_EVIDENCE = 6.0
"""log evidence that an effect must win beside the other effects of the answer, under the noise that this leaves."""
LEAST_BESIDE = 100.0
"""log evidence that an event of free course, or an effect beside a stronger one, must win: noise of other families than
those of the noise model gives up to 90 to what is free to follow it (healthy and other cases of benchmarks.foreign)."""
_LEAST_OF_LAW = 0.01
"""Share of the evidence of the strongest effect that a brief event must win beside it."""
_LEAST_OF_FRICTION = 0.02
"""Share of the log evidence of all effects that a dry friction must win beside another one: no law of it is exact."""
_SHAPES, _LEAST_EXCESS = 4, 0.4
"""Non-linear parameters from which an effect has shapes enough to follow noise, and the least energy of the residual
above that of noise, as its share, where it acts. The shape of a change that stays, as a leak, is that of no noise."""
_MOST_ELSEWHERE = 0.5
"""Energy in another window of the length of a brief event, as a share of its own: the event would be one of several."""
_ACTS = 0.01
"""Share of its largest energy in a sample from which an event acts there."""
_SPIKE, _CHANCE = 5.0, 4.0
"""Sigmas to which single residuals are limited, and that the energy of noise in some window may exceed its mean by."""


@dataclass(frozen=True)
class EffectProof:
    """Errors without and with an effect on samples that no fit saw, in units of the noise (rms; 1 is noise).

    Args:
        blocks: parts of the recording, with equal shares of the effect's response.
        improved_blocks: those in which the error falls.
        error_without, error_with: over all blocks.
        gain: log likelihood won over all blocks, for noise as large as the remaining residual.
        share: of the energy of the error without the effect, the part that it removes.
        rest: energy that the model leaves above the noise, in units of the energy of this effect, in the samples and
            channels where it acts.
        local: energy of the effect in a sample where it acts, over all channels, in units of their noise.
        evidence: log evidence of the model with the effect over the model without it, under the same noise; `gain`
            where the values of the others are impossible without it.
        excess: energy of the residual without the effect, where the effect acts, over that of the noise, less one.
        elsewhere: of a brief event, the largest energy that stays unexplained in another window of its length, in units
            of the energy of the event.
    """

    blocks: int
    improved_blocks: int
    error_without: float
    error_with: float
    gain: float
    share: float
    rest: float
    local: float
    evidence: float
    excess: float
    elsewhere: float

    @property
    def support(self) -> float:
        """Log evidence; beside a large unexplained error, the log likelihood won on samples that no fit saw."""
        return min(self.evidence, self.gain)

    @property
    def within_noise(self) -> bool:
        """Whether the residual without the effect is no larger than the noise, where the effect acts."""
        return self.excess <= MATERIAL_EXCESS

    @property
    def lacking(self) -> str:
        """What the proof lacks, as a clause; "" for a proof that holds."""
        if self.gain < _LEAST_GAIN:
            return "the error on samples outside the fit does not fall with it"
        if self.improved_blocks < _LEAST_IMPROVED:
            return f"the error falls in {self.improved_blocks} of {self.blocks} parts of the recording"
        if self.rest * _LEAST_OF_REST > 1.0:
            return f"the error that remains unexplained is {self.rest:.2g} times as large as what it explains"
        if self.evidence < _LEAST_EVIDENCE:
            return "the recording is nearly as likely without it"
        return ""


@dataclass(frozen=True, eq=False)
class ProvenModel:
    """A model whose every effect has its proof.

    Args:
        fit: of the model, under the noise that it leaves.
        proofs: of its parts, in their order.
        without: the best fits without each of its parts, in their order.
        dropped: effects without proof and what they lack.
    """

    fit: HypothesisFit
    proofs: tuple[EffectProof, ...]
    without: tuple[HypothesisFit, ...]
    dropped: dict[str, str]

    def shorter(self) -> HypothesisFit:
        """The best fit with one part fewer."""
        return max(self.without, key=lambda each: each.log_evidence)


def proven(state: HypothesisSearch, best: HypothesisFit) -> ProvenModel:
    """The model whose effects have their proof; the best other one where free curves without a proof hid its names."""
    found = _shortened(state, best)
    curves = {part.effect.name for part in best.parts if isinstance(part.effect, Dependence)} & set(found.dropped)
    kept = state.fits.get(names(found.fit), found.fit)
    open_ones = [each for key, each in state.fits.items() if found.dropped.keys().isdisjoint(key)]
    other = max(open_ones, key=lambda each: each.log_evidence, default=kept)
    if not curves or other.log_evidence - kept.log_evidence < _LEAST_EVIDENCE or state.limit.over():
        return found
    tried = _shortened(state, other)
    named = any(not isinstance(part.effect, Dependence) for part in tried.fit.parts)
    return replace(tried if named else found, dropped=found.dropped | tried.dropped)


def _shortened(state: HypothesisSearch, best: HypothesisFit) -> ProvenModel:
    """The model without the effects that lack a proof; after each removal the others are proven again."""
    dropped: dict[str, str] = {}
    while True:
        problem = state.under(best)
        whole = state.fitted(problem, best.parts, WARM_STEPS)
        without = [state.fitted(problem, _others(whole.parts, part), WARM_STEPS) for part in whole.parts]
        proofs = _compared(problem, whole, without)
        parts = zip(whole.parts, proofs, cancelling(problem, whole.parts), strict=True)
        lacking = [
            implausible(problem.recorded, [part])
            or below_rounding(problem, part)
            or immaterial(problem, part, proof)
            or proof.lacking
            or cancelled
            for part, proof, cancelled in parts
        ]
        if not any(lacking):
            # What fails by itself is no stronger effect, beside which another one is faint.
            strongest = max((proof.support for proof in proofs), default=0.0)
            lacking = [
                faint(part, proof, strongest, _brief(problem, part), _beside_unknown(problem))
                or _detail_of_friction(state, problem, whole, part, proof)
                for part, proof in zip(whole.parts, proofs, strict=True)
            ]
        failed = [index for index, reason in enumerate(lacking) if reason]
        if not failed:
            return ProvenModel(whole, tuple(proofs), tuple(without), dropped)
        # A free curve follows effects of the library in part, and hides their proof.
        curves = [index for index in failed if isinstance(whole.parts[index].effect, Dependence)]
        weakest = max(curves or failed, key=lambda index: without[index].log_evidence)
        dropped[whole.parts[weakest].effect.name] = lacking[weakest]
        best = without[weakest]


def allowed_excess(problem: Problem) -> float:
    """Energy above that of the noise, as its share, up to which the residual of a signal is no structure."""
    noise, rows = problem.noise, problem.active
    found = MATERIAL_EXCESS + _ERRORS * float(np.sqrt(2.0 / (np.count_nonzero(rows) * float(noise.band.sum()))))
    if noise.motion is not None:
        found += _MOTION * float(np.mean((noise.motion / noise.total**2)[rows]))
    return found


def immaterial(problem: Problem, part: FittedEffect, proof: EffectProof) -> str:
    """Why an effect is too small to be distinguished from errors of noise and motion that no model has."""
    recorded = problem.recorded
    # What the curve leaves on samples outside the fit is no reason for it.
    left = max(proof.error_with**2, 1.0)
    if isinstance(part.effect, Dependence) and proof.error_without**2 - left <= allowed_excess(problem):
        return "the residual is within the noise without it"
    if (
        isinstance(part.effect, Dependence)
        and part.effect.state == "base_acceleration"
        and proof.share < _LEAST_OF_BASE
    ):
        return "the odometry of the base may be wrong by as much"
    shapes = sum(not (p.linear or p.choice) for p in part.effect.parameters(recorded))
    if not (_stays(problem, part) or part.effect.of_joint) and shapes >= _SHAPES and proof.excess < _LEAST_EXCESS:
        return "where it acts, the residual is within the noise without it"
    if _brief(problem, part):
        if not part.effect.free(part.values) and proof.support >= _SURE:
            return ""
        if proof.elsewhere > _MOST_ELSEWHERE:
            return "at other times, as much remains unexplained"
        whole = 1.0 + proof.excess if proof.elsewhere == 0.0 else 0.0
        large = max(proof.local, whole) >= _LEAST_LOCAL
        return "" if large else "it is not larger than errors of the measured motion"
    return f"the squared error falls by {100 * proof.share:.1f} %" if proof.share < _LEAST_SHARE else ""


def _stays(problem: Problem, part: FittedEffect) -> bool:
    """Whether an event lasts to the end of the recording; one that comes again does not, even if it ends there."""
    windows = part.effect.windows(problem.recorded, part.values)
    return len(windows) == 1 and windows[0][1] >= problem.recorded.seconds[-1]


def _brief(problem: Problem, part: FittedEffect) -> bool:
    """Whether an effect is an event that ends and takes a small share of the recording."""
    windows = part.effect.windows(problem.recorded, part.values)
    total = sum(end - begin for begin, end in windows)
    return bool(windows) and not _stays(problem, part) and total < BRIEF * problem.recorded.duration


def _beside_unknown(problem: Problem) -> bool:
    """Whether what no name explains of the wrench acts on these efforts."""
    track = problem.recorded.effort
    return problem.signal == "effort" and track is not None and track.by_rest is not None


def faint(
    part: FittedEffect, proof: EffectProof, strongest: float, brief: bool = False, beside_unknown: bool = False
) -> str:
    """Why noise may give the evidence for an effect; `strongest` is the most that an effect of the model has.

    An effect that is alone explains everything that there is to explain; its probability says how weak it is. An event
    of free course follows noise, too. It and a `brief` one follow what the law of a far stronger effect leaves: no
    model is exact.
    """
    free = part.effect.free(part.values)
    if (free or brief) and proof.support < _LEAST_OF_LAW * strongest:
        return f"its evidence, {proof.support:.0f} nats, may come from the law of an effect with {strongest:.0f}"
    alone = not (free or beside_unknown) and proof.support >= strongest
    if alone or isinstance(part.effect, Dependence) or proof.support >= LEAST_BESIDE:
        return ""
    return f"its evidence, {proof.support:.0f} nats, may come from the noise"


def _detail_of_friction(
    state: HypothesisSearch, problem: Problem, whole: HypothesisFit, part: FittedEffect, proof: EffectProof
) -> str:
    """Why a friction of a model may be a detail of another one's law; "" where it is not.

    Either may explain most of what both explain, so that neither has much evidence beside the other: it is compared
    with the evidence of the whole model.
    """
    others = [other for other in whole.parts if other is not part and other.effect.dry and part.effect.dry]
    if not any(alike(part.effect, other.effect) for other in others):
        return ""
    won = whole.log_evidence - state.fitted(problem, (), 0).log_evidence
    if proof.support >= _LEAST_OF_FRICTION * won:
        return ""
    return f"its evidence, {proof.support:.0f} of {won:.0f} nats, may come from the law of another friction"


def _others(parts: Sequence[FittedEffect], part: FittedEffect) -> list[FittedEffect]:
    return [other for other in parts if other is not part]


def _compared(problem: Problem, whole: HypothesisFit, without: Sequence[HypothesisFit]) -> list[EffectProof]:
    """The proof of each part of `whole`; the fit without it is at its place in `without`."""
    length = 1 if problem.blocks is None else problem.blocks.rows.shape[1]
    if problem.blocks is not None and any(part.effect.free(part.values) for part in whole.parts):
        length = 1
        # Averages of several samples are too coarse for a short event: nothing would predict the pieces left out.
        problem = replace(problem, blocks=None)
        whole, *without = (fit(problem, each.parts, 1) for each in (whole, *without))
    proofs = [_proof(problem, length, whole, *pair) for pair in zip(whole.parts, without, strict=True)]
    settled = problem.settled(whole.parts)
    if settled.all():
        return proofs
    # A knock that is a fraction of a sample late counts as much as one that is not there: without the knocks, too.
    kept = replace(problem, judged=settled if problem.judged is None else settled & problem.judged)
    calm, *others = (fit(kept, each.parts, 1) for each in (whole, *without))
    again = [_proof(kept, length, calm, *pair) for pair in zip(calm.parts, others, strict=True)]
    pairs = zip(proofs, again, strict=True)
    return [max(pair, key=lambda proof: (not proof.lacking, proof.improved_blocks, proof.gain)) for pair in pairs]


def _proof(
    problem: Problem, length: int, whole: HypothesisFit, part: FittedEffect, without: HypothesisFit
) -> EffectProof:
    """The proof of a part of `whole` that `without` lacks."""
    channels = problem.measured.shape[1]
    fitted = [each.regression.residual.reshape(channels, -1) for each in (without, whole)]
    response = (fitted[0] - fitted[1]) ** 2
    acting = response / max(float(response.sum()), 1e-300)
    energy, share = response.sum(axis=0), acting.sum(axis=0)
    # The calibration is determined by the whole recording: pieces are cut where the effect does not act, too.
    cut = 0.5 * (_course(problem, part) if part.effect.free(part.values) else share) + 0.5 / len(share)
    fold = np.tile(_parts(cut, _BLOCKS**2) % _BLOCKS, channels)
    squares = [_predicted(each, fold) ** 2 for each in (without, whole)]
    fall = np.sum((squares[0] - squares[1]).reshape(channels, -1), axis=0)
    # A knock alone may have more than a block's share.
    blocks = _parts(np.minimum(share, 1.0 / _BLOCKS**2), _BLOCKS)
    falls = np.bincount(blocks, weights=fall, minlength=_BLOCKS)
    errors = [float(np.mean(each)) for each in squares]
    gain = 0.5 * float(fall.sum()) / max(errors[1], 1.0)
    evidence = whole.log_evidence - without.log_evidence
    return EffectProof(
        blocks=_BLOCKS,
        improved_blocks=int(np.sum(falls > 0.0)),
        error_without=float(np.sqrt(errors[0])),
        error_with=float(np.sqrt(errors[1])),
        gain=gain,
        share=float(np.clip(1.0 - errors[1] / max(errors[0], 1e-12), 0.0, 1.0)),
        rest=max(float(np.sum(acting * (fitted[1] ** 2 - 1.0))), 0.0) / max(float(np.sum(acting * response)), 1e-9),
        local=float(share @ energy) / length,
        evidence=evidence if np.isfinite(evidence) else gain,
        excess=_excess(problem, whole, without),
        elsewhere=elsewhere(fitted[1], energy, share),
    )


def _course(problem: Problem, part: FittedEffect) -> Array:
    """(R,) equal shares of the samples in the windows of an event, zero elsewhere.

    Where a free course is weak, pieces with equal shares of its response would be longer than the distance of its
    knots, and the samples that stay would not determine it.
    """
    inside = within(problem.seconds[problem.active], part.effect.windows(problem.recorded, part.values))
    return np.asarray(inside / max(int(inside.sum()), 1))


def _excess(problem: Problem, whole: HypothesisFit, without: HypothesisFit) -> float:
    """Energy of the residual of `without` over that of the noise, less one, weighed by what `whole` adds to it."""
    left, kept = (residual_of(problem, each)[problem.active] for each in (without, whole))
    scale = problem.noise.total[problem.active]
    added = ((left - kept) / scale) ** 2
    return float(np.sum(added * np.minimum((left / scale) ** 2, _SPIKE**2)) / max(float(added.sum()), 1e-300)) - 1.0


def elsewhere(left: Array, energy: Array, share: Array) -> float:
    """Largest energy above that of noise of a residual (C, N) in a window outside an event, relative to the event's."""
    acts = share > _ACTS * share.max()
    count, outside = int(acts.sum()), ~acts
    if count == 0 or int(outside.sum()) <= count:
        return 0.0
    squares = np.minimum(left[:, outside] ** 2, _SPIKE**2).sum(axis=0)
    sums = np.convolve(squares - squares.mean(), np.ones(count), mode="valid")
    chance = _CHANCE * squares.std() * np.sqrt(count)
    return max(float(sums.max() - chance), 0.0) / max(float(energy.sum()), 1e-300)


def _parts(share: Array, count: int) -> NDArray[np.intp]:
    """(N,) number of the part of each sample: consecutive parts with equal sums of `share` (N,)."""
    reached = np.cumsum(share) / max(float(share.sum()), 1e-300)
    return np.asarray(np.minimum((reached * count * (1.0 - 1e-9)).astype(np.intp), count - 1), dtype=np.intp)


def _predicted(found: HypothesisFit, fold: NDArray[np.intp]) -> Array:
    """(R,) whitened residuals, each predicted by a fit to the other folds."""
    linear, regression = found.linear, found.regression
    columns, target = regression.columns[linear], regression.target
    rows = [np.flatnonzero(fold == number) for number in range(_BLOCKS)]
    normals = [columns[:, row] @ columns[:, row].T for row in rows]
    rights = [columns[:, row] @ target[row] for row in rows]
    normal = np.sum(normals, axis=0) + np.diag(regression.penalty[linear])
    right = np.sum(rights, axis=0) + (regression.penalty * regression.mean)[linear]
    bounds = regression.bounds[linear]
    out = np.empty_like(target)
    for row, own, seen in zip(rows, normals, rights, strict=True):
        out[row] = target[row] - box_minimum(normal - own, right - seen, -bounds, bounds) @ columns[:, row]
    return out
