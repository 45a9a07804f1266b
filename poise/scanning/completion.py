"""The side of an object that no camera sees: what is hidden over the table counts as object, down to the table.

The thesis (section 3.2.4) projects the cloud onto the table, which makes a flat bottom. Here only what the views leave
hidden is filled: the space under what was seen, without what some view looks through (Kutulakos and Seitz 2000), so
that the gap under a shaft stays open as far as it was seen into.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from poise.scanning.floors import continued, floors
from poise.scanning.frames import View
from poise.scanning.fusion import BAND, Surface, fewest_views
from poise.scanning.looking import each, lookup
from poise.scanning.support import CELL, Footprint
from poise.scanning.underside import underside
from poise.types import Array, Indices, Mask

_VIEWS = 64
"""That are asked whether they look through."""
_FREE_VIEWS = 2
_BEHIND = 0.002
"""m behind what views see, within which they speak against free space: what is deeper may be air under a thin arm."""
_FREE = 0.0007
"""m that views have to see behind a place, on average, for it to be free."""
_NEAR, _ALIKE = 2.5, 0.3
_VERY_NEAR, _OPPOSITE = 1.3, -0.5
"""Cells from a seen point, and cosine between normals, within which a hidden face is that of the seen surface."""
_THIN = 2.0
"""Cells over the underside below which every seen point of a top gets its own below it."""
_UNDERSIDE = -0.7
"""Normal's z below which a face looks at the table."""
_STANDING, _GUESSED, _FAR, _HANGING = 0.2e-3, 0.5e-3, 0.2, 0.3
"""m, one sigma of a bottom around which the surface was seen down to the table, and of anything else; what each m to
the nearest point that was seen adds on the sides, and each m over the table under an underside: fitted to 37 sweeps of
benchmarks/sweep_objects.py and benchmarks/stereo_sweeps.py. What is hidden of one object is off together: as errors
that are independent beyond 1 to 4 cm, the same numbers describe these sweeps worse."""
_HEAP = 0.25
"""Of the height of a shadow that was taken off a floor: one sigma of the floor."""
_AIR_NEAR = 3.0
"""Cells from a seen point, within which it is kept where views look through: larger gaps are found without that."""
_FOOT, _BESIDE = 0.6e-3, 5
"""m over the floor, and cells, within which a side has to be seen for the object to stand there."""
_MOST_CELLS = 1_500_000
_SIDES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


@dataclass(frozen=True, eq=False)
class Completed:
    """What was not seen.

    Args:
        points: (M, 3) m in the world, on the hidden surface.
        normals: (M, 3) out of the object.
        doubt: (M,) m, one sigma of where they are.
        doubtful: m3, one sigma of the volume that follows.
        volume: m3, about, of the object.
        area: m2 of the object's surface that they make up.
        hidden: the share of it that this is.
        hidden_sides: as `hidden`, of the surface without its underside.
        unknown: m2 of the table, inside and beside the object, of which nothing is known at all: glass, or shadow.
        footprint: m2 that the object covers.
        air: (K, 3) m in the world, places near seen points that views look through, on a grid.
    """

    points: Array
    normals: Array
    doubt: Array
    doubtful: float
    volume: float
    area: float
    hidden: float
    hidden_sides: float
    unknown: float
    footprint: float
    air: Array


