"""How high the hidden underside of an object is over the table: a thin plate between the edges that views look under.

What views see at the edges continues between them: where sides come down to the table the object stands; where views
look under an edge it does not. Between both the underside bends as little as possible (a thin plate under tension,
Terzopoulos 1988), which continues tilted faces and the flanks of cylinders. An object at rest stands: its centre lies
over the hull of its contacts. Where the plate alone does not give that, it sags under an even load, the least with
which the object stands.
"""

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu

from poise.types import Array, Mask

_FOOT = 0.6e-3
"""m over the floor, within which a side has to be seen for the object to stand there."""
_CONTACT = 0.5e-3
"""m over the table, up to which the underside touches it."""
_TENSION, _PULL = 0.01, 1e-4
"""Of the plate, in columns: beyond 10 of them it is a membrane; far from all edges it comes down to the table."""
_ROUNDS = 20
_EDGE = 1.5
"""Cells between the lowest place that was seen and what views look through under it, at an edge of the underside."""
_RUN = 6
"""Neighbouring columns of a rim that make an edge which views look under."""
_SIDE = 0.5
"""Normal's z, up to which a point is on a side, or below."""


def underside(solid: Mask, seen: tuple[Array, Array], floor: float, low: Array, cell: float) -> Array:
    """(X, Y) m, height of the underside of each column over the table; 0 where the object stands, or nothing is known.

    Args:
        solid: (X, Y, Z) cells that may be object, without those that views look through.
        seen: (N, 3) m, points over the plane, and their normals.
        floor: m, below which points are the table's.
        low, cell: m, corner of the first cell, and size of cells.
    """
    covered: Mask = np.asarray(solid.any(axis=2))
    lowest = _lowest(covered.shape, *seen, low, cell)
    stands = covered & (ndimage.minimum_filter(lowest, 3) < floor + _FOOT)
    looked_under = low[2] + cell * solid.argmax(axis=2)
    under = _not_beside(covered & ~solid[..., 0], ndimage.binary_erosion(covered))
    hovers = under & (lowest < looked_under + _EDGE * cell) & ~stands
    if not hovers.any():
        return np.zeros(covered.shape)
    plate, sag = _plate(covered, np.where(hovers, lowest, 0.0), stands | hovers)
    weights = solid.sum(axis=2) * covered
    centre = np.array([(weights * axis).sum() for axis in np.indices(covered.shape)]) / weights.sum()
    load = 0.0
    if not _at_rest(covered, plate, centre):
        least, load = 0.0, 1.0 / max(float(sag.max()), 1e-12) * float(plate.max())
        for _ in range(_ROUNDS):
            middle = (least + load) / 2
            if _at_rest(covered, plate - middle * sag, centre):
                load = middle
            else:
                least = middle
    return np.where(covered, np.maximum(plate - load * sag, 0.0), 0.0)


def _not_beside(under: Mask, inner: Mask) -> Mask:
    """The columns (X, Y) of those that views look under, without single ones of the rim.

    The cells of a rim are partly beside the object. What views see farther inwards, or along an edge, is under it.

    Args:
        under: (X, Y) columns that views look under.
        inner: (X, Y) columns that are not on the rim.
    """
    edges = ndimage.label(under, np.ones((3, 3)))[0]
    long = np.bincount(edges.ravel()) >= _RUN
    return np.asarray(under & (long[edges] | ndimage.binary_dilation(under & inner, np.ones((3, 3)))))


def _lowest(shape: tuple[int, ...], points: Array, normals: Array, low: Array, cell: float) -> Array:
    """(X, Y) m, the lowest that was seen of sides in each column; infinity without any."""
    side = normals[:, 2] < _SIDE
    column = np.floor((points[side, :2] - low[:2]) / cell).astype(int)
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest, (column[:, 0], column[:, 1]), points[side, 2])
    return lowest


def _plate(covered: Mask, heights: Array, fixed: Mask) -> tuple[Array, Array]:
    """(X, Y) heights between those that are fixed, and how far an even load of 1 pulls them down."""
    number = np.cumsum(covered.ravel()).reshape(covered.shape) - 1
    count = int(covered.sum())
    pairs = [np.zeros((2, 0), int)]
    for one, other in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        both = covered[one] & covered[other]
        pairs.append(np.stack([number[one][both], number[other][both]]))
    i, j = np.concatenate(pairs, axis=1)
    ones = np.ones(2 * len(i))
    links = coo_array((ones, (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(count, count)).tocsr()
    bend = diags_array(np.asarray(links.sum(axis=1)).ravel()) - links
    known = fixed[covered].astype(float)
    system = bend @ bend + _TENSION * bend + diags_array(known + _PULL)
    right = np.stack([known * heights[covered], 1.0 - known], axis=1)
    solved = splu(system.tocsc()).solve(right)
    answer = np.zeros((2, *covered.shape))
    answer[:, covered] = solved.T
    return answer[0], answer[1]


def _at_rest(covered: Mask, heights: Array, centre: Array) -> bool:
    """Whether the columns that touch the table are around a place (2,), in columns."""
    offset = np.argwhere(covered & (heights < _CONTACT)) - centre
    if len(offset) < 2:
        return False
    angles = np.sort(np.arctan2(offset[:, 1], offset[:, 0]))
    return bool(np.diff(np.append(angles, angles[0] + 2 * np.pi)).max() < np.pi)
