"""Follows a block on elastic contacts from rest while a load grows, until it collapses.

The power of the load on the displacement is set, and the factor of the load is found. While it collapses the
displacement grows under a load that does not: there a given factor has no equilibrium, or many; a given power has one.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import overload

import numpy as np

from poise.types import Array, Indices

# The first step loads the block by this share of the most that is asked, or of its weight.
_FIRST_SHARE, _FIRST_WEIGHT = 0.25, 0.25
# How far the next step goes, as a multiple of the way so far: after many Newton steps, or few.
_AFTER_MANY, _AFTER_FEW, _FEW = 2.0, 3.0, 5
_MOST, _MANY, _SURE = 25, 10, 1.5
"""Newton steps to one point. After more than `_MANY` a longer step than `_SURE` may have led to another equilibrium: a
shorter one is tried."""
_LEAST_GROWTH, _STEPS = 1.04, 40
_DECIDED = 16
"""Given factors that are tried where Newton steps find no next point."""
_AT_PEAK, _STEEP = 12, 0.25
"""Points around a peak; before a plateau, where the factor would grow by more than this share, as at the last point."""
_BEYOND, _NEAR_END = 3, 0.97
"""Beyond the end of a path a state is looked for at a factor that is larger by so many tolerances; also from the last
point with no more than this share of the best factor."""
_SHORTER = 6
"""Times that the first step is taken again, an eighth as long, where it led to collapse."""


@dataclass(frozen=True, eq=False)
class PathPoint:
    """An equilibrium on the way.

    Args:
        displacement: (6 n,).
        factor: of the load.
        held: the contacts alone carry the load.
        compliance: power of the load on the change of the displacement by it; 0: not known.
        steps: Newton steps taken.
        change: (6 n,) of the displacement by the load, in the last step; None: the way there is followed on instead.
    """

    displacement: Array
    factor: float
    held: bool = True
    compliance: float = 0.0
    steps: int = 0
    change: Array | None = None


@dataclass(frozen=True, eq=False)
class CompiledPoints(Sequence[PathPoint]):
    """The points of a path that the compiled kernel followed; each is made when it is first asked for, and kept.

    Args:
        displacements: (K, 6 n), with bodies in the order of elimination.
        entries: (6 n,) where each of these numbers is among those of the bodies.
        factors, compliances, steps: (K,).
    """

    displacements: Array
    entries: Indices
    factors: list[float]
    compliances: list[float]
    steps: list[int]
    _made: dict[int, PathPoint] = field(default_factory=dict, init=False)

    def __len__(self) -> int:
        return len(self.factors)

    @overload
    def __getitem__(self, number: int) -> PathPoint: ...
    @overload
    def __getitem__(self, number: slice) -> list[PathPoint]: ...
    def __getitem__(self, number: int | slice) -> PathPoint | list[PathPoint]:
        if isinstance(number, slice):
            return [self[k] for k in range(*number.indices(len(self)))]
        number = range(len(self))[number]
        if number not in self._made:
            place = np.empty(self.displacements.shape[1])
            place[self.entries] = self.displacements[number]
            numbers = self.compliances[number], self.steps[number]
            self._made[number] = PathPoint(place, self.factors[number], True, *numbers)
        return self._made[number]


@dataclass(frozen=True, eq=False)
class LoadPath:
    """How far a block was followed.

    Args:
        points: equilibria on the way, the first at rest.
        end: (6 n,) the displacement at which it was left.
        ended: it collapsed, or reached the factor asked for; otherwise no equilibrium was found beyond.
    """

    points: Sequence[PathPoint]
    end: Array
    ended: bool

    @property
    def best(self) -> PathPoint:
        """The equilibrium with the largest factor."""
        factors = self._factors
        return self.points[factors.index(max(factors))]

    def up_to(self, factor: float) -> PathPoint:
        """The last equilibrium on the way with no more than a factor."""
        numbers = reversed(list(enumerate(self._factors)))
        return self.points[next((number for number, found in numbers if found <= factor), 0)]

    @property
    def _factors(self) -> list[float]:
        points = self.points
        return points.factors if isinstance(points, CompiledPoints) else [point.factor for point in points]


EquilibriumSearch = Callable[[Array, int], PathPoint | None]
"""From a displacement to the equilibrium at which the load has the same power; None where none is found after so many
Newton steps."""


StateSearch = Callable[[float, Array, bool], PathPoint | None]
"""From a factor and a displacement to the state of the block under the load, near it or, if thorough, anywhere; None
where it is not found."""


def follow(
    reach: EquilibriumSearch,
    rest: Array,
    response: Array,
    load: Array,
    above: float,
    weight: float,
    tolerance: float,
    begin: PathPoint | None = None,
) -> LoadPath:
    """Follow a block from rest until the factor of a load grows no more, or is `above`.

    Args:
        reach: finds equilibria.
        rest: (6 n,) displacement without the load.
        response: (6 n,) change of it, or of the beginning, under a small load, per factor.
        load: (6 n,).
        above: no more than this is asked.
        weight: size of the load at rest.
        tolerance: it collapses where the factor grows by less than this share over a doubling of the way.
        begin: an equilibrium to begin at; None: at rest.
    """
    compliance = float(load @ response)
    first = min(_FIRST_SHARE * above, _FIRST_WEIGHT * weight / (math.sqrt(float(load @ load)) or 1.0))
    slope, points = response / compliance, [PathPoint(rest, 0.0)]
    if begin is None:
        path = _followed(reach, points, slope, (0.0, compliance * first), _AFTER_FEW, above, tolerance)
    else:
        points, done = [*points, begin], float(load @ (begin.displacement - rest))
        if begin.factor >= above or flat_at(begin, done, tolerance):
            return LoadPath(points, begin.displacement, True)
        path = _followed(reach, points, slope, (done, _AFTER_MANY * done), _AFTER_MANY, above, tolerance)
    return _with_peak(reach, path, load, above, tolerance)


def _followed(
    reach: EquilibriumSearch,
    points: list[PathPoint],
    slope: Array,
    ways: tuple[float, float],
    ahead: float,
    above: float,
    tolerance: float,
) -> LoadPath:
    """The path on from its last point, along a slope; `ways` so far and to the first guess, `ahead` their ratio."""
    rest, (done, way), shorter, longest = points[0].displacement, ways, 0, np.inf
    guess = points[-1].displacement + (way - done) * slope
    for _ in range(_STEPS):
        careful = done > 0 and ahead > _SURE
        here, last = reach(guess, _MANY + 1 if careful else _MOST), points[-1]
        if here is None or (careful and here.steps > _MANY):
            ahead = longest = math.sqrt(ahead)
            if ahead < _LEAST_GROWTH:
                return LoadPath(points, last.displacement, False)
            way = done * ahead if done else way / 4
            guess = last.displacement + (way - done) * slope
            continue
        if not here.held:
            if done or shorter == _SHORTER:  # at far more than the last point it may have fallen on the way
                near = here.factor <= (1 + 2 * tolerance) * last.factor
                return LoadPath(points, here.displacement, near or not done)
            shorter, way = shorter + 1, way / 8  # within the first step, as where a small load rolls something away
            guess = rest + way * slope
            continue
        points.append(here)
        collapsed = done and here.factor - last.factor <= tolerance * here.factor * math.log2(way / done)
        flat = flat_at(here, way, tolerance) and here.factor <= (1 + tolerance) * last.factor
        if here.factor >= above or collapsed or flat:
            return LoadPath(points, here.displacement, True)
        if here.change is not None and here.compliance > 0:
            slope = here.change / here.compliance
        else:
            slope = (here.displacement - last.displacement) / (way - done)
        longest = longest if here.steps > _MANY else min(longest, _AFTER_FEW) ** 2
        ahead = min(longest, _AFTER_FEW if here.steps <= _FEW else _AFTER_MANY)
        done, way = way, ahead * way
        guess = here.displacement + (way - done) * slope
    return LoadPath(points, points[-1].displacement, False)


def _with_peak(reach: EquilibriumSearch, path: LoadPath, load: Array, above: float, tolerance: float) -> LoadPath:
    """A path that collapsed, with more points where its factor may be larger than at those it has.

    Between a point at which the factor grows and the next one, which has no more, there may be a peak. It is looked
    for where the factor, growing as at the first point, would be a little more than at all points.
    """
    points, least = list(path.points), 2 * tolerance
    gain, change = least, 2.0  # the step grows until it leads beyond the peak
    for _ in range(_AT_PEAK if path.ended else 0):
        most = max(point.factor for point in points)
        k, falls = _around_peak(points, load, least * most)
        if most >= above or k < 0:
            break
        low, high, rise = points[k], points[k + 1], _rise(points, k, load)
        share = ((1 + gain) * most - low.factor) / rise if rise > (least if falls else _STEEP) * most else 1.0
        here = reach(low.displacement + share * (high.displacement - low.displacement), _MOST) if share < 1 else None
        if here is None or not here.held:
            break
        change = 0.5 if falls and here.factor <= most else change
        gain = max(change * gain, least)
        points.insert(k + 1, here)
    return LoadPath(points, path.end, path.ended)


def _around_peak(points: Sequence[PathPoint], load: Array, little: float) -> tuple[int, bool]:
    """The last point before the peak, and whether the factor falls after it; otherwise there is a plateau.

    On a plateau the factor would grow by no more than a `little` to the next point.
    """
    best = max(range(len(points)), key=lambda k: points[k].factor)
    if best + 1 < len(points) and _rise(points, best, load) > little:
        return best, True
    k, falls = best - 1, points[best].compliance < 0
    while not falls and k > 0 and _rise(points, k, load) <= little:
        k -= 1
    return k, falls


def _rise(points: Sequence[PathPoint], k: int, load: Array) -> float:
    """What the factor would gain from a point to the next one, growing as there; 0 where it does not grow."""
    here, after = points[k : k + 2]
    way = float(load @ (after.displacement - here.displacement))
    return way / here.compliance if here.compliance > 0 else 0.0


def go_on(
    path: LoadPath, stand: StateSearch, resume: Callable[[PathPoint], LoadPath], above: float, tolerance: float
) -> LoadPath:
    """Go on where no next equilibrium was found: under larger, given factors the block stands or falls.

    Args:
        path: that has not ended.
        stand: finds the state under a given factor.
        resume: follows the load on from an equilibrium.
        above: no more than this is asked.
        tolerance: the path ends where the block stands and falls at factors that differ by twice this share.
    """
    least, resumed = 2 * tolerance, path.best
    step = least
    for _ in range(_DECIDED):
        best = path.best
        factor = min((1 + step) * best.factor, above)
        state = stand(factor, best.displacement, False)
        if state is None or not state.held:
            if best is not resumed:
                resumed, further, step = best, resume(best), least
                path = LoadPath([*path.points, *further.points[2:]], further.end, further.ended)
                if path.ended:
                    return path
                continue
            if step > least:
                step = least
                continue
            state = stand(factor, best.displacement, True)
            if state is None:
                return path
            if not state.held:
                return LoadPath(path.points, state.displacement, True)
        path, step = LoadPath([*path.points, state], state.displacement, factor >= above), 2 * step
        if path.ended:
            return path
    return path


def look_beyond(
    path: LoadPath, look: Callable[[float, Array], PathPoint | None], above: float, tolerance: float
) -> LoadPath:
    """A path; where it ended, with a state under more than its best factor if one is near, as one that has not.

    Friction allows several states: a path may pass over a peak, or leave states that hold more before its end.

    Args:
        path: followed.
        look: the state under a factor, if one is found near a displacement (6 n,) that stands.
        above: no more than this is asked.
        tolerance: the state is looked for at a factor that is larger by `_BEYOND` times this share.
    """
    points, at = path.points, max(range(len(path.points)), key=lambda k: path.points[k].factor)
    if not path.ended or not 0 < points[at].factor < above:
        return path
    best, before = points[at].displacement, points[max(at - 1, 0)].displacement
    after = path.end if at + 1 < len(points) else 2 * best - before
    factor = min((1 + _BEYOND * tolerance) * points[at].factor, above)
    for start in (2 * best - before, 2 * after - best, path.up_to(_NEAR_END * points[at].factor).displacement):
        if (state := look(factor, start)) is not None:
            return LoadPath([*points, state], state.displacement, factor >= above)
    return path


def flat_at(here: PathPoint, way: float, tolerance: float) -> bool:
    """Whether the factor would grow by less than a share, the tolerance, over as long a way as that so far."""
    return bool(here.compliance) and way / here.compliance <= tolerance * here.factor
