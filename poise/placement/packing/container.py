"""The room that is packed: what the fixed bodies of a scene enclose, or the top of one of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from poise.assembly import Assembly, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import plane_axes, unit
from poise.placement.packing.cover import Cover, cover_of, heights_over
from poise.types import Array, Mask

_CELLS = 256
"""Along the longer side of the scene, to find what is enclosed; and along that of a container that is no box."""
_SHALLOW = 5e-3
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
class Container:
    """What is packed, in axes of its own: two level ones along its sides, and up.

    Args:
        axes: (3, 3) rows are the axes, in the world.
        low, high: (2,) m, its sides.
        floor: m, of its lowest point.
        rim: m, of its walls; None without walls.
        lid: m, that nothing reaches above; None without a lid.
        fixed: what nothing may enter; walls are of infinite height.
        names: of the fixed bodies it consists of.
    """

    axes: Array
    low: Array
    high: Array
    floor: float
    rim: float | None
    lid: float | None
    fixed: Cover
    names: tuple[str, ...]

    @property
    def top(self) -> float | None:
        """m, of the lid, or of the walls; None when the height has no limit."""
        return self.rim if self.lid is None else self.lid

    @cached_property
    def _ground(self) -> tuple[Array, Array]:
        """m2 and height, m, of the parts of the ground."""
        lows, highs = self.fixed.low, self.fixed.high
        edges = []
        for k in (0, 1):
            sides = np.concatenate([[self.low[k], self.high[k]], lows[:, k], highs[:, k]])
            edges.append(np.unique(np.clip(sides, self.low[k], self.high[k])))
        ground = np.full((len(edges[0]) - 1, len(edges[1]) - 1), self.floor)
        middles = [(edge[1:] + edge[:-1]) / 2 for edge in edges]
        for low, high in zip(lows, highs, strict=True):
            inside = np.ix_(*((m > low[k]) & (m < high[k]) for k, m in enumerate(middles)))
            ground[inside] = np.maximum(ground[inside], high[2])
        return np.outer(*(np.diff(edge) for edge in edges)), ground

    def holds(self, item: RigidObject) -> bool:
        """Whether an object is over its ground."""
        corners = item.vertices @ self.axes.T
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle = (low + high)[:2] / 2
        return bool(np.all((middle > self.low) & (middle < self.high)) and low[2] > self.floor - _SHALLOW)

    def volume(self, top: float) -> float:
        """m3 of the room below a height, m."""
        areas, ground = self._ground
        return float(np.sum(areas * np.maximum(top - ground, 0.0)))


def find_container(assembly: Assembly, into: str | None, height: float | None) -> Container:
    """The room to pack: the largest that fixed bodies enclose, the one over a body, or the top of a body.

    Args:
        assembly: with the fixed bodies.
        into: id of the fixed body that carries the load; None: found.
        height: m, of the lid over the lowest point inside; None: no lid.

    Raises:
        InputError: OBJECT_UNKNOWN; BAD_INPUT for a body that is not fixed; OBJECT_INVALID when there is no container,
            or more than one.
    """
    fixed = [item for item in assembly.objects if item.fixed]
    body = None if into is None else _named(assembly, into)
    up = -unit(np.asarray(assembly.gravity))
    axes = _axes(up, body)
    found = _enclosed(fixed, axes, body)
    if found is None and body is None:  # thin walls are seen on a grid of their own only
        found, axes, body = _over_one(fixed, up) or (None, axes, None)
    if found is not None:
        found, axes = _along_walls(fixed, up, axes, found)
    if found is None:
        if body is None and len(fixed) != 1:
            raise InputError(
                ErrorCode.OBJECT_INVALID,
                f"no fixed bodies with walls enclose a room among {', '.join(item.id for item in fixed) or 'none'}: "
                "name the fixed body to pack onto (into)",
            )
        return _on_top(body or fixed[0], fixed, axes, height)
    return _inside(fixed, axes, found, height)


def _over_one(fixed: Sequence[RigidObject], up: Array) -> "tuple[_Room, Array, RigidObject] | None":
    """A room over a single body, with the body's axes."""
    for item in fixed:
        if _may_hold(item, fixed, up):
            axes = _axes(up, item)
            found = _enclosed(fixed, axes, item)
            if found is not None:
                return found, axes, item
    return None


