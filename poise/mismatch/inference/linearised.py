"""A hypothesis linearised at its values: the basis of the fit's steps and its evidence."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.effects import Effect, EffectParameter, Values
from poise.mismatch.inference.evidence import WhitenedRegression
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array, Mask

PRIOR_SCALES = (0.1, 1 / 3, 1.0, 3.0)
SLOPE_STEP = 1e-4
"""Of the unit interval, for derivatives by differences."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """A hypothesis linearised at its values; coefficients count from there. `free`: parameters with columns, or all."""

    parts: tuple[FittedEffect, ...]
    inputs: list[RecordedMotion]
    whole: RecordedMotion
    calibration: WhitenedRegression
    columns: Array
    square: float
    free: Mask | None = None

    def parameters(self) -> list[tuple[int, EffectParameter]]:
        """(part, parameter) of the columns."""
        every = [
            (i, p)
            for i, (part, recorded) in enumerate(zip(self.parts, self.inputs, strict=True))
            for p in continuous_parameters(part, recorded)
        ]
        return (
            every if self.free is None else [each for each, free in zip(every, self.free.tolist(), strict=True) if free]
        )

    def inside(self) -> "Linearised | None":
        """Without the columns of parameters at a bound; None when nothing linear is left of a part."""
        own = self.parameters()
        free = np.array([not p.at_bound(self.parts[i].values[p.name]) for i, p in own], dtype=bool)
        linear = [(i, inside) for (i, p), inside in zip(own, free.tolist(), strict=True) if p.linear]
        if {i for i, _ in linear} != {i for i, inside in linear if inside}:
            return None
        return self if free.all() else replace(self, columns=self.columns[free], free=free)

    def priors(self, scale: float) -> tuple[Array, Array]:
        """Precision and mean of the columns' coefficients, which count from the present values."""
        own = self.parameters()
        precision = np.array([(scale * p.scale) ** -2.0 if p.linear else 0.0 for _, p in own])
        mean = np.array([-self.parts[i].values[p.name] if p.linear else 0.0 for i, p in own])
        return precision, mean

    def regression(self, scale: float) -> WhitenedRegression:
        """Calibration and parts as one regression; non-linear parameters have a prior of unit width."""
        precision, mean = self.priors(scale)
        return self.calibration.extended(self.columns, np.where(precision > 0, precision, 1.0), mean)

    def rows(self) -> tuple[NDArray[np.intp], ...]:
        """Of each part: the row of `regression` for each parameter, -1 for those that were not fitted."""
        own, size = self.parameters(), self.calibration.count
        found = []
        for i, (part, recorded) in enumerate(zip(self.parts, self.inputs, strict=True)):
            row_of = {p.name: size + k for k, (j, p) in enumerate(own) if j == i}
            found.append(np.array([row_of.get(p.name, -1) for p in part.effect.parameters(recorded)], dtype=np.intp))
        return tuple(found)

    def covariances(self, whole: WhitenedRegression, rows: tuple[NDArray[np.intp], ...]) -> tuple[Array, ...]:
        """Of each part's parameters, from `regression` and `rows`; those that were not fitted have their resolution."""
        covariance = whole.covariance()
        found = []
        for part, recorded, row in zip(self.parts, self.inputs, rows, strict=True):
            parameters = part.effect.parameters(recorded)
            matrix = np.diag([p.resolution**2 / 12.0 for p in parameters])
            places = np.flatnonzero(row >= 0)
            # From places in the prior to values: dv/du by differences.
            rates = np.array([_rate(p, part.values[p.name]) for p in (parameters[place] for place in places)])
            matrix[np.ix_(places, places)] = covariance[np.ix_(row[places], row[places])] * np.outer(rates, rates)
            found.append(matrix)
        return tuple(found)


def linearised(
    problem: Problem, parts: tuple[FittedEffect, ...], calibration: WhitenedRegression | None, slopes: bool = True
) -> Linearised:
    """Linearise; a given calibration is kept, with the residual of these parts as its target."""
    inputs, whole = problem.compose(parts)
    if calibration is None:
        calibration = problem.regression(parts, whole)
    else:
        target = problem.whiten(problem.measured - problem.predicted(whole))
        calibration = calibration.with_target(target)
    columns = columns_of(problem, parts, inputs) if slopes else np.zeros((0, len(calibration.target)))
    about = Linearised(parts, inputs, whole, calibration, columns, 0.0)
    precision, mean = about.priors(PRIOR_SCALES[-1])
    return replace(about, square=calibration.square + float(precision @ mean**2))


def continuous_parameters(part: FittedEffect, recorded: RecordedMotion) -> list[EffectParameter]:
    """Its parameters that have a column: all but discrete ones, and those of a law that does not act."""
    every = acting_parameters(part.effect, recorded, part.values)
    return [p for p in every if p.linear or not (p.choice or p.resolution)]


def acting_parameters(effect: Effect, recorded: RecordedMotion, values: Values) -> list[EffectParameter]:
    """The parameters on which its response depends at these values."""
    inert = frozenset(effect.inert(values))
    return [p for p in effect.parameters(recorded) if p.name not in inert]


def acting_columns(effect: Effect, recorded: RecordedMotion, values: Values) -> Array:
    """(N, C, k) the response to one unit of each linear parameter that acts."""
    columns, inert = effect.columns(recorded, values), frozenset(effect.inert(values))
    acts = [p.name not in inert for p in effect.parameters(recorded) if p.linear]
    return columns if all(acts) else columns[:, :, acts]


def columns_of(problem: Problem, parts: tuple[FittedEffect, ...], inputs: list[RecordedMotion]) -> Array:
    """(k, R) whitened response to each parameter of each part."""
    white: list[Array] = []
    for part, recorded in zip(parts, inputs, strict=True):
        effect, values, own = part.effect, part.values, continuous_parameters(part, recorded)
        if effect.lasting and own:
            white.append(problem.whitened_curve(effect.columns(recorded, values)))
            continue
        linear = any(p.linear for p in own)
        straight = iter(np.moveaxis(acting_columns(effect, recorded, values), 2, 0) if linear else ())
        here = np.zeros(0) if all(p.linear for p in own) else effect.simulate(recorded, values)
        columns = [next(straight) if p.linear else slope_of(effect, recorded, values, p, here) for p in own]
        if columns:  # in the order in which they are whitened: a copy across the axes would take longer
            white.append(problem.whiten(np.stack([column.T for column in columns]).T))
    return np.concatenate(white) if white else np.zeros((0, problem.whiten(problem.measured).size))


def slope_of(effect: Effect, recorded: RecordedMotion, values: Values, p: EffectParameter, here: Array) -> Array:
    """(N, C) derivative of the response by the place of a parameter in its prior."""
    place = p.to_unit(values[p.name])
    ahead = place + SLOPE_STEP if place + SLOPE_STEP <= 1.0 else place - SLOPE_STEP
    there = effect.simulate(recorded, {**values, p.name: p.from_unit(ahead)})
    return np.asarray((there - here) / (ahead - place))


def _rate(p: EffectParameter, value: float) -> float:
    if p.linear:
        return 1.0
    place = p.to_unit(value)
    low, high = max(place - SLOPE_STEP, 0.0), min(place + SLOPE_STEP, 1.0)
    return (p.from_unit(high) - p.from_unit(low)) / (high - low)
