"""Several objects into a container, low and dense, so that the assembly stands after each of them."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from poise.assembly import Analysis, Assembly, RigidObject
from poise.assembly.statics import Deadline
from poise.errors import ErrorCode, NoAnswerError
from poise.geometry import Pose
from poise.placement import (
    CancelledError,
    Options,
    Placement,
    PlacementProgress,
    PlacementSequence,
    PlacementTest,
    Steady,
    Upright,
    Validator,
    cause_of,
    require_distinct,
    require_new,
)
from poise.placement.packing.arranging import Arrangement, Packer, Rule, Spot, drawn_orders
from poise.placement.packing.container import Container, find_container
from poise.placement.packing.cover import Cover, cover_of
from poise.placement.packing.turns import Turned, turns_of
from poise.types import Array

ORDERS = 60
"""Orders of the objects that are looked at, unless the caller says how many."""
SECONDS = 60.0
"""s: the deadline of a request without one."""
_SEARCHING = 0.5
"""Of the deadline, at most, for the choice of an order; the rest is for the certificates."""
_CERTIFIED = 4
"""Arrangements that are certified, at most, before the lowest of these is taken."""
_RISE = 1e-3
"""m by which a centre of mass has to rise before an object tips, see `Steady`."""
_TESTS: tuple[tuple[str, PlacementTest], ...] = (("tips easily", Steady(0.9 * _RISE)),)
_PLAIN = Options()

_NAMED = 5
"""Objects that the sentence of a refusal names, at most."""
REFUSALS = {
    "orientation": "no axis that may point up is opposite to a face that it stands on",
    "would_roll": "it would roll",
    "no_way_in": "where there is room, no straight way leads there",
    "would_tip": "it would tip easily",
    "too_large": "larger than the container in each orientation that is allowed",
    "under_lid": "it does not fit under the lid",
    "no_room": "no room is left for it",
    "no_support": "where there is room, what is below does not keep it from tipping",
    "not_stable": "where there is room, it does not stand",
    "not_robust": "where there is room, it does not stand robustly",
    "no_room_for_hand": "where there is room, the hand has none",
    "out_of_reach": "where there is room, the arm does not reach",
    "undecided": "a solver failed where there is room",
    "condition_not_met": "where there is room, a condition is not met",
}
"""Causes for which an object is left."""


@dataclass(frozen=True, eq=False)
class Packing(PlacementSequence):
    """Objects packed into a container; each stands without those that follow.

    Args:
        container: what was packed.
        top: m, of the load over the container's floor; what was in it before is part of the load.
        volume: m3, of the load.
        margin: N, the least of the stability margins after each object (`Analysis.stability`).
    """

    container: Container
    top: float
    volume: float
    margin: float

    @property
    def utilisation(self) -> float:
        """Volume of the load relative to that of the container up to the top of the load."""
        return self.volume / self.container.volume(self.container.floor + self.top)

    @property
    def filled(self) -> float | None:
        """The same up to the lid, or to the rim; None without either."""
        top = self.container.top
        return None if top is None else self.volume / self.container.volume(top)


def pack(
    assembly: Assembly | Analysis,
    items: Sequence[RigidObject],
    options: Options = _PLAIN,
    seed: int = 0,
    orders: int | None = None,
    progress: Callable[[PlacementProgress], bool] | None = None,
) -> Packing:
    """Pack objects low and dense: many orders by geometry alone, then a certificate for each step of the best.

    Candidates are corners of what is there, as in deepest-bottom-left-fill (Karabulut and Inceoglu 2004); the
    arrangement with the lowest top is taken. Objects are let down from above, so that an arm can follow the order.

    Args:
        assembly: what is there; it has to stand. Its fixed bodies are the container.
        items: the objects to pack, with unique ids.
        options: `packing`, looks, tests, uncertainty, `on`, attempts for each object, and the deadline for all.
        seed: same seed, same answer (unless a deadline cuts it short).
        orders: how many are looked at; None: `ORDERS`.
        progress: called after every pose and every order; returning False cancels.

    Raises:
        InputError: BAD_INPUT, and those of `find_container`.
        NoAnswerError: UNSTABLE when the assembly does not stand as it is; NO_PLACEMENT with `placed`, `left` and the
            cause for each that is left (`refused`); DEADLINE.
        CancelledError: CANCELLED.
    """
    start = time.monotonic()
    require_distinct(items)
    seconds = SECONDS if options.deadline is None else options.deadline
    analysis = Analysis.of(assembly, deadline=Deadline(start + seconds))
    for item in items:
        require_new(analysis.assembly.objects, item)
    job = _Job(analysis, items, options, start, progress)
    return job.best(np.random.default_rng(seed), ORDERS if orders is None else orders)


@dataclass(eq=False)
class _Certified:
    """An arrangement, and the analysis of each step.

    Args:
        tried: rejected poses of each object, by test.
    """

    analysis: Analysis
    placements: list[Placement] = field(default_factory=list)
    margin: float = np.inf
    tried: dict[str, Counter[str]] = field(default_factory=dict)
    arrangement: Arrangement = field(default_factory=Arrangement)


class _LateError(Exception):
    """The deadline has passed."""


_Ranked = tuple[tuple[int, float, float], list[RigidObject], Rule]


class _Job:
    """One request."""

    def __init__(
        self,
        analysis: Analysis,
        items: Sequence[RigidObject],
        options: Options,
        start: float,
        progress: Callable[[PlacementProgress], bool] | None,
    ) -> None:
        self._analysis, self._items, self._options = analysis, items, options
        self._start, self._progress = start, progress
        self._deadline = SECONDS if options.deadline is None else options.deadline
        analysis.require_stable(Deadline(start + self._deadline))
        self._iteration = 0
        self._rejected: Counter[str] = Counter()
        try:
            self._container = find_container(
                analysis.assembly, options.packing.into, options.packing.height, lambda: self._require_time(1.0)
            )
        except _LateError:
            raise self._late() from None
        axes, loaded = self._container.axes, [item for item in analysis.assembly.objects if not item.fixed]
        covers = [cover_of(item.shape.polyhedron, item.vertices @ axes.T) for item in loaded]
        self._before = [item for item in loaded if self._container.holds(item)]
        self._loaded = Cover.joined([Cover(np.zeros((0, 3)), np.zeros((0, 3))), *covers])
        self._turns: dict[str, list[Turned]] = {}
        self._impossible: dict[str, str] = {}

    def best(self, rng: np.random.Generator, count: int) -> Packing:
        """The lowest arrangement of all objects of which each step is certified."""
        found: list[_Certified] = []
        try:
            for item in self._items:
                self._require_time(1.0)
                self._turns[item.id] = self._turns_of(item)
            if self._impossible:
                raise self._refusal([], self._impossible)
            for cost, order, rule in self._ranked(rng, count)[:_CERTIFIED]:
                if found and found[0].arrangement.cost <= cost:
                    break
                found.append(self._certified(order, rule))
                found.sort(key=lambda one: one.arrangement.cost)
        except _LateError:
            if not found:
                raise self._late() from None
        best = found[0]
        if best.arrangement.left:
            raise self._refusal(list(best.arrangement.placed), best.arrangement.left)
        volume = sum(item.shape.volume for item in (*self._before, *self._items))
        up = self._container.axes[2]
        top = max([best.arrangement.top, *(float(np.max(item.vertices @ up)) for item in self._before)])
        top -= self._container.floor
        seconds = time.monotonic() - self._start
        return Packing(tuple(best.placements), seconds, self._container, top, volume, best.margin)

    def _ranked(self, rng: np.random.Generator, count: int) -> list[_Ranked]:
        """Orders and rules, that with the lowest load first; by geometry alone."""
        found: list[_Ranked] = []
        packer = self._packer(self._looks_right, _SEARCHING)
        flattest = [min(float(turned.size[2]) for turned in turns) for turns in self._turns.values()]
        lowest = self._container.floor + max(flattest)  # no load with all objects is lower
        try:
            for order, rule in drawn_orders(self._items, count, rng, lambda: found[0][1:] if found else None):
                self._report(None)
                worst = found[0][0][1] if found and not found[0][0][0] else np.inf
                arrangement = packer.arrange(order, rule, worst)
                if arrangement is not None:
                    found.append((arrangement.cost, order, rule))
                    found.sort(key=lambda one: one[0])
                    if not arrangement.left and arrangement.top <= lowest + 1e-6:
                        break
        except _LateError:
            if not found:
                raise
        return found

    def _certified(self, order: list[RigidObject], rule: Rule) -> _Certified:
        found = _Certified(self._analysis)
        packer = self._packer(lambda item, spot: self._stands(item, spot, found), 1.0)
        found.arrangement = packer.arrange(order, rule) or found.arrangement
        for name in found.arrangement.left:
            if found.tried.get(name):
                found.arrangement.left[name] = cause_of(found.tried[name], [look for look, _ in self._options.looks])
        return found

    def _packer(self, accepts: Callable[[RigidObject, Spot], bool], share: float) -> Packer:
        """A packer that ends with a share of the deadline."""
        on, gap = self._options.on, self._options.packing.gap
        bears = on in ("any", "fixed"), on in ("any", "objects")

        def in_time() -> None:
            self._require_time(share)

        return Packer(self._container, self._loaded, self._turns, gap, _RISE, bears, accepts, in_time)

    def _looks_right(self, item: RigidObject, spot: Spot) -> bool:
        self._require_time(_SEARCHING)
        there = self._there(item, spot)
        return all(look(there) for _, look in self._options.looks)

    def _stands(self, item: RigidObject, spot: Spot, found: _Certified) -> bool:
        """Whether an object stands at a place on what was certified before it; if so, it joins that."""
        self._require_time(1.0)
        tried = found.tried.setdefault(item.id, Counter())
        if tried.total() >= self._options.attempts:
            return False
        tests = (*_TESTS, *self._options.tests)
        validator = Validator(
            found.analysis, item, tests, self._options.looks, self._options.uncertainty, settling=False
        )
        begun = time.monotonic()
        accepted = validator.accept(self._there(item, spot).pose)
        self._iteration += 1
        self._rejected += validator.rejected
        self._report(None if accepted is None else accepted[1])
        tried += validator.rejected
        if accepted is None:
            return False
        seconds = time.monotonic() - begun
        found.placements.append(Placement(accepted[1], accepted[0], tried.total() + 1, seconds, dict(tried)))
        found.analysis = accepted[0]
        found.margin = min(found.margin, accepted[0].stability().margin)
        return True

    def _there(self, item: RigidObject, spot: Spot) -> RigidObject:
        axes, pose = self._container.axes, spot.pose
        return replace(item, pose=Pose(axes.T @ pose.rotation, axes.T @ pose.translation))

    def _turns_of(self, item: RigidObject) -> list[Turned]:
        """Orientations that fit into the empty container; when there are none, the reason is kept."""
        axes = self._container.axes
        wanted = [look for _, look in self._options.looks if isinstance(look, Upright)]

        def allowed(rotation: Array) -> bool:
            there = replace(item, pose=Pose(axes.T @ rotation, np.zeros(3)))
            return all(look(there) for look in wanted)

        found, why = turns_of(item, _RISE, allowed, lambda: self._require_time(1.0))
        fits = [turned for turned in found if self._fits(turned.size)]
        if not found:
            self._impossible[item.id] = why
        elif not fits:
            level = any(self._fits(turned.size * [1, 1, 0]) for turned in found)
            self._impossible[item.id] = "under_lid" if level else "too_large"
        return fits

    def _fits(self, size: Array) -> bool:
        """Whether bounds of some (3,) m fit into the empty container."""
        container = self._container
        lid = np.inf if container.lid is None else container.lid - container.floor
        gap = 0.0 if container.rim is None else 2 * self._options.packing.gap
        room = np.array([*(container.high - container.low - gap), lid])
        return bool(np.all(size <= room + 1e-7))

    def _report(self, item: RigidObject | None) -> None:
        progress = PlacementProgress(self._iteration, item, None)
        if self._progress is not None and not self._progress(progress):
            raise CancelledError(ErrorCode.CANCELLED, "packing was cancelled; nothing was changed")

    def _require_time(self, share: float) -> None:
        if time.monotonic() - self._start >= share * self._deadline:
            raise _LateError

    def _late(self) -> NoAnswerError:
        return NoAnswerError(
            ErrorCode.DEADLINE,
            f"no arrangement of {len(self._items)} objects was certified in {self._deadline:.3g} s; give a longer "
            "deadline, or fewer objects",
        )

    def _refusal(self, placed: list[str], left: Mapping[str, str]) -> NoAnswerError:
        """NO_PLACEMENT, with the cause for each object that is left."""
        sizes = {item.id: np.ptp(item.shape.polyhedron.vertices, axis=0) for item in self._items}
        named = list(left.items())[:_NAMED]
        sentences = [
            f"{name} ({' x '.join(f'{s:.3g}' for s in sizes[name])} m): {REFUSALS[why]}" for name, why in named
        ]
        more = f", and {len(left) - len(named)} more" if len(left) > len(named) else ""
        count = f"{len(placed)} of {len(self._items)} objects fit"
        if self._impossible:  # the others were not tried
            count = f"nothing was packed, since {len(left)} of {len(self._items)} objects cannot be"
        return NoAnswerError(
            ErrorCode.NO_PLACEMENT,
            f"{count}; {'; '.join(sentences)}{more}",
            placed=placed,
            left=list(left),
            refused=dict(left),
            cause=Counter(left.values()).most_common(1)[0][0],
            rejected=dict(self._rejected.most_common()),
            iterations=self._iteration,
        )
