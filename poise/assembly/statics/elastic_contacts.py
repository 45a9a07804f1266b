"""The contact points of a block as springs: forces, energy and stiffness at a displacement of the bodies."""

from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from poise.assembly.contact import FIXED_NODE, Interface
from poise.assembly.statics.block import BlockGeometry, Sparse, assembled
from poise.assembly.statics.body_stiffness import BodyStiffness
from poise.assembly.statics.deadline import Deadline
from poise.assembly.statics.elastic_state import ElasticFactor
from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.friction_surface import patch_friction
from poise.assembly.statics.load_path import CompiledPoints, LoadPath, PathPoint
from poise.geometry import cross, plane_axes
from poise.kernels import COMPILED, CompiledElastic, ElasticOutcome
from poise.types import Array, Indices

CATCH = 1e-8
"""Stiffness of a weak spring to the ground that supports unsupported bodies, per mean contact stiffness."""
_SLACK = 1e-6
"""How far all contacts are open before anything loads them, in units of load per mean stiffness: far below what loads
close. It decides where bodies touch with no force, where rounding would otherwise."""
_AT_CORNERS = 0.3
"""Share of an interface's stiffness at its corners; the rest is at the cells within."""


@dataclass(frozen=True, eq=False)
class _Points:
    """Springs of all interfaces of a block, one interface after another, in its units.

    Args:
        area: m2, that of an interface with a stiffness of 1.
        places: (P, 2) along the tangents of the interface.
        wrenches: (P, 3, 6) of unit forces (normal and two tangents) on the second body.
        stiffness: (P,).
        friction: (P,).
        interface: (P,) number within the block.
    """

    area: float
    places: Array
    wrenches: Array
    stiffness: Array
    friction: Array
    interface: Indices


@dataclass(frozen=True, eq=False)
class Stiffness:
    """Stiffness (6 n, 6 n) between the bodies of a block."""

    layout: BodyStiffness
    entries: Array

    def solve(self, load: Array) -> Array:
        """(6 n,) displacements under a load (6 n,)."""
        return self.layout.solve(self.entries, load)


