"""The contact points of a block as springs: forces, energy and stiffness at a displacement of the bodies."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from poise.assembly.contact import FIXED_NODE, Interface
from poise.assembly.statics.block import BlockGeometry, Sparse
from poise.assembly.statics.friction_surface import patch_friction
from poise.geometry import plane_axes
from poise.types import Array, Indices, Mask

CATCH = 1e-8
"""Stiffness of a weak spring to the ground that supports unsupported bodies, per mean contact stiffness."""
_SLACK = 1e-6
"""How far all contacts are open before anything loads them, in units of load per mean stiffness: far below what loads
close. It decides where bodies touch with no force, where rounding would otherwise."""
_DENSE = 120
"""Systems up to this size are solved dense."""
_AT_CORNERS = 0.3
"""Share of an interface's stiffness at its corners; the rest is at the cells within."""


@dataclass(frozen=True, eq=False)
class _Points:
    """Springs of all interfaces of a block, one interface after another, in its units.

    Args:
        wrenches: (P, 3, 6) of unit forces (normal and two tangents) on the second body.
        stiffness: (P,).
        friction: (P,).
        interface: (P,) number within the block.
    """

    wrenches: Array
    stiffness: Array
    friction: Array
    interface: Indices


class ElasticContacts:
    """Springs between the bodies of one block, which cannot pull, and friction at them.

    Args:
        geometry: of the block.
        interfaces: in order.
    """

    def __init__(self, geometry: BlockGeometry, interfaces: list[Interface]) -> None:
        points = _elastic_points(geometry, interfaces)
        self.interface = points.interface
        self.stiffness, self.friction = points.stiffness, points.friction
        self.catch = CATCH * float(points.stiffness.mean())
        self.count = geometry.count
        self._wrenches = points.wrenches
        self._starts = np.searchsorted(points.interface, np.arange(len(interfaces)))
        # The ground is one more body, whose motion and forces are dropped.
        self._sides = np.where(geometry.supports == FIXED_NODE, self.count, geometry.supports)
        self._pattern()

    def _pattern(self) -> None:
        """Prepare where in the stiffness of the bodies the blocks (6, 6) of each interface go, and with which sign."""
        size = 6 * self.count
        first, second = self._sides.T
        pairs = ((first, first, 1.0), (second, second, 1.0), (first, second, -1.0), (second, first, -1.0))
        rows, columns, signs, source = [], [], [], []
        for row, column, sign in pairs:
            kept = np.flatnonzero((row < self.count) & (column < self.count))
            shape = (len(kept), 6, 6)
            rows.append(np.broadcast_to(6 * row[kept][:, None, None] + np.arange(6)[:, None], shape).ravel())
            columns.append(np.broadcast_to(6 * column[kept][:, None, None] + np.arange(6), shape).ravel())
            source.append((36 * kept[:, None] + np.arange(36)).ravel())
            signs.append(np.full(len(kept) * 36, sign))
        diagonal = np.arange(size)
        at = np.concatenate([*columns, diagonal]) * size + np.concatenate([*rows, diagonal])
        entries, self._where = np.unique(at, return_inverse=True)
        self._source, self._signs = np.concatenate(source), np.concatenate(signs)
        self._rows = entries % size
        self._columns = np.searchsorted(entries // size, np.arange(size + 1))
        self._at = entries

    @cached_property
    def glued(self) -> Array | Sparse:
        """(6 n, 6 n) stiffness when nothing opens or slips."""
        return self._assembled(self.stiffness[:, None, None] * np.eye(3))

    def relative(self, displacement: Array) -> Array:
        """(P, 3) displacement of the second body relative to the first at each point: parting, and two tangents."""
        bodies = np.vstack([displacement.reshape(-1, 6), np.zeros(6)])
        moved = bodies[self._sides[:, 1]] - bodies[self._sides[:, 0]]
        relative = np.asarray((self._wrenches @ moved[self.interface][:, :, None])[:, :, 0])
        relative[:, 0] += _SLACK
        return relative

    def forces(self, relative: Array, bounds: Array | None) -> Array:
        """(P, 3) contact forces; friction limited to the bounds (P,), by default to what Coulomb's law says."""
        forces = -self.stiffness[:, None] * relative
        forces[:, 0] = np.maximum(forces[:, 0], 0.0)
        limits = self.friction * forces[:, 0] if bounds is None else bounds
        size = np.sqrt(forces[:, 1] ** 2 + forces[:, 2] ** 2)
        forces[:, 1:] *= np.minimum(1.0, limits / np.where(size > 0, size, 1.0))[:, None]
        return forces

    def pressed(self, relative: Array) -> Array:
        """(P,) friction that the normal forces allow."""
        return np.asarray(self.friction * np.maximum(-self.stiffness * relative[:, 0], 0.0))

    def left(self, u: Array, load: Array, relative: Array, bounds: Array | None = None) -> Array:
        """(6 n,) what contacts and catch leave of a load, negated."""
        wrenches = (self._wrenches * self.forces(relative, bounds)[:, :, None]).sum(axis=1)
        each = np.add.reduceat(wrenches, self._starts)
        total = np.zeros((self.count + 1, 6))
        np.add.at(total, self._sides[:, 1], each)
        np.subtract.at(total, self._sides[:, 0], each)
        return np.asarray(self.catch * u - load - total[:-1].ravel())

    def energy(self, u: Array, load: Array, relative: Array, bounds: Array) -> float:
        """Of contacts, catch and load at a displacement, with friction limited to the bounds."""
        k = self.stiffness
        pressed = np.minimum(relative[:, 0], 0.0)
        slide = np.sqrt(relative[:, 1] ** 2 + relative[:, 2] ** 2)
        with np.errstate(invalid="ignore"):
            friction = np.where(k * slide <= bounds, k * slide**2 / 2, bounds * slide - bounds**2 / (2 * k))
        return float(k @ pressed**2 / 2 + friction.sum() + self.catch * (u @ u) / 2 - load @ u)

    def jacobian(self, relative: Array, bounds: Array | None = None, damping: float = 0.0) -> Array | Sparse:
        """(6 n, 6 n) derivative of `left`; not symmetric without bounds, because friction follows the normal force.

        Plus this share of the stiffness when nothing opens or slips.
        """
        slide, closed = np.sqrt(relative[:, 1] ** 2 + relative[:, 2] ** 2), relative[:, 0] <= 0
        limits = self.pressed(relative) if bounds is None else bounds
        blocks, direction, slips = self._tangent(relative, slide, limits, closed)
        if bounds is None:
            blocks[:, 1:, 0] = -(self.friction * self.stiffness * (slips & closed))[:, None] * direction
        return self._assembled(blocks + (damping * self.stiffness)[:, None, None] * np.eye(3))

    def _tangent(self, relative: Array, slide: Array, bounds: Array, closed: Mask) -> tuple[Array, Array, Mask]:
        """Stiffness (P, 3, 3) with friction bounds held, directions of slip (P, 2), and which points slip (P,)."""
        k = self.stiffness
        slips = k * slide > bounds
        safe = np.where(slide > 0, slide, 1.0)
        direction = relative[:, 1:] / safe[:, None]
        across = np.where(slips, np.where(slips, bounds, 0.0) / safe, k)
        blocks = np.zeros((len(k), 3, 3))
        # Open contacts keep a trace of stiffness, so that a step never leaps without end.
        blocks[:, 0, 0] = np.where(closed, k, 1e-9 * k)
        along = direction[:, :, None] * direction[:, None]
        blocks[:, 1:, 1:] = across[:, None, None] * np.eye(2)
        blocks[:, 1:, 1:] -= np.where(slips, across, 0.0)[:, None, None] * along
        return blocks, direction, slips

    def _assembled(self, blocks: Array) -> Array | Sparse:
        """(6 n, 6 n) stiffness of the bodies of that of the points (P, 3, 3), and of the catch."""
        points = self._wrenches.transpose(0, 2, 1) @ (blocks @ self._wrenches)
        each = np.add.reduceat(points, self._starts).ravel()
        size = 6 * self.count
        values = np.concatenate([each[self._source] * self._signs, np.full(size, self.catch)])
        data = np.bincount(self._where, values, len(self._at))
        if size > _DENSE:
            return csc_array((data, self._rows, self._columns), shape=(size, size))
        dense = np.zeros(size * size)
        dense[self._at] = data
        return dense.reshape(size, size).T


def _elastic_points(geometry: BlockGeometry, interfaces: list[Interface]) -> _Points:
    """The springs of all interfaces: equal stiffness per area, part of it at the corners."""
    units = geometry.units
    areas = np.array([interface.area for interface in interfaces])
    mean = areas[areas > 0].mean() if np.any(areas > 0) else 1.0
    sizes = np.where(areas > 0, np.maximum(areas / mean, 1e-2), 1e-1)
    wrenches, stiffness = [], []
    number: list[NDArray[np.int64]] = []
    for i, (interface, size) in enumerate(zip(interfaces, sizes, strict=True)):
        share = _AT_CORNERS if interface.area > 0 else 1.0
        corners = len(interface.points)
        weights, places = [np.full(corners, share / corners)], [interface.points]
        if interface.area > 0:
            friction = patch_friction(interface)
            cells = friction.surface.cells()
            places.append(friction.centroid + friction.size * cells.places @ friction.axes)
            weights.append((1 - share) * cells.weights)
        points = (np.concatenate(places) - units.origin) / units.length
        frame = np.vstack([interface.normal, plane_axes(interface.normal)])
        arms = np.cross(points[:, None], frame)
        wrenches.append(np.concatenate([np.broadcast_to(frame, arms.shape), arms], axis=2))
        stiffness.append(size * np.concatenate(weights))
        number.append(np.full(len(points), i))
    which = np.concatenate(number)
    mu = np.array([interface.friction for interface in interfaces])[which]
    return _Points(np.concatenate(wrenches), np.concatenate(stiffness), mu, which)
