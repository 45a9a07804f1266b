"""Gaps that are narrower than the ball which carves a solid, but that a scan saw through."""

import numpy as np
from scipy.spatial import cKDTree

from poise.shape.solid import Solid
from poise.types import Array

_CELL = 0.75
"""Cells from a place in air within which the middle of a tetrahedron is in air, too: between a ball of the volume of a
cell (0.62), and one that holds the cell (0.87)."""
_LEAST = 0.003
"""Share of the volume that a gap has at the least: smaller ones are within the error of the surface."""
_THICK = 0.25
"""Cells that a gap is wide at the least: a sheet of flat tetrahedra over a face is none."""
_BARE = 0.1
"""Share of the corners of a gap that may have nothing behind them: walls have, and a layer of a plate has not."""


def without_gaps(solid: Solid, air: Array) -> Solid:
    """The solid without the tetrahedra that lie in air, where they form gaps.

    Args:
        solid: of the points of a scan.
        air: (K, 3) m, places that views look through, on a grid.
    """
    if len(air) < 2:
        return solid
    grid = cKDTree(air)
    cell = float(np.median(grid.query(air, 2)[0][:, 1]))
    open_ = np.isfinite(grid.query(solid.centroids, distance_upper_bound=_CELL * cell)[0])
    if not open_.any():
        return solid
    gaps = solid.only(open_)
    volumes, gap = gaps.pieces()
    around = np.bincount(gap[gaps.surface[1]], gaps.areas, len(volumes))
    behind = np.zeros(len(solid.vertices), bool)
    behind[solid.tetrahedra[~open_]] = True
    bare = np.bincount(gap, (~behind[gaps.tetrahedra]).mean(axis=1)) / np.bincount(gap)
    wide = (volumes > _LEAST * solid.volume) & (2 * volumes > _THICK * cell * around)
    open_[open_] = (wide & (bare < _BARE))[gap]
    return solid.only(~open_)


def is_cavity(space: Solid, normals: Array) -> bool:
    """Whether some tetrahedra are a space outside: the walls around it face it, and those of an object face away.

    Args:
        space: the tetrahedra.
        normals: (V, 3) outward unit normals of its vertices.
    """
    toward = space.centroids[:, None] - space.vertices[space.tetrahedra]
    facing = np.einsum("tki,tki->t", toward, normals[space.tetrahedra])
    return float(facing @ np.abs(space.volumes)) > 0
