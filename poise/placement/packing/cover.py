"""A body covered by upright boxes: exact for what is made of upright boxes, a grid of columns for everything else."""

from dataclasses import dataclass

import numpy as np

from poise.assembly.scene import Polyhedron
from poise.errors import InputError
from poise.types import Array, Indices, Mask
from poise.worlds import convex_pieces

_COLUMNS = 12
"""Columns along the longer side of a footprint that is no rectangle."""
_SAMPLES = 3
"""Heights looked at along each side of a column."""
_AT_ONCE = 20_000
"""Cells under triangles that are looked at together."""
_LEVEL = 1e-6
"""m: heights that differ by less are equal."""


@dataclass(frozen=True, eq=False)
class Cover:
    """Upright boxes that contain a body.

    Args:
        low, high: (K, 3) m, their corners, height last.
    """

    low: Array
    high: Array

    @property
    def bounds(self) -> Array:
        """(2, 3) m."""
        return np.stack([self.low.min(axis=0), self.high.max(axis=0)])

    def moved(self, by: Array) -> "Cover":
        return Cover(self.low + by, self.high + by)

    @classmethod
    def joined(cls, covers: "list[Cover]") -> "Cover":
        return cls(np.concatenate([c.low for c in covers]), np.concatenate([c.high for c in covers]))


def cover_of(polyhedron: Polyhedron, corners: Array, columns: int = _COLUMNS) -> Cover:
    """Boxes around a solid.

    Args:
        polyhedron: its surface.
        corners: (V, 3) m, its vertices where they are, height last.
        columns: along the longer side of what is not made of upright boxes.
    """
    boxes = _upright_boxes(polyhedron, corners)
    return boxes if boxes is not None else columns_of(polyhedron, corners, columns)


def _upright_boxes(polyhedron: Polyhedron, corners: Array) -> Cover | None:
    """The boxes that a solid is made of; None when it is not."""
    turned = np.linalg.lstsq(_homogeneous(polyhedron.vertices), corners, rcond=None)[0]
    if not np.all(np.isclose(np.abs(polyhedron.normals @ turned[:3]).max(axis=1), 1.0, atol=1e-6)):
        return None
    try:
        pieces = convex_pieces(polyhedron)
    except InputError:
        return None
    placed = [_homogeneous(piece) @ turned for piece in pieces]
    return Cover(np.array([p.min(axis=0) for p in placed]), np.array([p.max(axis=0) for p in placed]))


def _homogeneous(points: Array) -> Array:
    return np.column_stack([points, np.ones(len(points))])


def columns_of(polyhedron: Polyhedron, corners: Array, columns: int) -> Cover:
    """Columns from the lowest to the highest point of the surface over each cell of a grid; equal ones are joined."""
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    cell = float(size[:2].max()) / columns
    count = np.maximum(np.ceil(size[:2] / cell - 1e-9), 1).astype(int)
    fine = cell / _SAMPLES
    top = heights_over(polyhedron, corners, low[:2], count * _SAMPLES, fine)
    bottom = -heights_over(polyhedron, corners * [1, 1, -1], low[:2], count * _SAMPLES, fine)
    shape = (count[0], _SAMPLES, count[1], _SAMPLES)
    highest = top.reshape(shape).max(axis=(1, 3))
    lowest = bottom.reshape(shape).min(axis=(1, 3))
    return joined_columns(lowest, highest, low[:2], cell)


def joined_columns(lowest: Array, highest: Array, origin: Array, cell: float) -> Cover:
    """Boxes over rectangles of cells whose columns are equal.

    Args:
        lowest, highest: (nx, ny) m; columns with a highest point of minus infinity are left out.
        origin: (2,) m, of the first cell.
        cell: m.
    """
    left: Mask = highest > -np.inf
    found = []
    for i, j in np.argwhere(left):
        if not left[i, j]:
            continue
        same: Mask = left & _equal(highest, highest[i, j]) & _equal(lowest, lowest[i, j])
        along = j + int(np.argmin(np.append(same[i, j:], False)))
        rows = same[i:, j:along].all(axis=1)
        across = i + int(np.argmin(np.append(rows, False)))
        left[i:across, j:along] = False
        first, last = (origin + cell * np.array(corner) for corner in ((i, j), (across, along)))
        found.append((*first, lowest[i, j], *last, highest[i, j]))
    boxes = np.array(found).reshape(-1, 6)
    return Cover(boxes[:, :3], boxes[:, 3:])


def _equal(heights: Array, height: float) -> Mask:
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(heights - height) < _LEVEL) | (heights == height))


def heights_over(polyhedron: Polyhedron, corners: Array, origin: Array, count: Array, cell: float) -> Array:
    """(nx, ny) m, greatest height of a surface over the middle of each cell; minus infinity where there is none.

    Args:
        polyhedron: whose triangles.
        corners: (V, 3) m, its vertices, height last.
        origin: (2,) m, corner of the first cell.
        count: (2,) cells.
        cell: m.
    """
    heights = np.full(count, -np.inf)
    triangles = corners[polyhedron.triangles]
    first = np.maximum(np.ceil((triangles.min(axis=1)[:, :2] - origin) / cell - 0.5 - _LEVEL), 0).astype(int)
    last = np.minimum(np.floor((triangles.max(axis=1)[:, :2] - origin) / cell + 0.5 + _LEVEL), count).astype(int)
    sides = np.maximum(last - first, 0)
    (x0, y0), (x1, y1), (x2, y2) = (triangles[:, k, :2].T for k in range(3))
    flat = np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) < 1e-14
    cells = np.where(flat, 0, sides.prod(axis=1))
    seen = np.flatnonzero(cells)
    for part in np.split(seen, np.flatnonzero(np.diff(np.cumsum(cells[seen]) // _AT_ONCE)) + 1):
        _raise_to(heights, triangles[part], first[part], sides[part], origin, cell)
    return heights


def _raise_to(heights: Array, triangles: Array, first: Indices, sides: Indices, origin: Array, cell: float) -> None:
    """Raise cells to (T, 3, 3) triangles over them, of which each is looked at in a rectangle of cells, (T, 2)."""
    cells = sides.prod(axis=1)
    of = np.repeat(np.arange(len(cells)), cells)
    number = np.arange(len(of)) - np.repeat(np.cumsum(cells) - cells, cells)
    i, j = first[of, 0] + number // sides[of, 1], first[of, 1] + number % sides[of, 1]
    x, y = origin[0] + cell * (i + 0.5), origin[1] + cell * (j + 0.5)
    a, b, c = np.moveaxis(triangles if len(triangles) == 1 else triangles[of], 1, 0)
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    u = ((b[:, 0] - x) * (c[:, 1] - y) - (c[:, 0] - x) * (b[:, 1] - y)) / twice
    v = ((c[:, 0] - x) * (a[:, 1] - y) - (a[:, 0] - x) * (c[:, 1] - y)) / twice
    w = 1 - u - v
    inside = (u >= -1e-9) & (v >= -1e-9) & (w >= -1e-9)
    height = u * a[:, 2] + v * b[:, 2] + w * c[:, 2]
    np.maximum.at(heights.reshape(-1), (i * heights.shape[1] + j)[inside], height[inside])
