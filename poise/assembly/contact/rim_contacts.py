"""Where the rim of a cylinder touches a round side, another rim or an edge, leaning: at one point each.

Along the rim the distance from the other curve or axis has a few least values; what touches is near one of them.
"""

from collections.abc import Callable, Iterator

import numpy as np

from poise.assembly.contact.placed import ContactPatch, PlacedBody, RoundTouch
from poise.assembly.contact.touching import NO_TRIANGLES, overlap
from poise.assembly.scene import Cylinder
from poise.geometry import cross, plane_axes, unit
from poise.types import Array, Indices

_ANGLES = 2 * np.pi * np.arange(96) / 96
_FINER, _ROUNDS = np.linspace(-1, 1, 15), 7
"""Angles around the rim that are tried; around the best of them, in steps that become smaller so many times."""
PARALLEL = float(np.sin(np.radians(1.0)))
"""Sine of the angle below which axes, or edges, count as parallel."""
_LEAN = 1e-4
"""A rim touches alone where both faces beside it lean away by more, rad; otherwise the side does, or the cap."""


class _Rim:
    """One rim of a cylinder: a circle, with the outward normals of the side and of the cap beside it.

    Args:
        body: the cylinder.
        end: 1 or -1, which cap.
    """

    def __init__(self, body: PlacedBody, end: int) -> None:
        shape, pose = body.item.shape, body.item.pose
        if not isinstance(shape, Cylinder):
            raise TypeError(f"object {body.item.id} is not a cylinder")
        self.out = end * pose.rotation[:, 2]
        self.centre = pose.translation + shape.length / 2 * self.out
        self.radius = shape.radius
        self._axes = plane_axes(self.out)

    def at(self, angles: Array) -> Array:
        """(..., 3) points at angles (...) around the rim."""
        return self.centre + self.radius * self.aside(angles)

    def aside(self, angles: Array) -> Array:
        """(..., 3) outward normals of the side there."""
        return np.asarray(np.cos(angles)[..., None] * self._axes[0] + np.sin(angles)[..., None] * self._axes[1])

    def angle_of(self, point: Array) -> float:
        """At which a point (3,) of the rim is."""
        x, y = self._axes @ (point - self.centre)
        return float(np.arctan2(y, x))

    def along(self, angle: float) -> Array:
        """(3,) unit vector along the rim."""
        return np.asarray(np.cos(angle) * self._axes[1] - np.sin(angle) * self._axes[0])

    def faces(self, normal: Array, angle: float) -> bool:
        """Whether a direction leaves the cylinder through the rim alone."""
        return bool(normal @ self.out > _LEAN and normal @ self.aside(np.array(angle)) > _LEAN)

    def nearest(self, points: Array) -> Array:
        """(..., 3) the points of the rim that are nearest to others."""
        run = points - self.centre
        flat = run - (run @ self.out)[..., None] * self.out
        size = np.linalg.norm(flat, axis=-1, keepdims=True)
        return np.asarray(self.centre + self.radius * flat / np.where(size > 0, size, 1.0))


def rim_patches(body: PlacedBody, base: PlacedBody, margin: float) -> list[ContactPatch]:
    """The rims of a cylinder on the round side of another, or on the edges of a polyhedron, normals out of the base."""
    if base.cylinder is not None and _parallel(body, base):
        return []
    search = _on_side if base.cylinder is not None else _on_edges
    return [patch for end in (1, -1) for patch in search(_Rim(body, end), body, base, margin)]


def rims_on_rims(body: PlacedBody, base: PlacedBody, margin: float) -> list[ContactPatch]:
    """The rims of two cylinders on each other, normals out of the base."""
    patches = []
    pairs = [] if _parallel(body, base) else [(_Rim(body, a), _Rim(base, b)) for a in (1, -1) for b in (1, -1)]
    for rim, other in pairs:
        if float(np.linalg.norm(rim.centre - other.centre)) > rim.radius + other.radius + margin:
            continue

        def away(points: Array, other: _Rim = other) -> Array:
            return np.asarray(np.linalg.norm(points - other.nearest(points), axis=-1))

        for angle, _ in _least(rim, lambda points, _: away(points), np.zeros(1, dtype=np.int64), margin):
            place = rim.at(np.array(angle))
            foot = other.nearest(place)
            there = other.angle_of(foot)
            for normal in _square_to(rim.along(angle), other.along(there)):
                if rim.faces(-normal, angle) and other.faces(normal, there):
                    patches += _patch(place, foot, normal, margin, None)
    return patches


