"""Maps where contact forces have a choice: what elastic contacts withstand at a few points, and bounds between them."""

from dataclasses import dataclass, field

import numpy as np

from poise.assembly.contact import SurfacePoints
from poise.assembly.robustness.block_answers import CHECKED_SHARE
from poise.assembly.robustness.map_regions import Bounds, Pool, Programs, Region, bound_block
from poise.assembly.statics import BlockAnalysis, Deadline
from poise.types import Array, Indices, Mask

_FLAT_QUESTIONS, _CURVED_QUESTIONS = 10, 48
"""Points of one face, and of what is curved of one body, that elastic contacts are asked about at most."""

_FEW_POINTS = 100
"""Where symmetries carried faces into one that have no more points each, as many are asked as without. These are a good
part of them, and what is asked is certain; of many points, they would be few."""


@dataclass(frozen=True)
class _Ration(Deadline):
    """A deadline that also passes after a number of questions."""

    left: list[int] = field(default_factory=lambda: [0])

    @property
    def passed(self) -> bool:
        return self.left[0] <= 0 or super().passed


class _ElasticPool(Pool):
    """One block whose inverse load factors are raised to those of elastic contacts.

    `bounds` start from what the map knows: nothing below that is worth a question.
    """

    def __init__(
        self,
        block: BlockAnalysis,
        known: Bounds,
        tolerance: float,
        floor: float,
        clock: Deadline,
        answers: dict[tuple[int, bytes], Programs],
    ) -> None:
        """Take the block, and the bounds, tolerance, floor and answers of the map."""
        bounds = Bounds.none(len(known.upper))
        bounds.lower[:] = known.upper
        super().__init__(block, 0, bounds, clock, with_limit=True, with_patch=True, answers=answers)
        self._known, self._tolerance, self._floor, self._clock = known, tolerance, floor, clock
        self.doubtful = np.ones(len(known.upper), dtype=bool)
        self._shares, self._least = dict[tuple[float, ...], float](), 1.0
        self._unknown: list[Array] = []  # (6,) wrenches of which more may be held than was found

    def begin(self, flat: bool, region: Region) -> None:
        self._shares, self._least, self._unknown = {}, 1.0, []
        images = len(np.unique(region.folded))
        times = images if len(region.rows) <= images * _FEW_POINTS else 1
        self.deadline = _Ration(self._clock.at, [times * (_FLAT_QUESTIONS if flat else _CURVED_QUESTIONS)])

    def inverse_factors(self, body: int, wrenches: Array) -> Array:
        may = wrenches[: max(0, self.deadline.left[0])] if isinstance(self.deadline, _Ration) else wrenches
        return super().inverse_factors(body, may)

    def _asked(self, body: int, wrenches: Array) -> list[float]:
        """(k <= n,) inverse load factors of wrenches (n, 6) on a body of the block, as far as there is time."""
        values: list[float] = []
        loads = self.loads(body, wrenches)
        for wrench, load, limit in zip(wrenches, loads, self._limits(body, wrenches, loads).tolist(), strict=True):
            if self.deadline.passed:
                break
            values.append(self._inverse_factor(wrench, load, limit))
        return values

    def _limits(self, body: int, wrenches: Array, loads: Array) -> Array:
        """(q,) inverse load factors of wrenches (q, 6), whose loads are (q, 6 n), by limit analysis and patches.

        As for single pushes: with the centres of pressure where they are at collapse, not at rest as in the map before.
        """
        known = [self.answers.get((body, wrench.tobytes())) for wrench in wrenches]
        new = self.programs(loads[[one is None for one in known]])
        self.bounds.solves += len(new)
        fresh = iter(new)
        found = [next(fresh) if one is None else one for one in known]
        limits, patch = [one.limit for one in found], self.block.solvers.patch
        uppers = np.array([limit.upper for limit in limits])
        if patch is None:
            return uppers
        patches = patch.inverse_factors(loads, limits, uppers, [one.resting for one in found])
        return np.asarray(np.maximum(uppers, [one.upper for one in patches]))

    def _inverse_factor(self, wrench: Array, load: Array, limit: float) -> float:
        """Inverse load factor of a wrench (6,), whose load is (6 n,): of elastic contacts, but at least `limit`."""
        if isinstance(self.deadline, _Ration):
            self.deadline.left[0] -= 1
        if not np.isfinite(limit):
            return limit
        above = CHECKED_SHARE / max(limit, self._floor)
        # What elastic contacts hold at one point of a face, they nearly hold at the others; not so on other faces.
        face = tuple(np.round(wrench[:3], 6).tolist())
        expected = self._shares.get(face, 1.0) * above
        found = self.block.solvers.coulomb.factor(load, above, self._clock, expected, self._tolerance / 2)
        self._shares[face] = found.value / above if found.value > 0 else 1.0
        self._least = min(self._least, found.value / above)
        if found.value >= above:
            return limit
        if not found.known:
            self._unknown.append(wrench)
        return max(limit, 1 / found.value) if found.value > 0 else np.inf

    def cuts(self, body: int, wrenches: Array, start: int = 0) -> tuple[Array, Indices]:
        """None: the map has its mechanisms already."""
        return np.zeros(len(wrenches)), np.full(len(wrenches), -1)

    def take(self, region: Region) -> None:
        """Hand the bounds to the map; where elastic contacts hold less at all, no point holds a larger share."""
        rows = region.rows
        known = self._known.upper[rows]
        if self._least < 1:
            middle = int(np.abs(region.wrenches - region.wrenches.mean(axis=0)).sum(axis=1).argmin())
            if not region.solved[middle]:
                self.deadline = self._clock
                region.solve(np.array([middle]))
            with np.errstate(divide="ignore"):
                least = np.maximum(known, self._floor) / self._least
            region.upper = np.where(region.solved, region.values, np.maximum(region.upper, least))
        wider = region.upper > (1 + self._tolerance) * known
        unknown = [np.all(region.wrenches == wrench, axis=1) for wrench in self._unknown]
        self.doubtful[rows] = wider & (~region.solved | np.any([np.zeros_like(wider), *unknown], axis=0))
        self._known.upper[rows] = np.maximum(region.upper, known)


def confirm_map(
    block: BlockAnalysis,
    surface: SurfacePoints,
    rows: Indices,
    wrenches: Array,
    bounds: Bounds,
    tolerance: float,
    floor: float,
    deadline: Deadline,
    answers: dict[tuple[int, bytes], Programs],
) -> Mask:
    """Raise the upper bounds of inverse load factors at points (rows) to what elastic contacts withstand.

    A few points of each face are asked. Between them 1 / robustness counts as convex, as it is in limit analysis; where
    elastic contacts hold less than limit analysis, no point between counts as holding a larger share than the least.

    Returns:
        (r,) points whose bound rests on that and is wider than the tolerance, or that were not reached.
    """
    pool = _ElasticPool(block, bounds, tolerance, floor, deadline, answers)
    if deadline.passed:
        bounds.give_up(rows)
    else:
        bound_block(pool, surface, rows, wrenches, tolerance, floor)
    bounds.solves += pool.bounds.solves
    return pool.doubtful[rows]
