"""Follows a block on elastic contacts from rest while a load grows, until it collapses.

The power of the load on the displacement is set, and the factor of the load is found. While it collapses the
displacement grows under a load that does not: there a given factor has no equilibrium, or many; a given power has one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from poise.types import Array

# The first step loads the block by this share of the most that is asked, or of its weight.
_FIRST_SHARE, _FIRST_WEIGHT = 0.25, 0.25
# How far the next step goes, as a multiple of the way so far: after many Newton steps, or few.
_AFTER_MANY, _AFTER_FEW, _FEW = 2.0, 4.0, 5
_LEAST_GROWTH, _STEPS = 1.1, 40


@dataclass(frozen=True, eq=False)
class PathPoint:
    """An equilibrium on the way.

    Args:
        displacement: (6 n,).
        factor: of the load.
        held: the contacts alone carry the load.
        steps: Newton steps taken.
    """

    displacement: Array
    factor: float
    held: bool = True
    steps: int = 0


@dataclass(frozen=True, eq=False)
class LoadPath:
    """How far a block was followed.

    Args:
        last: the equilibrium with the largest factor.
        end: (6 n,) the displacement at which it was left.
        ended: it collapsed, or reached the factor asked for; otherwise no equilibrium was found beyond.
    """

    last: PathPoint
    end: Array
    ended: bool


Reach = Callable[[Array], PathPoint | None]
"""From a displacement to the equilibrium at which the load has the same power; None where none is found."""


def follow(
    reach: Reach, rest: Array, response: Array, load: Array, above: float, weight: float, tolerance: float
) -> LoadPath:
    """Follow a block from rest until the factor of a load grows no more, or is `above`.

    Args:
        reach: finds equilibria.
        rest: (6 n,) displacement without the load.
        response: (6 n,) change of it under a small load, per factor.
        load: (6 n,).
        above: no more than this is asked.
        weight: size of the load at rest.
        tolerance: it collapses where the factor grows by less than this share over a doubling of the way.
    """
    compliance = float(load @ response)
    first = min(_FIRST_SHARE * above, _FIRST_WEIGHT * weight / (float(np.linalg.norm(load)) or 1.0))
    done, way = 0.0, compliance * first
    best = last = here = PathPoint(rest, 0.0)
    slope, growth = response / compliance, _AFTER_FEW
    for _ in range(_STEPS):
        found = reach(last.displacement + (way - done) * slope)
        if found is None:
            growth = np.sqrt(growth)
            if growth < _LEAST_GROWTH:
                return LoadPath(best, last.displacement, False)
            way = done * growth if done else way / 4
            continue
        here = found
        if not here.held:
            break
        if here.factor >= above:
            return LoadPath(PathPoint(here.displacement, above), here.displacement, True)
        best = here if here.factor > best.factor else best
        if done and here.factor - last.factor <= tolerance * here.factor * np.log2(way / done):
            break
        slope = (here.displacement - last.displacement) / (way - done)
        last, done = here, way
        growth = _AFTER_FEW if here.steps <= _FEW else _AFTER_MANY
        way *= growth
    return LoadPath(best, here.displacement, True)
