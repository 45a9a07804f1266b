"""The noise of points from how far the nearest few of them leave a plane or a quadric.

A fit of a wide neighbourhood takes curvature, edges and other sides for noise. So the smallest neighbourhoods are asked
that are wide against the noise they show: in a narrower one the points fill a ball, and a plane fits in any direction.
"""

import numpy as np
from scipy.special import gammaincinv

from poise.shape.nearest import nearest
from poise.types import Array

_PLACES, _CLOUD = 300, 50_000
"""Neighbourhoods that are asked, and points that these are taken from, at the most."""
_SIZES = (8, 12, 20, 32)
"""Points in a neighbourhood."""
_PLANE, _QUADRIC = 3, 6
"""Free parameters."""
_WIDE = 5.0
"""Radius of a neighbourhood over the noise that it shows, from which on that is noise."""
_FLAT_SHARE = 0.35
"""Quantile of the places that is taken: at edges and where sides are near, fits are worse."""
_LATTICE, _SAME = 0.3, 1e-3
"""Share of the points whose nearest one is equally far, and what is equal, of the distance: such points are rounded."""


def local_noise_limit(points: Array, rng: np.random.Generator) -> float:
    """m, at most one sigma of points (N, 3) along each axis; infinite where no neighbourhood shows it.

    Curvature and the sampling make it larger than the noise, and errors that neighbours share make it smaller.
    """
    cloud = points if len(points) <= _CLOUD else points[rng.permutation(len(points))[:_CLOUD]]
    sizes = [size for size in _SIZES if size <= len(cloud) // 4]
    if not sizes:
        return np.inf
    some = rng.permutation(len(cloud))[:_PLACES]
    distances, near = nearest(cloud, cloud[some], max(sizes))
    if _is_lattice(distances[:, 1]):
        return np.inf
    limit = np.inf
    for size in sizes:
        radius = distances[:, size - 1]
        for left, parameters in zip(_residuals(cloud[near[:, :size]]), (_PLANE, _QUADRIC), strict=True):
            freedom = size - parameters
            usual = 2 * gammaincinv(freedom / 2, _FLAT_SHARE)  # that quantile of chi-squared
            noise = float(np.sqrt(np.quantile(left, _FLAT_SHARE) / usual))
            if float(np.median(radius)) >= _WIDE * noise:
                limit = min(limit, noise)
    return limit


def _is_lattice(distances: Array) -> bool:
    """Whether points (N,) were rounded to a grid: then neighbours lie in its planes, and show no noise."""
    usual = float(np.median(distances))
    return bool(np.mean(np.abs(distances - usual) <= _SAME * usual) > _LATTICE)


def _residuals(points: Array) -> tuple[Array, Array]:
    """(M,) m2, sums of squares about a plane, and about a quadric over it, of neighbourhoods (M, K, 3)."""
    off = points - points.mean(axis=1, keepdims=True)
    ways = np.linalg.eigh(off.transpose(0, 2, 1) @ off)[1]
    height, v, u = np.moveaxis(off @ ways, 2, 0)
    scale = np.maximum(np.abs(u).max(axis=1, keepdims=True), 1e-12)
    u, v = u / scale, v / scale
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    normal = terms.transpose(0, 2, 1) @ terms + 1e-9 * np.eye(_QUADRIC)
    fit = np.linalg.solve(normal, terms.transpose(0, 2, 1) @ height[..., None])
    return (height**2).sum(axis=1), ((height - (terms @ fit)[..., 0]) ** 2).sum(axis=1)
