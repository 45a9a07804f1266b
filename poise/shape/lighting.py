"""Takes the lighting out of the colours of a cloud, so that shading does not look like a border of materials.

Under distant light, the lightness of one paint is a smooth function of the surface's normal: spherical harmonics up to
the second order describe it to a few percent (Ramamoorthi and Hanrahan 2001). It is fitted to pairs of points of one
chromaticity, in the L1 norm, in which pairs of two paints that differ in lightness alone count little. Shadows are
not described.
"""

import math

import numpy as np

from poise.geometry import lengths
from poise.types import Array, Indices, Mask

_DARKEST = 0.02
"""Lightness below which a camera shows noise."""
_PAIRS, _FEWEST = 8000, 200
"""Pairs that are drawn, and the least that 8 coefficients follow from."""
_ONE_PAINT = 0.02
"""Distance of chromaticities r, g, b (which sum to 1) of points that may have one paint."""
_ROUNDS, _SMALL, _RIDGE = 20, 0.01, 1e-4
_LEAST, _TAIL = 0.2, 0.02
"""Range of the logarithm of the light from which it is taken out, and the share of points beyond each of its ends."""
_EXPLAINED = 0.6
"""What may be left of the differences of lightness within pairs, in the mean."""


def unlit(colours: Array, normals: Array, seen: Mask, smooth: Array | None = None) -> Array | None:
    """Colours as if light came from all sides alike; None where lighting does not explain their lightness.

    Args:
        colours: (N, 3) 0..1, linear in the light.
        normals: (N, 3) outward unit normals.
        seen: (N,) False where colours were not measured.
        smooth: (N, 3) the colours without the camera's noise, which the light is found from; None: `colours`.

    Returns:
        (N, 3), with the median lightness of the input; above 1 where a bright paint was lit from the side.
    """
    shown = colours if smooth is None else smooth
    i, j = _pairs(shown, np.flatnonzero(seen)).T
    if len(i) < _FEWEST:
        return None
    lightness = np.log(np.maximum(shown.mean(axis=1), _DARKEST))
    basis = _harmonics(normals)
    rows, wanted = basis[i] - basis[j], lightness[i] - lightness[j]
    fitted = _least_absolute(rows, wanted)
    effect = basis @ fitted
    low, high = np.quantile(effect[seen], [_TAIL, 1 - _TAIL])
    left = float(np.abs(wanted - rows @ fitted).mean()) / max(float(np.abs(wanted).mean()), 1e-9)
    if high - low < _LEAST or left > _EXPLAINED:
        return None
    inside = np.clip(effect, effect[seen].min(), effect[seen].max())
    return np.asarray(colours * np.exp(np.median(effect[seen]) - inside)[:, None])


def _pairs(colours: Array, known: Indices) -> Indices:
    """(P, 2) of different points with the same chromaticity."""
    if len(known) < 2:
        return np.zeros((0, 2), np.int64)
    drawn = known[np.random.default_rng(0).integers(len(known), size=(_PAIRS, 2))]
    chromaticity = colours / np.maximum(colours.sum(axis=1, keepdims=True), 3 * _DARKEST)
    apart = lengths(chromaticity[drawn[:, 0]] - chromaticity[drawn[:, 1]])
    return np.asarray(drawn[(apart < _ONE_PAINT) & (drawn[:, 0] != drawn[:, 1])])


def _harmonics(normals: Array) -> Array:
    """(N, 8) real spherical harmonics of the first and second order, without norms."""
    x, y, z = normals.T
    return np.stack([x, y, z, x * y, y * z, z * x, x**2 - y**2, 3 * z**2 - 1], axis=1)


def _least_absolute(rows: Array, wanted: Array) -> Array:
    """(K,) that minimises the sum of |rows @ x - wanted|, by reweighted least squares."""
    found: Array = np.zeros(rows.shape[1])
    ridge = _RIDGE * len(rows) * np.eye(rows.shape[1])
    for _ in range(_ROUNDS):
        weights = 1 / np.maximum(np.abs(rows @ found - wanted), _SMALL)
        weighted = rows * weights[:, None]
        found = np.asarray(np.linalg.solve(weighted.T @ rows + ridge, weighted.T @ wanted), np.float64)
    return found


def usual_step(colours: Array, edges: Indices) -> float:
    """Median distance of the colours (N, 3) of neighbours (E, 2); 0 without any."""
    return float(np.median(lengths(colours[edges[:, 0]] - colours[edges[:, 1]]))) if len(edges) else 0.0


def colour_noise(colours: Array, edges: Indices) -> float:
    """One sigma of the noise in each channel of colours (N, 3), from the steps between most neighbours (E, 2).

    The median length of three normal numbers of variance 1 is 1.538, and a difference has twice the variance.
    """
    return usual_step(colours, edges) / (1.538 * math.sqrt(2))


def colour_steps(one: Array, other: Array, shading: float) -> Array:
    """(...,) distances of colours (..., 3), the least when one's lightness may change by a share."""
    (a, b, c), (d, e, f) = (np.moveaxis(of, -1, 0) for of in (one, other))
    scale = (a * d + b * e + c * f) / np.maximum(d * d + e * e + f * f, 1e-12)
    scale = np.clip(scale, 1 / (1 + shading), 1 + shading)
    return lengths(one - scale[..., None] * other)