def _may_hold(item: RigidObject, fixed: Sequence[RigidObject], up: Array) -> bool:
    """Whether a body may carry a room: it has walls of its own, or others rise over its top, on it or next to it."""
    if not item.shape.polyhedron.convex:
        return True
    own = item.vertices
    rising = 0
    for other in fixed:
        corners = other.vertices
        near = np.all((corners.min(axis=0) < own.max(axis=0) + _NEXT) & (corners.max(axis=0) > own.min(axis=0) - _NEXT))
        if other is not item and near and np.max(corners @ up) > np.max(own @ up) + _SHALLOW:
            rising += 1 if other.shape.polyhedron.convex else _WALLS
    return rising >= _WALLS


def encloses(assembly: Assembly) -> bool:
    """Whether fixed bodies with walls enclose a room to pack."""
    try:
        return find_container(assembly, None, None).rim is not None
    except InputError:
        return False


def _named(assembly: Assembly, name: str) -> RigidObject:
    if name not in assembly.index:
        there = ", ".join(item.id for item in assembly.objects if item.fixed)
        raise InputError(ErrorCode.OBJECT_UNKNOWN, f"into {name!r}: not in the scene; fixed are {there}", object=name)
    item = assembly.objects[assembly.place_of(name)]
    if not item.fixed:
        raise InputError(ErrorCode.BAD_INPUT, f"into {name!r}: it is not fixed; containers are fixed bodies")
    return item


def _axes(up: Array, body: RigidObject | None) -> Array:
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
        return _axes(up, item)
    across = normals[walls] - np.outer(normals[walls] @ up, up)
    axes = plane_axes(up)
    angles = np.arctan2(across @ axes[1], across @ axes[0]) % (np.pi / 2)
    kinds, of = np.unique(np.round(angles, 4) % round(np.pi / 2, 4), return_inverse=True)
    largest = of == np.bincount(of, areas[walls], len(kinds)).argmax()
    first = unit(across[np.flatnonzero(largest)[0]])
    return np.stack([first, np.cross(up, first), up])


@dataclass(frozen=True, eq=False)
class _Room:
    """A part of the ground that is enclosed.

    Args:
        mask: cells of it.
        rim: m, height of its walls.
        origin: (2,) m, corner of the grid.
        cell: m.
    """

    mask: Mask
    rim: float
    origin: Array
    cell: float

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


def _enclosed(fixed: Sequence[RigidObject], axes: Array, body: RigidObject | None) -> _Room | None:
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
        raise InputError(
            ErrorCode.OBJECT_INVALID,
            f"fixed bodies enclose {1 + len(others)} rooms or more of similar size: name the body to pack into (into)",
        )
    return _Room(room, level, origin, cell)


def _sized_rooms(heights: Array, cell: float) -> list[tuple[float, float, Mask]]:
    """Volume, m3, rim and cells of each room."""
    ground = heights[np.isfinite(heights)].min()
    return [
        (float(np.sum(level - np.maximum(heights[room], ground))) * cell**2, level, room)
        for level, room in _rooms(heights)
    ]


def _along_walls(fixed: Sequence[RigidObject], up: Array, axes: Array, found: _Room) -> tuple[_Room, Array]:
    """A room on a fine grid along its walls, and these axes: those of the bodies around in which it is most square."""
    place, reach = found.corners @ axes[:2], found.cell
    choices = {0.0: axes}
    for item in fixed:
        corners = (item.vertices @ axes.T)[:, :2]
        low, high = found.sides + reach * np.array([[-_MARGIN], [_MARGIN]])
        if np.all((corners.min(axis=0) < high) & (corners.max(axis=0) > low)):
            own = _wall_axes(item, up)
            angle = np.arctan2(own[0] @ axes[1], own[0] @ axes[0]) % (np.pi / 2)
            choices.setdefault(round(float(angle), 4) % round(np.pi / 2, 4), own)
    best, along = found, axes
    for choice in list(choices.values())[:_CHOICES]:
        flat = place @ choice[:2].T
        heights, origin, cell = _heights(
            fixed, choice, flat.min(axis=0) - _MARGIN * reach, flat.max(axis=0) + _MARGIN * reach
        )
        rooms = _sized_rooms(heights, cell)
        if rooms:
            _, level, mask = max(rooms, key=lambda room: room[0])
            again = _Room(mask, level, origin, cell)
            if best is found or again.fill > best.fill + 1e-3:
                best, along = again, choice
    return best, along


