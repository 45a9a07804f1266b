"""Model `patch` for several bodies or interfaces: one wrench each, friction spread as under uniform pressure."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.assembly.contact import Interface
from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.equilibrium import contact_forces
from poise.assembly.statics.friction_surface import PatchFriction, patch_friction
from poise.assembly.statics.load_factor import UNLIMITED, InverseLoadFactor, LoadFactorProgram
from poise.assembly.statics.pair_program import PairRows
from poise.geometry import cross, lengths
from poise.types import Array, Indices, Mask

_PRESSED = 1e-6
"""An interface pressed by less than this, in the block's units, has no centre of pressure."""
# The centres of pressure are moved until friction about the old ones errs by this share of what turning resists,
# at most this many times.
_SETTLED, _MOVES = 0.05, 4
_LOOKED_AT = 100
"""Interfaces beyond a simple bound on friction whose limit surface is looked at."""
# Fewer forces than this are looked at one by one: arrays take longer.
_FORCES_AT_ONCE = 12
# Inverse load factors this much above those of limit analysis are worth moving the centres for.
_WEAKER = 1.01
# In blocks of more interfaces than this, patches less than twice as long as wide are one cell (3 % instead of 1.5 %).
_MANY, _COMPACT = 8, 2.0
# How closely programs are solved: far below what spreading friction over cells leaves.
_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class _Cells:
    """Cells of all patches of a block, in its units.

    Args:
        interface: (M,) number within the block.
        share: (M,) friction per unit of the interface's normal force: mu times the share of the area.
        places: (M, 3) from the centre of pressure.
        axes: (M, 2, 3) two tangents.
        turning: (M, 3) normal times spin.
        reach: (M,) lever arm of the patch against turning.
    """

    interface: Indices
    share: Array
    places: Array
    axes: Array
    turning: Array
    reach: Array


