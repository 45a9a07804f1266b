"""A scanned surface as a solid of few planar facets: space is cut along its planar patches, and full cells are kept."""

from typing import NamedTuple

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from poise.scanning.patches import Patch, SurfaceSamples, planar_patches
from poise.scanning.rounding import Sides, sides_of
from poise.scanning.scan import SEEN_OFF
from poise.shape import HIDDEN_OFF
from poise.types import Array, Indices, Mask

_LEAST = 0.005
"""m: the side of a square as large as the smallest patch, and as the smallest part of one that cuts a cell."""
_DEPTH = 1e-3
"""m from the faces of a cell within which a patch does not cut it."""
_MOST_CUTS = 150
_FULL, _ENOUGH = 0.5, 0.1
"""Shares of a cell: that is inside the surface, for it to be part of the solid; that is trusted, to decide that by."""
_LEAST_POINTS = 100
_LOST = 1e-3
"""Share of the volume that may be lost where cells are united."""
_CHANGED = 0.08
"""Share by which the volume may differ from the body's, whose edges overshoot."""
_LEFT_OUT = 2e-3
"""m: the thickness of a piece that may differ from the body, where the scan is trusted."""
_MARGIN = 0.01
"""m around a surface within which space is cut, and points count."""
_MOST_POINTS = 60_000
"""Of more, some are drawn: memory grows with their number."""
_OUTER = 8
"""Triangles that give the direction outwards at a point."""


class _Cell(NamedTuple):
    """A convex piece of space: inside of the planes (P, 4), normal . x + last <= 0."""

    body: manifold3d.Manifold
    planes: Array


def faceted(
    body: manifold3d.Manifold, points: Array, seen: Mask, below: float, most: float
) -> manifold3d.Manifold | None:
    """The solid between the planes of the patches of a scan; None when it takes too many, or departs from the body.

    An edge between two patches is where their planes meet, so that edges that a scan rounds, or that overshoot, become
    sharp. Sides go on along their planes below the height from which on the scan is trusted.

    Args:
        body: the closed surface of the scan; it stands on z = 0.
        points: (N, 3) m on it.
        seen: (N,) False for the points that were completed.
        below: m, height below which the scan does not count.
        most: m that the surface may move, on average.
    """
    counting = counted(body, points, below)
    trusted = body.trim_by_plane((0.0, 0.0, 1.0), below)
    if trusted.is_empty() or len(counting) < _LEAST_POINTS:
        return None
    samples = _samples(body, points[counting], seen[counting])
    patches = planar_patches(samples, _LEAST**2)
    sides = [sides_of(samples, patch) for patch in patches]
    if any(len(each.planes) > 1 for each in sides) and not all(len(each.planes) > 1 or each.flat for each in sides):
        return None  # a can would seem to rest on a side of which it is not known that it is round
    division = _Division(body, trusted, below, samples)
    full = division.filled(_around(body), list(zip(patches, sides, strict=True)))
    if not full or division.cuts > _MOST_CUTS:
        return None
    whole = manifold3d.Manifold.batch_boolean([cell.body for cell in full], manifold3d.OpType.Add)
    lost = sum(cell.body.volume() for cell in full) - whole.volume()
    off = whole.volume() + body.volume() - 2 * (whole ^ body).volume()
    changed = abs(whole.volume() - body.volume())
    good = abs(lost) < _LOST * whole.volume() and changed < _CHANGED * body.volume()
    good = good and off <= most * body.surface_area()
    return whole if good and not _lacks_a_piece(whole.trim_by_plane((0.0, 0.0, 1.0), below), trusted) else None


def _lacks_a_piece(one: manifold3d.Manifold, other: manifold3d.Manifold) -> bool:
    """Whether one of two bodies has a piece, such as a leg, that the other lacks; a sheet is 2 volume / area thick."""
    pieces = [*(one - other).decompose(), *(other - one).decompose()]
    return any(2 * piece.volume() > _LEFT_OUT * piece.surface_area() for piece in pieces)


