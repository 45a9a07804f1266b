"""Errors that all poses of a sweep share: stamps that are late, and a camera that sits elsewhere on the hand.

A table is flat, so that the heights at which views see it show both (as `depth_scale` finds depth of another scale). A
delay moves each view along its own velocity, another mounting moves it alike in the camera's frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from poise.geometry import Pose
from poise.scanning.frames import View
from poise.scanning.fusion import coarse_points, pixels_of
from poise.scanning.looking import each
from poise.scanning.placing import turned_in_hand
from poise.scanning.support import Plane
from poise.types import Array, Indices, Mask

Delayed = Callable[[float], Sequence[View]]
"""The views, were the images' stamps late by so many s more."""
PLANE, SHARE, DELAY, TURN, SHIFT = slice(0, 3), 3, 4, slice(5, 8), slice(8, 11)
"""The unknowns: height, m, and slopes of the table; share by which depth is too long; s that stamps are late; turn,
rad, and shift, m, of the camera in its own frame on the hand."""
PRIOR = 1 / np.array([1.0, 1.0, 1.0, 0.01, 0.1, *[np.deg2rad(0.5)] * 3, *[2e-3] * 3]) ** 2
"""Of the unknowns: 1 over the square of one sigma."""
INDEPENDENT = 20
"""Pixels of a view whose noise counts as independent; the others err like their neighbours."""
GROUPS = 12
"""Groups of views in a row, whose poses may err alike (Liang and Zeger 1986)."""
_FEWEST = 12
"""Views that are needed to distinguish a delay or a mounting from noise."""
_PIXELS = 150
"""Of a view, that are asked for."""
_GATES = (0.02, 0.012, 0.008, 0.006, 0.006)
"""m off the plane within which pixels are of the table; one round each."""
_FINEST, _REACH, _NARROWEST = 3e-4, 4.0, 2e-3
"""m, of a pixel's noise; how many times it a pixel of the table may be off; and m that it may be off at least."""
_WEIGHED = 2
"""Times that a round weighs views by what it leaves of them."""
_BAND = 4e-3
"""m off the plane from which on a pixel costs 1."""
_CLEAR, _CURED = 2.5e-4, 0.004
"""m, rms at the table, that the errors have to move it, and the cost that they have to take away, to be corrected."""
_ENOUGH = 0.15
"""Of the cost that both errors take away, that one of them may leave."""
_SAID = 1e-3, 0.05, 0.1, 5e-4
"""s, deg, mm and share from which on a correction is said."""
_STEP = 0.01
"""s, of the difference that a velocity is."""


@dataclass(frozen=True, eq=False)
class Path:
    """Poses of views for another delay and another mounting.

    Args:
        delayed: the views for a delay.
        change: (7,) delay, turn and shift that were applied.
    """

    delayed: Delayed
    change: Array

    @staticmethod
    def of(views: Sequence[View], delayed: Delayed | None) -> "Path":
        """The path of views; without `delayed`, between them a spline."""
        return Path(delayed or _spline(views), np.zeros(7))

    def placed(self, views: Sequence[View], change: Array) -> list[View]:
        """The views with their poses after a change (7,) besides; those without a pose are left out."""
        whole = self.change + change
        mounting = Pose(Rotation.from_rotvec(whole[1:4]).as_matrix(), whole[4:7])
        there = {view.frame.stamp: turned_in_hand(view, mounting) for view in self.delayed(float(whole[0]))}
        return [replace(there[view.frame.stamp], frame=view.frame) for view in views if view.frame.stamp in there]

    def rates(self, views: Sequence[View], change: Array) -> tuple[Array, Array]:
        """(V, 3, 3) and (V, 3): a point p of a view moves with a delay by the first times p plus the second, per s."""
        step = np.append(_STEP, np.zeros(6))
        sides = [{view.frame.stamp: view for view in self.placed(views, change + sign * step)} for sign in (1, -1)]
        turns, shifts = np.zeros((len(views), 3, 3)), np.zeros((len(views), 3))
        for number, view in enumerate(views):
            if all(view.frame.stamp in side for side in sides):
                late, early = (side[view.frame.stamp] for side in sides)
                rotation = (late.rotation_world_camera - early.rotation_world_camera) / (2 * _STEP)
                turns[number] = rotation @ view.rotation_world_camera.T
                shift = (late.translation_world_camera - early.translation_world_camera) / (2 * _STEP)
                shifts[number] = shift - turns[number] @ view.translation_world_camera
        return turns, shifts


