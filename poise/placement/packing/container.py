"""The room that is packed: what the fixed bodies of a scene enclose, or the top of one of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.assembly import Assembly, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import unit
from poise.placement.packing.cover import Cover, cover_of
from poise.placement.packing.rooms import CELLS, SHALLOW, Room, along_walls, enclosed, level_axes, over_one
from poise.types import Array


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
        return bool(np.all((middle > self.low) & (middle < self.high)) and low[2] > self.floor - SHALLOW)

    def volume(self, top: float) -> float:
        """m3 of the room below a height, m."""
        areas, ground = self._ground
        return float(np.sum(areas * np.maximum(top - ground, 0.0)))


def find_container(
    assembly: Assembly, into: str | None, height: float | None, proceed: Callable[[], None] = lambda: None
) -> Container:
    """The room to pack: the largest that fixed bodies enclose, the one over a body, or the top of a body.

    Args:
        assembly: with the fixed bodies.
        into: id of the fixed body that carries the load; None: found.
        height: m, of the lid over the lowest point inside; None: no lid.
        proceed: called before each step; what it raises, as where a deadline has passed, ends the search.

    Raises:
        InputError: OBJECT_UNKNOWN; BAD_INPUT for a body that is not fixed; OBJECT_INVALID when there is no container,
            or more than one.
    """
    fixed = [item for item in assembly.objects if item.fixed]
    body = None if into is None else _named(assembly, into)
    up = -unit(np.asarray(assembly.gravity))
    axes = level_axes(up, body)
    proceed()
    found = enclosed(fixed, axes, body)
    if found is None and body is None:  # thin walls are seen on a grid of their own only
        found, axes, body = over_one(fixed, up, proceed) or (None, axes, None)
    if found is not None:
        found, axes = along_walls(fixed, up, axes, found, proceed)
    if found is None:
        if body is None and len(fixed) != 1:
            raise InputError(
                ErrorCode.OBJECT_INVALID,
                f"no fixed bodies with walls enclose a room among {', '.join(item.id for item in fixed) or 'none'}: "
                "name the fixed body to pack onto (into)",
            )
        return _on_top(body or fixed[0], fixed, axes, height)
    return _inside(fixed, axes, found, height)


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


def _inside(fixed: Sequence[RigidObject], axes: Array, room: Room, height: float | None) -> Container:
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
    names = tuple(f.id for f, c in zip(fixed, covers, strict=True) if np.any(c.high[:, 2] >= floor - SHALLOW))
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
    cover = cover_of(item.shape.polyhedron, corners, CELLS // 4)
    near = np.all((cover.low[:, :2] < high) & (cover.high[:, :2] > low), axis=1)
    return Cover(cover.low[near], cover.high[near])


def _on_top(body: RigidObject, fixed: Sequence[RigidObject], axes: Array, height: float | None) -> Container:
    corners = body.vertices @ axes.T
    low, high, floor = corners.min(axis=0)[:2], corners.max(axis=0)[:2], float(corners[:, 2].max())
    cover = Cover.joined([_cover(item, axes, low, high) for item in fixed])
    return Container(axes, low, high, floor, None, None if height is None else floor + height, cover, (body.id,))
