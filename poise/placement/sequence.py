"""In which order, and where, several objects are put so that the assembly stands after each of them."""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from poise.assembly import Analysis, Assembly, RigidObject
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.placement.choice import best_confirmed
from poise.placement.planner import Options, Placement, PlacementProgress, plan_placement
from poise.placement.scoring import PlacementScore, estimate_score, evaluate
from poise.threads import in_one_thread

_TRIED_PER_OBJECT = 8
"""Plans for single objects in one order, per object, before it is given up."""


_PLAIN = Options()


@dataclass(frozen=True, eq=False)
class PlacementSequence:
    """Placements in the order in which they are made; each stands without those that follow.

    Args:
        placements: one for each object.
        seconds: of planning.
    """

    placements: tuple[Placement, ...]
    seconds: float

    @property
    def order(self) -> tuple[str, ...]:
        """Ids."""
        return tuple(placement.item.id for placement in self.placements)

    @property
    def analysis(self) -> Analysis:
        """Of the assembly with all objects."""
        return self.placements[-1].analysis

    @cached_property
    def score(self) -> PlacementScore:
        """Of that assembly, certified; computed when first used.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        return evaluate(self.analysis)


@in_one_thread
def plan_sequence(
    assembly: Assembly | Analysis,
    items: Sequence[RigidObject],
    options: Options = _PLAIN,
    seed: int = 0,
    orders: int | None = None,
    progress: Callable[[PlacementProgress], bool] | None = None,
) -> PlacementSequence:
    """Find an order of objects and a place for each.

    The heaviest comes first (thesis section 5.7). What finds no place waits for the next round; when nothing does, the
    last placement is taken back and made elsewhere. With more orders, further ones are drawn with odds by mass, as in
    the thesis, and the best assembly in the end decides.

    Args:
        assembly: what is there; it has to stand.
        items: the objects to place, with unique ids.
        options: of each placement; a deadline is for all together.
        seed: same seed, same answer (unless a deadline cuts it short).
        orders: how many are looked at; None: one.
        progress: see `plan_placement`.

    Raises:
        InputError: BAD_INPUT for no objects or an id that is given twice; see `plan_placement`.
        NoAnswerError: NO_PLACEMENT with the most that could be placed (data `placed`, `left`); as `plan_placement`.
        CancelledError: CANCELLED.
    """
    start = time.monotonic()
    ids = require_distinct(items)
    analysis = Analysis.of(assembly, deadline=options.deadline_from(start))
    analysis.require_stable(options.deadline_from(start))
    rng = np.random.default_rng(seed)
    orders_found: list[list[Placement]] = []
    most: list[Placement] = []
    for number in range(max(orders or 1, 1)):
        if orders_found and options.deadline is not None and time.monotonic() - start > options.deadline:
            break
        search = _Order(options, start, rng, progress, shuffled=number > 0, budget=_TRIED_PER_OBJECT * len(items))
        found = search.place(analysis, list(items))
        most = max(most, search.most, key=len)
        if found is not None:
            orders_found.append(found)
    if not orders_found:
        raise _no_order(ids, [placement.item.id for placement in most])
    return PlacementSequence(tuple(_best(orders_found, options, start)), time.monotonic() - start)


def require_distinct(items: Sequence[RigidObject]) -> list[str]:
    """The ids of objects to place.

    Raises:
        InputError: BAD_INPUT for none, or an id that is given twice.
    """
    ids = [item.id for item in items]
    if not items or len(set(ids)) < len(ids):
        raise InputError(ErrorCode.BAD_INPUT, f"objects to place: {ids}; name at least one, and each once")
    return ids


def _best(orders: list[list[Placement]], options: Options, start: float) -> list[Placement]:
    if len(orders) == 1:
        return orders[0]
    judged: list[tuple[list[Placement], PlacementScore]] = []
    for placements in orders:
        with suppress(NoAnswerError):  # an order of which a solver fails is dropped
            judged.append((placements, estimate_score(placements[-1].analysis, options.criterion == "median")))
    if not judged:
        return orders[0]
    deadline = options.deadline_from(start)
    results = [placements[-1].analysis for placements, _ in judged]
    return judged[best_confirmed(results, [score for _, score in judged], options.criterion, deadline)][0]


def _no_order(ids: list[str], placed: list[str]) -> NoAnswerError:
    left = [name for name in ids if name not in placed]
    return NoAnswerError(
        ErrorCode.NO_PLACEMENT,
        f"no order found: with {', '.join(placed) or 'nothing'} placed there is no place for {', '.join(left)}; "
        "make room, or allow more attempts",
        placed=placed,
        left=left,
    )


class _Order:
    """One pass of the search, depth first."""

    def __init__(
        self,
        options: Options,
        start: float,
        rng: np.random.Generator,
        progress: Callable[[PlacementProgress], bool] | None,
        shuffled: bool,
        budget: int,
    ) -> None:
        self._options, self._start, self._rng, self._progress = options, start, rng, progress
        self._shuffled, self._budget = shuffled, budget
        self.most: list[Placement] = []
        self._made: list[Placement] = []

    def place(self, analysis: Analysis, items: list[RigidObject]) -> list[Placement] | None:
        """Placements of all items, or None when there are none within the budget."""
        if not items:
            return list(self._made)
        for item in self._ranked(items):
            if self._budget <= 0:
                return None
            self._budget -= 1
            try:
                placement = plan_placement(analysis, item, self._left(), int(self._rng.integers(2**31)), self._progress)
            except NoAnswerError as error:
                if error.code not in (ErrorCode.NO_PLACEMENT, ErrorCode.SOLVER_FAILED):
                    raise
                continue
            self._made.append(placement)
            if len(self._made) > len(self.most):
                self.most = list(self._made)
            found = self.place(placement.analysis, [other for other in items if other is not item])
            if found is not None:
                return found
            self._made.pop()
        return None

    def _ranked(self, items: list[RigidObject]) -> list[RigidObject]:
        """The heaviest first, or drawn with odds by mass."""
        masses = np.array([item.mass for item in items])
        if not self._shuffled:
            return [items[k] for k in np.argsort(-masses, kind="stable")]
        chosen = self._rng.choice(len(items), size=len(items), replace=False, p=masses / masses.sum())
        return [items[k] for k in chosen]

    def _left(self) -> Options:
        """The options with what is left of the deadline."""
        if self._options.deadline is None:
            return self._options
        left = self._options.deadline - (time.monotonic() - self._start)
        if left <= 0:
            raise NoAnswerError(
                ErrorCode.DEADLINE, f"time was over with {len(self._made)} objects placed; give a longer deadline"
            )
        return replace(self._options, deadline=left)
