"""Friction of a patch under uniform pressure: its limit surface over sliding and turning in its plane."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from poise.assembly.contact import Interface, triangle_areas
from poise.geometry import plane_axes
from poise.types import Array, Indices

_QUADRATURE = 500
# Grid of the table of normal forces needed: azimuth of the force, and elevation of the moment above it.
_TABLE = 33
_CORNER_COLUMNS, _CORNER_ROWS = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
_ALIKE = 1e-8
"""Lengths and areas that differ by less, relative to a patch, are equal."""
_FEW = 64
"""Questions up to which the table is filled only where they are."""


@dataclass(frozen=True, eq=False)
class Cells:
    """A patch as a few cells, each sliding as a whole and turning as a ring.

    A motion with velocity v at a cell and turning rate w costs weights[k] * |(v, spins[k] w)| there: together the
    cells follow the limit surface of uniform pressure to 2 or 3 %, and pure turning exactly.

    Args:
        weights: (M,) shares of the normal force, sum 1.
        places: (M, 2) in the plane, from the centroid.
        spins: (M,) radii.
    """

    weights: Array
    places: Array
    spins: Array


@dataclass(frozen=True, eq=False)
class FrictionSurface:
    """The forces and moments that friction of coefficient 1 resists under a unit normal force, uniformly pressed.

    A convex set of (f_u, f_v, moment about the centroid), given by its support function: the mean of |v + w x r| over
    the patch (Goyal, Ruina, Papadopoulos 1991, "Planar sliding with dry friction"). Lengths are in units of one's own.

    Args:
        points: (P, 2) from the centroid.
        weights: (P,) share of the area of each, sum 1.
        sides: (2, 2) vectors along the longer and the shorter sides of a rectangle; None: another shape.
    """

    points: Array
    weights: Array
    sides: Array | None = None

    @cached_property
    def radius(self) -> float:
        """Moment resisted when turning about the centroid: the mean distance from it (2/3 of a disc's radius)."""
        return float(self.weights @ np.linalg.norm(self.points, axis=1)) or 1e-12

    def dissipation(self, velocity: Array, turning: Array) -> Array:
        """(D,) mean sliding speed for velocities (D, 2) of the centroid and turning rates (D,)."""
        # |v + w x r|^2 = |v|^2 + 2 w (v x r) + w^2 |r|^2: one product of matrices, and no other array of its size.
        square = np.sum(velocity**2, axis=1)
        motions = np.stack([square, 2 * turning * velocity[:, 1], -2 * turning * velocity[:, 0], turning**2], axis=1)
        x, y = self.points.T
        speeds = motions @ np.stack([np.ones_like(x), x, y, x * x + y * y])
        np.sqrt(np.maximum(speeds, 0.0, out=speeds), out=speeds)
        return np.asarray(speeds @ self.weights)

    @cached_property
    def _motions(self) -> Array:
        """(D, 3) motions (v, w * radius) of unit dissipation, all around."""
        lift, turn = np.meshgrid(np.pi / 2 * np.arange(24) / 24, 2 * np.pi * np.arange(48) / 48, indexing="ij")
        half = np.stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)], axis=2)
        first, like = self._azimuths(48)
        some = np.vstack([half[:, first].reshape(-1, 3), [0.0, 0.0, 1.0]])
        speeds = self.dissipation(some[:, :2], some[:, 2] / self.radius)
        speeds[speeds == 0] = 1.0  # a point turns against nothing: its radius of next to nothing says that
        half = half / speeds[:-1].reshape(24, -1)[:, like, None]
        half = np.vstack([half.reshape(-1, 3), [0.0, 0.0, 1.0 / speeds[-1]]])
        return np.concatenate([half, -half])

    def _azimuths(self, count: int) -> tuple[Indices, Indices]:
        """Which of `count` azimuths around have to be asked, and (count,) the number of one of these that each is like.

        A rectangle along the axes is mirrored by both.
        """
        every = np.arange(count)
        if self.sides is None or np.abs(self.sides).min(axis=1).max() > _ALIKE:
            return every, every
        half = np.minimum(every, count - every)
        return every[: count // 4 + 1], np.minimum(half, count // 2 - half)

    @cached_property
    def _table(self) -> Array:
        """(_TABLE, _TABLE) normal force needed for unit vectors (f, moment / radius), by azimuth and by elevation."""
        first, like = self._azimuths(_TABLE - 1)
        azimuth = np.linspace(0, 2 * np.pi, _TABLE)[first, None]
        lift = np.linspace(0, np.pi / 2, _TABLE)
        motions = self._motions[: len(self._motions) // 2]  # the others are their opposites
        flat = np.concatenate([np.cos(azimuth), np.sin(azimuth)], axis=1) @ motions[:, :2].T
        table, sums = np.empty((len(first), _TABLE)), np.empty_like(flat)
        for column, angle in enumerate(lift.tolist()):
            np.multiply(flat, math.cos(angle), out=sums)
            sums += math.sin(angle) * motions[:, 2]
            table[:, column] = np.maximum(sums.max(axis=1), -sums.min(axis=1))
        return np.asarray(table[np.append(like, like[0])])

    def _known(self, column: Indices, row: Indices) -> Array:
        """`_table`, of which a few questions fill in only the corners of the cells (...) that they are in."""
        if "_table" in self.__dict__ or column.size > _FEW:
            return self._table
        corners = (column[..., None] + _CORNER_COLUMNS) * _TABLE + row[..., None] + _CORNER_ROWS
        table = self._partial.ravel()
        wanted = np.unique(corners)
        wanted = wanted[np.isnan(table[wanted])]
        azimuth, lift = 2 * np.pi / (_TABLE - 1) * (wanted // _TABLE), np.pi / 2 / (_TABLE - 1) * (wanted % _TABLE)
        loads = np.stack([np.cos(lift) * np.cos(azimuth), np.cos(lift) * np.sin(azimuth), np.sin(lift)], axis=1)
        table[wanted] = (loads @ self._motions.T).max(axis=1)
        return self._partial

    @cached_property
    def _partial(self) -> Array:
        return np.full((_TABLE, _TABLE), np.nan)

    @property
    def for_kernel(self) -> tuple[Array, Array]:
        """(T, T) normal force needed, as far as known (NaN elsewhere: the kernel fills it in), and (D, 3) motions."""
        return self._table if "_table" in self.__dict__ else self._partial, self._motions

    def normal_force_needed(self, force: Array, moment: Array) -> Array:
        """(...) normal force needed, at friction 1, to resist forces (..., 2) and moments (...) about the centroid."""
        turning = moment / self.radius
        # Opposite loads need equal normal forces.
        azimuth = np.arctan2(force[..., 1], force[..., 0]) + np.where(turning < 0, np.pi, 0.0)
        azimuth += np.where(azimuth < 0, 2 * np.pi, 0.0)
        flat = np.sqrt(force[..., 0] ** 2 + force[..., 1] ** 2)
        column = azimuth * ((_TABLE - 1) / (2 * np.pi))
        row = np.arctan2(np.abs(turning), flat) * ((_TABLE - 1) / (np.pi / 2))
        i, j = np.minimum(column.astype(np.intp), _TABLE - 2), np.minimum(row.astype(np.intp), _TABLE - 2)
        a, b = column - i, row - j
        table, at = self._known(i, j).ravel(), i * _TABLE + j
        below = table.take(at) * (1 - b) + table.take(at + 1) * b
        above = table.take(at + _TABLE) * (1 - b) + table.take(at + (_TABLE + 1)) * b
        # Sliding straight needs as much as the force: the table, of few motions, has up to 0.2 % less.
        return np.maximum(np.sqrt(flat**2 + turning**2) * (below * (1 - a) + above * a), flat)

    def normal_force_needed_for(self, along: float, across: float, moment: float) -> float:
        """The same for one force: arrays of one number take ten times as long."""
        turning, flat = moment / self.radius, math.hypot(along, across)
        azimuth = math.atan2(across, along) + (math.pi if turning < 0 else 0.0)
        column = (azimuth % (2 * math.pi)) * ((_TABLE - 1) / (2 * math.pi))
        row = math.atan2(abs(turning), flat) * ((_TABLE - 1) / (math.pi / 2))
        i, j = min(int(column), _TABLE - 2), min(int(row), _TABLE - 2)
        a, b = column - i, row - j
        below, above = (line[j] * (1 - b) + line[j + 1] * b for line in self._rows[i : i + 2])
        return max(math.hypot(flat, turning) * (below * (1 - a) + above * a), flat)

    @cached_property
    def _rows(self) -> list[list[float]]:
        found: list[list[float]] = self._table.tolist()
        return found

    def motion(self, force: Array, moment: float) -> Array:
        """(3,) velocity of the centroid and turning rate with which the patch slips under a load."""
        load = np.append(force, moment / self.radius)
        best = self._motions[int((self._motions @ load).argmax())]
        return np.append(best[:2], best[2] / self.radius)

    def cells(self, compact: float = 0.0) -> Cells:
        """The patch split along its principal axes into cells as long as wide; one when below `compact` widths."""
        if compact not in self._cells:
            self._cells[compact] = self._split(compact)
        return self._cells[compact]

    @cached_property
    def _cells(self) -> dict[float, Cells]:
        return {}

    def _split(self, compact: float) -> Cells:
        if self.sides is not None:
            return self._split_rectangle(self.sides, compact)
        _, axes = np.linalg.eigh((self.points * self.weights[:, None]).T @ self.points)
        along = self.points @ axes[:, ::-1]
        sides = np.ptp(along, axis=0)
        counts = _cell_counts(sides, compact)
        grid = np.floor((along - along.min(axis=0)) / np.where(sides > 0, sides, 1) * counts * (1 - 1e-9))
        _, cell = np.unique(grid @ [8.0, 1.0], return_inverse=True)
        weights: Array = np.bincount(cell, self.weights).astype(np.float64)
        some = np.maximum(weights, np.finfo(float).tiny)  # triangles without area weigh nothing
        places = np.stack([np.bincount(cell, self.weights * x) for x in self.points.T], axis=1) / some[:, None]
        square = ((self.points - places[cell]) ** 2).sum(axis=1)
        spins = np.sqrt(np.bincount(cell, self.weights * square) / some)
        return Cells(weights, places, spins * _spin_factor(weights, places, spins, self.radius))

    def _split_rectangle(self, sides: Array, compact: float) -> Cells:
        """As `_split`, without errors of quadrature: the cells of a rectangle are mirrored as it is."""
        lengths = np.linalg.norm(sides, axis=1)
        counts = _cell_counts(lengths, compact)
        places = _grid(*counts.astype(int).tolist()) @ sides
        weights = np.full(len(places), 1 / len(places))
        spins = np.full(len(places), np.linalg.norm(lengths / counts) / math.sqrt(12))
        return Cells(weights, places, spins * _spin_factor(weights, places, spins, self.radius))


def _cell_counts(sides: Array, compact: float) -> Array:
    """(2,) cells along and across a patch with sides (2,); one when its aspect is below `compact`."""
    aspect = np.sqrt(max(sides[0], 1e-12) / max(sides[1], 1e-3 * sides[0], 1e-12))
    if aspect**2 < compact:
        return np.ones(2)
    return np.asarray(np.clip(np.round([2 * aspect, 2 / aspect + 0.2]), 1, 5))


def _grid(along: int, across: int) -> Array:
    """(along across, 2) centres of equal cells of a square of side 1 around the origin."""
    x, y = np.meshgrid((np.arange(along) + 0.5) / along - 0.5, (np.arange(across) + 0.5) / across - 0.5, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _spin_factor(weights: Array, places: Array, spins: Array, radius: float) -> float:
    """The factor on the spins for which turning about the centroid costs the radius, as it should."""
    low, high = 0.0, 4.0
    for _ in range(40):
        factor = (low + high) / 2
        mean = float(weights @ np.sqrt((places**2).sum(axis=1) + (factor * spins) ** 2))
        low, high = (factor, high) if mean < radius else (low, factor)
    return low


@dataclass(frozen=True, eq=False)
class PatchFriction:
    """The friction surface of an interface at its place.

    Args:
        surface: in lengths of `size`.
        size: m.
        centroid: (3,) m.
        axes: (2, 3) in the plane.
    """

    surface: FrictionSurface
    size: float
    centroid: Array
    axes: Array


def patch_friction(interface: Interface) -> PatchFriction:
    """The friction surface of an interface; lines are pressed uniformly along their length, scattered points alike."""
    return interface.once("friction", lambda: _patch_friction(interface))


def _patch_friction(interface: Interface) -> PatchFriction:
    axes = plane_axes(interface.normal)
    if interface.area > 0:
        areas = triangle_areas(interface.triangles)
        centroid = areas @ interface.triangles.mean(axis=1) / areas.sum()
        corners = (interface.triangles - centroid) @ axes.T
    else:
        # A round side presses along its line, in the middle of the narrow region that rolling resistance takes.
        line = interface.touch is not None and len(interface.touch.points) == 2
        points = interface.touch.points if interface.touch is not None and line else interface.points
        centroid = points.mean(axis=0)
        corners = ((points - centroid) @ axes.T)[:, None]
    size = float(np.abs(corners).max()) or 1.0
    # Rounded, because stacks repeat the same patch at other places.
    scaled = np.round(corners / size, 9) + 0.0
    return PatchFriction(_surface_of(scaled.tobytes(), scaled.shape), size, centroid, axes)


@lru_cache(maxsize=512)
def _surface_of(data: bytes, shape: tuple[int, ...]) -> FrictionSurface:
    """Surface of triangles (T, 3, 2), or of a line's ends or points (T, 1, 2)."""
    corners = np.frombuffer(data).reshape(shape)
    if shape[1] == 1:
        points = corners[:, 0]
        if len(points) == 2:
            points = points[0] + ((np.arange(64) + 0.5) / 64)[:, None] * (points[1] - points[0])
        return FrictionSurface(points, np.full(len(points), 1 / len(points)))
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.abs(np.linalg.det(sides)) / 2
    rectangle = _rectangle(corners.reshape(-1, 2), areas.sum())
    if rectangle is not None:
        long, short = np.linalg.norm(rectangle, axis=1)
        across = max(1, round(math.sqrt(_QUADRATURE * short / long)))
        grid = _grid(max(1, round(_QUADRATURE / across)), across)
        return FrictionSurface(grid @ rectangle, np.full(len(grid), 1 / len(grid)), rectangle)
    places, weights = [], []
    for corner, side, share in zip(corners[:, 0], sides, areas / areas.sum(), strict=True):
        steps = max(1, int(np.ceil(np.sqrt(_QUADRATURE * share))))
        centres = _triangle_centres(steps)
        places.append(corner + centres @ side)
        weights.append(np.full(len(centres), share / len(centres)))
    return FrictionSurface(np.concatenate(places), np.concatenate(weights))


def _rectangle(corners: Array, area: float) -> Array | None:
    """(2, 2) the longer and the shorter side of the rectangle around the origin that triangles fill.

    None where triangles with these corners (C, 2) and this area make another shape.
    """
    squares = (corners**2).sum(axis=1)
    far = corners[squares.argmax()]
    others = corners[(squares > squares.max() - _ALIKE) & (np.abs(corners @ far) < squares.max() - _ALIKE)]
    if not len(others):
        return None
    sides = np.stack([far + others[0], far - others[0]])
    sides = sides[np.argsort(-np.linalg.norm(sides, axis=1), kind="stable")]
    lengths = np.linalg.norm(sides, axis=1)
    if abs(sides[0] @ sides[1]) > _ALIKE or abs(lengths.prod() - area) > _ALIKE or lengths[1] < _ALIKE:
        return None
    inside = np.abs(corners @ (sides / lengths[:, None]).T) <= lengths / 2 + _ALIKE
    return sides if inside.all() else None


@lru_cache(maxsize=64)
def _triangle_centres(steps: int) -> Array:
    """(steps^2, 2) centres of the equal triangles into which (0, 0), (1, 0), (0, 1) splits."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(steps), np.arange(steps), indexing="ij"))
    upright = i + j < steps
    upward = np.stack([i[upright], j[upright]], axis=1) + 1 / 3
    flipped = i + j < steps - 1
    downward = np.stack([i[flipped], j[flipped]], axis=1) + 2 / 3
    return np.concatenate([upward, downward]) / steps
