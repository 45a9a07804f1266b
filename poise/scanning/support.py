"""The table under an object, found with gravity, and the separate objects on it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from poise.errors import ErrorCode, InputError
from poise.scanning.camera import rotated
from poise.types import Array, Indices, Mask

_TILT = np.deg2rad(12.0)
"""A table leans no more than this against gravity."""
NEAR = 0.006
"""m from a plane within which points count for it, before its noise is known."""
_LEAST_SHARE = 0.15
"""Of the points, that have to lie in the support plane."""
_THICKEST = 0.003
"""m, one sigma: a larger value is not a plane but a cut through a body."""
_SAMPLE, _TRIES = 2500, 400
_FITTED = 30_000
CELL = 0.003
"""m, of the height map."""
_LOWEST = 0.0008
"""m: what rises less over the table is the table."""
TALLEST = 0.6
_LEAST_AREA = 6e-5
"""m2: smaller clusters are not objects."""
_MOST = 50
"""Number of objects that are distinguished, the largest."""
_JOIN = 2
"""Cells between two pieces of one object that may be empty."""
_REMEDY = (
    "put the object on a table that the camera sees around it, and check that the base frame's z is up and that the"
    " hand-eye transform is the camera's"
)


@dataclass(frozen=True, eq=False)
class Plane:
    """normal . x = offset, m; the normal points up.

    Args:
        thickness: m, one sigma of the points about it: noise of depth, and how well the poses agree.
    """

    normal: Array
    offset: float
    thickness: float

    @property
    def tolerance(self) -> float:
        """m from it, up to which points may be points of it."""
        return max(NEAR, 3 * self.thickness)

    def heights(self, points: NDArray[np.floating]) -> NDArray[np.floating]:
        """(N,) m of points (N, 3) above it."""
        return self.placed(points)[:, 2]

    def placed(self, points: NDArray[np.floating]) -> NDArray[np.floating]:
        """(N, 3) m along the plane's axes, the last one the height above it."""
        return rotated(points, self.axes) - np.array([0, 0, self.offset], points.dtype)

    @cached_property
    def axes(self) -> Array:
        """(3, 3) rows: two directions along the plane, and its normal; level ones are the world's own x and y."""
        x = np.array([1.0, 0.0, 0.0]) - self.normal[0] * self.normal
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(self.normal, x), self.normal])


