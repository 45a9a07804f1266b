"""Whether the object moved between two views of a sweep: a rigid motion on the table that makes what came after agree.

Views shortly before and after an instant see the same sides. If the object was pushed between them, one rigid motion
along the table explains at once that points of the one side are seen through, or hidden, from the other. Errors of the
poses change slowly along a sweep; so what views a little earlier and later say of a motion is what is not significant.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, minimize

from poise.scanning.frames import View
from poise.scanning.fusion import BAND, object_pixels, voxel_means
from poise.scanning.looking import each, lookup
from poise.scanning.support import Footprint, Plane
from poise.types import Array, Single

_FEWEST, _MOST_VIEWS = 12, 48
"""Views of a sweep that are needed, and that are used."""
_VOXEL, _POINTS = 3e-3, 300
"""m between points, and how many of them are fitted."""
_MANY = 4
"""Times as many, for the motion that is found."""
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
_STEPS = np.vstack([sign * np.diag([3e-3, 3e-3, np.deg2rad(3.0)]) for sign in (1, -1)])
"""m and rad: if none of these makes views agree better, nothing moved by as much."""
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
    pixels = [part[0] for part in each(chosen, lambda view: object_pixels(view, footprint, _VOXEL))]
    points = _cloud(pixels)
    shares = _flipped(chosen, points, around)
    if shares.max(initial=0.0) < _QUIET:
        return None
    search = _Search(chosen, pixels, points, footprint.plane, around)
    likely = np.argsort(-shares, kind="stable")[:2] + around
    evenly = np.linspace(around, len(chosen) - around, 2 + 2 * len(shares) // around).round().astype(int)
    fits = [search.fitted(split, split in likely) for split in {*likely.tolist(), *evenly.tolist()}]
    best = max(fits, key=lambda fit: fit.distance * (fit.before - fit.after))
    if best.distance > _LEAST / 2:
        best = search.refined(best)
    others = [fit.distance for fit in fits if abs(fit.split - best.split) >= around]
    if best.distance < max(_LEAST, _ABOVE * float(np.median(others or [0.0]))) or best.after > _CURED * best.before:
        return None
    rotation, translation = search.rigid(best.motion)
    first = chosen[best.split].frame.stamp
    seconds = 1e-9 * (first - ordered[0].frame.stamp)
    return ObjectMove(first, seconds, rotation, translation, best.distance, float(best.motion[2]))


def _cloud(pixels: Sequence[Single]) -> Array:
    """(N, 3) m: the pixels of some views, averaged in voxels."""
    points = np.concatenate(pixels)
    return voxel_means(_VOXEL, points)[1] if len(points) else np.zeros((0, 3))


def _flipped(views: Sequence[View], points: Array, around: int) -> Array:
    """(S,) share of the points that views before an instant see, and those after it see through, or the other way."""
    beyond = lookup(views).beyond(points)
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


class _Search:
    """The motion (x and y along the plane, m, and rad) that brings views before and after an instant together.

    Args:
        views: in their order.
        pixels: of each, (N, 3) m of the object in the world.
        points: (N, 3) m of it; it turns about their middle.
        plane: that it moves along.
        around: views on each side of an instant.
    """

    def __init__(
        self, views: Sequence[View], pixels: Sequence[Single], points: Array, plane: Plane, around: int
    ) -> None:
        self._views, self._pixels, self._around = views, pixels, around
        self._points = points[np.random.default_rng(0).permutation(len(points))[:_POINTS]]
        self._middle, self._axes = points.mean(axis=0), plane.axes

    def rigid(self, motion: Array) -> tuple[Array, Array]:
        """Rotation and translation, m, of the world for a motion."""
        cosine, sine = np.cos(motion[2]), np.sin(motion[2])
        rotation = self._axes.T @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ self._axes
        shift = motion[:2] @ self._axes[:2]
        return rotation, self._middle + shift - rotation @ self._middle

    def fitted(self, split: int, search: bool) -> _Fit:
        """The motion between the views before and after one; without a search, only a small one is found."""
        misfit = self._misfit(split, _POINTS, _ASKED)
        if misfit is None:
            return _Fit(split, np.zeros(3), 0.0, 0.0, 0.0)
        far, near = (partial(misfit, gate=gate) for gate in _GATES)
        rest = np.zeros(3)
        still = near(rest)
        starts = [rest] if min(map(near, _STEPS)) < still else []
        if search and (start := _searched(far)).any():
            starts.append(start)
        tries = [_descended(near, start, 90 if search else 45) for start in starts]
        found = min(tries, key=lambda one: float(one.fun), default=OptimizeResult(x=rest, fun=still))
        return _Fit(split, found.x, self._distance(found.x), still, float(found.fun))

    def refined(self, fit: _Fit) -> _Fit:
        """A motion with more points and views."""
        misfit = self._misfit(fit.split, _MANY * _POINTS, self._around)
        if misfit is None:
            return fit
        near = partial(misfit, gate=_GATES[1])
        found = _descended(near, fit.motion, 90)
        return _Fit(fit.split, found.x, self._distance(found.x), near(np.zeros(3)), float(found.fun))

    def _distance(self, motion: Array) -> float:
        """m by which points of the object move on average."""
        rotation, translation = self.rigid(motion)
        return float(np.linalg.norm(self._points @ rotation.T + translation - self._points, axis=1).mean())

    def _misfit(self, split: int, points: int, asked: int) -> Callable[..., float] | None:
        """How far, 0..1, points of either side of an instant are from what some views of the other side see.

        Args:
            split: the first view after it.
            points: of each side, at the most.
            asked: views of each side.

        Returns:
            A function of a motion, and of the distance `gate`, m, that counts as 1; None where a side sees nothing.
        """
        sides = slice(split - self._around, split), slice(split, split + self._around)
        rng = np.random.default_rng(0)
        clouds = [_cloud(self._pixels[side]) for side in sides]
        if not all(map(len, clouds)):
            return None
        before, after = (cloud[rng.permutation(len(cloud))[:points]] for cloud in clouds)
        chosen = np.unique(np.linspace(0, self._around - 1, asked).round().astype(int))
        earlier, later = (lookup([self._views[side][i] for i in chosen]) for side in sides)

        def misfit(motion: Array, gate: float) -> float:
            rotation, translation = self.rigid(motion)
            there, back = before @ rotation.T + translation, (after - translation) @ rotation
            off = np.concatenate([later.beyond(there).ravel(), earlier.beyond(back).ravel()])
            known = off[np.isfinite(off)]
            apart = float(np.mean(np.minimum(np.abs(known) / gate, 1.0) ** 2)) if len(known) else 1.0
            return apart + _STILL * (self._distance(motion) / 0.01) ** 2

        return misfit


def _descended(cost: Callable[[Array], float], start: Array, most: int) -> OptimizeResult:
    simplex = start + np.vstack([np.zeros(3), _STEPS[:3]])
    return minimize(
        cost, start, method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": most, "xatol": 1e-4}
    )


def _searched(cost: Callable[[Array], float]) -> Array:
    """The best of some motions: first along the plane, then turned."""
    grid = np.array([[x, y, 0.0] for x in _REACH for y in _REACH])
    best = grid[int(np.argmin([cost(motion) for motion in grid]))]
    turned = best + np.array([[0.0, 0.0, turn] for turn in _TURNED])
    return np.asarray(turned[int(np.argmin([cost(motion) for motion in turned]))])
