"""Where each of several objects goes, by geometry alone: corners of what is there, and rules to choose from them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from poise.assembly import RigidObject
from poise.geometry import Pose
from poise.placement import rise_to_tip
from poise.placement.packing.container import Container
from poise.placement.packing.cover import Cover
from poise.placement.packing.turns import Turned
from poise.types import Array

_UP = np.array([0.0, 0.0, 1.0])
_EQUAL = 1e-7
"""m: rounding of positions and heights."""
REJECTED = "condition_not_met"
"""Cause for an object of which the last test accepted no candidate."""
_SHORT_LIST = 40
"""Candidates of an object, the best ones first, of which support is looked at."""
_MOST_EDGES = 60
"""Positions along each side, at most: those next to what was placed last are kept."""

_SPREAD = 0.4
"""Of the logarithm of the sizes by which objects are ordered at random."""
_BOTTOM, _GAPS = (0.0, 0.5, 1.0, 2.0), (0.0, 0.0, 0.05)
"""Weights of rules that are drawn."""
_CHANGES = 0.3
"""Share of the orders that are changes of the best before them; they come last."""
_OTHER_RULE = 0.3
"""Share of the changes of an arrangement that change its rule."""


@dataclass(frozen=True)
class Rule:
    """Weights of a candidate's score, of which the least is tried first.

    Args:
        top, bottom: 1/m, of its top and of its bottom.
        corner: 1/m, of its distance from one corner, along both sides.
        gaps: of the part of its base that nothing carries.
        across: 1/m, of its distance along the second side alone; what is left equal by that lies flat.
    """

    top: float
    bottom: float
    corner: float = 1e-3
    gaps: float = 0.0
    across: float = 0.0


DEEPEST = Rule(1e-10, 1.0, 1e-7, 0.0, 1e-4)
"""Deepest-bottom-left-fill: the lowest bottom, then the least distance along the second side, then along the first."""


@dataclass(frozen=True, eq=False)
class Spot:
    """A candidate: an orientation, and the lowest corner of its bounds (3,) m in the container's axes."""

    turned: Turned
    corner: Array

    @property
    def pose(self) -> Pose:
        """Of the object frame in the container's axes."""
        return Pose(self.turned.pose.rotation, self.turned.pose.translation + self.corner)

    @property
    def top(self) -> float:
        return float(self.corner[2] + self.turned.size[2])


@dataclass(eq=False)
class Arrangement:
    """Objects at their places, in the order in which they are let down.

    Args:
        placed: id and place of each.
        left: ids of what found no place, with the reason.
        top: m, of the highest object.
        moment: m4, volumes of bounds times heights: low ones are low and dense.
    """

    placed: dict[str, Spot] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)
    top: float = -np.inf
    moment: float = 0.0

    @property
    def cost(self) -> tuple[int, float, float]:
        """The lower the better: what is left over first, then the height of the load, then of its volume."""
        return len(self.left), round(self.top, 6), round(self.moment, 12)

    def add(self, name: str, spot: Spot) -> None:
        self.placed[name] = spot
        self.top = max(self.top, spot.top)
        self.moment += float(np.prod(spot.turned.size)) * float(spot.corner[2] + spot.turned.com[2])


Accepts = Callable[[RigidObject, Spot], bool]


