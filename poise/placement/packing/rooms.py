"""Rooms that fixed bodies enclose: parts of the ground with something higher all around."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from poise.assembly import RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import plane_axes, unit
from poise.placement.packing.cover import heights_over
from poise.types import Array, Mask

CELLS = 256
"""Along the longer side of what is looked at."""
SHALLOW = 5e-3
"""m: what is enclosed less deeply is no container."""
_LEVELS = 24
"""Heights of rims that are looked at."""
_NEXT = 5e-3
"""m between a body and walls next to it, at most."""
_WALLS = 3
"""Convex walls around a room, at least."""
_MARGIN = 4
"""Cells beside a room that is looked at again."""
_STEEP = 0.3
"""Cosine between the normal of a wall and up, at most."""
_CHOICES = 6
"""Directions of walls that are looked at, at most."""
_SECOND = 0.5
"""Volume, relative to the largest enclosed room, of another that makes the choice unclear."""


@dataclass(frozen=True, eq=False)
class Room:
    """A part of the ground that is enclosed.

    Args:
        mask: cells of it.
        rim: m, height of its walls.
        origin: (2,) m, corner of the grid.
        cell: m.
        volume: m3.
    """

    mask: Mask
    rim: float
    origin: Array
    cell: float
    volume: float

    @cached_property
    def sides(self) -> Array:
        """(2, 2) m, its lowest and highest corner."""
        rows = np.argwhere(self.mask)
        return np.stack([self.origin + self.cell * rows.min(axis=0), self.origin + self.cell * (rows.max(axis=0) + 1)])

    @property
    def fill(self) -> float:
        """Its area relative to that of the rectangle around it."""
        return float(np.sum(self.mask)) * self.cell**2 / float(np.prod(np.ptp(self.sides, axis=0)))

    @property
    def corners(self) -> Array:
        """(N, 2) m, middles of its cells."""
        return np.asarray(self.origin + self.cell * (np.argwhere(self.mask) + 0.5))


def enclosed(fixed: Sequence[RigidObject], axes: Array, body: RigidObject | None) -> Room | None:
    """The largest room that fixed bodies enclose, or the largest over one of them."""
    if not fixed:
        return None
    corners = np.concatenate([item.vertices @ axes.T for item in (fixed if body is None else [body])])
    heights, origin, cell = _heights(fixed, axes, corners[:, :2].min(axis=0), corners[:, :2].max(axis=0))
    own = np.isfinite(_heights_of(body, axes, origin, heights.shape, cell)) if body is not None else None
    rooms = _sized_rooms(heights, cell)
    if own is not None:
        rooms = [found for found in rooms if float(np.mean(own[found[2]])) > _SECOND]
    if not rooms:
        return None
    volume, level, room = max(rooms, key=lambda found: found[0])
    others = [found for found in rooms if found[0] > _SECOND * volume and not np.any(found[2] & room)]
    if others:
        raise _unclear(1 + len(others))
    return Room(room, level, origin, cell, volume)


def over_one(
    fixed: Sequence[RigidObject], up: Array, proceed: Callable[[], None]
) -> tuple[Room, Array, RigidObject] | None:
    """The largest room over a single body, with the body's axes; `proceed` is called before each body."""
    rooms = []
    for item in fixed:
        proceed()
        if _may_hold(item, fixed, up):
            axes = level_axes(up, item)
            found = enclosed(fixed, axes, item)
            if found is not None:
                rooms.append((found, axes, item))
    if not rooms:
        return None
    best = max(rooms, key=lambda room: room[0].volume)
    middles = [found.corners.mean(axis=0) @ axes[:2] for found, axes, _ in rooms]
    middle, reach = best[0].corners.mean(axis=0) @ best[1][:2], np.ptp(best[0].sides, axis=0).min() / 2
    similar = [found.volume > _SECOND * best[0].volume for found, _, _ in rooms]
    apart = [bool(np.linalg.norm(other - middle) > reach) for other in middles]
    if others := sum(s and a for s, a in zip(similar, apart, strict=True)):
        raise _unclear(1 + others)
    return best


def _unclear(count: int) -> InputError:
    return InputError(
        ErrorCode.OBJECT_INVALID,
        f"fixed bodies enclose {count} rooms or more of similar size: name the body to pack into (into)",
    )


def _may_hold(item: RigidObject, fixed: Sequence[RigidObject], up: Array) -> bool:
    """Whether a body may carry a room: it has walls of its own, or others rise over its top, on it or next to it."""
    if not item.shape.polyhedron.convex:
        return True
    own = item.vertices
    rising = 0
    for other in fixed:
        corners = other.vertices
        near = np.all((corners.min(axis=0) < own.max(axis=0) + _NEXT) & (corners.max(axis=0) > own.min(axis=0) - _NEXT))
        if other is not item and near and np.max(corners @ up) > np.max(own @ up) + SHALLOW:
            rising += 1 if other.shape.polyhedron.convex else _WALLS
    return rising >= _WALLS


