"""Hierarchical tetrahedral clustering: merge what is most convex together (Attene 2008; thesis eq. 3.27).

Three things keep two clusters apart: how much hollow their merging adds to the hollow that each has already (Attene
asks for the hollow of the whole, so that a part that is not convex can never grow), the step of colour between
them, which likely is a step of density, and how far the surface folds inwards along their border (the minima rule).
"""

import heapq
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from poise.shape.lighting import colour_steps
from poise.shape.solid import Solid
from poise.shape.surface_graph import SurfaceGraph
from poise.types import Array, Indices

_FEWEST_EDGES = 2
"""A border of fewer edges says little about a fold."""
_HASTE = 1e-3
"""Factor of the cost for what is too small to be a part."""
_ONE_COLOUR = 0.1
"""Distance of colours below which they are one."""


def _half_sphere(count: int) -> Array:
    """(count, 3) unit vectors, evenly spread on half a sphere."""
    step = np.arange(count) + 0.5
    down, around = np.arccos(1 - step / count), np.pi * (1 + 5**0.5) * step
    return np.stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), np.cos(down)], axis=1)


_DIRECTIONS = _half_sphere(50)
"""Of a hull with many corners, only those that are the outermost in one of these directions are kept: half the time."""


@dataclass(frozen=True)
class MergeCosts:
    """What keeps clusters apart, in shares of the object's volume.

    Args:
        colour: per unit of colour (0..1 in three channels) between two halves of all points; less for small clusters.
        fold: the same per unit of fold along their border (see `SurfaceGraph.creases`).
        hollow: for all the hollow of the merged cluster, as a share of it; what merging adds counts in full.
        size: for the square of the merged volume; small pairs merge first.
        shading: share by which lightness may differ for nothing, because lighting is not known exactly.
        one_colour: factor for clusters of one colour.
        least: share of the volume below which a cluster is no part, and merges with the likest beside it.
    """

    colour: float = 40.0
    fold: float = 6.0
    hollow: float = 0.04
    size: float = 1e-3
    least: float = 0.01
    shading: float = 0.0
    one_colour: float = 1.0


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

    def steps_to(self, parts: int) -> int:
        """How many merges leave a number of parts, or as near to it as there are clusters and pieces."""
        return int(np.clip(self.n_leaves - parts, 0, len(self.merges)))

    def steps_below(self, limit: float) -> int:
        """How many merges come before the first that costs more."""
        return next((step for step, merge in enumerate(self.merges) if merge.cost > limit), len(self.merges))


@dataclass(frozen=True, eq=False)
class _Cluster:
    """Hull corners; volume and hull's volume, and points, as shares of the object; mean colour."""

    corners: Array
    volume: float
    hull: float
    weight: float
    colour: Array