class ElasticContacts:
    """Springs between the bodies of one block, which cannot pull, and friction at them.

    Args:
        geometry: of the block.
        interfaces: in order.
        order: in which bodies are eliminated, where it is known.
    """

    def __init__(self, geometry: BlockGeometry, interfaces: list[Interface], order: Elimination | None = None) -> None:
        self._order = order
        points = _elastic_points(geometry, interfaces)
        self.area, self.places = points.area, points.places
        self.interface = points.interface
        self.stiffness, self.friction = points.stiffness, points.friction
        self.catch = CATCH * float(points.stiffness.mean())
        self.count = geometry.count
        self._starts = np.searchsorted(points.interface, np.arange(len(interfaces)))
        # The ground is one more body, whose motion and forces are dropped.
        self.sides = np.where(geometry.supports == FIXED_NODE, self.count, geometry.supports)
        self.wrenches = points.wrenches

    def held_by(self, catch: float) -> "ElasticContacts":
        """The same contacts of bodies that springs of another stiffness hold to the ground."""
        held = copy(self)
        held.catch = catch
        for kept in ("compiled", "glued"):
            held.__dict__.pop(kept, None)
        return held

    @cached_property
    def _stiffness_of_bodies(self) -> BodyStiffness:
        return BodyStiffness(self.sides, self.count)

    @cached_property
    def _forces(self) -> Any:
        """(6 n, 3 P) wrenches on the bodies of unit forces at the springs."""
        bodies = np.where(self.sides == self.count, FIXED_NODE, self.sides)
        forces: Sparse = assembled(self.wrenches, bodies[self.interface], self.count)
        return forces.toarray() if self._stiffness_of_bodies.kind == "dense" else forces.tocsr()

    @cached_property
    def _padded(self) -> tuple[Indices, Array, Array]:
        """(P,) where each spring is among as many for each interface; (R, 3, 6) their wrenches there, and side by side.

        The last are (I, 6, 3 M).
        """
        within = np.arange(len(self.wrenches)) - self._starts[self.interface]
        each = int(within.max()) + 1
        slot = self.interface * each + within
        padded = np.zeros((len(self._starts) * each, 3, 6))
        padded[slot] = self.wrenches
        columns = padded.reshape(len(self._starts), 3 * each, 6).transpose(0, 2, 1)
        return slot, padded, np.ascontiguousarray(columns)

    @cached_property
    def compiled(self) -> "CompiledElasticContacts | None":
        """The same in compiled form; None where the kernels are not installed."""
        if not COMPILED:
            return None
        return CompiledElasticContacts(self, self.wrenches, self._order or Elimination.of(self.sides, self.count))

    @cached_property
    def glued(self) -> Stiffness:
        """Stiffness when nothing opens or slips."""
        k, none = self.stiffness, np.zeros_like(self.stiffness)
        return self._assembled(np.array([k, k, k, none, none, none]))

    def moved(self, displacement: Array) -> Array:
        """(..., P, 3) motion of the second body relative to the first at each point: parting, and two tangents."""
        bodies = np.zeros((*displacement.shape[:-1], self.count + 1, 6))
        bodies[..., :-1, :] = displacement.reshape(*displacement.shape[:-1], -1, 6)
        between = bodies[..., self.sides[:, 1], :] - bodies[..., self.sides[:, 0], :]
        return np.asarray(np.einsum("pij,...pj->...pi", self.wrenches, between[..., self.interface, :]))

    def relative(self, displacement: Array) -> Array:
        """(..., P, 3) displacement of the second body relative to the first: `moved`, from where nothing presses."""
        relative = self.moved(displacement)
        relative[..., 0] += _SLACK
        return relative

    def forces(self, relative: Array, bounds: Array | None) -> Array:
        """(..., P, 3) contact forces; friction limited to the bounds (P,), by default to what Coulomb's law says."""
        forces = -self.stiffness[:, None] * relative
        forces[..., 0] = np.maximum(forces[..., 0], 0.0)
        limits = self.friction * forces[..., 0] if bounds is None else bounds
        size = np.sqrt(forces[..., 1] ** 2 + forces[..., 2] ** 2)
        forces[..., 1:] *= np.minimum(1.0, limits / np.where(size > 0, size, 1.0))[..., None]
        return forces

    def pressed(self, relative: Array) -> Array:
        """(P,) friction that the normal forces allow."""
        return np.asarray(self.friction * np.maximum(-self.stiffness * relative[:, 0], 0.0))

    def left(self, u: Array, load: Array, relative: Array, bounds: Array | None = None) -> Array:
        """(6 n,) what contacts and catch leave of a load, negated."""
        return np.asarray(self.catch * u - load - self._forces @ self.forces(relative, bounds).ravel())

    def energy(self, u: Array, load: Array, relative: Array, bounds: Array) -> float:
        """Of contacts, catch and load at a displacement, with friction limited to the bounds."""
        k = self.stiffness
        pressed = np.minimum(relative[:, 0], 0.0)
        slide = np.sqrt(relative[:, 1] ** 2 + relative[:, 2] ** 2)
        with np.errstate(invalid="ignore"):
            friction = np.where(k * slide <= bounds, k * slide**2 / 2, bounds * slide - bounds**2 / (2 * k))
        return float(k @ pressed**2 / 2 + friction.sum() + self.catch * (u @ u) / 2 - load @ u)

    def jacobian(self, relative: Array, bounds: Array | None = None, damping: float = 0.0) -> Stiffness:
        """Derivative of `left`; not symmetric without bounds, because friction follows the normal force.

        Plus this share of the stiffness when nothing opens or slips. Interfaces between bodies that have no forces
        are left out: the catch holds what nothing else holds.
        """
        k, closed = self.stiffness, relative[:, 0] <= 0
        acts = closed if bounds is None else closed | (bounds > 0)
        couples = (np.bincount(self.interface, acts, len(self._starts)) > 0) | np.any(self.sides == self.count, axis=1)
        slide = np.sqrt(relative[:, 1] ** 2 + relative[:, 2] ** 2)
        limits = self.pressed(relative) if bounds is None else bounds
        slips = k * slide > limits
        safe = np.where(slide > 0, slide, 1.0)
        first, second = relative[:, 1] / safe, relative[:, 2] / safe
        across = np.where(slips, np.where(slips, limits, 0.0) / safe, 0.0)
        own, sticking = np.empty((6, len(k))), np.where(slips, damping, 1.0 + damping) * k
        # Open contacts keep a trace of stiffness, so that a step never leaps without end.
        own[0] = np.where(closed, 1.0 + damping, 1e-9 + damping) * k
        own[1], own[2] = sticking + across * second**2, sticking + across * first**2
        own[3] = -across * first * second
        follows = self.friction * k * (slips & closed) if bounds is None else np.zeros_like(k)
        own[4], own[5] = -follows * first, -follows * second
        return self._assembled(own * couples[self.interface])

    def _assembled(self, own: Array) -> Stiffness:
        """Stiffness of the bodies, and of the catch.

        Args:
            own: (6, P) stiffness of the points along the normal and both tangents, between the tangents, and of both
                tangential forces in the normal direction.
        """
        slot, w, side_by_side = self._padded
        spread, rows = np.zeros((6, len(w))), np.empty_like(w)
        spread[:, slot] = own
        normal, first, second, shear, first_follows, second_follows = spread[:, :, None]
        rows[:, 0] = normal * w[:, 0]
        rows[:, 1] = first * w[:, 1] + shear * w[:, 2] + first_follows * w[:, 0]
        rows[:, 2] = shear * w[:, 1] + second * w[:, 2] + second_follows * w[:, 0]
        pairs = side_by_side @ rows.reshape(len(side_by_side), -1, 6)
        bodies = self._stiffness_of_bodies
        return Stiffness(bodies, bodies.matrix(pairs, self.catch))


