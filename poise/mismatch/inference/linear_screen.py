"""Several effects of joint efforts at once, selected by cross-validation of linear models.

The nominal model of a real arm lacks friction, rotors, offsets and more, all at the same time: beside the errors of the
others, the evidence of one effect says little. These effects are linear in their parameters, so that the normal
matrices of a few blocks of the recording give the error on each block of a fit to the others, for any set of effects.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.effects import Effect, Values
from poise.mismatch.inference.box import box_minimum
from poise.mismatch.inference.coarse import averaged_efforts
from poise.mismatch.inference.courses import brief, follows_residual
from poise.mismatch.inference.linearised import PRIOR_SCALES
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.recorded import EffortTrack
from poise.types import Array

_BLOCKS = 6
_ROWS = 3000
"""Averages of consecutive samples that are compared, at the most."""
_LEAST, _IN_BLOCKS = 0.12, 4
"""Share of the error of some joint on other blocks that an effect must explain, and the blocks in which it falls."""
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
_RIDGE = 1e-9
"""Relative to the mean of the normal matrix's diagonal."""
_FLOOR = 1e-5
"""Least variance of a joint's residual, relative to that of its measured effort."""


@dataclass(frozen=True, eq=False)
class _Family:
    """An effect at some of its non-linear values, with the columns (R, J, k) of its linear parameters.

    event: what the other blocks show does not predict it: it is brief, or its course is free inside a window.
    """

    effect: Effect | None
    values: Values
    columns: Array
    precision: Array
    lower: Array
    upper: Array
    event: bool = False

    @property
    def name(self) -> str:
        return self.effect.name if self.effect else ""


@dataclass(frozen=True, eq=False)
class _Sums:
    """Normal matrices (B, J, K, K), vectors (B, J, K) and squares (B, J) of all columns; `places` of each family.

    `noise` (J,) is the variance of the readings that no effect has to explain: zero unless errors of the model cancel.
    """

    families: tuple[_Family, ...]
    places: tuple[slice, ...]
    matrix: Array
    vector: Array
    square: Array
    rows: Array
    floor: Array
    noise: Array

    @cached_property
    def nominal(self) -> Array:
        """(J,) variance of the residual of the calibrated nominal model on held-out blocks."""
        return _begun(self, [])[1]


def screened(problem: Problem, effects: Sequence[Effect]) -> tuple[FittedEffect, ...]:
    """The effects that lower the error on held-out blocks, with values; none when no effect does.

    Args:
        problem: joint efforts.
        effects: with linear parameters.
    """
    effort, rows = problem.recorded.effort, np.flatnonzero(problem.active)
    if effort is None or len(rows) < 20 * _BLOCKS:
        return ()
    screen = _Screen(problem, effort, rows)
    linear = [each for each in effects if any(p.linear for p in each.parameters(problem.recorded))]
    choosing = [each for each in linear if follows_residual(each, problem)]
    sums = screen.extended([each for each in linear if each not in choosing])
    chosen = _grown(sums, [])
    for _ in range(_CHOICES if choosing else 0):
        # Which joints are concerned shows once the common effects are there, and those found before.
        known, names = len(chosen), {sums.families[i].name for i in chosen}
        left = [effect for effect in choosing if effect.name not in names]
        sums = screen.extended(left, _fitted(problem, sums, chosen))
        chosen = _grown(sums, chosen)
        if len(chosen) == known:
            break
    sums, chosen = _with_laws(problem, screen, sums, chosen)
    chosen = _varied(sums, _pruned(sums, _grown(sums, _with_event(sums, chosen), general=True)))
    for effect in (each for each in linear if each.made_of):
        chosen = _replaced(problem, sums, chosen, effect)
    return _fitted(problem, sums, chosen)


