"""Initial clusters of surface points that do not cross the edges of parts (thesis Algorithm 1, step 1; Lin 2018).

A cluster is known by one representative point. Two neighbouring clusters merge when the dissimilarity of their
representatives (thesis eq. 3.28: position, colour, normal) is below a threshold that doubles until few are left.
Unlike the sequential sweep of Lin et al., each round lets every cluster choose its most similar neighbour, so that
the order of the points changes nothing. Points on borders are not given away afterwards, as Algorithm 1 does: their
votes ate whole clusters where colours were noisy, and cost a fifth of the score where they were not.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from poise.shape.lighting import colour_steps
from poise.shape.surface_graph import folds
from poise.types import Array, Indices

_MOST_ROUNDS = 80
_SMOOTHINGS, _ALIKE, _LEAST_NOISE = 3, 1.5, 1e-3


@dataclass(frozen=True)
class Weights:
    """What makes two points different (thesis eq. 3.28): per spacing of the points, per unit of colour, per fold.

    Outward folds count for little: the edge of a box is inside a part, the corner between two boxes is between them.
    """

    position: float = 0.025
    colour: float = 4.0
    inward_fold: float = 1.0
    outward_fold: float = 0.2


@dataclass(frozen=True, eq=False)
class Features:
    """What is known of each surface point.

    Args:
        positions, colours, normals: (N, 3) in spacings, 0..1, and outward unit vectors.
        shading: share by which lightness may differ for nothing.
    """

    positions: Array
    colours: Array
    normals: Array
    shading: float = 0.0

    def dissimilarity(self, i: Indices, j: Indices, weights: Weights) -> Array:
        """Thesis eq. (3.28) between points i and j; both (E,)."""
        fold = folds(self.positions, self.normals, i, j)
        return np.asarray(
            weights.position * np.linalg.norm(self.positions[i] - self.positions[j], axis=1)
            + weights.colour * colour_steps(self.colours[i], self.colours[j], self.shading)
            + np.where(fold > 0, weights.inward_fold, -weights.outward_fold) * fold
        )


def initial_clusters(features: Features, edges: Indices, wanted: int, weights: Weights) -> Indices:
    """Cluster points until about `wanted` clusters are left.

    Args:
        features: of N points.
        edges: (E, 2) neighbours.
        wanted: merging stops at or below this many; what does not touch stays apart.

    Returns:
        (N,) cluster of each point, numbered from 0.
    """
    n_points = len(features.positions)
    labels = np.arange(n_points)
    representatives = np.arange(n_points)
    i, j = edges.T
    threshold = float(np.median(features.dissimilarity(i, j, weights)))
    for _ in range(_MOST_ROUNDS):
        a, b = labels[i], labels[j]
        apart = a != b
        if len(representatives) <= wanted or not np.any(apart):
            break
        low, high = np.minimum(a[apart], b[apart]), np.maximum(a[apart], b[apart])
        pairs = np.stack(np.divmod(np.unique(low * n_points + high), n_points), axis=1)
        cost = features.dissimilarity(representatives[pairs[:, 0]], representatives[pairs[:, 1]], weights)
        joined = _best_pairs(pairs, cost, threshold, len(representatives) - wanted)
        if not len(joined):
            threshold *= 2
            continue
        labels, representatives = _merge(labels, representatives, joined, features.positions)
    return labels


def _best_pairs(pairs: Indices, cost: Array, threshold: float, most: int) -> Indices:
    """Pairs under the threshold that are each other's best choice, the cheapest first, `most` at the most."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    costs = np.tile(cost, 2)
    order = np.lexsort((both[:, 1], costs, both[:, 0]))
    first = np.append(True, np.diff(both[order, 0]) != 0)
    choice = np.full(both.max() + 1, -1)
    choice[both[order[first], 0]] = both[order[first], 1]
    mutual = (choice[pairs[:, 0]] == pairs[:, 1]) & (choice[pairs[:, 1]] == pairs[:, 0]) & (cost < threshold)
    chosen = np.flatnonzero(mutual)
    return np.asarray(pairs[chosen[np.argsort(cost[chosen], kind="stable")][:most]])


def _merge(labels: Indices, representatives: Indices, pairs: Indices, positions: Array) -> tuple[Indices, Indices]:
    """Unite pairs of clusters; the representative is the point nearest to the middle of the new cluster."""
    n_clusters = len(representatives)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n_clusters, n_clusters))
    count, united = connected_components(graph, directed=False)
    labels = united[labels]
    sizes = np.bincount(labels, minlength=count)
    middles = np.column_stack([np.bincount(labels, positions[:, k], count) / sizes for k in range(3)])
    off_middle = np.linalg.norm(positions - middles[labels], axis=1)
    order = np.lexsort((off_middle, labels))
    return labels, order[np.append(True, np.diff(labels[order]) != 0)]


def smooth_colours(colours: Array, edges: Indices) -> Array:
    """Colours (N, 3) without the camera's noise, averaged over neighbours (E, 2) of much the same colour.

    What is much the same is learnt from the neighbours themselves; colours without noise stay as they are.
    """
    i, j = np.concatenate([edges, edges[:, ::-1]]).T
    alike = _ALIKE * float(np.median(np.linalg.norm(colours[edges[:, 0]] - colours[edges[:, 1]], axis=1)))
    if alike < _LEAST_NOISE:
        return colours
    for _ in range(_SMOOTHINGS):
        apart = np.linalg.norm(colours[i] - colours[j], axis=1)
        weights = coo_array((np.exp(-((apart / alike) ** 2) / 2), (i, j)), shape=(len(colours),) * 2).tocsr()
        total = 1 + np.asarray(weights.sum(axis=1)).reshape(-1, 1)
        colours = (weights @ colours + colours) / total
    return colours
