"""The table, what stands on it, and which of it is meant."""

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from poise.errors import ErrorCode, InputError
from poise.scanning.frames import View
from poise.scanning.fusion import agreement, coarse_points, fewest_views, is_solid
from poise.scanning.options import ScanOptions
from poise.scanning.support import Footprint, Plane, find_plane, objects_on
from poise.scanning.uniting import united
from poise.types import Array, Mask

_LEAST_DEPTH = 0.05
"""Share of the pixels that have to have depth, in the middle one of the frames."""
_BESIDE, _GAP = 5, 4
"""Cells around an object within which a gap of which nothing is known may belong to it, and the least of them."""
_AGREED, _LOW, _ASKED = 0.8, 0.03, 500
"""Share of a thing's pixels that views have to agree on, over that of the thing with the largest share, for it to stand
there, unless it is higher than this, m: of flying pixels at the edges of a table they agreed on 0.2 to 0.9 of that, of
things on 0.9 or more (benchmarks.stereo_sweeps); and how many pixels are asked."""
_EVERY = 8
"""Rows of a depth image, one of which is asked whether it has depth."""


def check_depth(views: Sequence[View], options: ScanOptions) -> None:
    """Report depth that cannot be used."""
    if not views:
        raise InputError(ErrorCode.EMPTY, "scan: there is no view; record depth, camera_info and joint_states together")
    shares = [float(np.mean(view.frame.depth[::_EVERY] > 0)) for view in views]
    if np.median(shares) < _LEAST_DEPTH:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE,
            f"scan: only {np.median(shares):.0%} of the pixels have depth (in the middle one of {len(views)} views); a"
            " D435 sees nothing nearer than 0.17 m, nor glass and mirrors: move the camera back, or choose the topic",
        )
    depths = np.concatenate([view.frame.depth[::_EVERY].ravel() for view in views[:: max(len(views) // 8, 1)]])
    typical = float(np.median(depths[depths > 0]))
    if typical > 2 * options.farthest:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"scan: depth is typically {typical:.2g} m, and only what is within {options.farthest:g} m is looked at; if"
            " the depth has another unit than millimetres, give it (depth_unit), else bring the camera nearer",
        )


def table_of(views: Sequence[View], options: ScanOptions) -> tuple[Array, Plane]:
    """Some points (N, 3) m of all views, and the table that they show."""
    points = coarse_points(views, options.farthest)
    return points, find_plane(points, up_of(options), np.random.default_rng(options.seed))


def up_of(options: ScanOptions) -> Array:
    """(3,) unit vector against gravity."""
    return np.asarray(np.array(options.up) / np.linalg.norm(options.up))


def things_on(
    views: Sequence[View], points: Array, plane: Plane, options: ScanOptions
) -> tuple[list[Footprint], Array, Mask]:
    """What rises over the table, the largest first, (K, 3) m of their middles, and (K,) which of it stands there.

    Args:
        views: that see it.
        points: (N, 3) m, some of all views.
        plane: the table.
        options: with the region.

    Raises:
        InputError: EMPTY when nothing does, or nothing is in the region.
    """
    points = regarded(points, plane, options)
    footprints, middles = united(views, *objects_on(points, plane), options.voxel)
    return footprints, middles, _standing(views, points, plane, footprints)


def _standing(views: Sequence[View], points: Array, plane: Plane, footprints: Sequence[Footprint]) -> Mask:
    """(K,) which are no flying pixels of block matching at the table's edges: on these, views do not agree."""
    if len(footprints) == 1:
        return np.ones(1, dtype=bool)
    x, y, heights = plane.placed(points).T
    owned = [np.flatnonzero(footprint.holds(x, y) & (heights > footprint.floor)) for footprint in footprints]
    asked = [own[:: len(own) // _ASKED + 1] for own in owned]
    agree, through, _ = agreement(views, points[np.concatenate(asked)])
    alike = (agree >= fewest_views(len(views))) & is_solid(agree, through)
    shares = np.array([np.mean(own) for own in np.split(alike, np.cumsum([len(own) for own in asked])[:-1])])
    high = np.array([footprint.top > _LOW for footprint in footprints])
    return np.asarray(high | (shares >= _AGREED * shares.max()))


def look_at(
    views: Sequence[View], options: ScanOptions, table: tuple[Array, Plane] | None = None
) -> tuple[Plane, Footprint, int, list[str]]:
    """The table, which may be known, the object's place on it, how many stand there, and notes."""
    points, plane = table or table_of(views, options)
    footprints, middles, standing = things_on(views, points, plane, options)
    given = options.near if options.near is not None or options.region is None else options.region[:3]
    wanted = _regard(views, plane) if given is None else np.array(given)
    apart = np.linalg.norm((middles - wanted) @ plane.axes[:2].T, axis=1)
    chosen = int(np.argmin(apart))
    standing[chosen] = True
    count, notes = int(standing.sum()), []
    if count > 1:
        why = "where the camera looks" if given is None else "the point or region that was given"
        notes = [
            f"{count} objects stand on the table, at {_places(middles[standing])} m: the one at"
            f" {_places(middles[[chosen]])} was taken, nearest to {why}; choose by a point"
        ]
    return plane, footprints[chosen], count, [*notes, *_divided(footprints, middles, chosen)]


def _divided(footprints: Sequence[Footprint], middles: Array, chosen: int) -> list[str]:
    """A sentence about others that may be the same object: between them is no table, but nothing that any view saw."""
    here = footprints[chosen]
    around = ndimage.binary_dilation(here.cells, iterations=_BESIDE) & ~here.known
    parts = [
        number
        for number, other in enumerate(footprints)
        if number != chosen
        and np.count_nonzero(around & ndimage.binary_dilation(other.cells, iterations=_BESIDE)) >= _GAP
    ]
    if not parts:
        return []
    return [
        f"between it and what is at {_places(middles[parts])} m no view gives any depth: if they are one object, a"
        " glossy or dark place divides it, and its volume is that of a piece alone; powder it, or cover it with tape"
    ]


def _places(middles: Array) -> str:
    return "; ".join(f"({', '.join(f'{value:.3f}' for value in middle)})" for middle in middles)


def _regard(views: Sequence[View], plane: Plane) -> Array:
    """(3,) m: the point of the table that the optical axes meet, in the middle."""
    eyes = np.array([view.translation_world_camera for view in views])
    axes = np.array([view.rotation_world_camera[:, 2] for view in views])
    falls = axes @ plane.normal
    meets = falls < -0.05
    if not meets.any():
        return np.asarray(eyes.mean(axis=0))
    reach = (plane.offset - eyes[meets] @ plane.normal) / falls[meets]
    return np.asarray(np.median(eyes[meets] + reach[:, None] * axes[meets], axis=0))


def regarded(points: Array, plane: Plane, options: ScanOptions) -> Array:
    """The points, of which those outside the region are laid onto the table: they are known, but nothing rises there.

    Raises:
        InputError: EMPTY when there are none in the region.
    """
    if options.region is None:
        return points
    middle, size = np.array(options.region[:3]), np.array(options.region[3:])
    offset = points - middle
    inside = np.all(np.abs(offset[:, :2]) <= size[:2] / 2, axis=1) & (offset[:, 2] <= size[2])
    if not inside.any():
        raise InputError(
            ErrorCode.EMPTY,
            f"scan: no view shows anything in the region of {size.tolist()} m at {middle.tolist()}: check it (x y z of"
            " the middle of its bottom, and its size, m, in the robot's base)",
        )
    return np.where(inside[:, None], points, points - plane.heights(points)[:, None] * plane.normal)
