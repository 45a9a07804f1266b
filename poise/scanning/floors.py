"""How high the floor of a hollow is where no view sees it: it continues the floor that was seen beside it.

What no view looks through counts as object, so that the shadow of a rim stands on the floor of a mug as a heap. The
floor beside the heap continues below it as a membrane, which ends freely at the walls of the hollow.
"""

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu

from poise.types import Array, Mask

_OVER = 1.5
"""Cells by which a seen place may be higher than what the views leave beside it, to continue there."""
_NEAR = 3.0
"""Columns within which the height of a level one is that of others, too."""
_WALLS = 0.2
"""Share of the border of a shadow that is higher than it, from which on the shadow is that of walls."""
_LEAST = 4
"""Columns of a shadow, at the least: smaller ones change nothing."""
_BESIDE = ((0, 1), (0, -1), (1, 1), (1, -1))
"""Axis and shift of the four neighbours of a column."""


def continued(tops: Array, level: Mask, others: Mask, cell: float) -> tuple[Array, Mask]:
    """Heights (X, Y) m and level columns, with those of others which are as high as level ones near them.

    Args:
        tops, level, cell: as of `floors`.
        others: (X, Y) columns whose top was seen.
    """
    apart, near = ndimage.distance_transform_edt(~level, return_indices=True)
    height = tops[tuple(near)]
    more = others & ~level & (apart < _NEAR) & (height < tops + _OVER * cell)
    return np.where(more, height, tops), level | more


def floors(tops: Array, level: Mask, guessed: Mask, cell: float) -> Array:
    """(X, Y) m, the likely height of each column: `tops`, or the floor that continues below a shadow.

    Args:
        tops: (X, Y) m, height up to which each column may be object; -inf for columns that have no object.
        level: (X, Y) columns whose top was seen and faces upwards.
        guessed: (X, Y) columns whose top no view saw.
        cell: m, size of the columns.
    """
    found = tops.copy()
    shadows, _ = ndimage.label(guessed)
    for number, part in enumerate(ndimage.find_objects(shadows), 1):
        if np.count_nonzero(shadows[part] == number) < _LEAST:
            continue
        wider = tuple(slice(max(along.start - 1, 0), along.stop + 1) for along in part)
        shadow = shadows[wider] == number
        found[wider] = np.where(shadow, _below(tops[wider], shadow, level[wider], cell), found[wider])
    return found


def _below(tops: Array, shadow: Mask, level: Mask, cell: float) -> Array:
    """(X, Y) m, the floor below one shadow; its tops where nothing continues there, or no wall casts it."""
    pairs = np.concatenate([_pairs(shadow, axis, shift) for axis, shift in _BESIDE], axis=1)
    within = shadow.ravel()[pairs[1]]
    inner, border = pairs[:, within], pairs[:, ~within]
    flat = tops.ravel()
    higher = flat[border[1]] > flat[border[0]] + _OVER * cell
    lower = border[:, ~higher & level.ravel()[border[1]]]
    if not lower.size or np.mean(higher) < _WALLS:
        return tops
    number = np.cumsum(shadow.ravel()) - 1
    size = int(shadow.sum())
    links = coo_array((np.ones(inner.shape[1]), (number[inner[0]], number[inner[1]])), shape=(size, size)).tocsr()
    known = np.bincount(number[lower[0]], minlength=size).astype(float)
    heights = np.bincount(number[lower[0]], flat[lower[1]], minlength=size)
    system = diags_array(np.asarray(links.sum(axis=1)).ravel() + known) - links
    solved = tops.copy()
    solved[shadow] = np.minimum(splu(system.tocsc()).solve(heights), tops[shadow])
    return solved


def _pairs(shadow: Mask, axis: int, shift: int) -> Array:
    """(2, P) numbers of the columns of a shadow, and of their neighbours on one side."""
    numbers = np.arange(shadow.size).reshape(shadow.shape)
    beside = np.roll(numbers, -shift, axis)
    inside = shadow.copy()
    edge: list[slice | int] = [slice(None), slice(None)]
    edge[axis] = -1 if shift > 0 else 0
    inside[tuple(edge)] = False
    return np.stack([numbers[inside], beside[inside]])
