"""Small linear systems of many hypotheses at once."""

import numpy as np

from poise.types import Array


def normalised(log_weights: Array) -> Array:
    """(H,) probabilities, from their logarithms up to a constant."""
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def seen_through(root: Array, information: Array) -> tuple[Array, Array]:
    """(H, m, m) 1 + R^T H R scaled to a unit diagonal, for R (H, 10, m), and (H, m) the roots of that diagonal."""
    system = np.eye(root.shape[2]) + root.swapaxes(1, 2) @ information @ root
    scale = np.sqrt(np.diagonal(system, axis1=1, axis2=2).clip(min=1.0))  # less than 1 by rounding alone
    return system / (scale[:, :, None] * scale[:, None, :]), scale


def solve(systems: Array, right: Array) -> Array:
    """`numpy.linalg.solve`, typed."""
    return np.asarray(np.linalg.solve(systems, right), dtype=np.float64)


def apply(matrices: Array, vectors: Array) -> Array:
    """(..., N) matrix times vector, row by row."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
