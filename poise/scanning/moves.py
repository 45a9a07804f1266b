"""Whether the object moved between two views of a sweep: a rigid motion on the table that makes what came after agree.

Views shortly before and after an instant see the same sides. If the object was pushed between them, one rigid motion
along the table explains at once that points of the one side are seen through, or hidden, from the other. Errors of the
poses change slowly along a sweep; so what views a little earlier and later say of a motion is what is not significant.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, minimize
from scipy.spatial.transform import Rotation

from poise.errors import InputError
from poise.scanning.frames import View
from poise.scanning.fusion import BAND, object_points
from poise.scanning.looking import each, look
from poise.scanning.support import Footprint, Plane
from poise.types import Array

_FEWEST, _MOST_VIEWS = 12, 48
"""Views of a sweep that are needed, and that are used."""
_VOXEL, _POINTS = 3e-3, 300
"""m between points, and how many of them are fitted."""
_ASKED = 4
"""Views on each side of an instant that points of the other side are looked up in."""
_FLIPPED = 0.75
"""Share of the views of one side that have to agree about a point."""
_QUIET = 0.04
"""Share of the points that one side sees through and the other does not, below which nothing moved."""
_GATES = (0.012, 0.006)
"""m: a point that is farther from what a view sees is off, however far; for the search, and for the fit."""
_REACH, _TURNED = np.arange(-0.024, 0.025, 0.008), np.deg2rad([-6.0, 0.0, 6.0])
"""m and rad of the search."""
_STILL = 2e-3
"""Cost of a motion of 1 cm, so that one that nothing shows is none."""
_LEAST, _ABOVE = 3e-3, 2.0
"""m that a push moves the object at least, and how many times what other instants show."""
_CURED = 0.92
"""Of what disagrees, that may be left by the motion."""


class ObjectMove(NamedTuple):
    """A motion of the object between two views.

    Args:
        stamp: ns of the first view after it.
        seconds: s from the first view of the sweep to it.
        rotation, translation: (3, 3) and (3,) m in the world: x -> rotation x + translation of the object's points.
        distance: m by which its points moved on average.
        turn: rad about the table's normal.
    """

    stamp: int
    seconds: float
    rotation: Array
    translation: Array
    distance: float
    turn: float

    def undone(self, views: Sequence[View]) -> list[View]:
        """The views, those before the push moved along with the object: all see it where it stood at last."""
        return [
            view.moved(self.rotation, self.translation) if view.frame.stamp < self.stamp else view for view in views
        ]

    def place(self, footprint: Footprint) -> tuple[float, float, float]:
        """x y z, m, in the world: the middle of a place, after the push."""
        x, y, z = (self.rotation @ footprint.corners.mean(axis=0) + self.translation).tolist()
        return x, y, z

    def __str__(self) -> str:
        return (
            f"{self.seconds:.1f} s after the first view, the object moved by {1e3 * self.distance:.0f} mm"
            f" ({np.rad2deg(self.turn):+.0f} deg), or the poses of the views are wrong from then on"
        )


class _Fit(NamedTuple):
    split: int
    motion: Array
    distance: float
    before: float
    after: float


def find_move(views: Sequence[View], footprint: Footprint) -> ObjectMove | None:
    """The largest motion of the object between two views; None when they show none.

    Pushes of less than about 4 mm are not always found, nor those of an object that only few views see.

    Args:
        views: of a sweep.
        footprint: where the object stands.
    """
    ordered = sorted(views, key=lambda view: view.frame.stamp)
    if len(ordered) < _FEWEST:
        return None
    chosen = [ordered[i] for i in np.unique(np.linspace(0, len(ordered) - 1, _MOST_VIEWS).round().astype(int))]
    around = int(np.clip(len(chosen) // 6, 3, 8))
    try:
        points = object_points(chosen, footprint, _VOXEL)
    except InputError:
        return None
    shares = _flipped(chosen, points, around)
    if shares.max() < _QUIET:
        return None
    likely = np.argsort(-shares, kind="stable")[:2] + around
    evenly = np.linspace(around, len(chosen) - around, 2 + 2 * len(shares) // around).round().astype(int)
    fits = [
        _fitted(chosen, points, footprint, split, around, split in likely)
        for split in {*likely.tolist(), *evenly.tolist()}
    ]
    best = max(fits, key=lambda fit: fit.distance * (fit.before - fit.after))
    others = [fit.distance for fit in fits if abs(fit.split - best.split) >= around]
    if best.distance < max(_LEAST, _ABOVE * float(np.median(others or [0.0]))) or best.after > _CURED * best.before:
        return None
    middle = points.mean(axis=0)
    rotation, translation = _motion(best.motion, middle, footprint.plane)
    first = chosen[best.split].frame.stamp
    seconds = 1e-9 * (first - ordered[0].frame.stamp)
    return ObjectMove(first, seconds, rotation, translation, best.distance, float(best.motion[2]))


def _flipped(views: Sequence[View], points: Array, around: int) -> Array:
    """(S,) share of the points that views before an instant see, and those after it see through, or the other way."""
    beyond = np.array(each(views, lambda view: look(view, points).beyond))
    seen, through = (np.cumsum(np.pad(one, ((1, 0), (0, 0))), axis=0) for one in (np.abs(beyond) < BAND, beyond > BAND))
    shares = []
    for split in range(around, len(views) - around + 1):
        sides = ((split - around, split), (split, split + around))
        see, miss = (np.array([of[end] - of[begin] for begin, end in sides]) for of in (seen, through))
        judged = np.all(see + miss >= 2, axis=0)
        sees, misses = see >= _FLIPPED * (see + miss), miss >= _FLIPPED * (see + miss)
        flipped = judged & ((sees[0] & misses[1]) | (misses[0] & sees[1]))
        shares.append(flipped.sum() / max(judged.sum(), 1))
    return np.array(shares)


def _fitted(views: Sequence[View], points: Array, footprint: Footprint, split: int, around: int, search: bool) -> _Fit:
    """The motion (x and y along the plane, m, and rad) that brings views before and after an instant together."""
    sides = views[split - around : split], views[split : split + around]
    rng = np.random.default_rng(0)
    middle = points.mean(axis=0)
    clouds = []
    for side in sides:
        try:
            cloud = object_points(side, footprint, _VOXEL)
        except InputError:
            return _Fit(split, np.zeros(3), 0.0, 0.0, 0.0)
        clouds.append(cloud[rng.permutation(len(cloud))[:_POINTS]])
    asked = [[side[i] for i in np.unique(np.linspace(0, around - 1, _ASKED).round().astype(int))] for side in sides]

    def cost(motion: Array, gate: float) -> float:
        rotation, translation = _motion(motion, middle, footprint.plane)
        there, back = clouds[0] @ rotation.T + translation, (clouds[1] - translation) @ rotation
        off = [look(view, there).beyond for view in asked[1]] + [look(view, back).beyond for view in asked[0]]
        apart = np.minimum(np.abs(np.concatenate(off)) / gate, 1.0) ** 2
        known = np.isfinite(apart)
        moved = float(np.linalg.norm(there - clouds[0], axis=1).mean())
        return float(apart[known].mean() if known.any() else 1.0) + _STILL * (moved / 0.01) ** 2

    starts = [np.zeros(3)] + ([_searched(lambda motion: cost(motion, _GATES[0]))] if search else [])
    tries = [_descended(lambda motion: cost(motion, _GATES[1]), start, 90 if search else 45) for start in starts]
    found = min(tries, key=lambda one: float(one.fun))
    rotation, translation = _motion(found.x, middle, footprint.plane)
    distance = float(np.linalg.norm(clouds[0] @ rotation.T + translation - clouds[0], axis=1).mean())
    return _Fit(split, found.x, distance, cost(np.zeros(3), _GATES[1]), float(found.fun))


def _descended(cost: Callable[[Array], float], start: Array, most: int) -> OptimizeResult:
    simplex = start + np.vstack([np.zeros(3), np.diag([3e-3, 3e-3, 0.05])])
    return minimize(
        cost, start, method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": most, "xatol": 1e-4}
    )


def _searched(cost: Callable[[Array], float]) -> Array:
    """The best of some motions: first along the plane, then turned."""
    grid = np.array([[x, y, 0.0] for x in _REACH for y in _REACH])
    best = grid[int(np.argmin([cost(motion) for motion in grid]))]
    turned = best + np.array([[0.0, 0.0, turn] for turn in _TURNED])
    return np.asarray(turned[int(np.argmin([cost(motion) for motion in turned]))])


def _motion(motion: Array, middle: Array, plane: Plane) -> tuple[Array, Array]:
    """Rotation and translation, m, of the world for a motion along the plane about a point."""
    rotation = Rotation.from_rotvec(motion[2] * plane.normal).as_matrix()
    shift = motion[0] * plane.axes[0] + motion[1] * plane.axes[1]
    return rotation, middle + shift - rotation @ middle
