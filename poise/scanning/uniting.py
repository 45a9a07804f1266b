"""Pieces of a height map that are one object: surface which the views agree on goes from one into the other.

Cells of the map that are partly beside a thin shaft show more table than shaft. So the map may divide an object there,
and flying pixels may connect two. In the fused surface the shaft is there, and flying pixels are not.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from poise.errors import InputError
from poise.scanning.frames import View
from poise.scanning.fusion import fuse
from poise.scanning.support import Footprint
from poise.shape import linked
from poise.types import Array, Indices

_REACH = 3.0
"""Voxels between points of one surface, at most: the thinnest gap between objects that the map separates is wider."""
_FEWEST = 20
"""Points of one surface that two pieces have at least, each, to be one object."""


def united(
    views: Sequence[View], footprints: Sequence[Footprint], middles: Array, voxel: float
) -> tuple[list[Footprint], Array]:
    """Footprints and (K, 3) m middles, of which those that one surface connects are one; the largest first.

    Args:
        views: that see them.
        footprints, middles: as of `objects_on`.
        voxel: m, spacing of the points.
    """
    groups = _connected(len(footprints), _touching(footprints))
    if len(groups) == len(footprints):
        return list(footprints), middles
    found = []
    for group in groups:
        own = [footprints[number] for number in group]
        for members in _connected(len(own), _same_surface(views, own, voxel)) if len(own) > 1 else [[0]]:
            numbers = [group[member] for member in members]
            sizes = [np.count_nonzero(footprints[number].cells) for number in numbers]
            found.append(
                (
                    sum(sizes),
                    _union([footprints[number] for number in numbers]),
                    np.average(middles[numbers], axis=0, weights=sizes),
                )
            )
    found.sort(key=lambda one: -one[0])
    return [one for _, one, _ in found], np.array([middle for *_, middle in found])


def _connected(count: int, pairs: list[tuple[int, int]]) -> list[list[int]]:
    """Numbers of things in groups that pairs connect, in their order."""
    own = linked(count, np.array(pairs, int).reshape(-1, 2))
    return [np.flatnonzero(own == group).tolist() for group in dict.fromkeys(own.tolist())]


def _touching(footprints: Sequence[Footprint]) -> list[tuple[int, int]]:
    """Pairs whose cells are neighbours."""
    number = np.zeros(footprints[0].cells.shape, int)
    for count, one in enumerate(footprints, 1):
        number[one.cells] = count
    high = ndimage.maximum_filter(number, 3)
    low = ndimage.minimum_filter(np.where(number > 0, number, len(footprints) + 1), 3)
    beside = (number > 0) & (low < high)
    pairs = np.unique(np.stack([low[beside], high[beside]]), axis=1) - 1
    return [(int(one), int(other)) for one, other in pairs.T]


def _same_surface(views: Sequence[View], footprints: Sequence[Footprint], voxel: float) -> list[tuple[int, int]]:
    """Pairs into both of which one surface goes."""
    whole = _union(footprints)
    try:
        points = fuse(views, whole, voxel, 0.0).points
    except InputError:  # too little is seen
        return []
    flat = whole.plane.placed(points)
    owner = np.full(len(points), -1)
    for number, one in enumerate(footprints):
        owner[one.holds(flat[:, 0], flat[:, 1])] = number
    surface = linked(len(points), cKDTree(points).query_pairs(_REACH * voxel, output_type="ndarray"))
    return [pair for one in np.unique(surface) for pair in _pairs(owner[surface == one])]


def _pairs(owners: Indices) -> list[tuple[int, int]]:
    """Neighbouring pairs of the pieces that have enough points of one surface."""
    numbers, counts = np.unique(owners[owners >= 0], return_counts=True)
    kept = numbers[counts >= _FEWEST].tolist()
    return list(pairwise(kept))


def _union(footprints: Sequence[Footprint]) -> Footprint:
    """One footprint of several."""
    cells = np.any([one.cells for one in footprints], axis=0)
    return replace(footprints[0], cells=cells, top=max(one.top for one in footprints))