class Packer:
    """Packs objects one after the other into a container.

    Args:
        container: what is packed.
        loaded: boxes around what is in it already.
        turns: orientations of each object, by id.
        gap: m, between objects and to walls.
        rise: m by which a centre of mass has to rise before an object tips.
        bears: which boxes of the container may carry something, (K,); and whether what is placed may.
        accepts: a last test of a candidate.
        in_time: called for each orientation; raises when there is no time left.
    """

    def __init__(
        self,
        container: Container,
        loaded: Cover,
        turns: Mapping[str, Sequence[Turned]],
        gap: float,
        rise: float,
        bears: tuple[bool, bool],
        accepts: Accepts,
        in_time: Callable[[], None],
    ) -> None:
        self._container, self._turns, self._gap, self._rise = container, turns, gap, rise
        self._bears, self._accepts, self._in_time = bears, accepts, in_time
        self._start = Cover.joined([container.fixed, loaded])

    def arrange(self, items: Sequence[RigidObject], rule: Rule, worst: float = np.inf) -> Arrangement | None:
        """Put objects in an order; None as soon as the load is higher than `worst`, m, or something is left then."""
        found = Arrangement()
        low, high = self._start.low, self._start.high
        for item in items:
            spot, why = self._place(item, low, high, rule)
            if spot is None:
                if np.isfinite(worst):
                    return None
                found.left[item.id] = why
                continue
            found.add(item.id, spot)
            if found.top > worst + _EQUAL:
                return None
            cover = spot.turned.cover.moved(spot.corner)
            low, high = np.concatenate([low, cover.low]), np.concatenate([high, cover.high])
        return found

    def _place(self, item: RigidObject, low: Array, high: Array, rule: Rule) -> tuple[Spot | None, str]:
        """The best place by a rule, or the reason why there is none."""
        candidates = []
        for turned in self._turns[item.id]:
            self._in_time()
            candidates.append((turned, self._candidates(turned, low, high)))
        fitting = [(turned, corners) for turned, corners in candidates if len(corners)]
        if not fitting:
            return None, "no_room"
        scores = [self._scores(turned, corners, low, high, rule) for turned, corners in fitting]
        number = np.repeat(np.arange(len(fitting)), [len(found) for found in scores])
        corners = np.concatenate([corners for _, corners in fitting])
        why = "no_support"
        for row in np.argsort(np.concatenate(scores), kind="stable")[: _SHORT_LIST * len(fitting)]:
            spot = Spot(fitting[number[row]][0], corners[row])
            if self._is_supported(spot, low, high):
                if self._accepts(item, spot):
                    return spot, ""
                why = REJECTED
        return None, why

    def _candidates(self, turned: Turned, low: Array, high: Array) -> Array:
        """(C, 3) lowest corners of an object that is let down beside what is there, under the lid."""
        sides = [self._positions(k, turned, low, high) for k in (0, 1)]
        if not all(map(len, sides)):
            return np.zeros((0, 3))
        rests = self._rests(turned.cover, sides[0], sides[1], low, high)
        place = np.stack([*np.meshgrid(*sides, indexing="ij"), rests], axis=-1).reshape(-1, 3)
        place = place[np.isfinite(place[:, 2])]
        lid = self._container.lid
        fits = place[:, 2] + turned.size[2] <= (np.inf if lid is None else lid + _EQUAL)
        return np.asarray(place[fits])

    def _positions(self, k: int, turned: Turned, low: Array, high: Array) -> Array:
        """(N,) m along one side: beside each thing with the gap, and flush with it."""
        size, container = turned.size[k], self._container
        first, last = container.low[k], container.high[k] - size
        apart = self._gap
        beside = [high[:, k] + apart, low[:, k] - apart - size, low[:, k], high[:, k] - size, [first, last]]
        found = np.unique(np.round(np.concatenate(beside), 9))
        found = found[(found >= first - _EQUAL) & (found <= last + _EQUAL)]
        if len(found) > _MOST_EDGES:
            found = found[np.linspace(0, len(found) - 1, _MOST_EDGES).astype(int)]
        return np.asarray(found)

    def _rests(self, cover: Cover, x: Array, y: Array, low: Array, high: Array) -> Array:
        """(nx, ny) m: where the bottom of the bounds comes to rest, with the gap to everything beside."""
        margin = self._gap - _EQUAL if self._gap > _EQUAL else -_EQUAL
        over = [
            (at[:, None, None] + cover.low[:, k][:, None] < high[:, k] + margin)
            & (at[:, None, None] + cover.high[:, k][:, None] > low[:, k] - margin)
            for k, at in ((0, x), (1, y))
        ]
        lift = high[:, 2] - cover.low[:, 2][:, None]  # (K, M)
        order = np.argsort(lift, axis=None, kind="stable")[::-1]
        rests = np.full((len(x), len(y)), -np.inf)
        first, second = (part.reshape(len(part), -1)[:, order] for part in over)
        lifts = lift.ravel()[order]
        for i in range(len(x)):  # the highest that is met carries it
            rows = np.flatnonzero(first[i])
            met = second[:, rows]
            rests[i] = np.where(met.any(axis=1), lifts[rows][met.argmax(axis=1)] if len(rows) else -np.inf, -np.inf)
        rests[np.isposinf(rests)] = np.nan
        return rests

    def _scores(self, turned: Turned, corners: Array, low: Array, high: Array, rule: Rule) -> Array:
        container = self._container
        bottom = corners[:, 2] - container.floor
        away = np.sum(corners[:, :2] - container.low, axis=1)
        scores = rule.top * (bottom + turned.size[2]) + rule.bottom * bottom + rule.corner * away
        scores += rule.across * (corners[:, 1] - container.low[1])
        if rule.gaps:
            best = np.argsort(scores, kind="stable")[:_SHORT_LIST]
            carried = np.array([np.sum(_meeting(turned.cover.moved(c), low, high)[1]) for c in corners[best]])
            scores[best] += rule.gaps * (1 - carried / np.prod(turned.size[:2]))
            others = np.ones(len(scores), dtype=bool)
            others[best] = False
            scores[others] += rule.gaps
        return np.asarray(scores)

    def _is_supported(self, spot: Spot, low: Array, high: Array) -> bool:
        """Whether what it lies on keeps it from tipping, and may carry it."""
        corners, areas, carriers = _meeting(spot.turned.cover.moved(spot.corner), low, high)
        carriers = carriers[areas > _EQUAL**2]
        if not len(corners):
            return False
        by_fixed, by_placed = self._bears
        fixed = carriers < len(self._container.fixed.low)
        if not ((by_placed and not fixed.all()) or (by_fixed and fixed.all())):
            return False
        com = spot.turned.com + np.append(spot.corner[:2], 0.0)
        points = np.column_stack([corners, np.zeros(len(corners))])
        return rise_to_tip(points, com, _UP) >= self._rise