def _rooms(heights: Array) -> Iterator[tuple[float, Mask]]:
    """Each part of the ground that is enclosed by something higher, with the height of the rim."""
    levels = np.unique(np.round(heights[np.isfinite(heights)], 6))
    if len(levels) > _LEVELS:
        levels = np.unique(levels[np.linspace(0, len(levels) - 1, _LEVELS).astype(int)])
    for level in levels[levels > levels[0] + _SHALLOW]:
        wall = heights >= level - 1e-5
        labels, count = ndimage.label(ndimage.binary_fill_holes(wall) & ~wall)
        for number in range(1, count + 1):
            room = labels == number
            if level - heights[room].min() > _SHALLOW:
                yield float(level), room


def _heights(fixed: Sequence[RigidObject], axes: Array, low: Array, high: Array) -> tuple[Array, Array, float]:
    """Greatest height of bodies on a grid over a rectangle, with its corner and its cell."""
    size = high - low
    cell = float(size.max()) / _CELLS
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


def _inside(fixed: Sequence[RigidObject], axes: Array, room: _Room, height: float | None) -> Container:
    rim, cell = room.rim, room.cell
    low, high = room.sides + cell * np.array([[-1], [1]])
    covers = [_cover(item, axes, low, high) for item in fixed]
    cover = Cover.joined(covers)
    walls = cover.high[:, 2] >= rim - 1e-5
    cover.high[walls, 2] = np.inf
    for k in (0, 1):
        crossing = walls & (cover.low[:, 1 - k] < high[1 - k]) & (cover.high[:, 1 - k] > low[1 - k])
        faces_up = [x for x in cover.high[crossing, k] if abs(x - low[k]) < 2.5 * cell]
        faces_down = [x for x in cover.low[crossing, k] if abs(x - high[k]) < 2.5 * cell]
        low[k], high[k] = max(faces_up, default=low[k]), min(faces_down, default=high[k])
    inner = np.all((cover.low[:, :2] < high) & (cover.high[:, :2] > low), axis=1)
    inside = Cover(cover.low[inner], cover.high[inner])
    sides = np.stack([low, high])
    floor = _lowest(inside, sides)
    names = tuple(f.id for f, c in zip(fixed, covers, strict=True) if np.any(c.high[:, 2] >= floor - _SHALLOW))
    walled = Cover.joined([inside, _around(sides)])
    return Container(axes, low, high, floor, rim, None if height is None else floor + height, walled, names)


def _around(sides: Array) -> Cover:
    """Walls of infinite height around (2, 2) m."""
    (x0, y0), (x1, y1) = sides
    far, end = 1.0, np.inf
    west = (x0 - far, y0 - far, x0, y1 + far)
    east = (x1, y0 - far, x1 + far, y1 + far)
    south = (x0, y0 - far, x1, y0)
    north = (x0, y1, x1, y1 + far)
    walls = np.array([west, east, south, north])
    ends = np.full((4, 1), end)
    return Cover(np.hstack([walls[:, :2], -ends]), np.hstack([walls[:, 2:], ends]))


def _lowest(cover: Cover, sides: Array) -> float:
    """m: the lowest of the ground."""
    ground = Container(np.eye(3), sides[0], sides[1], -np.inf, None, None, cover, ())._ground[1]
    heights = ground[np.isfinite(ground)]
    return float(heights.min()) if len(heights) else 0.0


def _cover(item: RigidObject, axes: Array, low: Array, high: Array) -> Cover:
    """Boxes of a fixed body, as far as they are near some sides."""
    corners = item.vertices @ axes.T
    outside = np.any((corners.max(axis=0)[:2] <= low) | (corners.min(axis=0)[:2] >= high))
    if outside:
        return Cover(np.zeros((0, 3)), np.zeros((0, 3)))
    cover = cover_of(item.shape.polyhedron, corners, _CELLS // 4)
    near = np.all((cover.low[:, :2] < high) & (cover.high[:, :2] > low), axis=1)
    return Cover(cover.low[near], cover.high[near])


def _on_top(body: RigidObject, fixed: Sequence[RigidObject], axes: Array, height: float | None) -> Container:
    corners = body.vertices @ axes.T
    low, high, floor = corners.min(axis=0)[:2], corners.max(axis=0)[:2], float(corners[:, 2].max())
    cover = Cover.joined([_cover(item, axes, low, high) for item in fixed])
    return Container(axes, low, high, floor, None, None if height is None else floor + height, cover, (body.id,))
