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
from poise.scanning.shared_errors import DELAY, GROUPS, PLANE, PRIOR, SHARE, Path, moves_with, sandwich, variance_of
from poise.scanning.support import Plane
from poise.types import Array, Indices, Mask

_POINTS, _PIXELS = 500, 60
"""Of the surface that are looked up; of the table, in each view."""
_GATES, _NEAR = (6e-3, 9e-3, 9e-3, 6e-3, 6e-3, 6e-3), 4e-3
"""m within which what a view sees is of a point, one round each, and of the table."""
_SETTLED = 1e-4, 5e-5
"""m by which a round moves the surface, and views against each other, below which it is the last one."""
_APART = 2.5e-4
"""m, rms, by which views are moved against each other, from which on the poses are corrected."""
_ROUNDS = 4
_OFF, _SURE = 2.0, 3.0
"""Standard errors by which the surface has to be off, for the poses to be corrected; and an error, to be named."""
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
        apart: m, rms, by which they move views of the same points against each other.
    """

    share: float
    change: Array
    sure: Mask
    off: float
    spread: float
    single: float
    apart: float

    @property
    def clear(self) -> bool:
        """Whether the poses are to be corrected."""
        return self.apart > _APART or abs(self.off) > max(_LEAST, _OFF * float(np.hypot(self.spread, self.single)))

    def better_than(self, other: "SurfaceDoubt") -> bool:
        """Whether views agree better."""
        return self.sigma <= other.sigma or (other.apart > _APART and self.apart < other.apart / 2)

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
        """(N,) m2, of what unknowns (11,) leave; of `count` views."""
        return variance_of(self.off + self.design @ unknowns, self.weights, self.owners, count)


class _Disagreement(NamedTuple):
    """What the views disagree about, with some poses.

    Args:
        parts: the table, and K points of the surface.
        means: (K, 9) how each point moves outwards with share and change; and m by which views see it elsewhere.
        grows: (11,) how the surface moves outwards with the unknowns, on average.
        single: (GROUPS,) m, the same by what the views of each group see.
    """

    parts: tuple[_Rows, _Rows]
    means: Array
    grows: Array
    single: Array

    def apart(self, unknowns: Array) -> float:
        """m, rms, by which unknowns (11,) move views of the same points against each other."""
        rows = self.parts[1]
        return float(np.sqrt(rows.weights @ (rows.design @ unknowns) ** 2 / max(rows.weights.sum(), 1e-9)))


def pose_doubt(views: Sequence[View], path: Path, surface: Surface, plane: Plane, farthest: float) -> SurfaceDoubt:
    """What the views say of their poses.

    Where poses are wrong by some mm, a view sees other places than those that it is asked for, which hides most of the
    error. So the places are looked up again with the poses that were found, until this changes nothing.

    Args:
        views: of a sweep.
        path: of them.
        surface: what they show of the object.
        plane: the table.
        farthest: m from the camera up to which it is looked at.
    """
    few = np.random.default_rng(0).permutation(len(surface.points))[:_POINTS]
    points, normals = surface.points[few], surface.normals[few]
    unknowns: Array = np.zeros(11)
    placed, rates = views, path.rates(views, unknowns[DELAY:])
    for gate in _GATES:
        found = _disagreement(placed, rates, (points, normals), plane, farthest, unknowns, gate)
        step, covariance = _solved(found.parts, len(placed), unknowns)
        unknowns = unknowns + step
        if abs(float(found.grows @ step)) < _SETTLED[0] and found.apart(step) < _SETTLED[1]:
            break
        outwards = found.means[:, -1] + found.means[:, :-1] @ step[SHARE:]
        points = points + np.clip(outwards, -gate, gate)[:, None] * normals
        placed = path.placed(views, unknowns[DELAY:])
        if len(placed) != len(rates[0]):  # a delay leaves views without a pose
            rates = path.rates(placed, unknowns[DELAY:])
    spread, off = float(np.sqrt(found.grows @ covariance @ found.grows)), float(found.grows @ unknowns)
    sure = np.abs(unknowns[SHARE:]) > _SURE * np.sqrt(np.diag(covariance)[SHARE:])
    single = float(np.linalg.norm(found.single))
    return SurfaceDoubt(float(unknowns[SHARE]), unknowns[DELAY:], sure, off, spread, single, found.apart(unknowns))


def _disagreement(
    views: Sequence[View],
    rates: tuple[Array, Array],
    surface: tuple[Array, Array],
    plane: Plane,
    farthest: float,
    unknowns: Array,
    gate: float,
) -> _Disagreement:
    """Of views that were placed with unknowns (11,), about a table and points (K, 3) of a surface with normals."""
    points, normals = surface
    rows, number = _surface_rows(views, rates, points, normals, float(unknowns[SHARE]), gate)
    total = np.maximum(np.bincount(number, rows.weights, minlength=len(points)), 1e-9)
    values = np.column_stack([rows.design[:, SHARE:], rows.off])
    sums = [np.bincount(number, rows.weights * column, minlength=len(points)) for column in values.T]
    means = np.stack(sums, axis=1) / total[:, None]  # where a point is, is not known either
    values = values - means[number]
    rows = rows._replace(design=np.column_stack([rows.design[:, PLANE], values[:, :-1]]), off=values[:, -1])
    table = _table_rows(views, rates, plane, points.mean(axis=0), farthest, unknowns)
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
    return _Disagreement((table, rows), means, grows, np.asarray(single, np.float64))


def _solved(parts: Sequence[_Rows], count: int, before: Array) -> tuple[Array, Array]:
    """(11,) change of the unknowns `before` that explains the distances best, and the (11, 11) covariance of both."""
    pull = PRIOR * np.where(np.arange(11) < SHARE, 0.0, before)
    unknowns: Array = np.zeros(11)
    for _ in range(_ROUNDS):
        weights = [part.weights / part.variance(unknowns, count) for part in parts]
        pairs = list(zip(parts, weights, strict=True))
        system = np.diag(PRIOR) + sum((part.design * weight[:, None]).T @ part.design for part, weight in pairs)
        right = pull + sum(part.design.T @ (weight * part.off) for part, weight in pairs)
        unknowns = np.asarray(-np.linalg.solve(system, right), np.float64)
    scores = [part.design * (weight * (part.off + part.design @ unknowns))[:, None] for part, weight in pairs]
    owners = np.concatenate([part.owners for part in parts])
    return unknowns, sandwich(system, np.concatenate(scores), owners, count)


def _surface_rows(
    views: Sequence[View], rates: tuple[Array, Array], points: Array, normals: Array, share: float, gate: float
) -> tuple[_Rows, Indices]:
    """What views, whose depth is too long by a share, see within `gate` m of points (K, 3); and the number of each."""
    beyond = lookup(views).beyond(points).astype(np.float64)
    place = np.array([view.translation_world_camera for view in views])
    axis = np.array([view.rotation_world_camera[:, 2] for view in views])
    apart = points - place[:, None]
    ahead = np.einsum("vki,vi->vk", apart, axis)
    along = np.einsum("vki,ki->vk", apart, normals)
    facing = -along / np.linalg.norm(apart, axis=2)
    beyond = (beyond - share * ahead) / (1 + share)
    used = (np.abs(beyond) < gate) & (facing > SLANT)
    owners, number = np.nonzero(used)
    weights = facing[used] * (1 - (beyond[used] / gate) ** 2) ** 2
    # The places are the points', not those that were seen: noise that is in both would count as depth of another scale.
    moves = moves_with(points[number], normals[number], owners, views, rates)
    design = np.column_stack([np.zeros((len(moves), SHARE)), moves])
    return _Rows(design, (beyond * along / ahead)[used], weights, owners), number


def _table_rows(
    views: Sequence[View],
    rates: tuple[Array, Array],
    plane: Plane,
    middle: Array,
    farthest: float,
    unknowns: Array,
) -> _Rows:
    """What views see of the table, which unknowns (11,) change; its height is that below `middle`."""
    parts = each(views, lambda view: pixels_of(view, _PIXELS, farthest).astype(np.float64))
    points, owners = np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    place = np.array([view.translation_world_camera for view in views])[owners]
    points = place + (points - place) / (1 + unknowns[SHARE])
    flat = np.column_stack([-np.ones(len(points)), (middle - points) @ plane.axes[:2].T])
    heights = plane.heights(points) + flat @ unknowns[PLANE]
    near = np.abs(heights) < _NEAR
    points, owners, flat, heights = (
        points[near] - heights[near, None] * plane.normal,
        owners[near],
        flat[near],
        heights[near],
    )
    moves = moves_with(points, np.tile(plane.normal, (len(points), 1)), owners, views, rates)
    design = np.column_stack([flat, moves])
    return _Rows(design, heights, (1 - (heights / _NEAR) ** 2) ** 2, owners)
