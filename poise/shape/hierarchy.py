"""Hierarchical tetrahedral clustering: merge what likely is one part first (Attene 2008; thesis section 3.2.1).

Whether a border lies between two parts is a question of odds. They depend on the share of the border along which the
surface folds inwards (the minima rule), and of that along which only a sheet does (see `sheets`), the step of colour,
how much larger the ellipsoid of inertia of both is than those of each (where Attene compares convex hulls), the ratio
of their thicknesses, and their sizes. The log odds are a sum of these; its weights are those of a logistic regression
on borders of random objects (see `MergeCosts`). A merge costs -log(1 - p), where p is the probability that it is wrong,
times the share of the surface that would then be in the wrong part.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poise.kernels import COMPILED, merged_clusters
from poise.shape.grouping import linked
from poise.shape.lighting import colour_noise, colour_steps
from poise.shape.sheets import sheet_folds
from poise.shape.solid import Solid
from poise.shape.surface_graph import INWARDS, SurfaceGraph
from poise.types import Array, Indices, Mask

_FEWEST_EDGES = 2
"""A border of fewer edges says little about a fold."""
_HASTE = 1e-3
"""Factor of the cost for what is too small to be a part."""
_ONE_COLOUR = 0.1
"""Distance of colours below which they are one."""
_THICKEST = 1.5
"""Log of the ratio of thicknesses above which more says nothing."""
_SMALLEST, _FLATTEST = 1e-6, 1e-24
"""Shares of the object's volume, and squares of volumes of ellipsoids, below which they are rounding errors."""
_MOST_COMPILED = 1000
"""Leaves whose pairs have a table each."""


@dataclass(frozen=True)
class MergeCosts:
    """Log odds that a border lies between two parts, as a sum; and what else keeps clusters apart.

    The first seven are a logistic regression on 1,470,000 pairs that might be merged, weighted by the surface that
    would be in the wrong part: of the random objects with seeds 100 to 259 and 300 to 371, with and without colours,
    with a noise of 0.3 and 1 mm, and of 60 boxes. The workshop tools had no part in it. The weight of folds is from
    another one with hollow things, since random objects have few sheets (see docs/segment_results.md).

    Args:
        constant: without any other.
        concave: for the share of the border's edges that fold inwards.
        colour: per unit of colour (0..1 in three channels).
        spread: for the log of the volume of both's ellipsoid of inertia over the sum of each one's.
        thickness: for the log of the ratio of volume per surface of one to that of the other.
        smaller: for the log of the smaller one's share of the volume.
        both: for the log of the share of both.
        fold: for the share of the border's edges across which a sheet folds (see `sheets`).
        blur: standard deviation, in edges of a cube of the object's volume, that the ellipsoids have more along each
            axis: that of a flat wall is so small that a second one at its side makes it many times as large.
        shading: share by which lightness may differ for nothing, because lighting is not known exactly.
        one_colour: factor of the cost for clusters of one colour.
        least: share of the volume below which a cluster is no part, and merges with the likest beside it.
    """

    constant: float = -3.56
    concave: float = 5.6
    colour: float = 7.2
    spread: float = 3.0
    thickness: float = 0.87
    smaller: float = -0.28
    both: float = 0.48
    fold: float = -10.0
    blur: float = 0.0
    shading: float = 0.0
    one_colour: float = 1.0
    least: float = 0.01

    @property
    def weights(self) -> Array:
        """(6,) of the terms of the log odds: concave, colour, spread, thickness, smaller, both."""
        return np.array([self.concave, self.colour, self.spread, self.thickness, self.smaller, self.both])


