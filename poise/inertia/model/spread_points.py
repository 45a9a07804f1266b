"""A few points that are spread evenly over a shape."""

import numpy as np
import scipy

from poise.types import Array


def spread(candidates: Array, count: int, rounds: int = 20) -> Array:
    """(count, 3) points spread evenly among (C, 3) candidates inside a shape; each of them is a candidate.

    The farthest point of all is added until there are enough (Gonzalez 1985), then each moves into the middle of the
    candidates nearest to it (Lloyd 1982).
    """
    if count >= len(candidates):
        return candidates
    chosen = [int(np.argmin(np.linalg.norm(candidates - candidates.mean(axis=0), axis=1)))]
    distance = np.full(len(candidates), np.inf)
    for _ in range(count - 1):
        distance = np.minimum(distance, np.linalg.norm(candidates - candidates[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(distance)))
    centres = candidates[chosen]
    for _ in range(rounds):
        owner = np.argmin(scipy.spatial.distance.cdist(candidates, centres), axis=1)
        size = np.maximum(np.bincount(owner, minlength=count), 1)[:, None]
        sums = np.stack([np.bincount(owner, candidates[:, axis], minlength=count) for axis in range(3)], axis=1)
        centres = sums / size
    nearest = np.argmin(scipy.spatial.distance.cdist(centres, candidates), axis=1)
    return np.asarray(candidates[np.unique(nearest)])