class _Screen:
    """The averaged samples of a recording, and the families of effects on them."""

    def __init__(self, problem: Problem, effort: EffortTrack, rows: NDArray[np.intp]) -> None:
        together = int(np.ceil(len(rows) / _ROWS))
        self._groups = rows[: len(rows) // together * together].reshape(-1, together)
        thin = averaged_efforts(effort, self._groups)
        self._problem = problem
        self._recorded = replace(problem.recorded, effort=thin)
        self._target = thin.measured - thin.prediction
        self._floor = _FLOOR * np.maximum(thin.measured.var(axis=0), 1e-12)
        self._noise = 0.5 * np.mean(np.diff(self._target, axis=0) ** 2, axis=0) * effort.errors_cancel
        groups = problem.groups(self._recorded)
        columns = np.concatenate([group.columns for group in groups], axis=2)
        bound = np.concatenate([group.bounds for group in groups])
        precision = np.full(len(bound), _TOLERANCE_RIDGE)
        self._families = [_Family(None, {}, columns, precision, -bound, bound)]

    def extended(
        self, effects: Sequence[Effect], beside: Sequence[FittedEffect] | None = None, general: bool = False
    ) -> _Sums:
        """The sums with further effects; those that start from what others leave, at the full rate.

        `general`: with the general ones of their starting points alone.
        """
        recorded, left = self._recorded, self._target
        if beside is not None:
            recorded = self._problem.recorded
            left = self._problem.measured - self._problem.predicted(self._problem.compose(beside)[1])
        for effect in effects:
            linear = [p for p in effect.parameters(recorded) if p.linear]
            lower = np.array([max(p.lower, p.low) for p in linear])
            upper = np.array([p.high for p in linear])
            precision = np.array([(PRIOR_SCALES[-1] * p.scale) ** -2.0 for p in linear])
            for start in effect.starts(recorded, left):
                if general and not effect.general_at(start):
                    continue
                columns = effect.columns(recorded, start)
                columns = columns if beside is None else np.asarray(columns[self._groups].mean(axis=1))
                event = effect.free_course or brief(effect, recorded, start)
                family = _Family(effect, dict(start), columns, precision, lower, upper, event)
                self._families.append(family)
        return _summed(self._families, self._target, self._floor, self._noise)


def _summed(families: Sequence[_Family], target: Array, floor: Array, noise: Array) -> _Sums:
    sizes = [family.columns.shape[2] for family in families]
    places = tuple(slice(int(end) - size, int(end)) for size, end in zip(sizes, np.cumsum(sizes), strict=True))
    edges = np.linspace(0, len(target), _BLOCKS + 1).astype(int)
    shape = _BLOCKS, target.shape[1], sum(sizes)
    matrix, vector, square = np.zeros((*shape, shape[2])), np.zeros(shape), np.zeros(shape[:2])
    for joint, measured in enumerate(target.T):
        whole = np.concatenate([family.columns[:, joint] for family in families], axis=1)
        acting = np.flatnonzero(whole.any(axis=0))  # most columns are of one other joint
        for block, (begin, end) in enumerate(itertools.pairwise(edges)):
            columns, wanted = whole[begin:end, acting], measured[begin:end]
            matrix[block, joint][np.ix_(acting, acting)] = columns.T @ columns
            vector[block, joint, acting], square[block, joint] = columns.T @ wanted, wanted @ wanted
    return _Sums(tuple(families), places, matrix, vector, square, np.diff(edges), floor, noise)


def _numbered(sums: _Sums, chosen: Sequence[int]) -> list[tuple[int, slice]]:
    """Families of a set, the calibration first, with their places in the vector of its coefficients."""
    found, begin = [], 0
    for i in (0, *chosen):
        end = begin + sums.families[i].columns.shape[2]
        found.append((i, slice(begin, end)))
        begin = end
    return found


def _index(sums: _Sums, chosen: Sequence[int]) -> Array:
    return np.concatenate([np.arange(sums.places[i].start, sums.places[i].stop) for i in (0, *chosen)])


def _bounded(sums: _Sums, chosen: Sequence[int], matrix: Array, vector: Array) -> Array:
    """The least-squares coefficients with priors, inside their bounds."""
    families = [sums.families[i] for i in (0, *chosen)]
    precision, lower, upper = (
        np.concatenate([getattr(family, name) for family in families]) for name in ("precision", "lower", "upper")
    )
    ridge = precision + _RIDGE * np.trace(matrix) / max(len(matrix), 1)
    return box_minimum(matrix + np.diag(ridge), vector, lower, upper)


def _solved(sums: _Sums, chosen: Sequence[int], variance: Array) -> Array:
    """Coefficients of a fit to all blocks, joints weighted by their residual variance (J,)."""
    index = _index(sums, chosen)
    matrix, vector = sums.matrix.sum(axis=0)[:, index][:, :, index], sums.vector.sum(axis=0)[:, index]
    return _bounded(
        sums, chosen, np.einsum("jkl,j->kl", matrix, 1 / variance), (vector / variance[:, None]).sum(axis=0)
    )


def _error(sums: _Sums, chosen: Sequence[int], variance: Array) -> Array:
    """(B, J) mean square on each block of a fit to the other blocks."""
    index = _index(sums, chosen)
    matrix, vector = sums.matrix[:, :, index[:, None], index], sums.vector[:, :, index]
    weighted = np.tensordot(1 / variance, matrix, (0, 1)), np.tensordot(1 / variance, vector, (0, 1))
    out = np.empty(sums.square.shape)
    for block in range(len(out)):
        rest = (weighted[0].sum(axis=0) - weighted[0][block], weighted[1].sum(axis=0) - weighted[1][block])
        values = _bounded(sums, chosen, *rest)
        bent = matrix[block] @ values @ values
        out[block] = sums.square[block] - 2.0 * vector[block] @ values + bent
    return np.asarray(np.maximum(out, 0.0) / sums.rows[:, None])


def _variance(error: Array, floor: Array) -> Array:
    """(J,)."""
    return np.asarray(np.maximum(error.mean(axis=0), floor))


def _begun(sums: _Sums, chosen: Sequence[int]) -> tuple[Array, Array]:
    """(B, J) error of a set with weights by its own residual, and that residual's variance (J,)."""
    variance = _variance(sums.square / sums.rows[:, None], sums.floor)
    for _ in range(2):
        error = _error(sums, chosen, variance)
        variance = _variance(error, sums.floor)
    return error, variance


def _grown(sums: _Sums, chosen: list[int], *, general: bool = False) -> list[int]:
    """Add the family that lowers the error most, until none does."""
    chosen = list(chosen)
    while len(chosen) < _MOST:
        (before, variance), detail = _begun(sums, chosen), _detail(sums, chosen)
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
            after = _error(sums, [*chosen, i], variance)
            if _proven(sums, before, after, variance, detail):
                falls[i] = 1.0 - _relative(after, variance)
        if not falls:
            break
        best = max(falls.values())
        near = [i for i, fall in falls.items() if fall >= _SIMPLER * best]
        size = min(sums.families[i].columns.shape[2] for i in near)
        chosen.append(max((i for i in near if sums.families[i].columns.shape[2] == size), key=falls.__getitem__))
    return chosen


def _with_event(sums: _Sums, chosen: list[int]) -> list[int]:
    """With the event that explains most beyond its number of free parameters."""
    events = [i for i in range(1, len(sums.families)) if sums.families[i].event and i not in chosen]
    if not events or any(sums.families[i].event for i in chosen):
        return chosen
    variance = _begun(sums, chosen)[1]
    without = _square(sums, chosen, variance)
    scores = {}
    for i in events:
        columns = sums.families[i].columns
        count, rows = int(columns.any(axis=(0, 1)).sum()), int(columns.any(axis=(1, 2)).sum())
        fall = without - _square(sums, [*chosen, i], variance)
        scores[i] = 0.5 * (fall - count * np.log(max(rows, 2)))
    best = max(events, key=scores.__getitem__)
    return [*chosen, best] if scores[best] > _LEAST_EVENT else chosen


def _square(sums: _Sums, chosen: Sequence[int], variance: Array) -> float:
    """Of the residual of a fit to all blocks, in units of the variance (J,)."""
    index, values = _index(sums, chosen), _solved(sums, chosen, variance)
    matrix, vector = sums.matrix.sum(axis=0)[:, index][:, :, index], sums.vector.sum(axis=0)[:, index]
    bent = matrix @ values @ values
    return float((sums.square.sum(axis=0) - 2.0 * vector @ values + bent) @ (1 / variance))


def _relative(error: Array, variance: Array) -> float:
    return float(np.mean(error / variance))


def _detail(sums: _Sums, chosen: Sequence[int]) -> Array:
    """(J,) the least fall of an error that is no detail of a law of friction: these do not grow with the load."""
    loads = [i for i in chosen if (effect := sums.families[i].effect) is not None and effect.widens == "payload"]
    if not loads or sums.noise.any():
        return _DETAIL * sums.nominal
    return _DETAIL * np.minimum(sums.nominal, _begun(sums, loads)[1])


def _proven(sums: _Sums, before: Array, after: Array, variance: Array, detail: Array) -> bool:
    """Whether the error falls materially in some joint, over all blocks and again in most of them."""
    falls = (before - after).mean(axis=0)
    material = (falls > _LEAST * before.mean(axis=0)) & (falls > detail)
    if sums.noise.any():
        sure = 0.5 * sums.rows.sum() * falls > _LEAST_GAIN * variance
        left, nominal = (np.maximum(error - sums.noise, 0.0) for error in (before.mean(axis=0), sums.nominal))
        material |= sure & (falls > _LEAST * left) & (falls > _DETAIL * nominal)
    blocks = (after / variance).mean(axis=1) < (before / variance).mean(axis=1)
    return bool(material.any() and falls @ (1 / variance) > 0.0 and blocks.sum() >= _IN_BLOCKS)


def _pruned(sums: _Sums, chosen: list[int]) -> list[int]:
    """Without families that later ones made redundant."""
    while chosen:
        (after, variance), detail = _begun(sums, chosen), _detail(sums, chosen)
        without = {i: _error(sums, [j for j in chosen if j != i], variance) for i in chosen}
        idle = [i for i in chosen if not (sums.families[i].event or _proven(sums, without[i], after, variance, detail))]
        if not idle:
            break
        chosen = [j for j in chosen if j != min(idle, key=lambda i: _relative(without[i], variance))]
    return chosen


def _varied(sums: _Sums, chosen: list[int]) -> list[int]:
    """With the best non-linear values of each effect; general ones must be clearly better, if the model has errors."""
    for place, i in enumerate(chosen):
        if sums.families[i].event:
            continue
        variance = _begun(sums, chosen)[1]
        alike = [k for k in range(1, len(sums.families)) if sums.families[k].name == sums.families[i].name]
        scores = {}
        for k in alike:
            error = _relative(_error(sums, [*chosen[:place], k, *chosen[place + 1 :]], variance), variance)
            dearer = _general(sums, k) > _general(sums, i) and not sums.noise.any()
            scores[k] = error / _SIMPLER if dearer else error
        chosen = [*chosen[:place], min(scores, key=scores.__getitem__), *chosen[place + 1 :]]
    return chosen


def _with_laws(problem: Problem, screen: _Screen, sums: _Sums, chosen: list[int]) -> tuple[_Sums, list[int]]:
    """With another law of a chosen effect, as that of an engine, before effects that could imitate it are settled."""
    for i in chosen:
        effect = sums.families[i].effect
        alike = [k for k, each in enumerate(sums.families) if each.effect is effect]
        if effect is not None and not effect.general and any(_general(sums, k) for k in alike):
            others = [each for each in _fitted(problem, sums, chosen) if each.effect is not effect]
            sums = screen.extended([effect], others, general=True)
    changed = _varied(sums, chosen)
    # Values within a law are settled at the end, when all effects are there.
    return sums, _grown(sums, changed) if any(_general(sums, k) for k in changed) else chosen


def _general(sums: _Sums, family: int) -> bool:
    effect = sums.families[family].effect
    return effect is not None and effect.general_at(sums.families[family].values)


def _replaced(problem: Problem, sums: _Sums, chosen: list[int], combined: Effect) -> list[int]:
    """With a combination in place of its simple effects, where these explain clearly less."""
    rest = [i for i in chosen if sums.families[i].name not in combined.made_of]
    if len(rest) == len(chosen):
        return chosen
    (before, variance), detail = _begun(sums, chosen), _detail(sums, chosen)
    tried = {i: _error(sums, [*rest, i], variance) for i, each in enumerate(sums.families) if each.effect is combined}
    proven = [i for i, error in tried.items() if _proven(sums, before, error, variance, detail)]
    if not proven:
        return chosen
    made = [*rest, min(proven, key=lambda i: _relative(tried[i], variance))]
    return chosen if _implausible(problem, sums, made) else made


def _implausible(problem: Problem, sums: _Sums, chosen: list[int]) -> bool:
    parts = _fitted(problem, sums, chosen)
    return any(part.effect.implausible(problem.recorded, part.values) for part in parts)


def _fitted(problem: Problem, sums: _Sums, chosen: list[int]) -> tuple[FittedEffect, ...]:
    values = _solved(sums, chosen, _begun(sums, chosen)[1])
    parts = []
    for i, place in _numbered(sums, chosen)[1:]:
        family = sums.families[i]
        if family.effect is None:
            continue
        linear = [p.name for p in family.effect.parameters(problem.recorded) if p.linear]
        parts.append(
            FittedEffect(family.effect, dict(family.values) | dict(zip(linear, values[place].tolist(), strict=True)))
        )
    return tuple(parts)