@dataclass(frozen=True)
class Merge:
    """One step: clusters `left` and `right` become `parent`, at a cost in nats times a share of the surface."""

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

    What is known of each is in rows of arrays: its share of the volume and of the points, its surface, its mean colour,
    and the moments of its volume: 1, x, y, z, xx, yy, zz, xy, xz, yz, in shares and in lengths of the object.
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
        self.considered: list[tuple[Array, Array]] | None = None
        self.costs, self._noise = costs, noise / np.sqrt(len(point_leaves))
        count = int(leaves.max()) + 1
        most = 2 * count - 1
        self._volume, self._area, self._weight = (np.zeros(most) for _ in range(3))
        self._colour, self._moment = np.zeros((most, 3)), np.zeros((most, 10))
        self._moment[:count] = _moments(solid, leaves, count)
        self._moment[:count, 4:7] += costs.blur**2 * self._moment[:count, :1]
        self._volume[:count] = np.maximum(self._moment[:count, 0], _SMALLEST**2)
        facing = np.bincount(leaves[solid.surface[1]], solid.areas, minlength=count) / solid.areas.sum()
        self._area[:count] = np.maximum(facing, _SMALLEST)
        sizes = np.bincount(point_leaves, minlength=count)
        sums = [np.bincount(point_leaves, colours[:, channel], count) for channel in range(3)]
        self._colour[:count] = np.stack(sums, axis=1) / np.maximum(sizes, 1)[:, None]
        self._weight[:count] = np.maximum(sizes, 1) / len(point_leaves)
        self.touching: dict[int, set[int]] = {leaf: set() for leaf in range(count)}
        self.next = count
        self._edges: dict[tuple[int, int], tuple[float, float]] = {}  # folded inwards, and all, along each border

    def meet(self, i: int, j: int) -> None:
        self.touching[i].add(j)
        self.touching[j].add(i)

    def add_border(self, i: int, j: int, inwards: float, edges: float) -> None:
        self._edges[i, j] = inwards, edges

    def merged_compiled(self, pairs: Indices, borders: tuple[Indices, Array, Array]) -> list[Merge]:
        """As `_merge_all`."""
        known: dict[str, Array] = {"volume": self._volume, "area": self._area, "weight": self._weight}
        known |= {"shade": self._colour, "moment": self._moment}
        numbers = {"noise": self._noise, "alike": _ONE_COLOUR, "haste": _HASTE, "few": _FEWEST_EDGES}
        numbers |= {"thickest": _THICKEST, "smallest": _SMALLEST, "flattest": _FLATTEST, **vars(self.costs)}
        rows, costs = merged_clusters(pairs, borders, known, numbers)
        steps = zip(rows.tolist(), costs.tolist(), strict=True)
        return [Merge(i, j, self.next + step, cost) for step, ((i, j), cost) in enumerate(steps)]

    def merging(self, i: Indices, j: Indices) -> Array:
        """(K,) what merging clusters i and j (K,) costs."""
        costs, terms = self.costs, self.terms(i, j)
        odds = costs.constant + terms @ costs.weights
        # What is too small to be a part, or of the same colour, merges before others do.
        alike = np.where(terms[:, 1] < _ONE_COLOUR, costs.one_colour, 1.0)
        haste = np.where(np.minimum(self._volume[i], self._volume[j]) < costs.least, _HASTE, alike)
        return np.asarray(haste * np.minimum(self._weight[i], self._weight[j]) * np.logaddexp(0.0, odds))

    def terms(self, i: Indices, j: Indices) -> Array:
        """(K, 6) terms of the log odds that i and j (K,) are of two parts; see `MergeCosts.weights`."""
        joined = _extents(self._moment[i] + self._moment[j])
        grown = np.log(joined / (_extents(self._moment[i]) + _extents(self._moment[j])))
        thick = self._volume[i] * self._area[j] / (self._volume[j] * self._area[i])
        smaller = np.maximum(np.minimum(self._volume[i], self._volume[j]), _SMALLEST)
        columns = [
            self._inwards(i, j),
            self._steps(i, j),
            grown,
            np.minimum(np.abs(np.log(thick)), _THICKEST),
            np.log(smaller),
            np.log(self._volume[i] + self._volume[j]),
        ]
        found = np.stack(columns, axis=1)
        if self.considered is not None:
            self.considered.append((np.stack([i, j], axis=1), found))
        return found

    def _steps(self, i: Indices, j: Indices) -> Array:
        """(K,) distances of colours, less what noise adds."""
        size = self._weight[i] * self._weight[j] / (self._weight[i] + self._weight[j])
        step = colour_steps(self._colour[i], self._colour[j], self.costs.shading)
        by_chance = 3 * self._noise**2 / size  # what noise in three channels adds to the square, in the mean
        return np.asarray(np.sqrt(np.maximum(step**2 - by_chance, 0.0)))

    def _inwards(self, i: Indices, j: Indices) -> Array:
        """(K,) shares of the borders' edges that fold inwards."""
        keys = zip(np.minimum(i, j).tolist(), np.maximum(i, j).tolist(), strict=True)
        inwards, edges = np.array([self._edges.get(key, (0.0, 0.0)) for key in keys]).reshape(-1, 2).T
        return np.asarray(inwards / (edges + _FEWEST_EDGES))

    def merge(self, i: int, j: int) -> int:
        """The cluster that takes the place of two."""
        parent, self.next = self.next, self.next + 1
        shades = self._colour[i] * self._weight[i] + self._colour[j] * self._weight[j]
        for known in (self._volume, self._area, self._weight, self._moment):
            known[parent] = known[i] + known[j]
        self._colour[parent] = shades / self._weight[parent]
        self.touching[parent] = (self.touching.pop(i) | self.touching.pop(j)) - {i, j}
        for k in self.touching[parent]:
            inwards, edges = 0.0, 0.0
            for child in (i, j):
                self.touching[k].discard(child)
                more, count = self._edges.pop((min(child, k), max(child, k)), (0.0, 0.0))
                inwards, edges = inwards + more, edges + count
            self._edges[k, parent] = inwards, edges
            self.touching[k].add(parent)
        return parent


