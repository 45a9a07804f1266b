"""Several effects of joint efforts at once, selected by cross-validation of linear models.

The nominal model of a real arm lacks friction, rotors, offsets and more, all at the same time: beside the errors of the
others, the evidence of one effect says little. These effects are linear in their parameters, so that the normal
matrices of a few blocks of the recording give the error on each block of a fit to the others, for any set of effects.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.effects import Effect, EffectParameter
from poise.mismatch.inference.block_fits import (
    BLOCKS,
    BlockSums,
    EffectFamily,
    begun,
    block_errors,
    block_sums,
    numbered,
    relative,
    solved,
    square_of,
)
from poise.mismatch.inference.coarse import averaged_efforts
from poise.mismatch.inference.courses import brief, follows_residual
from poise.mismatch.inference.linearised import PRIOR_SCALES
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.recorded import EffortTrack
from poise.types import Array

_ROWS = 3000
"""Averages of consecutive samples that are compared, at the most."""
_LEAST, _IN_BLOCKS = 0.12, 4
"""Share of the error of some joint on other blocks that an effect must explain, and the blocks in which it falls."""
_IDLE, _ACTIVE = 0.05, 3
"""Share of the mean fall below which an effect is idle in a block, and the least number of blocks where it acts."""
_DETAIL = 0.01
"""Least share of the error of the nominal model (with its load) in some joint: laws of friction hold to a tenth."""
_SIMPLER = 0.85
"""Share of the largest fall from which an effect with fewer parameters is preferred."""
_MOST = 10
_CHOICES = 2
"""Times that effects which choose a joint or a moment are looked for in what the others leave."""
_LEAST_EVENT = 20.0
"""log evidence (by its number of parameters) from which an event is fitted in full."""
_LEAST_GAIN = 20.0
"""log likelihood that an effect must win in some joint of a difference of two recordings, on other blocks."""
_TOLERANCE_RIDGE = 0.01
"""Precision of a calibration error in tolerances: inside the bounds the smallest is taken."""
_SCALE = EffectParameter("scale", "", 1.0, high=1.5, positive=True)
"""Of a response without linear parameters at a starting point."""
_FLOOR = 1e-5
"""Least variance of a joint's residual, relative to that of its measured effort."""


def screened(problem: Problem, effects: Sequence[Effect]) -> tuple[FittedEffect, ...]:
    """The effects that lower the error on held-out blocks, with values; none when no effect does.

    Args:
        problem: joint efforts.
        effects: a response without linear parameters, as a soft grasp's, is scaled.
    """
    effort, rows = problem.recorded.effort, np.flatnonzero(problem.active)
    if effort is None or len(rows) < 20 * BLOCKS:
        return ()
    screen = _Screen(problem, effort, rows)
    choosing = [each for each in effects if follows_residual(each, problem)]
    sums = screen.extended([each for each in effects if each not in choosing])
    chosen = _grown(sums, [])
    for _ in range(_CHOICES if choosing else 0):
        # Which joints are concerned shows once the common effects are there, and those found before.
        known, names = len(chosen), {sums.families[i].name for i in chosen}
        left = [effect for effect in choosing if effect.name not in names]
        sums = screen.extended(left, screen.left_by(sums, chosen))
        chosen = _grown(sums, chosen)
        if len(chosen) == known:
            break
    sums, chosen = _with_laws(problem, screen, sums, chosen)
    chosen = _varied(sums, _pruned(sums, _grown(sums, _with_event(problem, sums, chosen), general=True)))
    return _fitted(problem, sums, _combined(problem, sums, chosen, effects))


