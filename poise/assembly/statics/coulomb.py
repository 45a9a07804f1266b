"""Elastic contacts of a block: no tension, Coulomb friction limited by the normal forces that arise.

Limit analysis asks whether contact forces in balance exist. Between two walls they exist at any magnitude, although
nothing presses the walls to the cube. Here normal forces arise only where bodies are pushed into each other.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from poise.assembly.contact import Interface
from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.assembly.statics.elastic_contacts import ElasticContacts
from poise.types import Array, Mask

# A body stands when the catch carries less than this share of its load; its load counts as this share of all at least.
_CARRIED, _LEAST_LOAD = 5e-5, 1e-2
_FALLS = 1e-3
"""A body of whose load the catch carries more than this share is not held by any further rounds."""
_SETTLED = 1e-7
"""What may be left of the equations, per load."""
# Newton steps in a row; steps of a Tresca problem; Tresca problems between two attempts of Newton; attempts.
_STEPS, _TRESCA_STEPS, _ROUNDS, _ATTEMPTS = 15, 12, 3, 10
_ON_THE_WAY = (0.95,)
"""Shares of a factor at which a block stands that are asked, too: as the load grows, it must stand there before."""
_IDLE = 1e-3
"""An interface that carries less than this share of the lighter body at rest only touches."""
_PROBES, _NEAR = 40, 5
"""Load factors that are tried at most, and within how many tolerances Newton steps alone look for the factor."""
FACTOR_TOLERANCE = 0.004
"""Relative tolerance of the load factor at which a block collapses."""


@dataclass(frozen=True, eq=False)
class ElasticState:
    """The equilibrium of a block on elastic contacts.

    Args:
        stands: the contacts alone carry the load.
        unbalanced: share of the load of a body that they do not carry, at most.
        displacement: (6 n,) in units of load per mean stiffness.
        settled: the equations are solved; otherwise it does not stand.
        known: it was found before the deadline.
    """

    stands: bool
    unbalanced: float
    displacement: Array
    settled: bool = True
    known: bool = True


@dataclass(frozen=True, eq=False)
class ElasticFactor:
    """Up to which factor a block stands under a load.

    Args:
        value: it stands at this factor.
        known: it stands at none that is much larger; otherwise the deadline passed.
        twist: (6 n,) the motion at the least factor at which it did not stand; None when there was none.
    """

    value: float
    known: bool
    twist: Array | None = None


class CoulombBlock:
    """Elastic contacts of one block: no tension, Coulomb friction, rigid bodies.

    Slip is against friction, without the dilatancy that limit analysis assumes. Solved by a semismooth Newton method
    on the whole law (Alart, Curnier 1991); where that is stuck, rounds of Tresca problems give a new start (Nečas,
    Jarušek, Haslinger 1980): with friction bounded by the last round's normal forces, the equilibrium is the minimum
    of a convex energy.
    """

    def __init__(self, geometry: BlockGeometry, interfaces: list[Interface]) -> None:
        """Take a block and its interfaces in order."""
        self.geometry = geometry
        self.contacts = ElasticContacts(geometry, interfaces)

    def settle(
        self,
        load: Array,
        start: Array | None = None,
        deadline: Deadline = NO_DEADLINE,
    ) -> ElasticState:
        """Find the equilibrium under a load (6 n,), gravity included, in the block's units.

        Args:
            load: N and N m, in those units.
            start: (6 n,) displacement near which to look first; None: that of contacts that do not slip.
            deadline: when it passes, the state is not `known`.
        """
        contacts, bounds = self.contacts, np.full(len(self.contacts.stiffness), np.inf)
        if start is not None and (found := self._newton(load, start, deadline)).settled:
            return found
        u = self._tresca(load, bounds, contacts.glued.solve(load), deadline)
        for attempt in range(_ATTEMPTS):
            found = self._newton(load, u, deadline)
            if found.settled or not found.known:
                return found
            for _ in range(_ROUNDS):
                pressed = contacts.pressed(contacts.relative(u))
                bounds = pressed if attempt < 2 else (bounds + pressed) / 2
                u = self._tresca(load, bounds, u, deadline)
            found = self._state(load, u)
            if found.settled:
                return found
            if deadline.passed:
                return replace(found, known=False)
            if (carried := self._share(contacts.catch * u, load)) > _FALLS:
                return ElasticState(False, carried, u)
        return found

    @cached_property
    def pressed_at_rest(self) -> Mask:
        """(I,) interfaces that carry a load of the bodies they are between at rest, if only a little."""
        contacts, gravity = self.contacts, np.linalg.norm(self.geometry.gravity, axis=1)
        normal = contacts.forces(contacts.relative(self.rest.displacement), None)[:, 0]
        loads = np.append(gravity, np.inf)[self.geometry.supports].min(axis=1)
        return np.asarray(np.bincount(contacts.interface, normal) > _IDLE * loads)

    @cached_property
    def rest(self) -> ElasticState:
        """The state under gravity alone."""
        return self.settle(self.geometry.gravity.ravel())

    def factor(
        self,
        load: Array,
        above: float,
        deadline: Deadline = NO_DEADLINE,
        expected: float = np.inf,
        tolerance: float = FACTOR_TOLERANCE,
    ) -> ElasticFactor:
        """The factor up to which the block stands under gravity and this load (6 n,), at most `above`.

        The largest factor is settled in full. When it does not stand there, Newton steps from where it stands narrow
        the factor down; where these are stuck it may still stand, so the lowest such factor is settled in full, too.
        Only factors at which it stands count.

        Args:
            load: in the block's units.
            above: no more than this is asked.
            deadline: when it passes, the factor is what was found by then, and not known.
            expected: a factor below `above` that is enough when the block stands at it, as that of a load nearby.
            tolerance: relative, of the factor.
        """
        gravity = self.geometry.gravity.ravel()
        if deadline.passed:
            return ElasticFactor(0.0, False)
        state = self.rest
        if not state.stands:
            return ElasticFactor(0.0, True, state.displacement)
        first = min(above, expected)
        probe = state
        for share in (1.0, *_ON_THE_WAY):
            start = state.displacement + share * (probe.displacement - state.displacement)
            probe = self.settle(gravity + share * first * load, start, deadline)
            if not probe.known:
                return ElasticFactor(0.0, False)
            if not probe.stands:
                return self._below(load, share * first, probe, deadline, tolerance)
        return ElasticFactor(first, True)

    def _below(
        self, load: Array, above: float, fall: ElasticState, deadline: Deadline, tolerance: float
    ) -> ElasticFactor:
        """The factor up to which the block stands, below one at which it does not."""
        gravity, state, growth = self.geometry.gravity.ravel(), self.rest, np.zeros_like(load)
        # Below this share of the weight nothing is resolved.
        least = min(above, float(np.linalg.norm(gravity)) / (float(np.linalg.norm(load)) or 1.0)) / 10
        low, high = 0.0, above
        factor = self._estimate(load, above, fall, tolerance) or _middle(least, above)
        for _ in range(_PROBES):
            # The displacement grows along straight pieces.
            start = state.displacement + (factor - low) * growth
            probe = self._newton(gravity + factor * load, start, deadline)
            if probe.stands:
                growth = (probe.displacement - state.displacement) / (factor - low)
                low, state = factor, probe
            else:
                high = factor
            if low < high <= low + _NEAR * tolerance * max(low, least):
                probe = self.settle(gravity + high * load, deadline=deadline)
                if not probe.stands:
                    between = self._estimate(load, high, probe, tolerance)
                    asked = gravity + between * load
                    if between > low and self._newton(asked, state.displacement, deadline).stands:
                        low = between
                    return ElasticFactor(low, probe.known, probe.displacement)
                low, high, state = high, above, probe
            if not probe.known:
                return ElasticFactor(low, False)
            factor = (low + high) / 2 if high < 4 * max(low, least) else _middle(max(low, least), high)
        return ElasticFactor(low, True)

    def _estimate(self, load: Array, factor: float, fall: ElasticState, tolerance: float) -> float:
        """A factor at which the block may stand, from its fall at a larger one; 0 when it shows none.

        The catch carries what is too much. How much that is follows from the power of the motion.
        """
        u = fall.displacement
        power = float(load @ u)
        if not fall.settled or power <= 0:
            return 0.0
        return max((factor - self.contacts.catch * float(u @ u) / power) * (1 - tolerance), 0.0)

    def _share(self, part: Array, load: Array) -> float:
        """The share that a part (6 n,) is of the load on a body, the largest of all bodies."""
        loads = np.linalg.norm(load.reshape(-1, 6), axis=1)
        least = _LEAST_LOAD * float(np.linalg.norm(loads)) or 1.0
        return float((np.linalg.norm(part.reshape(-1, 6), axis=1) / np.maximum(loads, least)).max())

    def _state(self, load: Array, u: Array) -> ElasticState:
        """The state at a displacement; settled when contacts that slip as Coulomb says leave next to nothing."""
        contacts = self.contacts
        left = self._share(contacts.left(u, load, contacts.relative(u)), load)
        unbalanced = left + self._share(contacts.catch * u, load)
        return ElasticState(unbalanced <= _CARRIED, unbalanced, u, left <= _CARRIED / 2)

    def _newton(self, load: Array, start: Array, deadline: Deadline) -> ElasticState:
        """The state in which contacts, slipping as Coulomb says, carry a load; not settled when stuck on the way."""
        contacts, size = self.contacts, float(np.linalg.norm(load)) or 1.0

        def left(u: Array, relative: Array) -> tuple[float, Array]:
            rest = contacts.left(u, load, relative)
            return float(np.linalg.norm(rest)), rest

        u = self._descend(load, start, left, None, _SETTLED / 10 * size, _STEPS, deadline)
        found = self._state(load, u)
        return found if found.settled else replace(found, known=not deadline.passed)

    def _tresca(self, load: Array, bounds: Array, start: Array, deadline: Deadline) -> Array:
        """The displacement (6 n,) of least energy with friction limited to the bounds (P,), as far as time allows."""
        contacts, size = self.contacts, float(np.linalg.norm(load)) or 1.0

        def energy(u: Array, relative: Array) -> tuple[float, None]:
            return contacts.energy(u, load, relative, bounds), None

        return self._descend(load, start, energy, bounds, _SETTLED / 10 * size, _TRESCA_STEPS, deadline)

    def _descend(
        self,
        load: Array,
        start: Array,
        merit: Callable[[Array, Array], tuple[float, Array | None]],
        bounds: Array | None,
        enough: float,
        steps: int,
        deadline: Deadline,
    ) -> Array:
        """The displacement after damped Newton steps that lessen a merit, which may give what is left, too.

        Where everything at a body slips, a step would leap far beyond where it sticks again: damping, as by a viscous
        bond of the contacts, shortens it.
        """
        contacts, u, damping = self.contacts, start, 0.0
        relative = contacts.relative(u)
        value, rest = merit(u, relative)
        for _ in range(steps):
            rest = contacts.left(u, load, relative, bounds) if rest is None else rest
            if float(np.linalg.norm(rest)) <= enough or deadline.passed:
                break
            step = -contacts.jacobian(relative, bounds, damping).solve(rest)
            moved = contacts.moved(step)
            for length in (1.0, 0.5, 0.25):
                there = relative + length * moved
                new, new_rest = merit(u + length * step, there)
                if new < value:
                    u, value, rest, relative = u + length * step, new, new_rest, there
                    damping = damping / 10 if damping > 1e-7 and length == 1 else 0.0 if length == 1 else damping
                    break
            else:
                damping = max(10 * damping, 1e-4)
                if damping > 10:
                    break
        return u


def _middle(low: float, high: float) -> float:
    """Between two factors: in ratio when they are far apart."""
    return (low + high) / 2 if high < 4 * low else float(np.sqrt(low * high))