def _moments(solid: Solid, leaves: Indices, count: int) -> Array:
    """(count, 10) moments of the leaves' volume (see `_Clusters`), the exact integrals over their tetrahedra."""
    scale = solid.volume ** (1 / 3)
    corners = (solid.vertices[solid.tetrahedra] - solid.vertices.mean(axis=0)) / scale
    shares, middles = solid.volumes / solid.volume, corners.mean(axis=1)
    off = corners - middles[:, None]
    squares = np.einsum("tki,tkj->tij", off, off) / 20 + middles[:, :, None] * middles[:, None]
    rows, columns = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]).T
    first = np.column_stack([np.ones(len(shares)), middles, squares[:, rows, columns]]) * shares[:, None]
    return np.stack([np.bincount(leaves, column, minlength=count) for column in first.T], axis=1)


def _extents(moments: Array) -> Array:
    """(K,) roots of the determinants of the covariances of what has moments (K, 10): volumes of ellipsoids."""
    means = moments[:, 1:] / np.maximum(moments[:, :1], _SMALLEST)
    x, y, z = means[:, :3].T
    a, b, c, d, e, f = (means[:, 3:] - np.stack([x * x, y * y, z * z, x * y, x * z, y * z], axis=1)).T
    determinant = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)
    return np.asarray(np.sqrt(np.maximum(determinant, _FLATTEST)))


def build_hierarchy(
    solid: Solid,
    leaves: Indices,
    point_leaves: Indices,
    colours: Array,
    graph: SurfaceGraph,
    costs: MergeCosts,
    considered: list[tuple[Array, Array]] | None = None,
) -> Hierarchy:
    """Merge clusters of tetrahedra, what likely is one part first, until nothing touches.

    Args:
        solid: T tetrahedra.
        leaves: (T,) initial cluster of each, 0..L-1, none empty.
        point_leaves: (V,) the same for each vertex.
        colours: (V, 3) 0..1.
        graph: of the surface.
        costs: what keeps clusters apart.
        considered: takes (K, 2) pairs that might be merged and (K, 6) terms of their log odds, see
            `MergeCosts.weights`; then nothing is compiled.
    """
    clusters = _Clusters(solid, leaves, point_leaves, colours, colour_noise(colours, graph.edges), costs)
    n_leaves = clusters.next
    pairs = _touching(solid, leaves, n_leaves)
    borders = _borders(graph, sheet_folds(solid, graph), point_leaves, n_leaves, costs)
    pairs = np.concatenate([pairs, _bridges(solid, leaves, pairs, costs.least)])
    clusters.considered = considered
    compiled = COMPILED and n_leaves <= _MOST_COMPILED and considered is None
    merges = clusters.merged_compiled(pairs, borders) if compiled else _merge_all(clusters, pairs, borders)
    return Hierarchy(n_leaves, tuple(merges))