def counted(body: manifold3d.Manifold, points: Array, below: float) -> Indices:
    """The points that count: each place once, above a height, not far off the body, and not too many."""
    low, high = _bounds(body)
    rows = np.flatnonzero((points[:, 2] > below) & np.all((points > low) & (points < high), axis=1))
    if len(rows) > _MOST_POINTS:
        rows = np.sort(np.random.default_rng(0).choice(rows, _MOST_POINTS, replace=False))
    return np.asarray(rows[np.sort(np.unique(points[rows], axis=0, return_index=True)[1])])


def _samples(body: manifold3d.Manifold, points: Array, seen: Mask) -> SurfaceSamples:
    """The points, with directions outwards from the body's triangles."""
    mesh = body.to_mesh64()
    corners = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3][np.asarray(mesh.tri_verts, dtype=np.int64)]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    near = cKDTree(corners.mean(axis=1)).query(points, k=min(_OUTER, len(corners)))[1].reshape(len(points), -1)
    return SurfaceSamples.of(points, areas[near].sum(axis=1), np.where(seen, SEEN_OFF, HIDDEN_OFF))


def _bounds(body: manifold3d.Manifold) -> tuple[Array, Array]:
    """(3,) m each, the least and greatest coordinates of the space around a body."""
    corners = np.array(body.bounding_box()).reshape(2, 3)
    return corners[0] - _MARGIN, corners[1] + _MARGIN


def _around(body: manifold3d.Manifold) -> _Cell:
    """Space around a body, over the support."""
    low, high = _bounds(body)
    low[2] = 0.0
    start = manifold3d.Manifold.cube((*(high - low),)).translate((*low,))
    walls = np.vstack([np.column_stack([np.eye(3), -high]), np.column_stack([-np.eye(3), low])])
    return _Cell(start, walls)


class _Division:
    """Space is cut along patches, where they run through it, and what is inside of the surface is kept.

    Args:
        body, below: as of `faceted`.
        trusted: the body from that height on.
        samples: to which the patches belong.
    """

    def __init__(
        self, body: manifold3d.Manifold, trusted: manifold3d.Manifold, below: float, samples: SurfaceSamples
    ) -> None:
        self._body, self._trusted, self._below, self._samples = body, trusted, below, samples
        self.cuts = 0

    def filled(self, cell: _Cell, patches: list[tuple[Patch, Sides]]) -> list[_Cell]:
        """Convex parts of a cell that are inside; the cell itself when all of it is."""
        for number, (patch, sides) in enumerate(patches):
            if self.cuts > _MOST_CUTS or not (parts := self._divided(cell, patch, sides.planes)):
                continue
            self.cuts += 1
            found = [self.filled(part, patches[number + 1 :]) for part in parts]
            same = all(len(kept) == 1 and kept[0] is part for kept, part in zip(found, parts, strict=True))
            return [cell] if same else [each for kept in found for each in kept]
        return [cell] if self._is_full(cell.body) else []

    def _divided(self, cell: _Cell, patch: Patch, planes: Array) -> list[_Cell]:
        """The parts into which the planes of a patch cut a cell, when enough of the patch is inside; else none."""
        inside = np.all(self._samples.points[patch.rows] @ cell.planes[:, :3].T + cell.planes[:, 3] < -_DEPTH, axis=1)
        if self._samples.areas[patch.rows][inside].sum() < _LEAST**2:
            return []
        outermost = np.append(patch.normal, -patch.offset)
        if len(planes) > 1:  # in front of it a patch that bulges has nothing
            outermost[3] = -float(np.max(self._samples.points[patch.rows] @ patch.normal))
        beyond = cell.body.trim_by_plane((*outermost[:3],), -outermost[3])
        within = cell.body
        for plane in planes:
            within = within.trim_by_plane((*-plane[:3],), plane[3])
        if beyond.is_empty() or within.is_empty():
            return []
        return [_Cell(within, np.vstack([cell.planes, outermost])), _Cell(beyond, np.vstack([cell.planes, -outermost]))]

    def _is_full(self, cell: manifold3d.Manifold) -> bool:
        """Whether a cell is inside the surface, by what is trusted of that, where there is enough of it."""
        counting = cell.trim_by_plane((0.0, 0.0, 1.0), self._below)
        if counting.volume() > _ENOUGH * cell.volume():
            return bool((counting ^ self._trusted).volume() > _FULL * counting.volume())
        return bool((cell ^ self._body).volume() > _FULL * cell.volume())
