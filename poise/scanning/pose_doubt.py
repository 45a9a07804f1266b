"""How far a scanned surface may be off because of its poses: what views say of the table, and of the same points of it.

Errors that all poses share (depth of another scale, a delay, another mounting of the camera) are fitted to what views
disagree about. What the fit finds, and what it leaves open, moves the surface; so do errors of single groups of views.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poise.scanning.frames import View
from poise.scanning.fusion import SLANT, Surface, pixels_of
from poise.scanning.looking import each, lookup
from poise.scanning.shared_errors import DELAY, GROUPS, INDEPENDENT, PLANE, PRIOR, SHARE, Path, moves_with, sandwich
from poise.scanning.support import Plane
from poise.types import Array, Indices, Mask

_POINTS, _PIXELS = 500, 60
"""Of the surface that are looked up; of the table, in each view."""
_GATE, _NEAR = 6e-3, 4e-3
"""m within which what a view sees is of a point, and of the table."""
_FINEST = 3e-4
"""m, of a pixel's noise."""
_ROUNDS = 4
_SURE = 3.0
"""Standard errors by which the surface has to be off, for the poses to be corrected."""
_LEAST = 2e-4
"""m that it has to be off, too."""


class SurfaceDoubt(NamedTuple):
    """Where the surface would be with other poses.

    Args:
        share, change: by which depth is too long, and (7,) delay, s, turn, rad, and shift, m, of the camera on the hand
            that make views agree best.
        sure: (8,) which of share and change are for sure.
        off: m by which the surface moves outwards with them, on average.
        spread: m, one sigma of this, from what the views leave open.
        single: m, one sigma of it, from errors of single groups of views.
    """

    share: float
    change: Array
    sure: Mask
    off: float
    spread: float
    single: float

    @property
    def clear(self) -> bool:
        """Whether the poses are to be corrected."""
        return abs(self.off) > max(_LEAST, _SURE * float(np.hypot(self.spread, self.single)))

    @property
    def sigma(self) -> float:
        """m by which all of the seen surface may be off in the same direction, one sigma, if nothing is corrected."""
        return float(np.linalg.norm([self.off, self.spread, self.single]))


class _Rows(NamedTuple):
    """Distances (N,) m along normals, how they grow with the unknowns (N, 11), weights (N,), and the views (N,)."""

    design: Array
    off: Array
    weights: Array
    owners: Indices

    def variance(self, unknowns: Array, count: int) -> Array:
        """(N,) m2: of the noise, of which a view's pixels share some, and of what else a view's distances share."""
        left = self.off + self.design @ unknowns
        noise = max(1.4826 * float(np.median(np.abs(left))), _FINEST)
        total = np.maximum(np.bincount(self.owners, self.weights, minlength=count), 1e-9)
        means = np.bincount(self.owners, self.weights * left, minlength=count) / total
        pixels = np.bincount(self.owners, minlength=count)[self.owners]
        return np.asarray(noise**2 * np.maximum(pixels / INDEPENDENT, 1.0) + pixels * (total @ means**2) / total.sum())


