"""Where the weights of `poise.shape.hierarchy.MergeCosts` come from: a logistic regression on random objects.

python -m benchmarks.merge_odds [--objects N] [--boxes N]

Each pair of clusters that might be merged is asked whether most of their points are of two true parts. A pair counts as
much as the share of the surface that would be in the wrong part. All objects are development objects. Folds of
sheets do not count: random objects have too few of them.
"""

import argparse
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.random_objects import make_composite
from benchmarks.segmentation_draws import boxes
from benchmarks.segmentation_truth import NOISE
from poise.errors import InputError
from poise.shape import segmentation
from poise.shape.hierarchy import Hierarchy, MergeCosts, build_hierarchy
from poise.shape.nearest import nearest
from poise.shape.segmentation import SegmentationOptions
from poise.shape.solid import Solid
from poise.shape.surface_graph import SurfaceGraph
from poise.types import Array, Indices, Mask

SEEDS = (*range(100, 260), *range(300, 372))
ROUGH = 1e-3
"""m, the larger noise along each axis."""
NAMES = ("constant", "concave", "colour", "spread", "thickness", "smaller", "both")
RIDGE, ROUNDS = 1e-2, 30
"""Precision of the weights beforehand, and Newton steps at the most."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs that might be merged.

    Args:
        terms: (K, 7) of their log odds, 1 first.
        apart: (K,) whether they are of two parts.
        weights: (K,) shares of the surface.
        owners: (K,) number of the object.
    """

    terms: Array
    apart: Mask
    weights: Array
    owners: Indices

    @classmethod
    def of_all(cls, each: "list[Pairs]") -> "Pairs":
        columns = ([getattr(one, name) for one in each] for name in ("terms", "apart", "weights", "owners"))
        return cls(*(np.concatenate(column) for column in columns))


def clouds(objects: int, count: int) -> Iterator[tuple[Array, Array, Indices]]:
    """(N, 3) m, (N, 3) 0..1 and (N,) true parts, of some random objects and boxes, with both noises each."""
    for seed in np.random.default_rng(0).permutation(SEEDS)[:objects].tolist():
        made = make_composite(seed, NOISE)
        rng = np.random.default_rng([3000, seed])
        order, errors = rng.permutation(len(made.points)), rng.normal(size=made.points.shape)
        for noise in (0.0, np.sqrt(ROUGH**2 - NOISE**2)):
            yield made.points[order] + noise * errors, made.colours[order], made.labels[order]
    for points, errors, colours in boxes(count):
        for noise in (NOISE, ROUGH):
            yield points + noise * errors, colours, np.zeros(len(points), np.int64)


def pairs_of(points: Array, colours: Array | None, labels: Indices, owner: int) -> Pairs:
    """All pairs that are considered when a cloud is cut.

    Raises:
        InputError: what `segment` raises.
    """
    kept: list[Pairs] = []

    def recorded(
        solid: Solid, leaves: Indices, own: Indices, shades: Array, graph: SurfaceGraph, costs: MergeCosts
    ) -> Hierarchy:
        considered: list[tuple[Array, Array]] = []
        found = build_hierarchy(solid, leaves, own, shades, graph, costs, considered)
        pairs, terms = (np.concatenate(column) for column in zip(*considered, strict=True))
        truth = labels[nearest(points, solid.vertices, 1)[1][:, 0]]
        kept.append(_judged(_tally(found, own, truth), pairs, terms, owner, costs.colour == 0))
        return found

    with patch.object(segmentation, "build_hierarchy", recorded):
        segmentation.segment(points, colours, SegmentationOptions(costs=MergeCosts(fold=0.0)))
    return kept[0]


def _tally(found: Hierarchy, own: Indices, truth: Indices) -> Array:
    """(2 L - 1, P) points of each true part in each cluster, from the leaf `own` (V,) and true part (V,) of each."""
    counts = np.zeros((2 * found.n_leaves - 1, int(truth.max()) + 1))
    np.add.at(counts, (own, truth), 1)
    for merge in found.merges:
        counts[merge.parent] = counts[merge.left] + counts[merge.right]
    return counts


