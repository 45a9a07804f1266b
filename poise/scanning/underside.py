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
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from poise.types import Array, Mask

_FOOT = 0.6e-3
"""m over the floor, within which a side has to be seen for the object to stand there."""
_CONTACT = 0.5e-3
"""m over the table, up to which the underside touches it."""
_TENSION, _PULL, _CARRIED = 0.01, 1e-4, 1e-7
"""Of the plate, in columns: beyond 10 of them it is a membrane; far from all edges it comes down to the table, but not
where others carry it."""
_ROUNDS = 20
_EDGE = 1.5
"""Cells between the lowest place that was seen and what views look through under it, at an edge of the underside."""
_RUN = 6
"""Neighbouring columns of a rim that make an edge which views look under."""
_STEP, _FLAT = 2.5, 0.3
"""Cells that the top of an object rises between two columns, at a step; and the share of it beside the step."""
_BEHIND = 0.75
"""Cells behind the surface of a side, where the column is of what it bounds."""
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
    tops = cell * (solid.shape[2] - solid[..., ::-1].argmax(axis=2))
    lowest = _lowest(tops, *seen, low, cell)
    stands = covered & (_lowest_beside(lowest, tops, _STEP * cell) < floor + _FOOT)
    looked_under = low[2] + cell * solid.argmax(axis=2)
    under = _not_beside(covered & ~solid[..., 0], ndimage.binary_erosion(covered))
    hovers = under & (lowest < looked_under + _EDGE * cell) & ~stands
    if not hovers.any():
        return np.zeros(covered.shape)
    edges = (lowest + np.minimum(lowest, looked_under)) / 2  # they end between what is seen and what is looked through
    plate, sag = _plate(covered, np.where(hovers, edges, 0.0), (stands, hovers), tops / (_STEP * cell))
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


def _lowest(tops: Array, points: Array, normals: Array, low: Array, cell: float) -> Array:
    """(X, Y) m, the lowest that was seen of sides in each column; infinity without any.

    A side in the column of a shelf, at the border of the wall behind the side, is that of the wall.
    """
    side = normals[:, 2] < _SIDE
    place, inwards = points[side, :2], -_BEHIND * cell * normals[side, :2]
    most = np.array(tops.shape) - 1
    here, behind = (np.floor((at - low[:2]) / cell).astype(int).clip(0, most) for at in (place, place + inwards))
    apart = np.abs(tops[tuple(here.T)] - tops[tuple(behind.T)]) > _STEP * cell
    column = np.where(apart[:, None], behind, here)
    lowest = np.full(tops.shape, np.inf)
    np.minimum.at(lowest, (column[:, 0], column[:, 1]), points[side, 2])
    return lowest


def _lowest_beside(lowest: Array, tops: Array, step: float) -> Array:
    """(X, Y) m, the lowest of a column and of those around it whose tops (X, Y) m are as high within a step, m."""
    found = lowest.copy()
    padded, heights = np.pad(lowest, 1, constant_values=np.inf), np.pad(tops, 1)
    for x, y in np.ndindex(3, 3):
        part = np.s_[x : x + lowest.shape[0], y : y + lowest.shape[1]]
        found = np.where(np.abs(heights[part] - tops) < step, np.minimum(found, padded[part]), found)
    return found


def _steps(covered: Mask, tops: Array, axis: int) -> Mask:
    """Pairs of neighbours along an axis between which the top jumps, and which are flat on both sides of that."""
    heights = np.moveaxis(np.where(covered, tops, np.nan), axis, 0)
    change = np.abs(np.diff(heights, axis=0))
    jump = np.zeros(change.shape, bool)
    with np.errstate(invalid="ignore"):
        jump[1:-1] = (change[1:-1] > 1) & (np.maximum(change[:-2], change[2:]) < _FLAT * change[1:-1])
    return np.moveaxis(jump, 0, axis)


def _plate(covered: Mask, heights: Array, fixed: tuple[Mask, Mask], tops: Array) -> tuple[Array, Array]:
    """(X, Y) heights between those that are fixed, and how far an even load of 1 pulls them down.

    The plate is cut where the tops (X, Y), in steps, jump: a shelf between walls goes on below its own top. Where no
    column of such a part stands, but others do, the walls carry it. What was seen of an edge ends above its underside,
    less so in the lowest of neighbouring columns: nothing else pulls a plate down that is cut.

    Args:
        covered: (X, Y) columns of the object.
        heights: (X, Y) m, of fixed columns.
        fixed: (X, Y) columns that stand, and those that hover.
        tops: (X, Y) height of the columns, in steps.
    """
    number = np.cumsum(covered.ravel()).reshape(covered.shape) - 1
    count = int(covered.sum())
    pairs, cut = [np.zeros((2, 0), int)], False
    for axis, (one, other) in enumerate(((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:]))):
        steps = covered[one] & covered[other] & _steps(covered, tops, axis)
        cut |= bool(steps.any())
        both = covered[one] & covered[other] & ~steps
        pairs.append(np.stack([number[one][both], number[other][both]]))
    i, j = np.concatenate(pairs, axis=1)
    ones = np.ones(2 * len(i))
    links = coo_array((ones, (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(count, count)).tocsr()
    bend = diags_array(np.asarray(links.sum(axis=1)).ravel()) - links
    stands, hovers = fixed[0][covered], fixed[1][covered]
    known = (stands | hovers).astype(float)
    part = connected_components(links, directed=False)[1]
    carried = stands.any() & (np.bincount(part, stands) == 0) & (np.bincount(part, hovers) > 0)
    pull = np.where(carried[part], _CARRIED, _PULL)
    system = bend @ bend + _TENSION * bend + diags_array(known + pull)
    edges = _lowest_beside(np.where(fixed[1], heights, np.inf), tops, 1.0)[covered]
    right = np.stack([known * np.where(cut & hovers, edges, heights[covered]), 1.0 - known], axis=1)
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