def pose_doubt(views: Sequence[View], path: Path, surface: Surface, plane: Plane, farthest: float) -> SurfaceDoubt:
    """What the views say of their poses.

    Args:
        views: of a sweep.
        path: of them.
        surface: what they show of the object.
        plane: the table.
        farthest: m from the camera up to which it is looked at.
    """
    rates = path.rates(views, np.zeros(7))
    few = np.random.default_rng(0).permutation(len(surface.points))[:_POINTS]
    points, normals = surface.points[few], surface.normals[few]
    rows, number = _surface_rows(views, rates, points, normals)
    total = np.maximum(np.bincount(number, rows.weights, minlength=len(points)), 1e-9)
    values = np.column_stack([rows.design[:, SHARE:], rows.off])
    sums = [np.bincount(number, rows.weights * column, minlength=len(points)) for column in values.T]
    means = np.stack(sums, axis=1) / total[:, None]  # where a point is, is not known either
    values = values - means[number]
    rows = rows._replace(design=np.column_stack([rows.design[:, PLANE], values[:, :-1]]), off=values[:, -1])
    table = _table_rows(views, rates, plane, points.mean(axis=0), farthest)
    unknowns, covariance = _solved((table, rows), len(views))
    # The volume grows with what was seen, and with a table that lies lower.
    foot = float(np.mean(np.maximum(normals @ plane.normal, 0)))
    flat = table.design[:, PLANE]
    weighted = flat * table.weights[:, None]
    level = np.linalg.pinv(weighted.T @ flat)[0] @ weighted.T  # times heights: of the table below
    grows: Array = np.zeros(11)
    grows[SHARE:] = means[:, :-1].mean(axis=0) + foot * level @ table.design[:, SHARE:]
    group = np.arange(len(views)) * min(GROUPS, len(views)) // max(len(views), 1)
    seen = rows.weights * rows.off / total[number] / len(points)
    single = np.bincount(group[rows.owners], seen, minlength=GROUPS)
    single = single + foot * np.bincount(group[table.owners], level * table.off, minlength=GROUPS)
    spread = float(np.sqrt(grows @ covariance @ grows))
    off = float(grows @ unknowns)
    sure = np.abs(unknowns[SHARE:]) > _SURE * np.sqrt(np.diag(covariance)[SHARE:])
    return SurfaceDoubt(float(unknowns[SHARE]), unknowns[DELAY:], sure, off, spread, float(np.linalg.norm(single)))


def _solved(parts: Sequence[_Rows], count: int) -> tuple[Array, Array]:
    """(11,) unknowns that explain the distances best, and their (11, 11) covariance."""
    unknowns: Array = np.zeros(11)
    for _ in range(_ROUNDS):
        weights = [part.weights / part.variance(unknowns, count) for part in parts]
        pairs = list(zip(parts, weights, strict=True))
        system = np.diag(PRIOR) + sum((part.design * weight[:, None]).T @ part.design for part, weight in pairs)
        right = sum(part.design.T @ (weight * part.off) for part, weight in pairs)
        unknowns = np.asarray(-np.linalg.solve(system, right), np.float64)
    scores = [part.design * (weight * (part.off + part.design @ unknowns))[:, None] for part, weight in pairs]
    owners = np.concatenate([part.owners for part in parts])
    return unknowns, sandwich(system, np.concatenate(scores), owners, count)


def _surface_rows(
    views: Sequence[View], rates: tuple[Array, Array], points: Array, normals: Array
) -> tuple[_Rows, Indices]:
    """What views see of points (K, 3) with normals, and the number of the point in each row."""
    beyond = lookup(views).beyond(points).astype(np.float64)
    place = np.array([view.translation_world_camera for view in views])
    axis = np.array([view.rotation_world_camera[:, 2] for view in views])
    apart = points - place[:, None]
    ahead = np.einsum("vki,vi->vk", apart, axis)
    along = np.einsum("vki,ki->vk", apart, normals)
    facing = -along / np.linalg.norm(apart, axis=2)
    used = (np.abs(beyond) < _GATE) & (facing > SLANT)
    owners, number = np.nonzero(used)
    weights = facing[used] * (1 - (beyond[used] / _GATE) ** 2) ** 2
    # The places are the points', not those that were seen: noise that is in both would count as depth of another scale.
    moves = moves_with(points[number], normals[number], owners, views, rates)
    design = np.column_stack([np.zeros((len(moves), SHARE)), moves])
    return _Rows(design, (beyond * along / ahead)[used], weights, owners), number


def _table_rows(
    views: Sequence[View], rates: tuple[Array, Array], plane: Plane, middle: Array, farthest: float
) -> _Rows:
    """What views see of the table; its height is that below `middle`."""
    parts = each(views, lambda view: pixels_of(view, _PIXELS, farthest).astype(np.float64))
    points, owners = np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    heights = plane.heights(points)
    near = np.abs(heights) < _NEAR
    points, owners, heights = points[near] - heights[near, None] * plane.normal, owners[near], heights[near]
    moves = moves_with(points, np.tile(plane.normal, (len(points), 1)), owners, views, rates)
    design = np.column_stack([-np.ones(len(points)), (middle - points) @ plane.axes[:2].T, moves])
    return _Rows(design, heights, (1 - (heights / _NEAR) ** 2) ** 2, owners)