def _meeting(cover: Cover, low: Array, high: Array) -> tuple[Array, Array, np.ndarray]:
    """Corners (4 N, 2) of the rectangles where a body lies on others, their areas (N,), and on which (N,)."""
    lowest = cover.low[:, 2].min()
    below, carrying = cover.low[:, 2] < lowest + 1e-6, np.abs(high[:, 2] - lowest) < 1e-6
    k, m = (part.ravel() for part in np.meshgrid(np.flatnonzero(below), np.flatnonzero(carrying)))
    first = np.maximum(cover.low[k, :2], low[m, :2])
    last = np.minimum(cover.high[k, :2], high[m, :2])
    met = np.all(last - first > _EQUAL, axis=1)
    first, last, m = first[met], last[met], m[met]
    crossed = [np.column_stack([a[:, 0], b[:, 1]]) for a, b in ((first, last), (last, first))]
    corners = np.concatenate([first, last, *crossed])
    return corners, np.prod(last - first, axis=1), m


RuledOrder = tuple[list[RigidObject], Rule]
"""An order of objects, and the rule by which they are placed."""


def drawn_orders(
    items: Sequence[RigidObject], count: int, rng: np.random.Generator, best: Callable[[], RuledOrder | None]
) -> Iterator[RuledOrder]:
    """Orders of objects, and rules: the usual ones first, then random ones near these, then changes of the best.

    Args:
        items: to be ordered.
        count: of orders.
        rng: for what is random.
        best: the draw with the lowest load so far, and None without one.
    """
    sides = np.array([np.sort(np.ptp(item.shape.polyhedron.vertices, axis=0)) for item in items])
    volume, least, face, longest = sides.prod(axis=1), sides[:, 0], sides[:, 1] * sides[:, 2], sides[:, 2]
    lowest = Rule(1.0, 0.5)
    usual = [
        (volume, DEEPEST),
        (volume, Rule(0.0, 1.0)),
        (volume, lowest),
        (least, lowest),
        (face, lowest),
        (longest, lowest),
    ]
    for number in range(count):
        known = best()
        if number < len(usual):
            keys, rule = usual[number]
        elif known is not None and number >= (1 - _CHANGES) * count:
            yield _changed(*known, rng)
            continue
        else:
            keys = usual[int(rng.integers(len(usual)))][0] * np.exp(rng.normal(0.0, _SPREAD, len(items)))
            rule = _drawn_rule(rng)
        yield [items[k] for k in np.argsort(-keys, kind="stable")], rule


def _changed(order: Sequence[RigidObject], rule: Rule, rng: np.random.Generator) -> RuledOrder:
    """An order in which one or two objects have moved; sometimes another rule instead."""
    if rng.random() < _OTHER_RULE:
        return list(order), _drawn_rule(rng)
    changed = list(order)
    for _ in range(int(rng.integers(1, 3))):
        item = changed.pop(int(rng.integers(len(changed))))
        changed.insert(int(rng.integers(len(changed) + 1)), item)
    return changed, rule


def _drawn_rule(rng: np.random.Generator) -> Rule:
    bottom, gaps = float(rng.choice(_BOTTOM)), float(rng.choice(_GAPS))
    return Rule(1.0, bottom, 10 ** rng.uniform(-3, -1), gaps)