class PatchProgram:
    """Inverse load factors of loads on a block whose interfaces carry one wrench each.

    Normal forces act at the corners of each interface, friction at cells that share its normal force by area, about
    its centre of pressure: there friction acts when all of a patch slides one way. With the centres held, all
    supplies are convex, and inverse load factors and cuts are those of limit analysis.
    """

    def __init__(
        self, geometry: BlockGeometry, interfaces: Sequence[Interface], order: Elimination | None = None
    ) -> None:
        """Take a block and its interfaces in order; `order`: in which its bodies are eliminated, where it is known.

        Raises:
            NoAnswerError: SOLVER_FAILED; UNSTABLE when the block does not stand.
        """
        self._geometry = geometry
        self._frictions = [patch_friction(interface) for interface in interfaces]
        self._cells, middles = _cells(geometry, interfaces, self._frictions)
        self._mu = np.array([interface.friction for interface in interfaces])
        self._reach = np.zeros(len(interfaces))
        self._reach[self._cells.interface] = self._cells.reach
        self._centres = self._pressed_at(contact_forces(geometry)[:, 0], middles)
        self._layout = _Layout.of(geometry, self._cells)
        self._order = order or Elimination.of(geometry.supports, geometry.count)
        self.resting = self._program(self._centres)
        """Inverse load factors with the centres of pressure as they are at rest (of the forces of thesis eq.
        4.12-4.15): convex, so that its cuts hold for all loads. Pushes that shift the centres across the friction that
        they cause have errors of some per cent, steep ones off centre larger errors (overestimated robustness)."""
        self._moving: LoadFactorProgram | None = None

    @property
    def holds(self) -> bool:
        """Whether friction spread like this holds the block at rest at all."""
        return bool(np.isfinite(self.resting.inverse_factor(self._geometry.gravity.ravel()).value))

    def at_rest(
        self, loads: Array, limits: Sequence[InverseLoadFactor], enough: Array
    ) -> list[InverseLoadFactor | None]:
        """Inverse load factors of loads (Q, 6 n) with the centres of pressure as they are at rest.

        Args:
            loads: in the block's units.
            limits: what limit analysis (of the same corners) says. None is answered where its forces are friction
                that patches can have, which therefore hold as much.
            enough: (Q,) inverse load factors of at most this need no close bounds.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        found: list[InverseLoadFactor | None] = [None] * len(loads)
        known = [row for row, limit in enumerate(limits) if limit.multipliers is not None]
        allowed = np.zeros(len(loads), dtype=bool)
        if known:
            allowed[known] = self.allows(np.array([limits[row].multipliers for row in known]))
        asked = np.flatnonzero(~allowed)
        for row, resting in zip(asked.tolist(), self.resting.each(loads[asked], enough[asked]), strict=True):
            found[row] = resting
        return found

    def inverse_factors(
        self,
        loads: Array,
        limits: Sequence[InverseLoadFactor],
        enough: Array,
        resting: Sequence[InverseLoadFactor | None] | None = None,
    ) -> list[InverseLoadFactor]:
        """Inverse load factors of loads (Q, 6 n) with the centres of pressure where they are at collapse.

        Args:
            loads, limits, enough: as `at_rest` takes them. The limit is returned where patches hold as much; where
                it is weaker anyway, the centres stay as they are at rest; otherwise its normal forces are the first
                guess of where they move.
            resting: what `at_rest` says, where it is known.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        known = list(self.at_rest(loads, limits, enough) if resting is None else resting)
        weaker: list[tuple[int, Array]] = []
        for row, (one, limit, least) in enumerate(zip(known, limits, enough.tolist(), strict=True)):
            if one is None or limit.multipliers is None or one.multipliers is None:
                continue
            if one.upper > max(least, _WEAKER * limit.value + UNLIMITED):
                weaker.append((row, one.multipliers))
        if weaker:
            for (row, _), fits in zip(weaker, self._fit(self._centres, np.array([m for _, m in weaker])), strict=True):
                if not fits:
                    known[row] = self._moved(loads[row], limits[row], float(enough[row]))
        return [limit if one is None else one for limit, one in zip(limits, known, strict=True)]

    def _moved(self, load: Array, limit: InverseLoadFactor, enough: float) -> InverseLoadFactor:
        """See `inverse_factors`, where patches cannot have the friction of the limit's forces."""
        normal_forces = np.zeros(0) if limit.multipliers is None else limit.multipliers[1::3]
        for _ in range(_MOVES):
            centres = self._pressed_at(normal_forces, self._centres)
            if self._moving is None:
                self._moving = self._program(self._centres)
            self._moving.set_entries(self._layout.entries(self._sliding(centres)))
            inverse = self._moving.inverse_factor(load, enough)
            if inverse.multipliers is None or self._fit(centres, inverse.multipliers[None])[0]:
                break
            normal_forces = inverse.multipliers[1 : 1 + len(normal_forces)]
        return inverse

    def allows(self, multipliers: Array) -> Mask:
        """(Q,) whether contact forces found by limit analysis (Q, rows) turn no patch more than uniform pressure could.

        A sufficient test: friction force over its limit, plus moment about the centre of pressure over its limit, is
        at most 1 (convexity of the limit surface).
        """
        geometry = self._geometry
        friction = multipliers[:, 2::3] * geometry.friction, multipliers[:, 3::3] * geometry.friction
        return self.allows_at(self._plane, geometry.interface, multipliers[:, 1::3], *friction)

    def allows_at(self, plane: tuple[Array, Array], which: Indices, normal: Array, along: Array, across: Array) -> Mask:
        """The same of any forces.

        Args:
            plane: (P,), (P,) where they act, along the tangents of their interface, in the block's units.
            which: (P,) their interface, ascending.
            normal, along, across: (Q, P) normal forces, and friction along both tangents.
        """
        (u, v), starts = plane, np.searchsorted(which, np.arange(len(self._centres)))
        of_points = normal, along, across, u * across - v * along, normal * u, normal * v
        total, fu, fv, turn, nu, nv = np.add.reduceat(of_points, starts, axis=2)
        turning = turn - (nu * fv - nv * fu) / np.maximum(total, _PRESSED)
        demand = np.sqrt(fu * fu + fv * fv) * self._reach + np.abs(turning)
        over = demand > self._mu * self._reach * total * (1 + 1e-4) + _PRESSED
        counts = over.sum(axis=1)
        looked_at = (counts > 0) & (counts <= _LOOKED_AT)
        # Those that are not within the simple bound may still be within the limit surface.
        allowed: Mask = counts <= _LOOKED_AT
        rows, interfaces = np.nonzero(over & looked_at[:, None])
        moments = turning[rows, interfaces] * self._geometry.units.length
        most = self._mu[interfaces] * total[rows, interfaces] * (1 + 1e-3) + _PRESSED
        often = np.bincount(interfaces, minlength=len(self._mu)) > _FORCES_AT_ONCE
        for i in np.flatnonzero(often).tolist():
            at, friction = interfaces == i, self._frictions[i]
            forces = np.stack([fu[rows[at], i], fv[rows[at], i]], axis=1)
            needed = friction.surface.normal_force_needed(forces, moments[at] / friction.size)
            allowed[rows[at][needed > most[at]]] = False
        some = np.flatnonzero(~often[interfaces])
        questions = (rows[some], interfaces[some], moments[some], most[some])
        for row, i, moment, bound in zip(*(each.tolist() for each in questions), strict=True):
            if allowed[row]:
                friction, force = self._frictions[i], (float(fu[row, i]), float(fv[row, i]))
                allowed[row] = friction.surface.normal_force_needed_for(*force, moment / friction.size) <= bound
        return allowed

    @cached_property
    def _plane(self) -> tuple[Array, Array]:
        """Coordinates (K,), (K,) of the corners along the tangents of their interface."""
        tangents = self._geometry.frames[:, 1:]
        u, v = np.einsum("ikj,ij->ki", tangents, self._geometry.points)
        return u, v

    def _fit(self, centres: Array, multipliers: Array) -> Mask:
        """(Q,) whether friction, taken about these centres (I, 3), is about those that the forces found (Q, R) have."""
        corners, cells, count = len(self._geometry.points), self._cells, len(multipliers)
        normal = multipliers[:, 1 : 1 + corners]
        slides = multipliers[:, 1 + corners :].reshape(count, -1, 4)[..., 1:3]
        forces = (slides[..., 0, None] * cells.axes[:, 0] + slides[..., 1, None] * cells.axes[:, 1]).swapaxes(1, 2)
        total = _sums(forces, cells.interface, len(centres)).swapaxes(1, 2)
        shift = self._pressed_at(normal, centres) - centres
        resists = _sums(cells.share * cells.reach, cells.interface, len(centres))
        resists = resists * _sums(normal, self._geometry.interface, len(centres))
        # Shift and friction lie in the plane: the length of their product is the moment about the normal.
        fits: Mask = np.all(lengths(cross(shift, total)) <= _SETTLED * resists + _PRESSED, axis=-1)
        return fits

    def _pressed_at(self, normal_forces: Array, otherwise: Array) -> Array:
        """(..., I, 3) centre of pressure of each interface (..., K); where it is not pressed, (I, 3) otherwise."""
        which, count = self._geometry.interface, len(otherwise)
        totals = _sums(normal_forces, which, count)[..., None]
        moments = _sums(normal_forces[..., None, :] * self._geometry.points.T, which, count).swapaxes(-1, -2)
        return np.where(totals > _PRESSED, moments / np.where(totals > _PRESSED, totals, 1.0), otherwise)

    def _program(self, centres: Array) -> LoadFactorProgram:
        """Unknowns: twists, and a bound on each cell's speed, which is of its interface alone."""
        geometry, layout = self._geometry, self._layout
        rows = PairRows(
            geometry.supports,
            geometry.count,
            singles=layout.corners,
            wides=layout.cells,
            locals=layout.cells,
            wide=4,
            entries=layout.entries(self._sliding(centres)),
            shared=-geometry.gravity.ravel(),
            equal=False,
        )
        return LoadFactorProgram(rows, _TOLERANCE, self._order)

    def _sliding(self, centres: Array) -> Array:
        """(M, 3, 6) wrenches of unit friction at the cells: along both tangents, and turning."""
        cells = self._cells
        points = centres[cells.interface] + cells.places
        wrenches = np.zeros((len(cells.share), 3, 6))
        wrenches[:, :2, :3] = cells.axes
        wrenches[:, :2, 3:] = cross(points[:, None], cells.axes)
        wrenches[:, 2, 3:] = cells.turning
        return wrenches


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where the rows of patches are in `PairRows.entries`: of each interface its corners, then four rows per cell.

    Args:
        corners, cells: (I,) of each interface.
        plain: (E,) entries without those that depend on the centres of pressure.
        motions: (M, 3, 6) where these are.
    """

    corners: Indices
    cells: Indices
    plain: Array
    motions: Indices

    @classmethod
    def of(cls, geometry: BlockGeometry, cells: _Cells) -> "_Layout":
        """Lay out the corners and cells of a block: a corner opens faster than its interface's cells cost."""
        number = len(geometry.supports)
        corners = np.bincount(geometry.interface, minlength=number).astype(np.int64)
        counts = np.bincount(cells.interface, minlength=number).astype(np.int64)
        width = 6 + counts
        begin = np.concatenate([[0], np.cumsum((corners + 4 * counts) * width)]).astype(np.int64)
        plain = np.zeros(begin[-1])
        which, cell_of = geometry.interface, cells.interface
        within_cells = np.arange(len(cell_of)) - (np.cumsum(counts) - counts)[cell_of]
        within_corners = np.arange(len(which)) - (np.cumsum(corners) - corners)[which]
        row = begin[which] + within_corners * width[which]
        normals = geometry.frames[:, 0]
        opening = np.concatenate([normals, np.cross(geometry.points, normals)], axis=1)
        plain[row[:, None] + np.arange(6)] = -opening
        # Every corner of an interface bears the friction of all its cells.
        owner = np.repeat(np.arange(len(which)), counts[which])
        first = (np.cumsum(counts) - counts)[which]
        cell = np.arange(len(owner)) - (np.cumsum(counts[which]) - counts[which])[owner]
        plain[row[owner] + 6 + cell] = cells.share[first[owner] + cell]
        head = begin[cell_of] + (corners[cell_of] + 4 * within_cells) * width[cell_of]
        plain[head + 6 + within_cells] = -1.0
        motions = head[:, None] + (1 + np.arange(3)) * width[cell_of][:, None]
        return cls(corners, counts, plain, motions[:, :, None] + np.arange(6))

    def entries(self, sliding: Array) -> Array:
        """(E,) with the wrenches (M, 3, 6) of friction at the cells."""
        entries = self.plain.copy()
        entries[self.motions] = -sliding
        return entries


