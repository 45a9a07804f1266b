"""Conic programs over the motions of a block: every row is of one interface, and one row is shared by all bodies.

Solved by the compiled kernel, which uses that structure; by Clarabel where the kernel is missing or stuck.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import block_array, coo_array, csc_array

from poise.assembly.statics.block import Sparse, assembled
from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.solvers import Cones, ConicProgram, Outcome
from poise.kernels import COMPILED, CompiledConeProgram
from poise.types import Array, Indices, Mask


@dataclass(frozen=True, eq=False)
class PairRows:
    """Rows R of the interfaces of a block, and what they are.

    The slacks -R (relative motion, unknowns of the interface) are in cones, and shared y <= 1, or = 1 if `equal`.

    Args:
        supports: (I, 2) bodies on both sides of each interface, or FIXED_NODE. count: number of bodies.
        singles: (I,) rows of each interface that are cones of their own.
        wides: (I,) second-order cones of `wide` rows each, which follow.
        locals: (I,) unknowns of the interface alone.
        entries: (E,) of each interface in turn, row after row: six for the motion, then those for its unknowns.
        shared: (6 n,).
    """

    supports: Indices
    count: int
    singles: Indices
    wides: Indices
    locals: Indices
    wide: int
    entries: Array
    shared: Array
    equal: bool

    @cached_property
    def heights(self) -> Indices:
        """(I,) rows of each interface."""
        return self.singles + self.wide * self.wides

    @cached_property
    def interface(self) -> Indices:
        """(R,) to which each row belongs."""
        return np.repeat(np.arange(len(self.heights)), self.heights)

    @cached_property
    def first(self) -> Indices:
        """(R,) where the entries of each row begin."""
        widths = (6 + self.locals)[self.interface]
        return np.cumsum(widths) - widths

    @cached_property
    def order(self) -> Indices:
        """(R,) rows with all cones of one row first."""
        within = np.arange(len(self.interface)) - (np.cumsum(self.heights) - self.heights)[self.interface]
        single = within < self.singles[self.interface]
        return np.concatenate([np.flatnonzero(single), np.flatnonzero(~single)])

    def matrix(self) -> tuple[Sparse, Array, Cones]:
        """The same as one sparse matrix A and right side b, slacks b - A x: the shared row, then in `order`."""
        rows = self.entries[self.first[:, None] + np.arange(6)][self.order]
        motions = assembled(rows[:, None], self.supports[self.interface[self.order]], self.count).T
        counts = self.locals[self.interface[self.order]]
        row = np.repeat(np.arange(len(counts)), counts)
        within = np.arange(len(row)) - (np.cumsum(counts) - counts)[row]
        at = (np.cumsum(self.locals) - self.locals)[self.interface[self.order]][row] + within
        values = self.entries[self.first[self.order][row] + 6 + within]
        own = coo_array((values, (row, at)), shape=(len(counts), int(self.locals.sum())))
        shared = csc_array(self.shared.reshape(1, -1))
        matrix = block_array([[shared, None], [motions, own]], format="csc")
        right = np.zeros(matrix.shape[0])
        right[0] = 1.0
        cones = Cones(
            zero=int(self.equal),
            nonnegative=int(not self.equal) + int(self.singles.sum()),
            second_order=(self.wide,) * int(self.wides.sum()),
        )
        return csc_array(matrix), right, cones


@dataclass(frozen=True, eq=False)
class PairSolution:
    """The most power of a load on a motion y.

    Args:
        outcome: see `Outcome`.
        value: of load @ y; what the multipliers prove that it is at most.
        upper: see `value`.
        motion: (6 n,) y; a direction of unending growth when unbounded.
        multipliers: (1 + R,) of the shared row, then of the rows in `PairRows.order`.
    """

    outcome: Outcome
    value: float
    upper: float
    motion: Array
    multipliers: Array


@dataclass(frozen=True, eq=False)
class PairSolutions:
    """`PairSolution` of Q loads.

    Args:
        solved: (Q,) whether the rest was found.
        value, upper: (Q,). motion: (Q, 6 n). multipliers: (Q, 1 + R).
    """

    solved: Mask
    value: Array
    upper: Array
    motion: Array
    multipliers: Array


class PairProgram:
    """max load @ y over the motions that the rows allow, for any number of loads; not to be shared between threads.

    Args:
        rows: of the program.
        order: of elimination; None: it is found.
        tolerance: of the equations and of the gap, relative.
    """

    def __init__(self, rows: PairRows, tolerance: float, order: Elimination | None = None) -> None:
        self._rows, self._tolerance, self._order = rows, tolerance, order
        self._direct: ConicProgram | None = None

    @cached_property
    def order(self) -> Elimination:
        """In which bodies are eliminated."""
        return self._order or Elimination.of(self._rows.supports, self._rows.count)

    @cached_property
    def _compiled(self) -> CompiledConeProgram:
        rows, order = self._rows, self.order
        return CompiledConeProgram(
            order.compiled,
            rows.singles,
            rows.wides,
            rows.locals,
            rows.wide,
            rows.entries,
            rows.shared[order.entries],
            rows.equal,
            self._tolerance,
        )

    def set_entries(self, entries: Array) -> None:
        """Replace the entries of the rows, which stay where they are."""
        self._rows.entries[:] = entries
        self._direct = None
        if COMPILED:
            self._compiled.set_entries(entries)

    def solve(self, load: Array, enough: float = -np.inf) -> PairSolution:
        """Solve for a load (6 n,); where the most power is at most `enough`, its bounds need not be any closer.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        if COMPILED and np.isfinite(load).all():
            found = self.solve_all(load[None], np.array([enough]))
            if found.solved[0]:
                value, upper = float(found.value[0]), float(found.upper[0])
                return PairSolution(Outcome.SOLVED, value, upper, found.motion[0], found.multipliers[0])
        return self.solve_directly(load)

    def solve_all(self, loads: Array, enough: Array) -> PairSolutions:
        """Solve for loads (Q, 6 n) in one call of the kernel; what it does not solve is left to `solve`."""
        if not COMPILED or not np.isfinite(loads).all():
            none, rows = np.zeros(len(loads)), np.zeros((len(loads), 1 + len(self._rows.order)))
            return PairSolutions(np.zeros(len(loads), dtype=bool), none, none.copy(), np.zeros_like(loads), rows)
        found = self._compiled.solve(loads[:, self.order.entries], enough)
        motion = np.empty_like(loads)
        motion[:, self.order.entries] = found.motion
        multipliers = found.multipliers.take(self._order_of_multipliers, axis=1)
        return PairSolutions(found.outcome == 0, found.value, found.upper, motion, multipliers)

    @cached_property
    def _order_of_multipliers(self) -> Indices:
        """(1 + R,) where the kernel has that of the shared row, and those of the rows in `PairRows.order`."""
        return np.append(len(self._rows.order), self._rows.order)

    def solve_directly(self, load: Array) -> PairSolution:
        """By Clarabel, for what the kernel does not solve.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        if self._direct is None:
            self._direct = ConicProgram(*self._rows.matrix(), tolerance=self._tolerance)
        objective = np.zeros(len(load) + int(self._rows.locals.sum()))
        objective[: len(load)] = -load
        found = self._direct.solve(objective)
        return PairSolution(found.outcome, -found.value, -found.dual_value, found.x[: len(load)], found.z)