class CompiledElasticContacts:
    """Elastic contacts whose loops run in C; displacements and loads (6 n,) in the order of the bodies.

    Args:
        contacts: the same ones.
        wrenches: (P, 3, 6) of unit forces at their points.
        order: in which bodies are eliminated.
    """

    def __init__(self, contacts: ElasticContacts, wrenches: Array, order: Elimination) -> None:
        self._entries = order.entries
        springs = np.searchsorted(contacts.interface, np.arange(len(contacts.sides) + 1))
        arrays = springs, wrenches, contacts.stiffness, contacts.friction
        self._kernel = CompiledElastic(order.compiled, *arrays, catch=contacts.catch, slack=_SLACK)

    def _back(self, found: Array) -> Array:
        out = np.empty_like(found)
        out[self._entries] = found
        return out

    def descend(
        self, load: Array, start: Array, bounds: Array | None, enough: float, steps: int, deadline: Deadline
    ) -> Array:
        """As `CoulombBlock._descend`."""
        given = load[self._entries], start[self._entries], bounds, enough, steps, deadline.remaining
        return self._back(self._kernel.descend(*given))

    def left(self, u: Array, load: Array) -> Array:
        """As `ElasticContacts.left`, with friction as Coulomb's law says."""
        return self._back(self._kernel.left(u[self._entries], load[self._entries]))

    def reach(
        self, load: Array, push: Array, start: Array, enough: float, steps: int, deadline: Deadline
    ) -> tuple[Array, float, float, float, int]:
        """The displacement, factor, merit, compliance and steps that `CoulombBlock._reach` wants."""
        given = load[self._entries], push[self._entries], start[self._entries], enough, steps, deadline.remaining
        u, factor, left, compliance, taken = self._kernel.reach(*given)
        return self._back(u), factor, left, compliance, taken

    def follow(
        self,
        loads: tuple[Array, Array],
        rest: Array,
        begin: PathPoint | None,
        response: Array | None,
        limits: tuple[float, float],
        deadline: Deadline,
        look: bool,
    ) -> LoadPath:
        """As `load_path.follow`: gravity and the load, at most a factor, with a tolerance of it; and `look_beyond`."""
        entries = self._entries
        gravity, push = (load[entries] for load in loads)
        start = None if begin is None else (begin.displacement[entries], begin.factor, begin.compliance)
        slope = None if response is None else response[entries]
        found = self._kernel.follow((gravity, push), rest[entries], start, slope, (*limits, deadline.remaining), look)
        numbers = found.factors.tolist(), found.compliances.tolist(), found.steps.tolist()
        return LoadPath(CompiledPoints(found.displacements, entries, *numbers), self._back(found.end), found.ended)

    def factors(
        self,
        gravity: Array,
        rest: Array,
        loads: Array,
        most: tuple[Array, Array],
        limits: tuple[float, Deadline],
    ) -> list[ElasticFactor | None]:
        """As `CoulombBlock.factor` for loads (Q, 6 n), at most factors (Q,); None where more searches are needed.

        Args:
            gravity, rest: (6 n,) load, and displacement under it.
            loads: (Q, 6 n).
            most: (Q,) factors that are enough, and those that are asked at most.
            limits: tolerance of factors, and the deadline of all.
        """
        entries, (enough, above), (tolerance, deadline) = self._entries, most, limits
        given = gravity[entries], rest[entries], loads[:, entries], enough, (tolerance, deadline.remaining)
        asked = self._kernel.factors(*given)
        best, earlier, motions = np.empty((3, *loads.shape))
        best[:, entries], earlier[:, entries], motions[:, entries] = asked.best, asked.earlier, asked.motions
        values = np.minimum(asked.factors, above).tolist()
        found: list[ElasticFactor | None] = []
        for row, (outcome, value) in enumerate(zip(asked.outcomes.tolist(), values, strict=True)):
            if outcome == ElasticOutcome.UNDECIDED:
                found.append(None)
            elif outcome == ElasticOutcome.LATE:
                found.append(ElasticFactor(value, False))
            else:
                motion = motions[row] if outcome == ElasticOutcome.COLLAPSED else None
                found.append(ElasticFactor(value, True, motion, best[row], earlier[row]))
        return found

    def response(self, at: Array | None, push: Array) -> Array:
        """(6 n,) change under a small push at a displacement; None: where nothing opens or slips."""
        return self._back(self._kernel.response(None if at is None else at[self._entries], push[self._entries]))


