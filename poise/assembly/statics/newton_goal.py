"""What damped Newton steps on elastic contacts look for, and how long a step is best."""

from dataclasses import dataclass

import numpy as np

from poise.assembly.statics.deadline import Deadline
from poise.assembly.statics.elastic_contacts import ElasticContacts, Stiffness
from poise.types import Array

_LENGTHS, _GOOD = 5, 0.5
"""Lengths of a step that are tried, each half of the one before, until one lessens what is left to this share."""
_SHORT, _LEAP, _LEAPS, _NEAR = 0.2, 100.0, 3, 1e5
"""A leap is a whole step that leaves up to so many times as much, where the best length is less: a few springs open,
close or slip back and forth, and short steps do not get beyond that. So many are taken, near an equilibrium: where no
more than so many times what is enough is left."""
_NEARLY, _GAINS, _PATIENCE = 1e4, 0.7, 4
"""With a push, what is left of less than so many times what is enough is given up when so many steps do not lessen
it."""
_LITTLE, _AGAIN, _BRIEF = 1e-4, 2, 12
"""The least damping, and after so many whole steps in a row it is reduced. Of at most so many steps none is damped."""


@dataclass(eq=False)
class Goal:
    """What Newton steps look for: the equilibrium under a load, with friction bounds (P,) or as Coulomb says.

    Or with a factor of a push that the displacement decides: the power of the push on it does not change. `change`
    (6 n,) is that of the displacement by the push in the last step, `compliance` the power of the push on it.
    """

    load: Array
    bounds: Array | None = None
    push: Array | None = None
    factor: float = 0.0
    compliance: float = 0.0
    change: Array | None = None
    leaps: int = 0

    def step(self, jacobian: Stiffness, rest: Array) -> Array:
        """(6 n,) the Newton step; not finite where the stiffness is singular."""
        try:
            move = -jacobian.solve(rest)
            if self.push is not None:
                along = jacobian.solve(self.push)
                self.compliance, self.change = float(self.push @ along), along
                move -= float(self.push @ move) / self.compliance * along
        except np.linalg.LinAlgError:
            return np.full_like(rest, np.nan)
        return move

    def search(
        self, contacts: ElasticContacts, u: Array, relative: Array, move: Array, value: float, enough: float
    ) -> tuple[float, float, bool]:
        """How long a step from a displacement of merit `value` is best, the merit there, and whether it is a leap.

        The first length that halves what is left (of an energy: that lessens it), otherwise the best one of those
        tried, or a leap.
        """
        if not np.isfinite(move).all():
            return 0.0, np.inf, False
        moved, good = contacts.moved(move), value if self.bounds is not None else _GOOD * value
        best, least, whole = 0.0, np.inf, np.inf
        for length in 0.5 ** np.arange(_LENGTHS):
            new, _ = self.merit(contacts, u + length * move, relative + length * moved)
            whole = new if length == 1 else whole
            if new < least:
                best, least = float(length), new
            if new < good:
                return best, least, False
        short = best < _SHORT or not least < value
        if short and whole < _LEAP * value <= _LEAP * _NEAR * enough and self.bounds is None and self.leaps < _LEAPS:
            self.leaps += 1
            return 1.0, whole, True
        return best, least, False

    def merit(self, contacts: ElasticContacts, u: Array, relative: Array) -> tuple[float, Array]:
        """Of a displacement: the size of what is left, or the energy with friction bounds; and (6 n,) what is left."""
        rest = contacts.left(u, self.load, relative, self.bounds)
        if self.bounds is not None:
            return contacts.energy(u, self.load, relative, self.bounds), rest
        if self.push is not None:
            self.factor = float(self.push @ rest) / float(self.push @ self.push)
            rest = rest - self.factor * self.push
        return float(np.linalg.norm(rest)), rest


def newton_steps(
    contacts: ElasticContacts, goal: Goal, u: Array, enough: float, steps: int, deadline: Deadline
) -> tuple[Array, float, int]:
    """Damped Newton steps towards a goal: the displacement, its merit, and how many steps that took.

    Where everything at a body slips, a step would leap far beyond where it sticks again: damping, as by a viscous
    bond of the contacts, shortens it. Few steps are asked of a place near a point of the path, which needs none.
    """
    damping, step, full = 0.0, 0, 0
    earlier, stale = np.inf, 0
    relative = contacts.relative(u)
    value, rest = goal.merit(contacts, u, relative)
    for step in range(steps + 1):
        if step == steps or float(np.linalg.norm(rest)) <= enough or deadline.passed:
            break
        if goal.push is not None and value <= _NEARLY * enough:
            stale = stale + 1 if value > _GAINS * earlier else 0
            if stale == _PATIENCE:
                break
            earlier = min(earlier, value)
        move, factor = goal.step(contacts.jacobian(relative, goal.bounds, damping), rest), goal.factor
        length, new, leap = goal.search(contacts, u, relative, move, value, enough)
        if leap or new < value:
            u, relative = u + length * move, relative + length * contacts.moved(move)
            value, rest = goal.merit(contacts, u, relative)
            full = full + 1 if length == 1 and not leap else 0
            if full >= _AGAIN or (full and damping <= _LITTLE):
                damping = damping / 10 if damping > 1e-7 else 0.0
        else:
            goal.factor, damping, full = factor, max(10 * damping, _LITTLE), 0
            if damping > 10 or (goal.push is not None and steps <= _BRIEF):
                break
    return u, value, step
