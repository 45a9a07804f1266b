"""Effects of a model that cancel each other: what they leave follows something else."""

import itertools
from collections.abc import Sequence

import numpy as np

from poise.mismatch.inference.problem import FittedEffect, Problem

_CANCELS = 0.3
"""Energy of the response of two effects, relative to the smaller one's own, below which they cancel; and so of two
delays."""


def cancelling(problem: Problem, parts: Sequence[FittedEffect]) -> list[str]:
    """For each part, why it is no effect of its own: another one takes most of its response back; "" where none does.

    A filter and an early clock together smooth without delay, an encoder's zero and a turned sensor hardly act: what
    two large effects leave when they cancel follows something else.
    """

    def energy(chosen: Sequence[FittedEffect]) -> float:
        rest = [part for part in parts if part not in chosen]
        response = whole - problem.predicted(problem.compose(rest)[1])
        return float(np.sum((response / problem.noise.sigma) ** 2))

    whole = problem.predicted(problem.compose(parts)[1])
    alone = [energy([part]) for part in parts]
    found = [""] * len(parts)
    for i, j in itertools.combinations(range(len(parts)), 2):
        cancel = energy([parts[i], parts[j]]) < _CANCELS * min(alone[i], alone[j])
        if cancel or _no_delay(parts[i], parts[j]):
            found[i], found[j] = (f"{parts[k].effect.name} would cancel it" for k in (j, i))
    return found


def _no_delay(one: FittedEffect, other: FittedEffect) -> bool:
    """Whether two delays leave hardly any: the smoothing that stays may be that of the measured motion."""
    if not (one.effect.delay and other.effect.delay):
        return False
    delays = [each.values[each.effect.delay] for each in (one, other)]
    return abs(sum(delays)) < _CANCELS * min(map(abs, delays))
