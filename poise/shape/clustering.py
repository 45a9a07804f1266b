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

from poise.geometry import lengths
from poise.kernels import COMPILED, clustered_points
from poise.shape.lighting import colour_steps, usual_step
from poise.shape.surface_graph import folds
from poise.types import Array, Indices

_MOST_ROUNDS = 80
_SMOOTHINGS, _ALIKE, _LEAST_NOISE = 3, 1.5, 1e-3
_EQUAL = 1e-9
"""Share by which distances differ that are the same but for rounding, as of two points from the middle between them."""


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
            weights.position * lengths(self.positions[i] - self.positions[j])
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
    if COMPILED:
        numbers = {"position": weights.position, "colour": weights.colour, "shading": features.shading}
        numbers |= {"inward": weights.inward_fold, "outward": weights.outward_fold, "equal": _EQUAL}
        known = features.positions, features.colours, features.normals
        return clustered_points(known, edges, wanted, _MOST_ROUNDS, numbers)
    clusters = _Groups(features, edges, weights)
    threshold = float(np.median(clusters.costs))
    for _ in range(_MOST_ROUNDS):
        left = len(clusters.representatives)
        if left <= wanted or not len(clusters.pairs):
            break
        joined = clusters.best_pairs(threshold, left - wanted)
        if len(joined):
            clusters.merge(joined)
        else:
            threshold *= 2
    return clusters.labels


class _Groups:
    """Clusters of points that are left: the cluster of each point, their representatives, and neighbours.

    Args:
        features, edges, weights: as of `initial_clusters`.
    """

    def __init__(self, features: Features, edges: Indices, weights: Weights) -> None:
        self._features, self._weights = features, weights
        count = len(features.positions)
        self.labels = np.arange(count)
        self.representatives = np.arange(count)
        self._sums, self._sizes = features.positions.copy(), np.ones(count)
        self._find_pairs(edges)

    def _find_pairs(self, edges: Indices) -> None:
        """Neighbours (E, 2), each pair once and the lower first, with what joining them costs."""
        count = len(self.representatives)
        i, j = edges.T
        apart = i != j
        keys = np.sort(np.minimum(i, j)[apart] * count + np.maximum(i, j)[apart])
        low, high = np.divmod(keys[np.append(True, np.diff(keys) > 0)] if len(keys) else keys, count)
        self.pairs = np.stack([low, high], axis=1)
        ends = self.representatives[low], self.representatives[high]
        self.costs = self._features.dissimilarity(*ends, self._weights)

    def best_pairs(self, threshold: float, most: int) -> Indices:
        """Pairs under the threshold that are each other's best choice, the cheapest first, `most` at the most."""
        below = np.flatnonzero(self.costs < threshold)
        low, high = self.pairs[below[np.argsort(self.costs[below], kind="stable")]].T
        ranks = np.arange(len(low))
        best = np.full(len(self.representatives), len(low))
        for ends in (low, high):
            np.minimum.at(best, ends, ranks)
        mutual = (best[low] == ranks) & (best[high] == ranks)
        return np.stack([low[mutual], high[mutual]], axis=1)[:most]

    def merge(self, joined: Indices) -> None:
        """Unite pairs (M, 2), of which no two share a cluster.

        The representative is the point nearest to the middle of the new cluster.
        """
        low, high = joined.T
        own = np.arange(len(self.representatives))
        own[high] = low
        kept = own == np.arange(len(own))
        number = (np.cumsum(kept) - 1)[own]
        self.labels = number[self.labels]
        for sums in (self._sums, self._sizes):
            sums[low] += sums[high]
        self._sums, self._sizes = self._sums[kept], self._sizes[kept]
        self.representatives = self.representatives[kept]
        grown = np.zeros(len(self._sizes), bool)
        grown[number[low]] = True
        members = np.flatnonzero(grown[self.labels])[::-1]
        of = self.labels[members]
        off = lengths(self._features.positions[members] - (self._sums / self._sizes[:, None])[of])
        least = np.full(len(grown), np.inf)
        np.minimum.at(least, of, off)
        nearest = off <= (1 + _EQUAL) * least[of]
        self.representatives[of[nearest]] = members[nearest]  # of equal ones the first point, which is written last
        self._find_pairs(number[self.pairs])


def smooth_colours(colours: Array, edges: Indices) -> Array:
    """Colours (N, 3) without the camera's noise, averaged over neighbours (E, 2) of much the same colour.

    What is much the same is learnt from the neighbours themselves; colours without noise stay as they are.
    """
    i, j = np.concatenate([edges, edges[:, ::-1]]).T
    alike = _ALIKE * usual_step(colours, edges)
    if alike < _LEAST_NOISE:
        return colours
    for _ in range(_SMOOTHINGS):
        apart = lengths(colours[i] - colours[j])
        weights = coo_array((np.exp(-((apart / alike) ** 2) / 2), (i, j)), shape=(len(colours),) * 2).tocsr()
        total = 1 + np.asarray(weights.sum(axis=1)).reshape(-1, 1)
        colours = (weights @ colours + colours) / total
    return colours