def _spline(views: Sequence[View]) -> Delayed:
    """Views along the path between their poses."""
    stamps = np.array([view.frame.stamp for view in views]) * 1e-9
    if len(views) < _FEWEST or not np.all(np.diff(stamps) > 0):
        return lambda delay: views
    seconds = stamps - stamps[0]
    turning = RotationSpline(seconds, Rotation.from_matrix(np.array([view.rotation_world_camera for view in views])))
    moving = CubicSpline(seconds, np.array([view.translation_world_camera for view in views]))

    def delayed(delay: float) -> list[View]:
        at = seconds - delay
        known = (at > -2 * _STEP) & (at < seconds[-1] + 2 * _STEP)
        at = np.clip(at, 0.0, seconds[-1])
        poses = zip(views, turning(at).as_matrix(), moving(at), known, strict=True)
        return [
            replace(view, rotation_world_camera=turn, translation_world_camera=place)
            for view, turn, place, inside in poses
            if inside
        ]

    return delayed


def moves_with(
    points: Array, normals: Array, owners: Indices, views: Sequence[View], rates: tuple[Array, Array]
) -> Array:
    """(N, 8) how far points (N, 3) of views `owners` move along normals (N, 3) with share, delay, turn and shift."""
    turn, place = (
        np.array([getattr(view, f"{name}_world_camera") for view in views])[owners]
        for name in ("rotation", "translation")
    )
    apart = points - place
    there = np.einsum("nji,nj->ni", turn, apart)
    normal = np.einsum("nji,nj->ni", turn, normals)
    late = np.einsum("nij,nj->ni", rates[0][owners], points) + rates[1][owners]
    share, delay = -np.einsum("ni,ni->n", apart, normals), np.einsum("ni,ni->n", late, normals)
    return np.column_stack([share, delay, np.cross(there, normal), normal])


@dataclass(frozen=True, eq=False)
class _TableFit:
    """What explains the heights of a table: (11,) unknowns, the cost left, and m, rms, by which they move it."""

    unknowns: Array
    cost: float
    moved: float


class _Table:
    """Pixels of a table in some views.

    Args:
        views: whose poses are asked.
        path: of them.
        plane: (3,) height and slopes of the table, to begin with.
        farthest: m from the camera up to which it is looked at.
    """

    def __init__(self, views: Sequence[View], path: Path, plane: Array, farthest: float) -> None:
        self._views, self._path, self._plane = views, path, plane
        parts = each(views, lambda view: view.in_camera(pixels_of(view, _PIXELS, farthest)).astype(np.float64))
        self._there, self._owners = np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(p) for p in parts])

    def fit(self, free: Mask, gates: Sequence[float] = _GATES) -> _TableFit:
        """Gauss-Newton over the unknowns that are free (11,), one round for each gate, m."""
        unknowns = np.append(self._plane, np.zeros(8))
        for gate in gates:
            design, heights, used = self._design(unknowns)
            close = np.abs(heights[used & (np.abs(heights) < gate)])
            noise = max(1.4826 * float(np.median(close)), _FINEST) if len(close) else gate
            reach = min(gate, max(_REACH * noise, _NARROWEST))
            weights = np.where(used, np.maximum(1 - (heights / reach) ** 2, 0) ** 2, 0)
            near, prior = weights > 0, PRIOR[free]
            if not near.any():
                continue
            rows, off, owners = design[near][:, free], heights[near], self._owners[near]
            pull = np.where(np.arange(11) < SHARE, 0.0, unknowns)[free] * prior
            step: Array = np.zeros(len(prior))
            for _ in range(_WEIGHED):
                # Poses that are off by themselves move all pixels of a view, as no error that they share does.
                variance = variance_of(off - rows @ step, weights[near], owners, len(self._views))
                precise = weights[near] / variance
                system = (rows * precise[:, None]).T @ rows + np.diag(prior)
                step = np.asarray(np.linalg.solve(system, rows.T @ (precise * off) + pull), np.float64)
            unknowns[free] -= step
        beyond = np.minimum((heights / _BAND) ** 2, 1.0)
        cost = float(np.mean(1 - (1 - beyond) ** 3)) if len(beyond) else 0.0
        flat, change = design[weights > 0, PLANE], design[weights > 0, DELAY:] @ unknowns[DELAY:]
        change = change - flat @ np.linalg.lstsq(flat, change, rcond=None)[0] if len(change) else change
        return _TableFit(unknowns, cost, float(np.sqrt(np.mean(change**2))) if len(change) else 0.0)

    def _design(self, unknowns: Array) -> tuple[Array, Array, Mask]:
        """(N, 11) how heights grow with the unknowns, (N,) m heights, (N,) whether they are known."""
        placed = self._path.placed(self._views, unknowns[DELAY:])
        there = {view.frame.stamp for view in placed}
        used = np.array([view.frame.stamp in there for view in self._views])
        known = iter(placed)
        views = [next(known) if one else view for one, view in zip(used, self._views, strict=True)]
        turn = np.array([view.rotation_world_camera for view in views])[self._owners]
        place = np.array([view.translation_world_camera for view in views])[self._owners]
        points = np.einsum("nij,nj->ni", turn, self._there) * (1 - unknowns[SHARE]) + place
        normal = np.array([-unknowns[1], -unknowns[2], 1.0])
        heights = points @ normal - unknowns[0]
        # Depth of another share moves a pixel by its distance, of which the noise must not count.
        moves = moves_with(points, np.tile(normal, (len(points), 1)), self._owners, views, self._rates(views, unknowns))
        moves[:, 0] = place @ normal - unknowns[0]
        design = np.column_stack([-np.ones(len(points)), -points[:, :2], moves])
        return design, heights, used[self._owners]

    def _rates(self, views: Sequence[View], unknowns: Array) -> tuple[Array, Array]:
        return self._path.rates(views, unknowns[DELAY:])