class _Screen:
    """The averaged samples of a recording, and the families of effects on them."""

    def __init__(self, problem: Problem, effort: EffortTrack, rows: NDArray[np.intp]) -> None:
        together = int(np.ceil(len(rows) / _ROWS))
        self._groups = rows[: len(rows) // together * together].reshape(-1, together)
        thin = averaged_efforts(effort, self._groups)
        self._problem = problem
        self._recorded = replace(problem.recorded, effort=thin)
        # What a stuck joint's friction carries is no part of any effect.
        self._free = np.asarray(problem.free[self._groups].min(axis=1))
        self._target = (thin.measured - thin.prediction) * self._free
        self._floor = _FLOOR * np.maximum(thin.measured.var(axis=0), 1e-12)
        self._noise = 0.5 * np.mean(np.diff(self._target, axis=0) ** 2, axis=0) * effort.errors_cancel
        groups = problem.groups(self._recorded)
        columns = np.concatenate([group.columns for group in groups], axis=2) * self._free[:, :, None]
        bound = np.concatenate([group.bounds for group in groups])
        precision = np.full(len(bound), _TOLERANCE_RIDGE)
        self._families = [EffectFamily(None, {}, columns, precision, -bound, bound)]

    def left_by(self, sums: BlockSums, chosen: Sequence[int], without: Effect | None = None) -> Array:
        """(N, J) what a set with its calibration errors leaves at the full rate; `without`: one of its effects."""
        problem, values = self._problem, solved(sums, chosen, begun(sums, chosen)[1])
        parts = [each for each in _parts(problem, sums, chosen, values) if each.effect is not without]
        groups = problem.groups(problem.recorded)
        ends = np.cumsum([len(group.bounds) for group in groups])
        each = np.split(values[: ends[-1]], ends[:-1])
        calibrated = sum(group.response(own) for group, own in zip(groups, each, strict=True))
        return problem.unexplained(problem.predicted(problem.compose(parts)[1]) + calibrated)

    def extended(self, effects: Sequence[Effect], left: Array | None = None, general: bool = False) -> BlockSums:
        """The sums with further effects.

        Args:
            effects: to add.
            left: (N, J) what others leave, from which they start, at the full rate; None: the averaged target.
            general: with the general ones of their starting points alone.
        """
        recorded = self._recorded if left is None else self._problem.recorded
        target = self._target if left is None else left
        for effect in effects:
            own = [p for p in effect.parameters(recorded) if p.linear]
            linear = own or [_SCALE]
            lower = np.array([max(p.lower, p.low) for p in linear])
            upper = np.array([p.high for p in linear])
            precision = np.array([(PRIOR_SCALES[-1] * p.scale) ** -2.0 for p in linear])
            for start in effect.starts(recorded, target):
                if general and not effect.general_at(start):
                    continue
                columns = effect.columns(recorded, start) if own else effect.simulate(recorded, start)[:, :, None]
                columns = columns if left is None else np.asarray(columns[self._groups].mean(axis=1))
                columns = columns * self._free[:, :, None]
                event = effect.free_course or brief(effect, recorded, start)
                family = EffectFamily(effect, dict(start), columns, precision, lower, upper, event)
                self._families.append(family)
        return block_sums(self._families, self._target, self._floor, self._noise)


def _grown(sums: BlockSums, chosen: list[int], *, general: bool = False) -> list[int]:
    """Add the family that lowers the error most, until none does."""
    chosen = list(chosen)
    while len(chosen) < _MOST:
        (before, variance), detail = begun(sums, chosen), _detail(sums, chosen)
        names = {sums.families[i].name for i in chosen}
        falls = {}
        for i in range(1, len(sums.families)):
            family = sums.families[i]
            effect = family.effect
            # General effects are tried after all others, since they can imitate several of them.
            if effect is None or effect.made_of or sums.families[i].event or effect.general_at(family.values) > general:
                continue
            if family.name in names:
                continue
            after = block_errors(sums, [*chosen, i], variance)
            if _proven(sums, before, after, variance, detail):
                falls[i] = 1.0 - relative(after, variance)
        if not falls:
            break
        best = max(falls.values())
        near = [i for i, fall in falls.items() if fall >= _SIMPLER * best]
        size = min(sums.families[i].columns.shape[2] for i in near)
        chosen.append(max((i for i in near if sums.families[i].columns.shape[2] == size), key=falls.__getitem__))
    return chosen


def _with_event(problem: Problem, sums: BlockSums, chosen: list[int]) -> list[int]:
    """With the event that explains most beyond its number of free parameters, among those whose values are possible."""
    events = [i for i in range(1, len(sums.families)) if sums.families[i].event and i not in chosen]
    if not events or any(sums.families[i].event for i in chosen):
        return chosen
    variance = begun(sums, chosen)[1]
    without = square_of(sums, chosen, variance)
    scores = {}
    for i in events:
        columns = sums.families[i].columns
        count, rows = int(columns.any(axis=(0, 1)).sum()), int(columns.any(axis=(1, 2)).sum())
        fall = without - square_of(sums, [*chosen, i], variance)
        scores[i] = 0.5 * (fall - count * np.log(max(rows, 2)))
    for best in sorted((i for i in events if scores[i] > _LEAST_EVENT), key=scores.__getitem__, reverse=True):
        if best not in _impossible(problem, sums, [*chosen, best]):
            return [*chosen, best]
    return chosen


def _detail(sums: BlockSums, chosen: Sequence[int]) -> Array:
    """(J,) the least fall of an error that is no detail of a law of friction: these do not grow with the load."""
    loads = [i for i in chosen if (effect := sums.families[i].effect) is not None and effect.widens == "payload"]
    if not loads or sums.noise.any():
        return _DETAIL * sums.nominal
    return _DETAIL * np.minimum(sums.nominal, begun(sums, loads)[1])


def _proven(sums: BlockSums, before: Array, after: Array, variance: Array, detail: Array) -> bool:
    """Whether the error falls materially in some joint, over all blocks and again in most of them."""
    falls = (before - after).mean(axis=0)
    material = (falls > _LEAST * before.mean(axis=0)) & (falls > detail)
    if sums.noise.any():
        sure = 0.5 * sums.rows.sum() * falls > _LEAST_GAIN * variance
        left, nominal = (np.maximum(error - sums.noise, 0.0) for error in (before.mean(axis=0), sums.nominal))
        material |= sure & (falls > _LEAST * left) & (falls > _DETAIL * nominal)
    return bool(material.any() and falls @ (1 / variance) > 0.0 and _repeated((before - after) / variance))


def _repeated(falls: Array) -> bool:
    """Whether errors that fall by (B, J) do so in most blocks; knocks of a gear are rare: some blocks have none."""
    falls = falls.mean(axis=1)
    fell, idle = falls > 0.0, np.abs(falls) < _IDLE * falls.mean()
    rare = (fell & ~idle).sum() >= _ACTIVE and (fell | idle).sum() >= _IN_BLOCKS
    return bool(rare or fell.sum() >= _IN_BLOCKS)


def _pruned(sums: BlockSums, chosen: list[int]) -> list[int]:
    """Without families that later ones made redundant."""
    while chosen:
        (after, variance), detail = begun(sums, chosen), _detail(sums, chosen)
        without = {i: block_errors(sums, [j for j in chosen if j != i], variance) for i in chosen}
        idle = [i for i in chosen if not (sums.families[i].event or _proven(sums, without[i], after, variance, detail))]
        if not idle:
            break
        chosen = [j for j in chosen if j != min(idle, key=lambda i: relative(without[i], variance))]
    return chosen


def _varied(sums: BlockSums, chosen: list[int]) -> list[int]:
    """With the best non-linear values of each effect; general ones must be clearly better, if the model has errors."""
    for place, i in enumerate(chosen):
        if sums.families[i].event:
            continue
        variance = begun(sums, chosen)[1]
        alike = [k for k in range(1, len(sums.families)) if sums.families[k].name == sums.families[i].name]
        scores = {}
        for k in alike:
            error = block_errors(sums, [*chosen[:place], k, *chosen[place + 1 :]], variance)
            scores[k] = _score(sums, k, error, variance, _general(sums, i))
        chosen = [*chosen[:place], min(scores, key=scores.__getitem__), *chosen[place + 1 :]]
    return chosen


def _score(sums: BlockSums, family: int, error: Array, variance: Array, general: bool) -> float:
    """The relative error (B, J) of a set with a family: greater for a general one where none was."""
    dearer = _general(sums, family) > general and not sums.noise.any()
    return relative(error, variance) / (_SIMPLER if dearer else 1.0)


def _with_laws(problem: Problem, screen: _Screen, sums: BlockSums, chosen: list[int]) -> tuple[BlockSums, list[int]]:
    """With another law of a chosen effect, as that of an engine, before effects that could imitate it are settled."""
    for i in chosen:
        effect = sums.families[i].effect
        alike = [k for k, each in enumerate(sums.families) if each.effect is effect]
        if effect is not None and not effect.general and any(_general(sums, k) for k in alike):
            sums = screen.extended([effect], screen.left_by(sums, chosen, without=effect), general=True)
    changed = _varied(sums, chosen)
    # Values within a law are settled at the end, when all effects are there.
    return sums, _grown(sums, changed) if any(_general(sums, k) for k in changed) else chosen


def _general(sums: BlockSums, family: int) -> bool:
    effect = sums.families[family].effect
    return effect is not None and effect.general_at(sums.families[family].values)


def _combined(problem: Problem, sums: BlockSums, chosen: list[int], effects: Sequence[Effect]) -> list[int]:
    """With combinations in place of simple effects; of those that contain the same one, the best comes first."""
    left = [each for each in effects if each.made_of]
    while left:
        tried = [_replaced(problem, sums, chosen, each) for each in left]
        better = [made for made in tried if made != chosen]
        if not better:
            break
        variance = begun(sums, chosen)[1]
        chosen = min(better, key=lambda made: relative(block_errors(sums, made, variance), variance))
        left = [each for each, made in zip(left, tried, strict=True) if made != chosen]
    return chosen


def _replaced(problem: Problem, sums: BlockSums, chosen: list[int], combined: Effect) -> list[int]:
    """With a combination in place of its simple effects, where these explain clearly less."""
    rest = [i for i in chosen if sums.families[i].name not in combined.made_of]
    if len(rest) == len(chosen):
        return chosen
    (before, variance), detail = begun(sums, chosen), _detail(sums, chosen)
    tried = {
        i: block_errors(sums, [*rest, i], variance) for i, each in enumerate(sums.families) if each.effect is combined
    }
    proven = [i for i, error in tried.items() if _proven(sums, before, error, variance, detail)]
    if not proven:
        return chosen
    general = any(_general(sums, i) for i in chosen if i not in rest)
    best = min(proven, key=lambda i: _score(sums, i, tried[i], variance, general))
    # Effects that imitated what the combination adds go: beside it they are redundant, or their values are impossible.
    kept = _pruned(sums, [*rest, best])
    impossible = _impossible(problem, sums, kept)
    made = [i for i in kept if i == best or i not in impossible]
    if best not in made or _impossible(problem, sums, made):
        return chosen
    return made if _proven(sums, before, block_errors(sums, made, variance), variance, detail) else chosen


def _impossible(problem: Problem, sums: BlockSums, chosen: list[int]) -> list[int]:
    """Those of a set whose values are implausible."""
    fitted = zip(chosen, _fitted(problem, sums, chosen), strict=True)
    return [i for i, part in fitted if part.effect.implausible(problem.recorded, part.values)]


def _fitted(problem: Problem, sums: BlockSums, chosen: Sequence[int]) -> tuple[FittedEffect, ...]:
    return _parts(problem, sums, chosen, solved(sums, chosen, begun(sums, chosen)[1]))


def _parts(problem: Problem, sums: BlockSums, chosen: Sequence[int], values: Array) -> tuple[FittedEffect, ...]:
    """The effects of a set with their coefficients."""
    parts = []
    for i, place in numbered(sums, chosen)[1:]:
        family = sums.families[i]
        if family.effect is None:
            continue
        linear = [p.name for p in family.effect.parameters(problem.recorded) if p.linear]
        fitted = values[place].tolist() if linear else []
        parts.append(FittedEffect(family.effect, dict(family.values) | dict(zip(linear, fitted, strict=True))))
    return tuple(parts)