def _on_side(rim: _Rim, body: PlacedBody, base: PlacedBody, margin: float) -> Iterator[ContactPatch]:
    centre, axis = base.item.pose.translation, base.item.pose.rotation[:, 2]
    shape = base.item.shape
    if not isinstance(shape, Cylinder):
        return

    def feet(points: Array) -> Array:
        return centre + ((points - centre) @ axis)[..., None] * axis

    def away(points: Array, _: Indices) -> Array:  # negative where they overlap: the deepest place counts
        return np.asarray(np.linalg.norm(points - feet(points), axis=-1) - shape.radius)

    for angle, _ in _least(rim, away, np.zeros(1, dtype=np.int64), margin):
        place = rim.at(np.array(angle))
        foot = feet(place)
        normal = unit(place - foot)
        if abs((place - centre) @ axis) < (1 - 1e-6) * shape.length / 2 and rim.faces(-normal, angle):
            # As of sides that cross: each rolls along the other.
            touch = RoundTouch(place[None], np.array([min(rim.radius, shape.radius)]), None)
            yield from _patch(place, foot + shape.radius * normal, normal, margin, touch)


def _on_edges(rim: _Rim, body: PlacedBody, base: PlacedBody, margin: float) -> Iterator[ContactPatch]:
    edges = base.edges_near(overlap(body.bounds, base.bounds, margin))
    first, last = np.moveaxis(base.vertices[base.edges[edges]], 1, 0)
    run = last - first
    square = np.einsum("ek,ek->e", run, run)

    def feet(points: Array, rows: Indices) -> Array:
        share = np.einsum("...k,...k->...", points - first[rows], run[rows]) / square[rows]
        return np.asarray(first[rows] + np.clip(share, 0.0, 1.0)[..., None] * run[rows])

    def away(points: Array, rows: Indices) -> Array:
        return np.asarray(np.linalg.norm(points - feet(points, rows), axis=-1))

    for angle, row in _least(rim, away, np.arange(len(edges)), margin):
        place = rim.at(np.array(angle))
        foot = feet(place, np.array(row))
        share = (foot - first[row]) @ run[row] / square[row]
        if not 1e-6 < share < 1 - 1e-6:
            continue
        for normal in _square_to(rim.along(angle), unit(run[row])):
            if rim.faces(-normal, angle) and base.edge_pushes(int(edges[row]), normal):
                yield from _patch(place, foot, normal, margin, None)


def _parallel(first: PlacedBody, second: PlacedBody) -> bool:
    """Whether the axes of two cylinders are."""
    across = cross(first.item.pose.rotation[:, 2], second.item.pose.rotation[:, 2])
    return bool(np.linalg.norm(across) < PARALLEL)


def _square_to(first: Array, second: Array) -> list[Array]:
    """Both unit vectors across two; none where these are nearly parallel."""
    across = cross(first, second)
    size = float(np.linalg.norm(across))
    return [across / size, -across / size] if size > PARALLEL else []


def _patch(place: Array, foot: Array, normal: Array, margin: float, touch: RoundTouch | None) -> list[ContactPatch]:
    gap = float((place - foot) @ normal)
    if abs(gap) > margin:
        return []
    return [ContactPatch((place - gap / 2 * normal)[None], normal, gap, NO_TRIANGLES, touch)]


def _least(
    rim: _Rim, away: Callable[[Array, Indices], Array], rows: Indices, margin: float
) -> Iterator[tuple[float, int]]:
    """Angles around a rim, each with a row, at which the distance from what the row stands for is least.

    Args:
        rim: the circle.
        away: distances (...) of points (..., 3) from what rows (...) stand for, m.
        rows: (R,).
        margin: m; larger distances are left out.
    """
    if not len(rows):
        return
    step = float(_ANGLES[1])
    tried = away(rim.at(_ANGLES)[:, None], rows)
    lower = (tried <= np.roll(tried, 1, axis=0)) & (tried < np.roll(tried, -1, axis=0))
    places, found = np.nonzero(lower & (tried <= margin + rim.radius * step))
    angles, which = _ANGLES[places], rows[found]
    for _ in range(_ROUNDS if len(angles) else 0):
        near = angles[:, None] + step * _FINER
        best = away(rim.at(near), which[:, None]).argmin(axis=1)
        angles, step = near[np.arange(len(angles)), best], step * float(_FINER[1] - _FINER[0])
    for angle, row, distance in zip(angles.tolist(), which.tolist(), away(rim.at(angles), which).tolist(), strict=True):
        if distance <= margin:
            yield angle, row