def variance_of(left: Array, weights: Array, owners: Indices, count: int, independent: float = INDEPENDENT) -> Array:
    """(N,) m2: of the noise of distances, of which a view's pixels share some, and of what else a view's share.

    Args:
        left: (N,) m that no unknown explains.
        weights: (N,) of the distances.
        owners: (N,) the views that they are from.
        count: of the views.
        independent: pixels of a view whose noise counts as independent.
    """
    noise = max(1.4826 * float(np.median(np.abs(left))), _FINEST)
    total = np.maximum(np.bincount(owners, weights, minlength=count), 1e-9)
    means = np.bincount(owners, weights * left, minlength=count) / total
    pixels = np.bincount(owners, minlength=count)[owners]
    return np.asarray(noise**2 * np.maximum(pixels / independent, 1.0) + pixels * (total @ means**2) / total.sum())


def sandwich(system: Array, scores: Array, owners: Indices, count: int) -> Array:
    """(K, K) covariance of unknowns, from scores (N, K) of rows of `count` views, which err alike in groups."""
    bounds = np.linspace(0, count, min(GROUPS, count) + 1).round().astype(int)
    summed = np.array([scores[(owners >= first) & (owners < last)].sum(axis=0) for first, last in pairwise(bounds)])
    inverse = np.linalg.inv(system)
    return np.asarray(inverse @ (summed.T @ summed) @ inverse + inverse)


def without_shared(
    views: Sequence[View], path: Path, plane: Plane | None, farthest: float
) -> tuple[Sequence[View], Path, list[str]]:
    """The views without a delay or a wrong mounting that the table shows clearly, their path, and what was done.

    Args:
        views: of a sweep.
        path: of them.
        plane: the table, about; None: a level one.
        farthest: m from the camera up to which it is looked at.
    """
    if len(views) < _FEWEST:
        return views, path, []
    table = _Table(views, path, _first_plane(views, plane, farthest), farthest)
    free = np.ones(11, bool)
    free[SHIFT.stop - 1] = False  # along the axis: the scale of depth imitates it
    none, late, mounted = free.copy(), free.copy(), free.copy()
    none[DELAY:] = late[TURN.start :] = mounted[DELAY] = False
    if table.fit(free, _GATES[:1]).moved < _CLEAR:
        return views, path, []
    both = table.fit(free)
    gain = table.fit(none).cost - both.cost
    if both.moved < _CLEAR or gain < _CURED:
        return views, path, []
    fits = [table.fit(late), table.fit(mounted), both]
    found = next(fit for fit in fits if fit.cost - both.cost <= _ENOUGH * gain)
    change = found.unknowns[DELAY:]
    return (
        path.placed(views, change),
        replace(path, change=change),
        [f"views saw the table at different heights, which was corrected: {words_of(change)}"],
    )


def _first_plane(views: Sequence[View], plane: Plane | None, farthest: float) -> Array:
    """(3,) height, m, and slopes of the table."""
    if plane is not None:
        return np.array([plane.offset, -plane.normal[0], -plane.normal[1]]) / float(plane.normal[2])
    heights = coarse_points(views, farthest)[:, 2]
    return np.array([float(np.median(heights)) if len(heights) else 0.0, 0.0, 0.0])


def words_of(change: Array, share: float = 0.0) -> str:
    """What is wrong: (7,) delay, turn and shift, and the share by which depth was too long."""
    delay, turn, shift = change[0], np.rad2deg(np.linalg.norm(change[1:4])), 1e3 * np.linalg.norm(change[4:])
    said = []
    if abs(delay) >= _SAID[0]:
        said.append(
            f"the images' stamps are {1e3 * abs(delay):.0f} ms {'late' if delay > 0 else 'early'} against the poses:"
            f" the clocks differ, or a driver stamps late; give it (--delay {delay:.3f})"
        )
    if turn >= _SAID[1] or shift >= _SAID[2]:
        said.append(
            f"the camera is turned by {turn:.1f} deg and moved by {shift:.1f} mm: the hand-eye transform is not this"
            " camera's; calibrate it (poise calibrate)"
        )
    if abs(share) >= _SAID[3]:
        said.append(f"depth is {100 * abs(share):.1f} % too {'long' if share > 0 else 'short'}; calibrate the camera")
    return "; ".join(said)