def along_walls(
    fixed: Sequence[RigidObject], up: Array, axes: Array, found: Room, proceed: Callable[[], None]
) -> tuple[Room, Array]:
    """A room on a fine grid along its walls, and these axes: those of the bodies around in which it is most square.

    `proceed` is called before each body and each choice of axes.
    """
    place, reach = found.corners @ axes[:2], found.cell
    choices = {0.0: axes}
    for item in fixed:
        proceed()
        corners = (item.vertices @ axes.T)[:, :2]
        low, high = found.sides + reach * np.array([[-_MARGIN], [_MARGIN]])
        if np.all((corners.min(axis=0) < high) & (corners.max(axis=0) > low)):
            own = _wall_axes(item, up)
            angle = np.arctan2(own[0] @ axes[1], own[0] @ axes[0]) % (np.pi / 2)
            choices.setdefault(round(float(angle), 4) % round(np.pi / 2, 4), own)
    best, along = found, axes
    for choice in list(choices.values())[:_CHOICES]:
        proceed()
        flat = place @ choice[:2].T
        heights, origin, cell = _heights(
            fixed, choice, flat.min(axis=0) - _MARGIN * reach, flat.max(axis=0) + _MARGIN * reach
        )
        rooms = _sized_rooms(heights, cell)
        if rooms:
            volume, level, mask = max(rooms, key=lambda room: room[0])
            again = Room(mask, level, origin, cell, volume)
            if best is found or again.fill > best.fill + 1e-3:
                best, along = again, choice
    return best, along


def level_axes(up: Array, body: RigidObject | None) -> Array:
    """Level axes along the sides of a body, or of the world, and up."""
    sides = np.eye(3) if body is None else body.pose.rotation.T
    level = max(
        sides, key=lambda side: float(np.linalg.norm(side - (side @ up) * up)) - 1e-3 * abs(side @ np.eye(3)[1])
    )
    across = level - (level @ up) * up
    first = unit(across) if np.linalg.norm(across) > 1e-6 else plane_axes(up)[0]
    return np.stack([first, np.cross(up, first), up])


def _wall_axes(item: RigidObject, up: Array) -> Array:
    """Axes across the largest of a body's walls, and up; along its sides when it has none."""
    a, b, c = (item.vertices[item.shape.polyhedron.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    walls = (np.abs(normals @ up) < _STEEP * areas) & (areas > 0)
    if not np.any(walls):
        return level_axes(up, item)
    across = normals[walls] - np.outer(normals[walls] @ up, up)
    axes = plane_axes(up)
    angles = np.arctan2(across @ axes[1], across @ axes[0]) % (np.pi / 2)
    kinds, of = np.unique(np.round(angles, 4) % round(np.pi / 2, 4), return_inverse=True)
    largest = of == np.bincount(of, areas[walls], len(kinds)).argmax()
    first = unit(across[np.flatnonzero(largest)[0]])
    return np.stack([first, np.cross(up, first), up])


def _sized_rooms(heights: Array, cell: float) -> list[tuple[float, float, Mask]]:
    """Volume, m3, rim and cells of each room."""
    ground = heights[np.isfinite(heights)].min()
    return [
        (float(np.sum(level - np.maximum(heights[room], ground))) * cell**2, level, room)
        for level, room in _rooms(heights)
    ]


def _rooms(heights: Array) -> Iterator[tuple[float, Mask]]:
    """Each part of the ground that is enclosed by something higher, with the height of the rim."""
    levels = np.unique(np.round(heights[np.isfinite(heights)], 6))
    if len(levels) > _LEVELS:
        levels = np.unique(levels[np.linspace(0, len(levels) - 1, _LEVELS).astype(int)])
    for level in levels[levels > levels[0] + SHALLOW]:
        wall = heights >= level - 1e-5
        labels, count = ndimage.label(ndimage.binary_fill_holes(wall) & ~wall)
        for number in range(1, count + 1):
            room = labels == number
            if level - heights[room].min() > SHALLOW:
                yield float(level), room


def _heights(fixed: Sequence[RigidObject], axes: Array, low: Array, high: Array) -> tuple[Array, Array, float]:
    """Greatest height of bodies on a grid over a rectangle, with its corner and its cell."""
    size = high - low
    cell = float(size.max()) / CELLS
    count = np.ceil(size / cell - 1e-9).astype(int) + 2
    origin = low - cell
    heights = np.full(count, -np.inf)
    for item in fixed:
        heights = np.maximum(heights, _heights_of(item, axes, origin, tuple(count), cell))
    return heights, origin, cell


def _heights_of(item: RigidObject, axes: Array, origin: Array, count: tuple[int, ...], cell: float) -> Array:
    corners = item.vertices @ axes.T
    fine = heights_over(item.shape.polyhedron, corners, origin, 2 * np.array(count), cell / 2)
    heights: Array = fine.reshape(count[0], 2, count[1], 2).max(axis=(1, 3))
    if np.any(np.ptp(corners, axis=0)[:2] < cell):  # thinner than the grid sees
        first, last = ((f(corners, axis=0)[:2] - origin) // cell for f in (np.min, np.max))
        box = tuple(slice(max(int(a), 0), max(int(b) + 1, 0)) for a, b in zip(first, last, strict=True))
        heights[box] = np.maximum(heights[box], corners[:, 2].max())
    return heights
