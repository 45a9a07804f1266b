"""Ways through joint space: RRT-Connect (Kuffner and LaValle 2000), and short cuts."""

import time
from collections.abc import Callable

import numpy as np

from poise.types import Array

_REACH = 0.4
"""rad of one extension."""
_NODES = 4000
_SHORT_CUTS = 60

Free = Callable[[Array, Array], bool]
"""Whether the straight way from one configuration to another is free, its end included."""


class _Tree:
    """Configurations, each with the one it was reached from."""

    def __init__(self, root: Array) -> None:
        self._nodes = np.empty((64, len(root)))
        self._nodes[0] = root
        self._parents = [-1]

    def __len__(self) -> int:
        return len(self._parents)

    def node(self, number: int) -> Array:
        return np.asarray(self._nodes[number])

    def nearest(self, q: Array) -> int:
        return int(np.square(self._nodes[: len(self)] - q).sum(axis=1).argmin())

    def add(self, q: Array, parent: int) -> int:
        if len(self) == len(self._nodes):
            self._nodes = np.concatenate([self._nodes, np.empty_like(self._nodes)])
        self._nodes[len(self)] = q
        self._parents.append(parent)
        return len(self) - 1

    def way(self, number: int) -> list[Array]:
        """From a node to the root."""
        way = []
        while number >= 0:
            way.append(self._nodes[number].copy())
            number = self._parents[number]
        return way

    def extend(self, q: Array, free: Free) -> tuple[int, bool]:
        """One step towards a configuration: the new node (-1 when it is not free), and whether it is there."""
        near = self.nearest(q)
        run = q - self.node(near)
        length = float(np.abs(run).max())
        there = length <= _REACH
        new = q if there else self.node(near) + run * (_REACH / length)
        return (self.add(new, near), there) if free(self.node(near), new) else (-1, False)

    def connect(self, q: Array, free: Free) -> tuple[int, bool]:
        """As many steps towards a configuration as are free."""
        while True:
            number, there = self.extend(q, free)
            if number < 0 or there:
                return number, there


def find_way(
    start: Array,
    goal: Array,
    free: Free,
    bounds: tuple[Array, Array],
    rng: np.random.Generator,
    deadline: float,
    nodes: int = _NODES,
) -> Array | None:
    """(N, J) configurations from start to goal, straight between each other; None when none was found in time.

    Args:
        start, goal: (J,), both free.
        free: see `Free`.
        bounds: (J,) least and greatest position.
        rng: chooses; the same seed finds the same way, unless the deadline comes first.
        deadline: moment of the monotonic clock, s.
        nodes: of both trees at most.
    """
    if free(start, goal):
        return np.stack([start, goal])
    here, there, turned = _Tree(start), _Tree(goal), False
    while len(here) + len(there) < nodes and time.monotonic() < deadline:
        number, _ = here.extend(rng.uniform(*bounds), free)
        if number >= 0:
            met, reached = there.connect(here.node(number), free)
            if reached:
                way = here.way(number)[::-1] + there.way(met)[1:]
                return np.array(way[::-1] if turned else way)
        here, there, turned = there, here, not turned
    return None


def shortened(way: Array, free: Free, rng: np.random.Generator, deadline: float) -> Array:
    """(N, J) the same way with random short cuts between points of it (Geraerts and Overmars 2007)."""
    points = list(way)
    for _ in range(_SHORT_CUTS):
        if len(points) < 3 or time.monotonic() > deadline:
            break
        lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        first, second = np.sort(rng.uniform(0, lengths[-1], 2))
        i, j = (int(np.searchsorted(lengths, at, side="right")) - 1 for at in (first, second))
        j = min(j, len(points) - 2)
        if i >= j:
            continue
        ends = [
            points[k] + (points[k + 1] - points[k]) * (at - lengths[k]) / max(lengths[k + 1] - lengths[k], 1e-12)
            for k, at in ((i, first), (j, second))
        ]
        if free(ends[0], ends[1]):
            points = [*points[: i + 1], *ends, *points[j + 1 :]]
    return np.array(points)
