"""Elastic contacts of a block: no tension, Coulomb friction limited by the normal forces that arise.

Limit analysis asks whether contact forces in balance exist. Between two walls they exist at any magnitude, although
nothing presses the walls to the cube. Here normal forces arise only where bodies are pushed into each other.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from poise.assembly.contact import Interface
from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.creep import CREEP_STEPS, creep
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.assembly.statics.elastic_contacts import ElasticContacts
from poise.assembly.statics.elastic_state import ElasticFactor, ElasticState, LoadShares
from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.load_path import LoadPath, PathPoint, follow, go_on, look_beyond
from poise.assembly.statics.newton_goal import Goal, newton_steps
from poise.types import Array, Mask

_CARRIED = 5e-5
"""A body stands when the catch carries less than this share of its load."""
_FALLS = 1e-3
"""A body of whose load the catch carries more than this share is not held by any further rounds. It falls if bodies
creep to such a state, too."""
_SETTLED = 1e-7
"""What may be left of the equations, per load."""
# Newton steps in a row; steps of a Tresca problem; Tresca problems between two attempts of Newton; attempts.
_STEPS, _TRESCA_STEPS, _ROUNDS, _ATTEMPTS = 15, 12, 3, 10
_FEW = 2
"""Attempts where it is asked whether a block stands at a little more than at the end of a path."""
_STUCK = 2
"""The attempt after which bodies creep to where they stand; after an earlier one if it seems that they fall."""
_REACHED = 2e-4
"""What may be left of the load on each body at a point of the path of a growing load."""
_SMALL = 20
"""Up to so many bodies a state is looked for beyond the end of a path, and paths go on along the last way, which misses
fewer peaks; with more bodies along what the load changes, which takes fewer steps."""
_BRIEF_LOOK = 6
"""Newton steps to a state that may stand beyond the end of a path."""
_MODERATE, _BEYOND = 40, 3
"""In blocks of up to so many bodies such a state is also looked for near contacts that never slip, at a factor that is
larger by so many tolerances."""
_IDLE = 1e-3
"""An interface that carries less than this share of the lighter body at rest only touches."""
_NEAR_STEPS, _NEAR_EARLIER = 15, 25
"""Newton steps to an equilibrium from a state that may be near, at collapse or earlier."""
_EARLIER = 0.8  # share of its factor up to which states on the way to it count as earlier ones
FACTOR_TOLERANCE = 0.004
"""Relative tolerance of the load factor at which a block collapses."""


class CoulombBlock:
    """Elastic contacts of one block: no tension, Coulomb friction, rigid bodies.

    Slip is against friction, without the dilatancy that limit analysis assumes. Solved by a semismooth Newton method
    on the whole law (Alart, Curnier 1991); where that is stuck, rounds of Tresca problems give a new start (Nečas,
    Jarušek, Haslinger 1980): with friction bounded by the last round's normal forces, the equilibrium is the minimum
    of a convex energy.
    """

    def __init__(self, geometry: BlockGeometry, interfaces: list[Interface], order: Elimination | None = None) -> None:
        """Take a block and its interfaces in order; `order`: in which its bodies are eliminated, where it is known."""
        self.geometry = geometry
        self.contacts = ElasticContacts(geometry, interfaces, order)
        self._shares = LoadShares(geometry.gravity)

    def settle(
        self, load: Array, start: Array | None = None, deadline: Deadline = NO_DEADLINE, attempts: int = _ATTEMPTS
    ) -> ElasticState:
        """Find the equilibrium under a load (6 n,), gravity included, in the block's units.

        Args:
            load: N and N m, in those units.
            start: (6 n,) displacement near which to look first; None: that of contacts that do not slip.
            deadline: when it passes, the state is not `known`.
            attempts: of Newton steps, with Tresca problems after each.
        """
        contacts, bounds = self.contacts, np.full(len(self.contacts.stiffness), np.inf)
        if start is not None and (found := self._newton(load, start, deadline)).settled:
            return found
        u = self._tresca(load, bounds, self._glued(load), deadline)
        for attempt in range(attempts):
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
            falls = (carried := self._shares.of(contacts.catch * u, load)) > _FALLS
            # Rounds may throw bodies far from a state in which they stand: what falls there may creep to it.
            asked = attempt <= _STUCK < attempts and (falls or attempt == _STUCK)
            if asked and (crept := self._crept(load, deadline)) is not None:
                return crept
            if falls:  # rounds alone are no proof: where bodies did not creep to a fall, either, it is open
                return ElasticState(False, carried, u, known=attempts <= _STUCK)
        return replace(found, known=False)

    def _crept(self, load: Array, deadline: Deadline) -> ElasticState | None:
        """See `creep`."""
        mean, held = float(self.contacts.stiffness.mean()), copy(self)

        def step(at: Array, bond: float) -> Array | None:
            held.contacts, pulled = self.contacts.held_by(bond * mean), load + bond * mean * at
            moved = held._descend(pulled, at, None, CREEP_STEPS, deadline)
            return moved if self._shares.of(held._left(moved, pulled), load) <= _CARRIED else None

        def state(at: Array) -> ElasticState | None:
            found, carried = self._state(load, at), self._shares.of(self.contacts.catch * at, load)
            return found if found.settled or carried > _FALLS else None

        return creep(step, state, len(load))

    def in_world(self, displacement: Array) -> Array:
        """(n, 6) displacements (6 n,) at the world's origin, for contacts of a stiffness of 1 N/m per m2."""
        units = self.geometry.units
        return units.velocity(displacement.reshape(-1, 6)) * (units.weight / self.contacts.area)

    def of_world(self, displacements: Array) -> Array:
        """The inverse of `in_world`."""
        units = self.geometry.units
        return np.asarray(units.of_velocity(displacements) * (self.contacts.area / units.weight)).ravel()

    @cached_property
    def pressed_at_rest(self) -> Mask:
        """(I,) interfaces that carry a load of the bodies they are between at rest, if only a little."""
        contacts, gravity = self.contacts, np.linalg.norm(self.geometry.gravity, axis=1)
        normal = self.forces(self.rest.displacement)[:, 0]
        loads = np.append(gravity, np.inf)[self.geometry.supports].min(axis=1)
        return np.asarray(np.bincount(contacts.interface, normal) > _IDLE * loads)

    def forces(self, displacement: Array) -> Array:
        """(..., P, 3) normal force and friction at each elastic point, at displacements (..., 6 n)."""
        return self.contacts.forces(self.contacts.relative(displacement), None)

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

        The block is followed from rest while the load grows, so that every state it stands in is reached from there;
        see `load_path`.

        Args:
            load: in the block's units.
            above: no more than this is asked.
            deadline: when it passes, the factor is what was found by then, and not known.
            expected: a factor below `above` that is enough when the block stands at it, as that of a load nearby.
            tolerance: relative, of the factor.
        """
        return self.factors(load[None], np.array([above]), deadline, expected, tolerance)[0]

    def factors(
        self,
        loads: Array,
        above: Array,
        deadline: Deadline = NO_DEADLINE,
        expected: float = np.inf,
        tolerance: float = FACTOR_TOLERANCE,
    ) -> list[ElasticFactor]:
        """The same of loads (Q, 6 n), at most factors (Q,); of few bodies most in one call of the kernel."""
        if not len(loads) or deadline.passed:  # a block that is not asked about is not settled
            return [ElasticFactor(0.0, False)] * len(loads)
        rest, gravity, compiled = self.rest, self.geometry.gravity.ravel(), self.contacts.compiled
        if not rest.stands:
            return [ElasticFactor(0.0, rest.known, rest.displacement)] * len(loads)
        found: list[ElasticFactor | None] = [None] * len(loads)
        if compiled is not None and self.geometry.count <= _SMALL:
            most = np.minimum(above, expected), above
            found = compiled.factors(gravity, rest.displacement, loads, most, (tolerance, deadline))
        rows = zip(found, loads, above.tolist(), strict=True)
        return [one or self._followed(load, most, deadline, expected, tolerance) for one, load, most in rows]

    def _followed(
        self, load: Array, above: float, deadline: Deadline, expected: float, tolerance: float
    ) -> ElasticFactor:
        """See `factor`; by paths, and all searches."""
        if deadline.passed:
            return ElasticFactor(0.0, False)
        most, look = min(above, expected), self.geometry.count <= _SMALL
        path = self._follow(load, most, deadline, tolerance, look=look)
        if len(path.points) == 1 and not deadline.passed:
            # Where all contacts slip at rest, as of a cylinder in a steep groove, the least load seems to move
            # everything far; what contacts that stick would yield leads to where some stick again.
            path = self._follow(load, most, deadline, tolerance, response=self._glued(load), look=look)
        if not path.ended and len(path.points) > 1:
            path = self._go_on(path, load, most, tolerance, deadline)
        if (stuck := self._stuck_beyond(path, load, most, tolerance, deadline)) is not None:
            path = self._go_on(stuck, load, most, tolerance, deadline)
        best = path.best
        earlier = path.up_to(_EARLIER * best.factor).displacement
        if best.factor >= most:
            return ElasticFactor(min(best.factor, above), True, None, best.displacement, earlier)
        if not path.ended and deadline.passed:
            return ElasticFactor(best.factor, False)
        return ElasticFactor(best.factor, path.ended, self._response(path.end, load), best.displacement, earlier)

    def _follow(
        self,
        load: Array,
        most: float,
        deadline: Deadline,
        tolerance: float,
        begin: PathPoint | None = None,
        response: Array | None = None,
        look: bool = False,
    ) -> LoadPath:
        """See `load_path.follow`; `response` (6 n,): to the load at the beginning, where it is another.

        If `look`, with a state beyond its end where one is found: see `load_path.look_beyond`.
        """
        rest, gravity, compiled = self.rest.displacement, self.geometry.gravity.ravel(), self.contacts.compiled
        if compiled is not None:
            return compiled.follow((gravity, load), rest, begin, response, (most, tolerance), deadline, look)

        def reach(start: Array, steps: int) -> PathPoint | None:
            return None if deadline.passed else self._reach(load, start, steps, deadline)

        if response is None:
            response = self._response(rest if begin is None else begin.displacement, load)
        path = follow(reach, rest, response, load, most, self._shares.weight, tolerance, begin)
        return look_beyond(path, partial(self._stands_near, load, deadline), most, tolerance) if look else path

    def _stands_near(self, load: Array, deadline: Deadline, factor: float, start: Array) -> PathPoint | None:
        """The state near a displacement (6 n,) under a factor of a load (6 n,), if it is soon found and stands."""
        state = self._newton(self.geometry.gravity.ravel() + factor * load, start, deadline, _BRIEF_LOOK)
        return PathPoint(state.displacement, factor) if state.settled and state.stands else None

    def _stuck_beyond(
        self, path: LoadPath, load: Array, most: float, tolerance: float, deadline: Deadline
    ) -> LoadPath | None:
        """A path that ended, with a state under more than its best factor near that of contacts that never slip.

        None where there is none: a path may have left a stiff state for a soft one that holds less.
        """
        best, factor = path.best.factor, (1 + _BEYOND * tolerance) * path.best.factor
        if not path.ended or not 0 < best < factor <= most or self.geometry.count > _MODERATE or deadline.passed:
            return None
        total, unlimited = self.geometry.gravity.ravel() + factor * load, np.full(len(self.contacts.stiffness), np.inf)
        state = self._newton(total, self._tresca(total, unlimited, self._glued(total), deadline), deadline)
        if not (state.settled and state.stands):
            return None
        return LoadPath([*path.points, PathPoint(state.displacement, factor)], state.displacement, False)

    def _go_on(self, path: LoadPath, load: Array, most: float, tolerance: float, deadline: Deadline) -> LoadPath:
        """The path on from where Newton steps found no next point of it."""
        rest, gravity = self.rest.displacement, self.geometry.gravity.ravel()

        def stand(factor: float, start: Array, thorough: bool) -> PathPoint | None:
            total = gravity + factor * load
            state = self.settle(total, start, deadline, _FEW) if thorough else self._newton(total, start, deadline)
            return PathPoint(state.displacement, factor, state.stands) if state.known and state.settled else None

        def resume(begin: PathPoint) -> LoadPath:
            if load @ (begin.displacement - rest) <= 0:  # this far no power of the load leads
                return LoadPath([path.points[0], begin], begin.displacement, False)
            return self._follow(load, most, deadline, tolerance, begin)

        return go_on(path, stand, resume, most, tolerance)

    def beside(
        self,
        load: Array,
        starts: Sequence[Array],
        least: float,
        most: float,
        enough: float,
        deadline: Deadline = NO_DEADLINE,
    ) -> ElasticFactor | None:
        """As `factor`, followed from an equilibrium near a displacement (6 n,), such as between those of other loads.

        Args:
            starts: one near collapse, and one earlier on the way to it, which is tried where the first leads nowhere.

        Returns:
            None where none was found, or less than the `least` factor.
        """
        for start, steps in zip(starts, (_NEAR_STEPS, _NEAR_EARLIER), strict=False):
            begin = None if deadline.passed else self._reach(load, start, steps, deadline)
            if begin is None or not begin.held or load @ (begin.displacement - self.rest.displacement) <= 0:
                continue
            path = self._follow(load, min(most, enough), deadline, FACTOR_TOLERANCE, begin)
            best = path.best
            if best.factor >= least and (path.ended or best.factor >= enough):
                early = path.up_to(_EARLIER * best.factor)
                ways = best.displacement, early.displacement if early.factor > 0 else None
                return ElasticFactor(min(best.factor, most), True, self._response(path.end, load), *ways)
        return None

    def held_at(self, load: Array, displacement: Array) -> float:
        """The factor of a load (6 n,) at which a displacement (6 n,) is an equilibrium; 0 where it is none."""
        here = self._reach(load, displacement, 0, NO_DEADLINE)
        return here.factor if here is not None and here.held else 0.0

    def motion(self, displacement: Array, load: Array) -> Array:
        """(6 n,) the motion that a small load (6 n,) causes at a displacement (6 n,): near collapse, the mechanism."""
        return self._response(displacement, load)

    def _glued(self, load: Array) -> Array:
        """(6 n,) displacement when nothing opens or slips."""
        compiled = self.contacts.compiled
        return self.contacts.glued.solve(load) if compiled is None else compiled.response(None, load)

    def _response(self, u: Array, load: Array) -> Array:
        """(6 n,) change of a displacement under a small load."""
        contacts, compiled = self.contacts, self.contacts.compiled
        return contacts.jacobian(contacts.relative(u)).solve(load) if compiled is None else compiled.response(u, load)

    def _left(self, u: Array, load: Array) -> Array:
        """(6 n,) what contacts that slip as Coulomb says, and the catch, leave of a load, negated."""
        contacts, compiled = self.contacts, self.contacts.compiled
        return contacts.left(u, load, contacts.relative(u)) if compiled is None else compiled.left(u, load)

    def _state(self, load: Array, u: Array) -> ElasticState:
        """The state at a displacement; settled when contacts that slip as Coulomb says leave next to nothing."""
        left = self._shares.of(self._left(u, load), load)
        unbalanced = left + self._shares.of(self.contacts.catch * u, load)
        return ElasticState(unbalanced <= _CARRIED, unbalanced, u, left <= _CARRIED / 2)

    def _newton(self, load: Array, start: Array, deadline: Deadline, steps: int = _STEPS) -> ElasticState:
        """The state in which contacts, slipping as Coulomb says, carry a load; not settled when stuck."""
        found = self._state(load, self._descend(load, start, None, steps, deadline))
        return found if found.settled else replace(found, known=not deadline.passed)

    def _tresca(self, load: Array, bounds: Array, start: Array, deadline: Deadline) -> Array:
        """The displacement (6 n,) of least energy with friction limited to the bounds (P,), as far as time allows."""
        return self._descend(load, start, bounds, _TRESCA_STEPS, deadline)

    def _reach(self, load: Array, start: Array, steps: int, deadline: Deadline) -> PathPoint | None:
        """The equilibrium at which a load has the power that it has at the start; None where none is found."""
        gravity, compiled = self.geometry.gravity.ravel(), self.contacts.compiled
        enough = _SETTLED / 10 * (self._shares.weight or 1.0)
        if compiled is not None:
            u, factor, left, compliance, steps = compiled.reach(gravity, load, start, enough, steps, deadline)
            change = None
        else:
            goal = Goal(gravity, push=load)
            u, left, steps = newton_steps(self.contacts, goal, start, enough, steps, deadline)
            factor, compliance, change = goal.factor, goal.compliance, goal.change
        total = gravity + factor * load
        size = max(math.sqrt(float(total @ total)), self._shares.weight)
        if left > _SETTLED * size and (
            left > _REACHED * size or self._shares.of(self._left(u, total), total) > _REACHED
        ):
            return None
        held = self._shares.of(self.contacts.catch * u, total) <= _CARRIED
        return PathPoint(u, factor, held, compliance, steps, change if self.geometry.count > _SMALL else None)

    def _descend(self, load: Array, start: Array, bounds: Array | None, steps: int, deadline: Deadline) -> Array:
        """The displacement after damped Newton steps that lessen what is left; with bounds (P,), the energy."""
        enough = _SETTLED / 10 * (float(np.linalg.norm(load)) or 1.0)
        compiled = self.contacts.compiled
        if compiled is not None:
            return compiled.descend(load, start, bounds, enough, steps, deadline)
        return newton_steps(self.contacts, Goal(load, bounds), start, enough, steps, deadline)[0]