def _judged(counts: Array, pairs: Indices, terms: Array, owner: int, plain: bool) -> Pairs:
    """Pairs of clusters that have points; where colours say nothing (`plain`), they are no term."""
    left, right = counts[pairs[:, 0]], counts[pairs[:, 1]]
    full = (left.sum(axis=1) > 0) & (right.sum(axis=1) > 0)
    left, right, rows = left[full], right[full], np.insert(terms[full], 0, 1.0, axis=1)
    rows[:, NAMES.index("colour")] *= not plain
    total = counts[counts.sum(axis=1).argmax()].sum()
    weights = np.minimum(left.max(axis=1), right.max(axis=1)) / total
    return Pairs(rows, left.argmax(axis=1) != right.argmax(axis=1), weights, np.full(len(rows), owner))


def chances(pairs: Pairs, weights: Array) -> Array:
    """(K,) that they are of two parts."""
    return np.asarray(1 / (1 + np.exp(-np.clip(pairs.terms @ weights, -50, 50))))


def fitted(pairs: Pairs) -> tuple[Array, Array]:
    """(7,) weights of the logistic regression, and (7,) standard errors from the differences between objects."""
    share = pairs.weights / pairs.weights.mean()
    found, prior = np.zeros(len(NAMES)), RIDGE * np.eye(len(NAMES))
    for _ in range(ROUNDS):
        chance = chances(pairs, found)
        curvature = prior + (pairs.terms * (share * chance * (1 - chance))[:, None]).T @ pairs.terms
        slope = pairs.terms.T @ (share * (pairs.apart - chance)) - prior @ found
        step = np.linalg.solve(curvature, slope)
        found = found + step
        if np.abs(step).max() < 1e-8:
            break
    residual = (share * (pairs.apart - chances(pairs, found)))[:, None] * pairs.terms
    by_object = np.stack([np.bincount(pairs.owners, column) for column in residual.T], axis=1)
    inverse = np.linalg.inv(curvature)
    return found, np.sqrt(np.diag(inverse @ by_object.T @ by_object @ inverse))


def loss(pairs: Pairs, weights: Array) -> float:
    """Mean of -log of the probability of what is true, weighted by the surface."""
    chance = np.clip(chances(pairs, weights), 1e-12, 1 - 1e-12)
    return float(np.average(-np.log(np.where(pairs.apart, chance, 1 - chance)), weights=pairs.weights))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=len(SEEDS), help="how many random objects")
    parser.add_argument("--boxes", type=int, default=60, help="how many boxes and plates")
    arguments = parser.parse_args()
    found: list[Pairs] = []
    total = 2 * (min(arguments.objects, len(SEEDS)) + arguments.boxes)
    for number, (points, colours, labels) in enumerate(track(clouds(arguments.objects, arguments.boxes), total=total)):
        for given in (colours, None):
            with suppress(InputError):  # a plate as thin as the noise is refused
                found.append(pairs_of(points, given, labels, number // 2))
    pairs, costs = Pairs.of_all(found), MergeCosts()
    weights, errors = fitted(pairs)
    used = np.array([costs.constant, *costs.weights])
    table = Table("term", "weight in the code", "fitted", "standard error, by objects")
    for name, *row in zip(NAMES, used, weights, errors, strict=True):
        table.add_row(name, *(f"{value:.2f}" for value in row))
    console = Console(width=120)
    console.print(f"{len(pairs.terms)} pairs of {len(found)} clouds, {np.mean(pairs.apart):.1%} of two parts")
    console.print(table)
    console.print(f"loss: weights in the code {loss(pairs, used):.4f}, fitted {loss(pairs, weights):.4f}")


if __name__ == "__main__":
    main()