def complete(surface: Surface, views: Sequence[View], footprint: Footprint, cell: float) -> Completed:
    """The hidden surface between what was seen and the table.

    Args:
        surface: what was seen.
        views: that saw it.
        footprint: where it stands.
        cell: m, spacing of the new points.
    """
    axes, plane = footprint.plane.axes, footprint.plane
    placed: Array = plane.placed(surface.points).astype(np.float64)
    cell = max(cell, float((np.ptp(placed, axis=0).prod() / _MOST_CELLS) ** (1 / 3)))  # something large: coarser
    low = np.append(placed[:, :2].min(axis=0) - 2 * cell, 0.0)
    shape = np.ceil((placed.max(axis=0) - low) / cell).astype(int) + np.array([3, 3, 1])
    column = np.floor((placed - low) / cell).astype(int)
    above, inside = _below_roof(column, shape)
    solid, open_ = _carved(above, views, axes, plane.offset, low, cell)
    free = low + cell * (np.argwhere(open_) + 0.5)
    free = free[np.isfinite(cKDTree(placed).query(free, distance_upper_bound=_AIR_NEAR * cell)[0])]
    seen = placed, surface.normals @ axes.T
    sunk, heap = _without_heaps(solid, column, seen, inside, low, cell)
    air = underside(solid, seen, footprint.floor, low, cell)
    solid &= low[2] + cell * (np.arange(shape[2]) + 0.5) > air[..., None]
    solid[column[:, 0], column[:, 1], column[:, 2]] = True  # what was seen is there
    points, normals = _faces(solid, low, cell)
    points[points[:, 2] < 0.5 * cell, 2] = 0.0
    hanging = _on_underside(points, normals, air, low, cell)
    heaps = _on_floor(points, normals, sunk, heap, low, cell)
    hidden = ~_seen_already(points, normals, *seen, cell)
    sides = normals[:, 2] > _UNDERSIDE
    shares = float(np.mean(hidden)), float(np.mean(hidden[sides])) if sides.any() else 0.0
    area = float(np.sum(hidden)) * cell**2
    off = _doubts(points[hidden], normals[hidden], seen, footprint.floor, low, cell)
    off = np.where(hanging[hidden], np.maximum(_GUESSED, _HANGING * points[hidden, 2]), off)
    off = np.maximum(off, _HEAP * heaps[hidden])
    doubts = float(off.sum()) * cell**2, float(np.count_nonzero(solid)) * cell**3
    points, normals, off = _under_thin(points[hidden], normals[hidden], off, seen, air, low, cell)
    in_world, free = ((places + np.array([0, 0, plane.offset])) @ axes for places in (points, free))
    covers = float(np.count_nonzero(solid.any(axis=2))) * cell**2
    known = _unknown(footprint, placed, sunk, low, cell), covers
    return Completed(in_world, normals @ axes, off, *doubts, area, *shares, *known, free)


def _below_roof(column: Indices, shape: Indices) -> tuple[Mask, tuple[Mask, Mask]]:
    """Cells (X, Y, Z) inside the outline that are not above what was seen.

    Args:
        column: (N, 3) cells of the points that were seen.
        shape: (3,) numbers of cells.

    Returns:
        The cells; (X, Y) columns inside the outline; and those of them that are far from all that was seen.
    """
    top = np.full(shape[:2], -1)
    np.maximum.at(top, (column[:, 0], column[:, 1]), column[:, 2])
    covered = ndimage.binary_fill_holes(ndimage.binary_closing(np.pad(top >= 0, 3), iterations=2))[3:-3, 3:-3]
    roof = np.where(top >= 0, top, ndimage.grey_dilation(top, 5))
    dark = covered & (roof < 0)
    roof = np.where(dark, top.max(), roof)
    return covered[..., None] & (np.arange(shape[2]) <= roof[..., None]), (covered, dark)


def _carved(
    solid: Mask, views: Sequence[View], axes: Array, offset: float, low: Array, cell: float
) -> tuple[Mask, Mask]:
    """Without the cells behind which the views see on average (a truncated signed distance, as in `fusion`).

    Returns:
        What is left; and which of the others as many views see through as have to see a point, and as a third of those
        that see anything near.
    """
    index = np.argwhere(solid)
    asked = (low + cell * (index + 0.5) + np.array([0, 0, offset])) @ axes
    chosen = [views[i] for i in np.unique(np.linspace(0, len(views) - 1, _VIEWS).round().astype(int))]

    def ask(view: View) -> tuple[Mask, Array, Mask]:
        (beyond,) = lookup([view]).beyond(asked)
        informative = beyond > -_BEHIND  # deeper is hidden
        return informative, np.where(informative, np.minimum(beyond, BAND), 0.0), beyond > _BEHIND

    answers = each(chosen, ask)
    count, distance, through = (np.sum([part[i] for part in answers], axis=0) for i in range(3))
    free = (count >= min(_FREE_VIEWS, len(views))) & (distance > _FREE * count)
    carved, open_ = solid.copy(), np.zeros_like(solid)
    carved[tuple(index[free].T)] = False
    open_[tuple(index[free & (through >= fewest_views(len(chosen))) & (3 * through > count)].T)] = True
    return carved, open_


