"""Smooth surfaces through noisy points: local fits to the points of the same side, and the noise that they leave.

The two sides of a plate are nearer to each other than the reach of a fit, so points count by how alike their normals
are. The height is fitted as a quadric, because a plane through curved surface lies inside of it (moving least squares,
Alexa et al. 2003, with the weights of the normals of Öztireli et al. 2009).
"""

import numpy as np
from scipy.spatial import cKDTree

from poise.geometry import cross, lengths
from poise.kernels import COMPILED, side_averages
from poise.shape.solid import Solid
from poise.shape.surface_graph import unit_normals
from poise.types import Array

_ALIKE = 0.3
"""Cosine between normals below which two points are of different sides."""
_STIFFNESS = np.diag([1e-9, 1e-2, 1e-2, 3e-2, 3e-2, 3e-2])
"""Of the height, slopes and curvatures of a fit, relative to its weights: few points make a plane."""
_NORMAL_ROUNDS = 2
_NOISE_NEIGHBOURS, _NOISE_PLACES, _FEWEST = 20, 400, 10
_FLAT_SHARE = 0.35
"""Quantile of the local residuals that is taken for the noise: elsewhere edges and other sides add to it."""


def side_normals(solid: Solid, radius: float) -> Array:
    """(V, 3) outward unit normals of all vertices, averaged over those of the same side within a radius, m.

    A vertex inside of the solid has the normal of the nearest one on the surface.
    """
    normals, on_surface = unit_normals(solid)
    if not on_surface.all():
        outer = np.flatnonzero(on_surface)
        buried = np.flatnonzero(~on_surface)
        normals[buried] = normals[outer[cKDTree(solid.vertices[outer]).query(solid.vertices[buried])[1]]]
    if COMPILED:
        return side_averages(solid.vertices, normals, radius, _NORMAL_ROUNDS)
    i, j = cKDTree(solid.vertices).query_pairs(radius, output_type="ndarray").T
    for _ in range(_NORMAL_ROUNDS):
        alike = np.maximum(np.einsum("ij,ij->i", normals[i], normals[j]), 0) ** 2
        sums = [
            np.bincount(i, alike * normals[j, axis], len(normals))
            + np.bincount(j, alike * normals[i, axis], len(normals))
            for axis in range(3)
        ]
        normals = normals + np.stack(sums, axis=1)
        normals /= np.maximum(lengths(normals), 1e-30)[:, None]
    return normals


def fitted_heights(cloud: tuple[Array, Array], places: tuple[Array, Array], count: int) -> tuple[Array, Array, Array]:
    """Quadrics through the points around some places.

    Args:
        cloud: (N, 3) m and (N, 3) normals.
        places: (M, 3) m and (M, 3) normals.
        count: nearest points of each place that are asked.

    Returns:
        (M,) m heights of the surface over the places, along their normals; (M,) m standard deviation of the points
        about it; (M,) how many points of the same side that rests on.
    """
    points, normals = cloud
    at, up = places
    distance, near = cKDTree(points).query(at, k=min(count, len(points)))
    reach = np.maximum(distance[:, -1:], 1e-12) * 1.001
    weight = np.maximum(np.einsum("mki,mi->mk", normals[near], up) - _ALIKE, 0) / (1 - _ALIKE)
    members = np.count_nonzero(weight > 0, axis=1)
    weight *= (1 - (distance / reach) ** 2) ** 2
    offset = points[near] - at[:, None]
    across = cross(up, np.where(np.abs(up[:, :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    across /= lengths(across)[:, None]
    u, v, height = (
        np.einsum("mki,mi->mk", offset, way) / (reach if flat else 1.0)
        for way, flat in ((across, True), (cross(up, across), True), (up, False))
    )
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    weighted = terms * weight[..., None]
    system = weighted.transpose(0, 2, 1) @ terms + _STIFFNESS * np.maximum(weight.sum(axis=1), 1e-9)[:, None, None]
    coefficients = np.linalg.solve(system, np.einsum("mki,mk->mi", weighted, height)[..., None])
    residual = (height - (terms @ coefficients)[..., 0]) * np.sqrt(weight)
    kish = weight.sum(axis=1) ** 2 / np.maximum((weight**2).sum(axis=1), 1e-30)  # effective number of points
    free = np.maximum(1 - 6 / np.maximum(kish, 6.5), 0.05)
    spread = np.sqrt((residual**2).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-30) / free)
    return coefficients[:, 0, 0], spread, members


def local_noise(points: Array, normals: Array, rng: np.random.Generator) -> float:
    """m, one sigma of the points (N, 3) along their normals, where the surface is flattest; 0 when nothing shows it."""
    some = rng.permutation(len(points))[:_NOISE_PLACES]
    _, spread, members = fitted_heights((points, normals), (points[some], normals[some]), _NOISE_NEIGHBOURS)
    enough = members >= _FEWEST
    return float(np.quantile(spread[enough], _FLAT_SHARE)) * _QUANTILE_BIAS if np.any(enough) else 0.0


_QUANTILE_BIAS = 1.1
"""Of white noise on a plane, one sigma over that quantile of the residuals."""
