"""The second hypothesis about a scanned solid: the space that no view saw into may be empty.

A cup upside down and a solid block give the same images, so that no sigma around one of them describes both. The volume
of the solid and its sigma hold if there is no hollow; this module says which space a hollow may take.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from poise.shape.solid import Solid
from poise.types import Array, Indices, Mask

_SAMPLES = 4000
_WALL = 0.002
"""m: the walls of cups and boxes are thicker."""
_ASKED, _HOLE = 500, 1.0
"""Points that are asked for the nearest other; and the radius of holes between points, in distances to it."""
_PER_CELL = 8
"""Samples in each cell, on average, so that hardly any cell inside is empty."""
_SIGMAS = 2.0
"""Of the volume, above which a hollow is not described by its uncertainty."""


@dataclass(frozen=True, eq=False)
class Hollow:
    """Space inside a solid that may be empty: behind walls of all that was seen, and open where nothing was seen.

    Args:
        samples: (K, 3) m, evenly over all of the solid.
        owners: (K,) tetrahedron that each lies in.
        empty: (K,) which samples are in the space.
        volume: m3 of the space.
        opening: m2 of the surface that was not seen, over the space.
    """

    samples: Array
    owners: Indices
    empty: Mask
    volume: float
    opening: float

    def matters(self, solid: Solid) -> bool:
        """Whether the volume of the solid would be wrong by more than it is uncertain."""
        return self.volume > _SIGMAS * solid.volume_std

    def sentence(self, solid: Solid) -> str:
        """Both hypotheses, for people."""
        spread, least = 1e6 * solid.volume_std, 1e6 * (solid.volume - self.volume)
        return (
            f"{1e4 * self.opening:.0f} cm2 of the surface were not seen, and a hollow that is open there (as of a cup"
            f" upside down) would look the same: the volume is {1e6 * solid.volume:.4g} ± {spread:.2g} cm3 if it is"
            f" solid, and between {least:.2g} cm3 and that if it is hollow, which volume_std does not include: turn it"
            " over and scan again, if it may be hollow"
        )


def hollow_of(solid: Solid, points: Array, seen: Mask) -> Hollow | None:
    """The space that may be a hollow; None when there is none.

    Args:
        solid: of the points.
        points: (N, 3) m.
        seen: (N,) False where a scan completed the surface.
    """
    if seen.all() or not seen.any():
        return None
    rng = np.random.default_rng(0)
    sizes = np.maximum(solid.volumes, 0.0)
    owners = rng.choice(len(sizes), _SAMPLES, p=sizes / sizes.sum())
    inside = np.einsum("kc,kci->ki", rng.dirichlet(np.ones(4), _SAMPLES), solid.vertices[solid.tetrahedra[owners]])
    there = cKDTree(points[seen])
    apart = float(np.median(there.query(points[seen][:: max(len(points) // _ASKED, 1)], k=2)[0][:, 1]))
    empty = ~np.isfinite(there.query(inside, distance_upper_bound=np.hypot(_WALL, _HOLE * apart))[0])
    each = float(sizes.sum()) / _SAMPLES
    cell = (_PER_CELL * each) ** (1 / 3)
    empty[empty] = _open(inside[empty], points[~seen], cell)
    if not empty.any():
        return None
    triangles, _ = solid.surface
    middles = solid.vertices[triangles].mean(axis=1)
    over = np.flatnonzero(np.isfinite(cKDTree(inside[empty]).query(middles, distance_upper_bound=cell)[0]))
    unseen = cKDTree(points[~seen]).query(middles[over])[0] < there.query(middles[over])[0]
    opening = float(solid.areas[over[unseen]].sum())
    return Hollow(inside, owners, empty, each * np.count_nonzero(empty), opening)


def _open(deep: Array, unseen: Array, cell: float) -> Mask:
    """(K,) which samples (K, 3) are connected with a surface that was not seen (M, 3), in cells of a size, m."""
    if not len(deep):
        return np.zeros(0, bool)
    low = deep.min(axis=0) - cell
    index = ((deep - low) / cell).astype(np.int64)
    filled = np.zeros(index.max(axis=0) + 2, bool)
    filled[tuple(index.T)] = True
    numbers, count = ndimage.label(filled)
    own = numbers[tuple(index.T)]
    apart, near = cKDTree(deep).query(unseen, distance_upper_bound=cell)
    opened = np.zeros(count + 1, bool)
    opened[own[near[np.isfinite(apart)]]] = True
    return np.asarray(opened[own])