def _elastic_points(geometry: BlockGeometry, interfaces: list[Interface]) -> _Points:
    """The springs of all interfaces: equal stiffness per area, part of it at the corners."""
    units = geometry.units
    areas = np.array([interface.area for interface in interfaces])
    mean = areas[areas > 0].mean() if np.any(areas > 0) else 1.0
    sizes = np.where(areas > 0, np.maximum(areas / mean, 1e-2), 1e-1)
    springs = [interface.once("springs", partial(_springs, interface)) for interface in interfaces]
    which = np.repeat(np.arange(len(springs)), [len(shares) for _, shares in springs])
    points = (np.concatenate([points for points, _ in springs]) - units.origin) / units.length
    normals = np.array([interface.normal for interface in interfaces])
    frames = np.concatenate([normals[:, None], plane_axes(normals)], axis=1)[which]
    wrenches = np.concatenate([frames, cross(points[:, None], frames)], axis=2)
    return _Points(
        area=float(mean),
        places=np.einsum("ij,ikj->ik", points, frames[:, 1:]),
        wrenches=wrenches,
        stiffness=sizes[which] * np.concatenate([shares for _, shares in springs]),
        friction=np.array([interface.friction for interface in interfaces])[which],
        interface=which,
    )


def _springs(interface: Interface) -> tuple[Array, Array]:
    """(P, 3) where the springs of an interface are, m, and (P,) their shares of its stiffness."""
    corners = len(interface.points)
    if interface.area == 0:
        return interface.points, np.full(corners, 1 / corners)
    friction = patch_friction(interface)
    cells = friction.surface.cells()
    places = friction.centroid + friction.size * cells.places @ friction.axes
    shares = [np.full(corners, _AT_CORNERS / corners), (1 - _AT_CORNERS) * cells.weights]
    return np.concatenate([interface.points, places]), np.concatenate(shares)