def _faces(solid: Mask, low: Array, cell: float) -> tuple[Array, Array]:
    """Middles (F, 3) m and normals (F, 3) of the cells' sides that face outwards."""
    padded = np.pad(solid, 1)
    points, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for side in _SIDES:
        outside = ~np.roll(padded, -side, axis=(0, 1, 2))
        index = np.argwhere(padded & outside) - 1
        points.append(low + cell * (index + 0.5 + 0.5 * side))
        normals.append(np.tile(side, (len(index), 1)))
    return np.concatenate(points), np.concatenate(normals).astype(np.float64)


def _on_underside(points: Array, normals: Array, air: Array, low: Array, cell: float) -> Mask:
    """Which faces (F, 3) are of an underside over air (X, Y) m; they are moved to its height."""
    height = air[_columns(points, low, cell, air.shape)]
    hanging = (normals[:, 2] < _UNDERSIDE) & (height > 0) & (np.abs(points[:, 2] - height) <= cell)
    points[hanging, 2] = height[hanging]
    return np.asarray(hanging)


def _seen_already(points: Array, normals: Array, seen: Array, seen_normals: Array, cell: float) -> Mask:
    """Which faces lie along a surface that was seen."""
    distance, near = cKDTree(seen).query(points, k=6, distance_upper_bound=_NEAR * cell)
    there = np.isfinite(distance)
    alike = np.einsum("fi,fki->fk", normals, seen_normals[np.where(there, near, 0)])
    return np.asarray(
        np.any(there & ((alike > _ALIKE) | ((distance < _VERY_NEAR * cell) & (alike > _OPPOSITE))), axis=1)
    )


def _doubts(points: Array, normals: Array, seen: tuple[Array, Array], floor: float, low: Array, cell: float) -> Array:
    """(F,) m, one sigma of where hidden faces are.

    Under an object whose sides were seen down to the table there is hardly any air; under a shaft there may be, and
    what lies far from anything that was seen may be a hollow.
    """
    there, facing = seen
    off = np.maximum(_GUESSED, _FAR * cKDTree(there).query(points)[0])
    bottom = (normals[:, 2] < _UNDERSIDE) & (points[:, 2] < 0.5 * cell)
    off[bottom] = _GUESSED
    sides = there[facing[:, 2] < -_UNDERSIDE]
    if len(sides):
        column = np.floor((sides[:, :2] - low[:2]) / cell).astype(int)
        lowest = np.full(column.max(axis=0) + 1, np.inf)
        np.minimum.at(lowest, (column[:, 0], column[:, 1]), sides[:, 2])
        lowest = ndimage.minimum_filter(lowest, _BESIDE)
        nearest = column[cKDTree(sides[:, :2]).query(points[bottom, :2])[1]]
        stands = lowest[nearest[:, 0], nearest[:, 1]] < floor + _FOOT
        off[bottom] = np.where(stands, _STANDING, _GUESSED)
    return np.asarray(off)


def _under_thin(
    points: Array, normals: Array, off: Array, seen: tuple[Array, Array], air: Array, low: Array, cell: float
) -> tuple[Array, Array, Array]:
    """The bottom of thin plates is as dense as their top: else a point without another below it bounds no volume.

    Returns:
        The points, their normals, and one sigma of where they are, m.
    """
    there, facing = seen
    column = _columns(there, low, cell, air.shape)
    thick = there[:, 2] - air[column]
    thin = (thick > 0) & (thick < _THIN * cell) & (facing[:, 2] > -_UNDERSIDE)
    below = np.column_stack([there[thin, :2], air[column][thin]])
    if not len(below):
        return points, normals, off
    kept = cKDTree(below).query(points)[0] > cell
    down = np.tile([0.0, 0.0, -1.0], (len(below), 1))
    like = off[cKDTree(points).query(below)[1]] if len(points) else np.full(len(below), _GUESSED)
    return np.concatenate([points[kept], below]), np.concatenate([normals[kept], down]), np.append(off[kept], like)


