"""Hierarchical tetrahedral clustering: merge what is most convex together (Attene 2008; thesis eq. 3.27).

Three things keep two clusters apart: how much hollow their merging adds to the hollow that each has already (Attene
asks for the hollow of the whole, so that a part that is not convex can never grow), the step of colour between
them, which likely is a step of density, and how far the surface folds inwards along their border (the minima rule).
"""

import heapq
from dataclasses import dataclass

import numpy as np

from poise.kernels import COMPILED, merged_clusters
from poise.shape.hulls import TRIANGLES, Hulls
from poise.shape.lighting import colour_noise, colour_steps
from poise.shape.solid import Solid
from poise.shape.surface_graph import SurfaceGraph
from poise.types import Array, Indices

_FEWEST_EDGES = 2
"""A border of fewer edges says little about a fold."""
_HASTE = 1e-3
"""Factor of the cost for what is too small to be a part."""
_FOLDED = 0.3
"""Mean fold along a border from which on it folds inwards, as where two parts meet; walls of a cup fold in and out."""
_ONE_COLOUR = 0.1
"""Distance of colours below which they are one."""
_MOST_COMPILED = 1000
"""Leaves whose pairs have a table each."""


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
        smooth: factor for the hollow that merging adds, where the colour is one and the border does not fold inwards.
        least: share of the volume below which a cluster is no part, and merges with the likest beside it.
    """

    colour: float = 40.0
    fold: float = 15.0
    hollow: float = 0.04
    size: float = 1e-3
    least: float = 0.01
    shading: float = 0.0
    one_colour: float = 1.0
    smooth: float = 0.35


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


class _Clusters:
    """Clusters that are left, their borders, and their cost of merging.

    What is known of each is in rows of arrays: its hull, its volume and that of its hull, and its points, as shares of
    the object; its mean colour.
    """

    def __init__(
        self,
        solid: Solid,
        leaves: Indices,
        point_leaves: Indices,
        colours: Array,
        noise: float,
        costs: MergeCosts,
    ) -> None:
        self.costs, self._noise = costs, noise / np.sqrt(len(point_leaves))
        self._total = solid.volume
        count = int(leaves.max()) + 1
        most = 2 * count - 1
        self._volume, self._hull, self._weight = (np.zeros(most) for _ in range(3))
        self._colour = np.zeros((most, 3))
        around = solid.vertices - solid.vertices.mean(axis=0)
        first = Hulls.of_clusters(around, solid.tetrahedra, leaves, count)
        self._hulls = Hulls(*(np.concatenate([part, np.zeros((count - 1, *part.shape[1:]))]) for part in first))
        self._volume[:count] = np.bincount(leaves, solid.volumes, minlength=count) / self._total
        self._hull[:count] = np.maximum(first.volumes / self._total, self._volume[:count])
        sizes = np.bincount(point_leaves, minlength=count)
        sums = [np.bincount(point_leaves, colours[:, channel], count) for channel in range(3)]
        self._colour[:count] = np.stack(sums, axis=1) / np.maximum(sizes, 1)[:, None]
        self._weight[:count] = np.maximum(sizes, 1) / len(point_leaves)
        self.touching: dict[int, set[int]] = {leaf: set() for leaf in range(count)}
        self.next = count
        self._folds: dict[tuple[int, int], tuple[float, float]] = {}  # sum and number of edges across each border

    def meet(self, i: int, j: int) -> None:
        self.touching[i].add(j)
        self.touching[j].add(i)

    def add_folds(self, i: int, j: int, folds: float, edges: float) -> None:
        self._folds[i, j] = folds, edges

    def merged_compiled(self, pairs: Indices, borders: tuple[Indices, Array, Array]) -> list[Merge]:
        """As `_merge_all`."""
        known = {"reach": self._hulls.reach, "points": self._hulls.points, "volume": self._volume}
        known |= {"hull": self._hull, "shade": self._colour, "weight": self._weight}
        numbers = {"noise": self._noise, "total": self._total, "folded": _FOLDED, "alike": _ONE_COLOUR}
        numbers |= {"haste": _HASTE, "few": _FEWEST_EDGES, **vars(self.costs)}
        rows, costs = merged_clusters(pairs, borders, TRIANGLES, known, numbers)
        steps = zip(rows.tolist(), costs.tolist(), strict=True)
        return [Merge(i, j, self.next + step, cost) for step, ((i, j), cost) in enumerate(steps)]

    def merging(self, i: Indices, j: Indices) -> tuple[Array, Array]:
        """(K,) what merging clusters i and j (K,) costs: what lies between them, and the hollow (eq. 3.27); the hulls.

        Hulls (K,) are shares of the object's volume.
        """
        border, step, fold = self._border(i, j)
        volume = self._volume[i] + self._volume[j]
        hull = np.maximum(self._joined(i, j).volumes / self._total, volume)
        added = np.maximum(hull - self._hull[i] - self._hull[j], 0.0)
        alike = step < _ONE_COLOUR
        added *= np.where(alike, np.clip(fold / _FOLDED, self.costs.smooth, 1.0), 1.0)
        shape = added + self.costs.hollow * (hull - volume) + self.costs.size * volume**2
        small = np.minimum(self._volume[i], self._volume[j]) < self.costs.least
        # What is too small to be a part, or of the same colour, merges before others do.
        haste = np.where(small, _HASTE, np.where(alike, self.costs.one_colour, 1.0))
        return haste * (border + shape), hull

    def _border(self, i: Indices, j: Indices) -> tuple[Array, Array, Array]:
        """(K,) what colour and fold ask, (K,) distances of colours, and (K,) mean folds, positive inwards."""
        keys = zip(np.minimum(i, j).tolist(), np.maximum(i, j).tolist(), strict=True)
        fold, edges = np.array([self._folds.get(key, (0.0, 0)) for key in keys]).reshape(-1, 2).T
        size = self._weight[i] * self._weight[j] / (self._weight[i] + self._weight[j])
        step = colour_steps(self._colour[i], self._colour[j], self.costs.shading)
        by_chance = 3 * self._noise**2 / size  # what noise in three channels adds to the square, in the mean
        step = np.sqrt(np.maximum(step**2 - by_chance, 0.0))
        fold = fold / (edges + _FEWEST_EDGES)
        asked = self.costs.colour * step + self.costs.fold * np.maximum(fold, 0.0)
        return size * asked, step, fold

    def _joined(self, i: Indices, j: Indices) -> Hulls:
        return Hulls(*(part[i] for part in self._hulls)).with_each(Hulls(*(part[j] for part in self._hulls)))

    def merge(self, i: int, j: int, hull: float) -> int:
        """Put a cluster, whose hull is known, in the place of two; gives its number."""
        parent, self.next = self.next, self.next + 1
        joined = self._joined(np.array([i]), np.array([j]))
        for part, row in zip(self._hulls, joined, strict=True):
            part[parent] = row[0]
        self._volume[parent] = self._volume[i] + self._volume[j]
        self._hull[parent] = hull
        self._weight[parent] = self._weight[i] + self._weight[j]
        shades = self._colour[i] * self._weight[i] + self._colour[j] * self._weight[j]
        self._colour[parent] = shades / self._weight[parent]
        self.touching[parent] = (self.touching.pop(i) | self.touching.pop(j)) - {i, j}
        for k in self.touching[parent]:
            fold, edges = 0.0, 0.0
            for child in (i, j):
                self.touching[k].discard(child)
                more, count = self._folds.pop((min(child, k), max(child, k)), (0.0, 0.0))
                fold, edges = fold + more, edges + count
            self._folds[k, parent] = fold, edges
            self.touching[k].add(parent)
        return parent


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
    clusters = _Clusters(solid, leaves, point_leaves, colours, colour_noise(colours, graph.edges), costs)
    n_leaves = clusters.next
    pairs, borders = _touching(solid, leaves, n_leaves), _folds(graph, point_leaves, n_leaves)
    compiled = COMPILED and n_leaves <= _MOST_COMPILED
    merges = clusters.merged_compiled(pairs, borders) if compiled else _merge_all(clusters, pairs, borders)
    return Hierarchy(n_leaves, tuple(merges))


def _touching(solid: Solid, leaves: Indices, count: int) -> Indices:
    """(K, 2) leaves that share a face, the lower first."""
    owner, behind = np.repeat(np.arange(len(leaves)), 4), solid.neighbours.ravel()
    i, j = leaves[owner[behind >= 0]], leaves[behind[behind >= 0]]
    shared = np.zeros(count * count, bool)
    shared[(i * count + j)[i < j]] = True
    return np.stack(np.divmod(np.flatnonzero(shared), count), axis=1)


def _folds(graph: SurfaceGraph, point_leaves: Indices, count: int) -> tuple[Indices, Array, Array]:
    """(B, 2) leaves with edges of the surface between them, (B,) sums of their folds, and (B,) how many there are."""
    i, j = point_leaves[graph.edges].T
    across = i != j
    border = np.minimum(i, j)[across] * count + np.maximum(i, j)[across]
    present, which = np.unique(border, return_inverse=True)
    sums, edges = np.bincount(which, graph.creases[across]), np.bincount(which).astype(np.float64)
    return np.stack(np.divmod(present, count), axis=1), sums.astype(np.float64), edges


def _merge_all(clusters: _Clusters, pairs: Indices, borders: tuple[Indices, Array, Array]) -> list[Merge]:
    """The cheapest pair that is left, again and again; arguments as of `_touching` and `_folds`."""
    for i, j in pairs.tolist():
        clusters.meet(i, j)
    for (i, j), *folds in zip(borders[0].tolist(), *(each.tolist() for each in borders[1:]), strict=True):
        clusters.add_folds(i, j, *folds)
    queue: list[tuple[float, int, int, float]] = []

    def consider(pairs: list[tuple[int, int]]) -> None:
        if pairs:
            i, j = np.array(pairs).T
            costs, hulls = clusters.merging(i, j)
            for one in zip(costs.tolist(), i.tolist(), j.tolist(), hulls.tolist(), strict=True):
                heapq.heappush(queue, one)

    consider([(i, j) for i, others in clusters.touching.items() for j in sorted(others) if i < j])
    merges = []
    while queue:
        cost, i, j, hull = heapq.heappop(queue)
        if i in clusters.touching and j in clusters.touching:
            parent = clusters.merge(i, j, hull)
            merges.append(Merge(i, j, parent, cost))
            consider([(k, parent) for k in sorted(clusters.touching[parent])])
    return merges
