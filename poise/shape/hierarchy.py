"""Hierarchical tetrahedral clustering: merge what is most convex together (Attene 2008; thesis eq. 3.27)."""

import heapq
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from poise.shape.solid import Array, Indices, Solid

TIE = 1e-3


@dataclass(frozen=True)
class Merge:
    """One step: clusters `left` and `right` become `parent`, at a cost in shares of the object's volume."""

    left: int
    right: int
    parent: int
    cost: float


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """All merges of the leaves 0..L-1, in order; parents are numbered from L on.

    Args:
        n_leaves: L.
        merges: at most L - 1; fewer when the solid is in several pieces.
    """

    n_leaves: int
    merges: tuple[Merge, ...]

    def labels(self, steps: int) -> Indices:
        """(L,) part of each leaf after the first `steps` merges, numbered from 0 by the leaves' order."""
        member = np.arange(self.n_leaves)
        for merge in self.merges[:steps]:
            member[(member == merge.left) | (member == merge.right)] = merge.parent
        return np.unique(member, return_inverse=True)[1]

    def steps_below(self, limit: float) -> int:
        """How many merges come before the first that costs more."""
        return next((step for step, merge in enumerate(self.merges) if merge.cost > limit), len(self.merges))


@dataclass
class _Cluster:
    hull_points: Array
    volume: float
    colour: Array
    weight: float


class _Clusters:
    """Clusters that are left, and their cost of merging. A hull is made of its two hulls' corners only."""

    def __init__(self, solid: Solid, leaves: Indices, colours: Array, colour_cost: float) -> None:
        self._total = solid.volume
        self._colour_cost = colour_cost
        count = int(leaves.max()) + 1
        volumes = np.bincount(leaves, solid.volumes, minlength=count)
        self.items: dict[int, _Cluster] = {}
        for leaf in range(count):
            corners = solid.vertices[np.unique(solid.tetrahedra[leaves == leaf])]
            self.items[leaf] = _Cluster(_hull(corners)[0], float(volumes[leaf]), colours[leaf], float(volumes[leaf]))
        self.next = count

    def together(self, i: int, j: int) -> tuple[float, Array]:
        """Cost of a merge, and the corners of the common hull."""
        one, other = self.items[i], self.items[j]
        points, hull_volume = _hull(np.concatenate([one.hull_points, other.hull_points]))
        volume = one.volume + other.volume
        hollow = max(0.0, hull_volume - volume)
        step = float(np.linalg.norm(one.colour - other.colour))
        # Eq. (3.27) with volumes in place of counts: tetrahedra differ in size, and convex pairs come smallest first.
        cost = hollow / self._total + self._colour_cost * step
        tie = (one.volume**2 + other.volume**2) / self._total**2
        return cost + TIE * tie, points

    def merge(self, i: int, j: int, points: Array) -> int:
        one, other = self.items.pop(i), self.items.pop(j)
        weight = one.weight + other.weight
        colour = (one.colour * one.weight + other.colour * other.weight) / weight
        self.items[self.next] = _Cluster(points, one.volume + other.volume, colour, weight)
        self.next += 1
        return self.next - 1


def build_hierarchy(solid: Solid, leaves: Indices, colours: Array, colour_cost: float) -> Hierarchy:
    """Merge clusters of tetrahedra, the most convex and most alike first, until nothing touches.

    Args:
        solid: T tetrahedra.
        leaves: (T,) initial cluster of each, 0..L-1, none empty.
        colours: (L, 3) mean colour of each cluster, 0..1; a step of colour likely is a step of density.
        colour_cost: what a unit of colour counts, in shares of the object's volume.
    """
    clusters = _Clusters(solid, leaves, colours, colour_cost)
    n_leaves = clusters.next
    touching: dict[int, set[int]] = {leaf: set() for leaf in range(n_leaves)}
    owner = np.repeat(np.arange(len(leaves)), 4)
    behind = solid.neighbours.ravel()
    for i, j in np.unique(np.column_stack([leaves[owner[behind >= 0]], leaves[behind[behind >= 0]]]), axis=0).tolist():
        if i != j:
            touching[i].add(j)
            touching[j].add(i)
    queue: list[tuple[float, int, int]] = []
    known: dict[tuple[int, int], tuple[float, Array]] = {}

    def consider(i: int, j: int) -> None:
        known[i, j] = clusters.together(i, j)
        heapq.heappush(queue, (known[i, j][0], i, j))

    for i in range(n_leaves):
        for j in sorted(touching[i]):
            if i < j:
                consider(i, j)
    merges = []
    while queue:
        _, i, j = heapq.heappop(queue)
        if i not in clusters.items or j not in clusters.items:
            continue
        cost, points = known.pop((i, j))
        parent = clusters.merge(i, j, points)
        merges.append(Merge(i, j, parent, cost))
        touching[parent] = (touching.pop(i) | touching.pop(j)) - {i, j}
        for k in sorted(touching[parent]):
            touching[k] = (touching[k] - {i, j}) | {parent}
            consider(k, parent)
    return Hierarchy(n_leaves, tuple(merges))


def _hull(points: Array) -> tuple[Array, float]:
    """Corners and volume of the convex hull; flat sets have none."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return points, 0.0
    return points[hull.vertices], float(hull.volume)