class _Clusters:
    """Clusters that are left, their borders, and their cost of merging."""

    def __init__(self, solid: Solid, leaves: Indices, point_leaves: Indices, colours: Array, costs: MergeCosts) -> None:
        self.costs = costs
        self._total = solid.volume
        count = int(leaves.max()) + 1
        volumes = np.bincount(leaves, solid.volumes, minlength=count) / self._total
        sizes = np.bincount(point_leaves, minlength=count)
        sums = [np.bincount(point_leaves, colours[:, channel], count) for channel in range(3)]
        means = np.stack(sums, axis=1) / np.maximum(sizes, 1)[:, None]
        self.items: dict[int, _Cluster] = {}
        for leaf in range(count):
            corners, hull = self._hull(solid.vertices[np.unique(solid.tetrahedra[leaves == leaf])], volumes[leaf])
            weight = max(int(sizes[leaf]), 1) / len(point_leaves)
            self.items[leaf] = _Cluster(corners, float(volumes[leaf]), hull, weight, means[leaf])
        self.touching: dict[int, set[int]] = {leaf: set() for leaf in range(count)}
        self.next = count
        self._folds: dict[tuple[int, int], tuple[float, int]] = {}  # sum and number of edges across each border

    def meet(self, i: int, j: int) -> None:
        self.touching[i].add(j)
        self.touching[j].add(i)

    def add_fold(self, i: int, j: int, fold: float, edges: int) -> None:
        key = (min(i, j), max(i, j))
        total, count = self._folds.get(key, (0.0, 0))
        self._folds[key] = (total + fold, count + edges)

    def border_cost(self, i: int, j: int) -> float:
        """What colour and fold alone ask; no hull is needed."""
        one, other = self.items[i], self.items[j]
        fold, edges = self._folds.get((min(i, j), max(i, j)), (0.0, 0))
        size = one.weight * other.weight / (one.weight + other.weight)
        step = self._step(one, other)
        return size * (self.costs.colour * step + self.costs.fold * max(0.0, fold / (edges + _FEWEST_EDGES)))

    def haste(self, i: int, j: int) -> float:
        """Factor by which a cluster that is too small to be a part, or of the same colour, merges before others do."""
        one, other = self.items[i], self.items[j]
        if min(one.volume, other.volume) < self.costs.least:
            return _HASTE
        alike = self.costs.one_colour < 1 and self._step(one, other) < _ONE_COLOUR
        return self.costs.one_colour if alike else 1.0

    def _step(self, one: _Cluster, other: _Cluster) -> float:
        return float(colour_steps(one.colour, other.colour, self.costs.shading))

    def together(self, i: int, j: int) -> tuple[float, _Cluster]:
        """What the shape of a merge costs (eq. 3.27), and the merged cluster: its hull is that of the two hulls."""
        one, other = self.items[i], self.items[j]
        volume = one.volume + other.volume
        corners, hull = self._hull(np.concatenate([one.corners, other.corners]), volume)
        weight = one.weight + other.weight
        colour = (one.colour * one.weight + other.colour * other.weight) / weight
        added = max(0.0, hull - one.hull - other.hull)
        cost = added + self.costs.hollow * (hull - volume) + self.costs.size * volume**2
        return cost, _Cluster(corners, volume, hull, weight, colour)

    def merge(self, i: int, j: int, merged: _Cluster) -> int:
        """Put a cluster in the place of two; gives its number."""
        parent, self.next = self.next, self.next + 1
        del self.items[i], self.items[j]
        self.items[parent] = merged
        self.touching[parent] = (self.touching.pop(i) | self.touching.pop(j)) - {i, j}
        for k in self.touching[parent]:
            for child in (i, j):
                self.touching[k].discard(child)
                self.add_fold(k, parent, *self._folds.pop((min(child, k), max(child, k)), (0.0, 0)))
            self.touching[k].add(parent)
        return parent

    def _hull(self, points: Array, least: float) -> tuple[Array, float]:
        """Corners of the convex hull, and its share of the object; flat sets count as what they fill."""
        if len(points) > 2 * len(_DIRECTIONS):
            along = points @ _DIRECTIONS.T
            points = points[np.unique(np.concatenate([along.argmin(axis=0), along.argmax(axis=0)]))]
        try:
            hull = ConvexHull(points)
        except (QhullError, ValueError):
            return points, float(least)
        return points[hull.vertices], max(float(hull.volume) / self._total, float(least))


def build_hierarchy(
    solid: Solid,
    leaves: Indices,
    point_leaves: Indices,
    colours: Array,
    graph: SurfaceGraph,
    costs: MergeCosts,
) -> Hierarchy:
    """Merge clusters of tetrahedra, the most convex and most alike first, until nothing touches.

    Args:
        solid: T tetrahedra.
        leaves: (T,) initial cluster of each, 0..L-1, none empty.
        point_leaves: (V,) the same for each vertex.
        colours: (V, 3) 0..1.
        graph: of the surface.
        costs: what keeps clusters apart.
    """
    clusters = _Clusters(solid, leaves, point_leaves, colours, costs)
    n_leaves = clusters.next
    owner, behind = np.repeat(np.arange(len(leaves)), 4), solid.neighbours.ravel()
    faces = np.stack([leaves[owner[behind >= 0]], leaves[behind[behind >= 0]]], axis=1)
    for i, j in np.unique(faces[faces[:, 0] < faces[:, 1]], axis=0).tolist():
        clusters.meet(i, j)
    ends = point_leaves[graph.edges]
    across = ends[:, 0] != ends[:, 1]
    for (i, j), fold in zip(ends[across].tolist(), graph.creases[across].tolist(), strict=True):
        clusters.add_fold(i, j, fold, 1)
    return Hierarchy(n_leaves, tuple(_merge_all(clusters)))


def _merge_all(clusters: _Clusters) -> list[Merge]:
    """Hulls are the work: a pair's is made only when what its border asks is the least of all."""
    queue: list[tuple[float, int, int]] = []
    known: dict[tuple[int, int], _Cluster] = {}

    def consider(i: int, j: int) -> None:
        cost = clusters.border_cost(i, j) * clusters.haste(i, j)
        heapq.heappush(queue, (cost, min(i, j), max(i, j)))

    for i, others in clusters.touching.items():
        for j in sorted(others):
            if i < j:
                consider(i, j)
    merges = []
    while queue:
        cost, i, j = heapq.heappop(queue)
        if i not in clusters.items or j not in clusters.items:
            continue
        if (i, j) not in known:
            more, known[i, j] = clusters.together(i, j)
            heapq.heappush(queue, (cost + more * clusters.haste(i, j), i, j))
            continue
        parent = clusters.merge(i, j, known.pop((i, j)))
        merges.append(Merge(i, j, parent, cost))
        for k in sorted(clusters.touching[parent]):
            consider(k, parent)
    return merges
