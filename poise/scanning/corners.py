"""Depth that is too long in corners, as a time-of-flight camera's: the table beside an object shows it.

Light that table and object reflect onto each other arrives late (multipath), so that both are seen farther away. All
views share this error, and agree. But the table is flat, and is then seen lower beside the object than elsewhere.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from poise.scanning.flatness import few_of
from poise.scanning.frames import View
from poise.scanning.fusion import pixels_of
from poise.scanning.support import CELL, Footprint, Plane
from poise.types import Array, Mask

_PIXELS = 6000
"""Of a view, that are asked for."""
_BORDER = 2
"""Cells by which a footprint is wider than what rises."""
_FEW, _FEWEST_VIEWS = 15, 5
"""Pixels of a view in either place, and views, below which nothing is known."""
_LEAST, _SURE = 8e-4, 4.0
"""m by which upright faces are off, and standard errors, from which on the table is seen lower: less moves what is
seen of an object, of which half is sides, by less than 0.4 mm."""
_WALLS = 5.0
"""Of how much lower the table is seen, by which upright faces are off. A single reflection between a table and an
upright wall of 30 to 100 mm moves the wall by 4 to 7 times as much as the table 12 to 39 mm in front of it where the
camera looks down by 45 degrees, and by 2 to 15 times, as the tangent of that angle, from 25 to 65 degrees: the steeper,
the more light the table has, and the wall has less."""
_FACING = 0.5
"""Cosine, seen from above, between the ways from a place of the table to the camera and away from the object, from
which on the camera also sees (and lights) the side of the object that faces this place."""
_STEEPEST = 3.7
"""Tangent of 75 degrees, above which views show no sides."""


_PLACES = ((1, 3, 8, 25, False), (4, 13, 34, 84, True))
"""First and last cells beside the object and elsewhere, and whether only those in front of it count.

Light that the table and the object reflect onto each other sinks the table most at 12 to 39 mm from a side that is
seen, and hardly from 0.1 m on. What spreads between pixels, or close to a fold, sinks it next to the object.
"""


@dataclass(frozen=True)
class Sunken:
    """How much lower views see the table beside the object; all 0 where they do not.

    Args:
        low: m.
        inwards: m, one sigma, by which upright faces may be off inwards for the same reason.
    """

    low: float = 0.0
    inwards: float = 0.0

    def of_faces(self, normals: Array, up: Array) -> Array:
        """(N,) m, one sigma, by which faces of outward normals (N, 3) may be off inwards.

        It follows how much of the table a face sees: nothing where it faces up. What faces down counts as upright.
        """
        return np.asarray(self.inwards * np.clip(1 - normals @ up, 0, 1))


@dataclass(frozen=True)
class _Rings:
    """Where the table is compared with itself.

    Args:
        beside, away: the cells beside the object, and those of the table elsewhere.
        outwards: (2, X, Y) cells, from the nearest cell of the object to each; None: all sides count, and the angle at
            which the camera looks down does not.
    """

    beside: Footprint
    away: Footprint
    outwards: Array | None


def sunken(views: Sequence[View], footprint: Footprint, farthest: float) -> Sunken:
    """By how much views see the table lower beside the object than elsewhere; 0 where they do not, or show too little.

    Each view is compared with itself, so that errors of the poses do not count.

    Args:
        views: of a sweep.
        footprint: where the object stands.
        farthest: m from the camera up to which it is looked at.
    """
    seen = [_table(view, footprint.plane, farthest) for view in few_of(views)]
    found = [_sunken(seen, rings) for rings in _rings(footprint)]
    return max(found, key=lambda one: one.inwards)


def _rings(footprint: Footprint) -> list[_Rings]:
    """The cells of each of `_PLACES`."""
    rises = ndimage.binary_erosion(footprint.cells, iterations=_BORDER)
    apart, nearest = ndimage.distance_transform_edt(~rises, return_indices=True)
    outwards = np.indices(rises.shape) - nearest
    return [
        _Rings(
            replace(footprint, cells=(apart > first) & (apart <= last)),
            replace(footprint, cells=(apart > least) & (apart <= most)),
            outwards if in_front else None,
        )
        for first, last, least, most, in_front in _PLACES
    ]


def _table(view: View, plane: Plane, farthest: float) -> tuple[Array, Array]:
    """(3,) where the camera of a view is, and (N, 3) what it sees of the table, over the plane of the table, m."""
    placed = plane.placed(pixels_of(view, _PIXELS, farthest)).astype(np.float64)
    eye = plane.placed(view.translation_world_camera[None])[0].astype(np.float64)
    return eye, placed[np.abs(placed[:, 2]) < plane.tolerance]


def _sunken(seen: Sequence[tuple[Array, Array]], rings: _Rings) -> Sunken:
    """What one pair of rings shows in views of the table, see `_table`."""
    shown = [one for eye, table in seen if (one := _lower(eye, table, rings)) is not None]
    if len(shown) < _FEWEST_VIEWS:
        return Sunken()
    low, inwards = np.array(shown).T
    middle = float(np.median(inwards))
    spread = 1.4826 * float(np.median(np.abs(inwards - middle)))
    sure = middle > max(_LEAST, _SURE * 1.25 * spread / np.sqrt(len(inwards)))
    return Sunken(float(np.median(low)), middle) if sure else Sunken()


def _lower(eye: Array, table: Array, rings: _Rings) -> tuple[float, float] | None:
    """m by which a view sees the table lower beside the object, and upright faces inwards; None: unknown."""
    beside, away = (table[ring.holds(table[:, 0], table[:, 1])] for ring in (rings.beside, rings.away))
    if rings.outwards is not None:
        beside = beside[_in_front(beside, eye, rings)]
    if min(len(beside), len(away)) < _FEW:
        return None
    if rings.outwards is None:
        low = float(np.median(away[:, 2]) - np.median(beside[:, 2]))
        return low, _WALLS * low
    level = _level(away)
    low = float(np.median(away[:, 2] - level(away)) - np.median(beside[:, 2] - level(beside)))
    across = float(np.median(np.hypot(*(beside - eye).T[:2])))
    return low, _WALLS * low * min(eye[2] / max(across, 1e-6), _STEEPEST)


def _in_front(places: Array, eye: Array, rings: _Rings) -> Mask:
    """(N,) whether the side of the object that is nearest to places (N, 3) of the table faces the camera at `eye`."""
    cell = np.floor((places[:, :2] - rings.beside.low) / CELL).astype(np.int64)
    outwards = np.asarray(rings.outwards)[:, cell[:, 0], cell[:, 1]].T
    toward = eye[:2] - places[:, :2]
    lengths = np.linalg.norm(outwards, axis=1) * np.linalg.norm(toward, axis=1)
    return np.asarray(np.einsum("ni,ni->n", outwards, toward) > _FACING * lengths)


def _level(places: Array) -> Callable[[Array], Array]:
    """Heights of the plane through places (N, 3) of the table, which one view sees tilted where its pose is off."""
    middle = places[:, :2].mean(axis=0)

    def terms(at: Array) -> Array:
        return np.column_stack([np.ones(len(at)), at[:, :2] - middle])

    found = np.linalg.lstsq(terms(places), places[:, 2], rcond=None)[0]
    return lambda at: np.asarray(terms(at) @ found)
