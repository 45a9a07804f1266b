"""Few parts whose masses a sensor at rest can distinguish (thesis section 3.2.5).

At rest only mass and centre of mass show, which is four numbers: of parts whose centroids lie in one plane (or more
than four of them) some can trade mass without a trace, and non-negative least squares then gives some none at all.
The thesis' own suggestion is followed: the hierarchy of merges is undone where that gives centroids that span space.
"""

import numpy as np

from poise.shape.segmentation import Segmentation
from poise.types import Array, Indices

_MOST_PARTS = 4
_LEAST_SPREAD = 0.03
"""The smallest singular value of centroids and ones, each part weighted by the root of its share, lengths in radii."""


def independent_parts(found: Segmentation, most: int = _MOST_PARTS) -> Indices:
    """(T,) part of each tetrahedron: at most `most` parts, never finer than the segmentation's own.

    Merges are undone from the costliest down, leaving out those that would make centroids (nearly) coplanar. Pieces
    that do not touch stay apart, however many there are.
    """
    hierarchy = found.hierarchy
    leaf_volume = np.bincount(found.leaves, found.solid.volumes, minlength=hierarchy.n_leaves)
    first = found.solid.volumes[:, None] * found.solid.centroids
    sums = [np.bincount(found.leaves, first[:, axis], minlength=hierarchy.n_leaves) for axis in range(3)]
    leaf_first = np.stack(sums, axis=1)
    members = {leaf: [leaf] for leaf in range(hierarchy.n_leaves)}
    for merge in hierarchy.merges:
        members[merge.parent] = members[merge.left] + members[merge.right]
    children = {merge.parent: (merge.left, merge.right) for merge in hierarchy.merges}
    parts = [node for node in members if node not in {c for pair in children.values() for c in pair}]
    above = hierarchy.merges[found.steps :]  # what the segmentation itself keeps apart
    again = True
    while again and len(parts) < most:
        again = False
        for merge in sorted(above, key=lambda merge: -merge.cost):
            if merge.parent not in parts:
                continue
            split = [part for part in parts if part != merge.parent] + [merge.left, merge.right]
            volumes = np.array([leaf_volume[members[part]].sum() for part in split])
            moments = np.array([leaf_first[members[part]].sum(axis=0) for part in split])
            if spread(moments / volumes[:, None], volumes) >= _LEAST_SPREAD:
                parts, again = split, True
                break
    part_of_leaf = np.zeros(hierarchy.n_leaves, dtype=np.int64)
    for number, part in enumerate(parts):
        part_of_leaf[members[part]] = number
    return np.unique(part_of_leaf[found.leaves], return_inverse=True)[1]


def spread(centroids: Array, volumes: Array) -> float:
    """How far parts at (K, 3) m with volumes (K,) are from trading mass unseen: 0 when they can, as five always can."""
    if len(volumes) > _MOST_PARTS:
        return 0.0
    shares = volumes / volumes.sum()
    offsets = centroids - shares @ centroids
    radius = max(float(np.sqrt(shares @ np.sum(offsets**2, axis=1))), 1e-12)
    rows = np.column_stack([np.ones(len(shares)), offsets / radius]) * np.sqrt(shares)[:, None]
    return float(np.linalg.svd(rows, compute_uv=False)[-1])