def _touching(solid: Solid, leaves: Indices, count: int) -> Indices:
    """(K, 2) leaves that share a face, the lower first."""
    owner, behind = np.repeat(np.arange(len(leaves)), 4), solid.neighbours.ravel()
    i, j = leaves[owner[behind >= 0]], leaves[behind[behind >= 0]]
    shared = np.zeros(count * count, bool)
    shared[(i * count + j)[i < j]] = True
    return np.stack(np.divmod(np.flatnonzero(shared), count), axis=1)


def _bridges(solid: Solid, leaves: Indices, pairs: Indices, least: float) -> Indices:
    """(K, 2) leaves, the lower first, that join pieces too small to be parts, which touch nothing, to the nearest.

    Specks of noise beside a surface are such pieces.
    """
    piece = linked(int(leaves.max()) + 1, pairs)[leaves]
    shares = np.bincount(piece, solid.volumes) / solid.volume
    small = shares < min(least, shares.max())
    if not small.any():
        return np.zeros((0, 2), dtype=np.int64)
    middles = solid.centroids
    own, others = (np.flatnonzero(small[piece] == which) for which in (True, False))
    away, nearest = cKDTree(middles[others]).query(middles[own])
    order = np.argsort(away, kind="stable")
    first = order[np.unique(piece[own[order]], return_index=True)[1]]
    return np.sort(np.stack([leaves[own[first]], leaves[others[nearest[first]]]], axis=1), axis=1)


def _borders(
    graph: SurfaceGraph, folded: Mask, point_leaves: Indices, count: int, costs: MergeCosts
) -> tuple[Indices, Array, Array]:
    """(B, 2) leaves with edges of the surface between them, (B,) how many of these fold inwards, and (B,) all.

    An edge that is `folded` counts as a number of edges that fold inwards, which may be negative.
    """
    i, j = point_leaves[graph.edges].T
    across = i != j
    border = np.minimum(i, j)[across] * count + np.maximum(i, j)[across]
    present, which = np.unique(border, return_inverse=True)
    inwards = (graph.creases > INWARDS) + costs.fold / costs.concave * folded
    ends, edges = np.stack(np.divmod(present, count), axis=1), np.bincount(which).astype(np.float64)
    return ends, np.asarray(np.bincount(which, inwards[across]), dtype=np.float64), edges


def _merge_all(clusters: _Clusters, pairs: Indices, borders: tuple[Indices, Array, Array]) -> list[Merge]:
    """The cheapest pair that is left, again and again; arguments as of `_touching` and `_borders`."""
    for i, j in pairs.tolist():
        clusters.meet(i, j)
    for (i, j), *edges in zip(borders[0].tolist(), *(each.tolist() for each in borders[1:]), strict=True):
        clusters.add_border(i, j, *edges)
    queue: list[tuple[float, int, int]] = []

    def consider(pairs: list[tuple[int, int]]) -> None:
        if pairs:
            i, j = np.array(pairs).T
            for one in zip(clusters.merging(i, j).tolist(), i.tolist(), j.tolist(), strict=True):
                heapq.heappush(queue, one)

    consider([(i, j) for i, others in clusters.touching.items() for j in sorted(others) if i < j])
    merges = []
    while queue:
        cost, i, j = heapq.heappop(queue)
        if i in clusters.touching and j in clusters.touching:
            parent = clusters.merge(i, j)
            merges.append(Merge(i, j, parent, cost))
            consider([(k, parent) for k in sorted(clusters.touching[parent])])
    return merges