def _sums(values: Array, which: Indices, count: int) -> Array:
    """(..., I) sums of values (..., K) over each interface, which all have some; `which` (K,) ascends."""
    return np.add.reduceat(values, np.searchsorted(which, np.arange(count)), axis=-1)


def _cells(
    geometry: BlockGeometry, interfaces: Sequence[Interface], frictions: Sequence[PatchFriction]
) -> tuple[_Cells, Array]:
    """The cells of all interfaces, and the centroids (I, 3) of these, in the block's units."""
    units = geometry.units
    sizes = [friction.size / units.length for friction in frictions]
    coarse = _COMPACT if len(interfaces) > _MANY else 0.0
    parts = [friction.surface.cells(coarse) for friction in frictions]
    number = np.repeat(np.arange(len(parts)), [len(part.weights) for part in parts])
    mu = np.array([interface.friction for interface in interfaces])
    normals = np.array([interface.normal for interface in interfaces])
    spins = np.concatenate([part.spins * size for part, size in zip(parts, sizes, strict=True)])
    places = [part.places @ friction.axes * size for part, friction, size in zip(parts, frictions, sizes, strict=True)]
    centroids = np.array([friction.centroid for friction in frictions])
    cells = _Cells(
        interface=number,
        share=mu[number] * np.concatenate([part.weights for part in parts]),
        places=np.concatenate(places),
        axes=np.array([friction.axes for friction in frictions])[number],
        turning=normals[number] * spins[:, None],
        reach=np.array([friction.surface.radius * size for friction, size in zip(frictions, sizes, strict=True)])[
            number
        ],
    )
    return cells, (centroids - units.origin) / units.length