def find_plane(points: Array, up: Array, rng: np.random.Generator) -> Plane:
    """The largest plane that is about level (RANSAC, Fischler and Bolles 1981, with gravity as a prior).

    Args:
        points: (N, 3) m.
        up: (3,) unit vector against gravity.
        rng: draws the samples.

    Raises:
        InputError: SCAN_INCOMPLETE when there is none.
    """
    few = points[rng.choice(len(points), min(_SAMPLE, len(points)), replace=False)] if len(points) else points
    if len(few) < 100:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE, f"scan: only {len(few)} points have depth, no support plane shows; {_REMEDY}"
        )
    corners = few[rng.integers(len(few), size=(_TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    corners, normals = corners[length > 1e-6], normals[length > 1e-6] / length[length > 1e-6, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    apart = np.abs(few @ normals.T - np.einsum("ti,ti->t", normals, corners[:, 0]))
    shares = np.mean(apart < NEAR, axis=0)
    level = normals @ up > np.cos(_TILT)
    best = int(np.argmax(np.where(level, shares, -1.0))) if level.any() else -1
    if best < 0 or shares[best] < _LEAST_SHARE:
        other = int(np.argmax(shares))
        lean = np.rad2deg(np.arccos(np.clip(normals[other] @ up, -1, 1)))
        found = f"the largest plane leans by {lean:.0f} deg" if shares[other] > _LEAST_SHARE else "there is no plane"
        raise InputError(ErrorCode.SCAN_INCOMPLETE, f"scan: no support plane: {found}; {_REMEDY}", disagree=True)
    plane = _fitted(points, normals[best], float(normals[best] @ corners[best, 0]))
    if plane.thickness > _THICKEST:
        thick = f"what is about level is {1e3 * plane.thickness:.0f} mm thick"
        raise InputError(ErrorCode.SCAN_INCOMPLETE, f"scan: no support plane: {thick}; {_REMEDY}", disagree=True)
    return plane


def _fitted(points: Array, normal: Array, offset: float) -> Plane:
    """Least squares on what is near the plane, three times over."""
    points = points[:: max(len(points) // _FITTED, 1)]
    near = NEAR
    for _ in range(3):
        inside = points[np.abs(Plane(normal, offset, near).heights(points)) < near]
        middle = inside.mean(axis=0)
        axes = np.linalg.eigh(np.cov((inside - middle).T))[1]
        normal = axes[:, 0] if axes[:, 0] @ normal > 0 else -axes[:, 0]
        offset = float(normal @ middle)
        spread = 1.4826 * float(np.median(np.abs(Plane(normal, offset, near).heights(inside))))
        near = float(np.clip(3 * spread, 1.5e-3, NEAR))
    return Plane(normal, offset, spread)


@dataclass(frozen=True, eq=False)
class Footprint:
    """Cells of the plane, seen from above, that belong to one object.

    Args:
        plane: it stands on.
        low: (2,) m of the first cell's corner along the plane's axes.
        cells: (X, Y) the object's.
        known: (X, Y) cells in which anything was seen.
        top: m, of the highest point.
        floor: m above the plane below which points are the table's.
    """

    plane: Plane
    low: Array
    cells: Mask
    known: Mask
    top: float
    floor: float

    def holds(self, along: NDArray[np.floating], across: NDArray[np.floating], margin: int = 0) -> Mask:
        """Which points, at (N,) m along the plane's axes, are over the object."""
        cells = ndimage.binary_dilation(self.cells, iterations=margin) if margin else self.cells
        x = np.floor((along - self.low[0]) / CELL).astype(np.int32)
        y = np.floor((across - self.low[1]) / CELL).astype(np.int32)
        inside = (x >= 0) & (y >= 0) & (x < cells.shape[0]) & (y < cells.shape[1])
        return np.asarray(inside & cells[np.where(inside, x, 0), np.where(inside, y, 0)])

    @cached_property
    def corners(self) -> Array:
        """(8, 3) m in the world, of a box around it with two cells to spare."""
        rows, columns = (np.flatnonzero(self.cells.any(axis=axis)) for axis in (1, 0))
        x = self.low[0] + CELL * np.array([rows[0] - 2, rows[-1] + 3])
        y = self.low[1] + CELL * np.array([columns[0] - 2, columns[-1] + 3])
        z = self.plane.offset + np.array([-0.003, self.top + 0.006])
        box = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
        return box @ self.plane.axes


def objects_on(points: Array, plane: Plane) -> tuple[list[Footprint], Array]:
    """What rises over the plane, each thing by itself, the largest first, and (K, 3) m of their middles.

    Raises:
        InputError: EMPTY when nothing does.
    """
    placed = plane.placed(points)
    flat, heights = placed[:, :2].astype(np.float64), placed[:, 2].astype(np.float64)
    # What is farther below is a mirror image in the plane, or the floor; the mean of a cell would fall with it.
    over = (heights > -plane.tolerance) & (heights < TALLEST)
    flat, heights = flat[over], heights[over]
    low = np.quantile(flat, 0.001, axis=0) - CELL
    high = np.minimum(np.quantile(flat, 0.999, axis=0) + CELL, low + 4.0)
    shape = np.ceil((high - low) / CELL).astype(int)
    cell = np.floor((flat - low) / CELL).astype(np.int64)
    inside = np.all((cell >= 0) & (cell < shape), axis=1)
    number, heights = (cell[:, 0] * shape[1] + cell[:, 1])[inside], heights[inside]
    count = np.bincount(number, minlength=int(shape.prod()))
    mean = np.bincount(number, heights, minlength=len(count)) / np.maximum(count, 1)
    level = mean[(count > 2) & (np.abs(mean) < NEAR)]
    spread = 1.4826 * float(np.median(np.abs(level))) if len(level) else plane.thickness
    floor = max(_LOWEST, 3 * spread)
    known = (count > 0).reshape(shape)
    raised = ((count > 1) & (mean > floor)).reshape(shape)
    # A few points at the edges of other things float over the table: what is low has to rise by most of its points.
    most = np.bincount(number, heights > floor, minlength=len(count)) > 0.5 * count
    solid = raised & (most | (mean > NEAR)).reshape(shape)
    return _things(plane, low, (raised, solid), known, (number, heights), floor)


def _things(
    plane: Plane, low: Array, raised_solid: tuple[Mask, Mask], known: Mask, seen: tuple[Indices, Array], floor: float
) -> tuple[list[Footprint], Array]:
    """Footprints of the pieces of a height map: its raised cells, of which the solid ones say what is one piece."""
    raised, solid = (ndimage.binary_opening(cells, np.ones((2, 2))) for cells in raised_solid)
    labels = _separated(_pieces(raised), _pieces(solid) * solid)
    areas = np.bincount(labels[raised], minlength=labels.max() + 1) * CELL**2
    order = [piece for piece in np.argsort(-areas[1:], kind="stable")[:_MOST] + 1 if areas[piece] >= _LEAST_AREA]
    if not order:
        raise InputError(
            ErrorCode.EMPTY,
            f"scan: nothing rises more than {1e3 * floor:.1f} mm over the support plane that was found; aim the camera"
            " at the object and the table around it, or, if it is black, shiny or of glass, powder it",
        )
    number, heights = seen
    footprints, middles = [], []
    for piece in order:
        cells = labels == piece
        over = cells.ravel()[number] & (heights > floor)
        footprints.append(Footprint(plane, low, cells, known, float(np.quantile(heights[over], 0.998)), floor))
        middle = low + CELL * (np.argwhere(cells & raised).mean(axis=0) + 0.5)
        middles.append(plane.axes.T @ np.array([*middle, plane.offset + footprints[-1].top / 2]))
    return footprints, np.array(middles)


def _pieces(cells: Mask) -> Indices:
    """(X, Y) numbers of the pieces of a map, with the cells around them; 0 elsewhere."""
    return np.asarray(ndimage.label(ndimage.binary_dilation(cells, iterations=_JOIN), np.ones((3, 3)))[0])


def _separated(labels: Indices, solid: Indices) -> Indices:
    """The labels of pieces, where several solid pieces are in one, each with the cells that are nearest to it."""
    areas = np.bincount(solid.ravel()) * CELL**2
    out = labels.copy()
    large = (solid > 0) & (areas[solid] >= _LEAST_AREA)
    pairs = np.unique(np.stack([labels[large], solid[large]]), axis=1)
    for piece in np.flatnonzero(np.bincount(pairs[0]) > 1).tolist():
        own = np.where(labels == piece, solid, 0)
        own[areas[own] < _LEAST_AREA] = 0
        nearest = ndimage.distance_transform_edt(own == 0, return_distances=False, return_indices=True)
        out[labels == piece] = (int(out.max()) + own[tuple(nearest)])[labels == piece]
    return np.unique(out, return_inverse=True)[1].reshape(out.shape)
