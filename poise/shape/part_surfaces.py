"""The closed surface around each part of a segmented object."""

import numpy as np

from poise.shape.solid import Solid
from poise.types import Array, Indices


def part_surface(solid: Solid, labels: Indices, part: int) -> tuple[Array, Indices]:
    """(V, 3) m and (F, 3) vertex numbers, counter-clockwise from outside, around the tetrahedra of one part.

    Args:
        solid: all of them.
        labels: (T,) part of each.
        part: which.
    """
    kept = np.flatnonzero(labels == part)
    number = np.full(len(labels) + 1, -1)
    number[kept] = np.arange(len(kept))
    alone = Solid(solid.vertices, solid.tetrahedra[kept], number[solid.neighbours[kept]])
    triangles, _ = alone.surface
    used, corners = np.unique(triangles, return_inverse=True)
    return solid.vertices[used], corners.reshape(-1, 3)