def _columns(points: Array, low: Array, cell: float, shape: tuple[int, ...]) -> tuple[Indices, ...]:
    """Numbers of the columns of cells that points (N, 3) lie in."""
    return tuple(np.floor((points[:, :2] - low[:2]) / cell).astype(int).clip(0, np.array(shape) - 1).T)


def _without_heaps(
    solid: Mask, column: Indices, seen: tuple[Array, Array], inside: tuple[Mask, Mask], low: Array, cell: float
) -> tuple[Array, Array]:
    """Take the shadows of walls off the floors of hollows, and all of them where no floor continues far inside.

    Args:
        solid: (X, Y, Z) cells that may be object; those of shadows are removed.
        column: (N, 3) cells of the points that were seen.
        seen: (N, 3) m, the points, and their normals.
        inside: (X, Y) columns inside the outline, and those of them that are far from all that was seen.
        low, cell: m, corner of the first cell, and size of cells.

    Returns:
        (X, Y) m: the floor in columns that were changed, else infinity; and how much was taken off.
    """
    there, facing = seen
    whole = solid.copy()
    whole[column[:, 0], column[:, 1], column[:, 2]] = True
    layers = np.arange(solid.shape[2])
    highest = np.where(whole, layers, -1).max(axis=2)
    tops = np.where(highest >= 0, low[2] + cell * (highest + 1.0), -np.inf)
    index = np.argwhere(highest >= 0)
    faces = np.column_stack([low[:2] + cell * (index + 0.5), tops[highest >= 0]])
    guessed = np.zeros(highest.shape, bool)
    guessed[tuple(index.T)] = ~_seen_already(faces, np.tile([0.0, 0.0, 1.0], (len(faces), 1)), *seen, cell)
    upward = facing[:, 2] > -_UNDERSIDE
    upward &= there[:, 2] > tops[column[:, 0], column[:, 1]] - 2 * cell
    shown = np.full(highest.shape, -np.inf)
    np.maximum.at(shown, (column[upward, 0], column[upward, 1]), there[upward, 2])
    level = np.isfinite(shown) & ~guessed
    covered, dark = inside
    table = covered & (highest < 0)
    heights = np.where(level, shown, np.where(table, 0.0, tops))
    found = floors(*continued(heights, level | table, ~guessed & (highest >= 0), cell), guessed, cell)
    taken = np.zeros(tops.shape)
    taken[guessed] = tops[guessed] - found[guessed]
    floor = np.where(taken > 0, found, np.inf)
    solid &= (low[2] + cell * (layers + 0.5) < floor[..., None]) & ~(dark & (taken <= 0))[..., None]
    return floor, taken


def _on_floor(points: Array, normals: Array, floor: Array, heap: Array, low: Array, cell: float) -> Array:
    """(F,) m that were taken off over the faces (F, 3) of floors that no view saw; these are moved to their height."""
    column = _columns(points, low, cell, floor.shape)
    height = floor[column]
    lies = (normals[:, 2] > -_UNDERSIDE) & (np.abs(points[:, 2] - height) <= cell)
    points[lies, 2] = height[lies]
    return np.where(lies, heap[column], 0.0)


def _unknown(footprint: Footprint, seen: Array, floor: Array, low: Array, cell: float) -> float:
    """m2 around and inside the footprint of which nothing is known: no seen point (N, 3) m, no pixels, no floor."""
    around = ndimage.binary_dilation(footprint.cells, iterations=2)
    known = footprint.known.copy()
    under = low[:2] + cell * (np.argwhere(np.isfinite(floor)) + 0.5)
    column = np.floor((np.concatenate([seen[:, :2], under]) - footprint.low) / CELL).astype(int)
    column = column[np.all((column >= 0) & (column < known.shape), axis=1)]
    known[column[:, 0], column[:, 1]] = True
    return float(np.count_nonzero(around & ~known)) * CELL**2
