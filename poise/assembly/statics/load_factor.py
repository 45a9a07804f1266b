"""The inverse of the factor at which a load makes a block collapse, its mechanism, and the program for both."""

from dataclasses import dataclass

import numpy as np

from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.pair_program import PairProgram, PairRows
from poise.assembly.statics.solvers import Outcome
from poise.types import Array

UNLIMITED = 1e-7
"""Inverse load factors below this mean never: the load would have to exceed ten million times the block's weight."""


@dataclass(frozen=True, eq=False)
class InverseLoadFactor:
    """1 / (the factor at which a load makes a block collapse), everything in the block's units.

    Args:
        value: 0 for loads that are sustained without limit, inf for loads that nothing resists.
        upper: contact forces prove that the inverse load factor is at most this.
        twist: (6 n,) the collapse mechanism, scaled so that it takes power 1 against gravity. The inverse load factor
            of EVERY load w is at least twist @ w, and equal for this one. Where the value is inf: a motion that
            nothing resists, scaled so that this load has power 1.
        multipliers: of the program's rows (contact forces, in the program's own order); None when the value is inf.
    """

    value: float
    upper: float
    twist: Array
    multipliers: Array | None = None


@dataclass(frozen=True, eq=False)
class InverseLoadFactors:
    """`InverseLoadFactor` of Q loads: value (Q,), upper (Q,), twist (Q, 6 n)."""

    value: Array
    upper: Array
    twist: Array


class LoadFactorProgram:
    """Inverse load factors of any number of loads on one block.

    With contact forces f in a convex cone K, and their wrenches G f on the bodies, a load w is sustained at the factor
    s when G f + gravity + s w = 0 has a solution (static theorem; thesis eq. 4.44-4.48). Divided by s, the least 1/s
    is a support function,

        f(w) = max { y.w : G'y in K*, -y.gravity <= 1 },

    and its maximiser y is the collapse mechanism (kinematic theorem). The set does not depend on the load: one solver
    is kept, only the objective changes, and every y found is a bound for all other loads.
    """

    def __init__(self, rows: PairRows, tolerance: float, order: Elimination | None = None) -> None:
        """Take the rows of y in K*; the shared one is for gravity. `order`: of elimination, where it is known."""
        self._program = PairProgram(rows, tolerance, order)

    def set_entries(self, entries: Array) -> None:
        """Replace the entries of the rows, see `PairRows`."""
        self._program.set_entries(entries)

    def inverse_factor(self, load: Array, enough: float = 0.0, stuck: bool = False) -> InverseLoadFactor:
        """InverseLoadFactor of a load (6 n,) in the block's units.

        Where it is at most `enough`, its bounds need not be any closer. `stuck`: the kernel did not solve it.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        size = float(np.abs(load).max())
        if size == 0:
            return InverseLoadFactor(0.0, 0.0, np.zeros_like(load))
        found = self._program.solve_directly(load / size) if stuck else self._program.solve(load / size, enough / size)
        if found.outcome is Outcome.UNBOUNDED:
            return InverseLoadFactor(np.inf, np.inf, found.motion / (found.motion @ load))
        lower, upper = found.value * size, found.upper * size
        return InverseLoadFactor(max(lower, 0.0), max(upper, lower, 0.0), found.motion, found.multipliers * size)

    def inverse_factors(self, loads: Array, enough: Array) -> InverseLoadFactors:
        """The same of loads (Q, 6 n) at once; bounds of at most `enough` (Q,) need not be any closer.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        sizes = np.abs(loads).max(axis=1, initial=0.0)
        scale = np.where(sizes > 0, sizes, 1.0)
        found = self._program.solve_all(loads / scale[:, None], enough / scale)
        lower = np.maximum(found.value * sizes, 0.0)
        factors = InverseLoadFactors(lower, np.maximum(found.upper * sizes, lower), found.motion)
        for row in np.flatnonzero(~found.solved).tolist():
            one = self.inverse_factor(loads[row], float(enough[row]), stuck=True)
            factors.value[row], factors.upper[row], factors.twist[row] = one.value, one.upper, one.twist
        return factors

    def each(self, loads: Array, enough: Array | None = None) -> list[InverseLoadFactor]:
        """`inverse_factor` of each of loads (Q, 6 n), with what is `enough` (Q,); most in one call of the kernel.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        sizes, at_most = np.abs(loads).max(axis=1, initial=0.0), np.zeros(len(loads)) if enough is None else enough
        if not sizes.all():
            return [self.inverse_factor(*asked) for asked in zip(loads, at_most.tolist(), strict=True)]
        found = self._program.solve_all(loads / sizes[:, None], at_most / sizes)
        lower, multipliers = np.maximum(found.value * sizes, 0.0), found.multipliers * sizes[:, None]
        upper = np.maximum(found.upper * sizes, lower).tolist()
        solved, rows = found.solved.tolist(), zip(lower.tolist(), upper, found.motion, multipliers, strict=True)
        asked = zip(solved, rows, loads, strict=True)
        return [
            InverseLoadFactor(*row) if known else self.inverse_factor(load, stuck=True) for known, row, load in asked
        ]
