"""Calls the conic solver (Clarabel): checks that data are finite, limits the time, and verifies every answer."""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import clarabel
import numpy as np
from scipy.sparse import csc_matrix

from poise.errors import ErrorCode, NoAnswerError
from poise.types import Array

_MAX_ITERATIONS = 200
_TIME_LIMIT = 30.0
SOLVER_TOLERANCE = 1e-9
# What is left of the equations in an accepted answer, relative to the data. Clarabel itself aims at SOLVER_TOLERANCE.
_ACCEPTED_RESIDUAL = 1e-5
# Matrices up to this many entries are multiplied dense.
_DENSE = 40_000


class Outcome(Enum):
    """How a program ended."""

    SOLVED = "solved"
    INFEASIBLE = "no point satisfies the constraints"
    UNBOUNDED = "the objective falls without end"


@dataclass(frozen=True, eq=False)
class ConicSolution:
    """Answer of a program.

    Args:
        outcome: see `Outcome`.
        x: (n,) the minimiser; a direction of unending descent when unbounded.
        z: (m,) multipliers of the rows; a certificate when infeasible.
        value: of the objective at x.
        dual_value: of the dual objective at z, which bounds the minimum from below.
    """

    outcome: Outcome
    x: Array
    z: Array
    value: float
    dual_value: float


@dataclass(frozen=True)
class Cones:
    """The cone of the slacks: `zero` equations, then `nonnegative` rows, then second-order cones of these sizes."""

    zero: int = 0
    nonnegative: int = 0
    second_order: tuple[int, ...] = ()

    @property
    def rows(self) -> int:
        return self.zero + self.nonnegative + sum(self.second_order)

    def for_clarabel(self) -> list[object]:
        cones: list[object] = []
        if self.zero:
            cones.append(clarabel.ZeroConeT(self.zero))
        if self.nonnegative:
            cones.append(clarabel.NonnegativeConeT(self.nonnegative))
        return cones + [clarabel.SecondOrderConeT(size) for size in self.second_order]


_LARGEST_SVD = 1_000_000
"""Entries of a matrix up to which a singular value decomposition finds directions that no row constrains."""


class ConicProgram:
    """min 1/2 x'Px + q'x subject to b - A x in a cone; kept in memory, so that only q is sent again.

    Each program has one solver: not to be shared between threads.

    Args:
        matrix: (m, n) A.
        right: (m,) b.
        cones: what the m rows are, in this order.
        quadratic: (n, n) P, positive semidefinite; None: zero.
        tolerance: of feasibility and of the gap, relative.
        time_limit: for one solve, s.

    Raises:
        NoAnswerError: SOLVER_FAILED when the data is not finite.
    """

    def __init__(
        self,
        matrix: Any,
        right: Array,
        cones: Cones,
        quadratic: Any = None,
        tolerance: float = SOLVER_TOLERANCE,
        time_limit: float = _TIME_LIMIT,
    ) -> None:
        self._A: Any = csc_matrix(matrix, copy=True)
        self._b = np.asarray(right, dtype=np.float64)
        rows, columns = self._A.shape
        self._P: Any = csc_matrix((columns, columns)) if quadratic is None else csc_matrix(quadratic)
        if rows != cones.rows or rows != len(self._b):
            raise ValueError(f"{rows} rows, {len(self._b)} right sides, cones of {cones.rows} rows")
        for data in (self._A.data, self._b, self._P.data):
            _check_finite(data)
        self._cones, self._tolerance, self._time_limit = cones, tolerance, time_limit
        self._quick = self._solver(careful=False)
        self._careful: Any = None
        self._scale = 1.0 + _norm(self._b)
        self._dense = rows * columns <= _DENSE
        self._prepare_check()
        self._curvature = None if quadratic is None else self._P

    def _solver(self, careful: bool) -> Any:
        settings = _settings(self._tolerance, self._time_limit)
        # Both halve the time of small programs, and what few answers they spoil the check finds.
        settings.iterative_refinement_enable = settings.equilibrate_enable = careful
        zero = np.zeros(self._A.shape[1])
        return clarabel.DefaultSolver(self._P, zero, self._A, self._b, self._cones.for_clarabel(), settings)

    def _prepare_check(self) -> None:
        """Keep A and its transpose as the check of answers multiplies fastest: small ones dense."""
        self._rows: Any = self._A.toarray() if self._dense else self._A
        self._columns: Any = self._rows.T if self._dense else self._A.T.tocsr()

    def set_matrix(self, data: Array) -> None:
        """Replace the stored entries of A (in the order of its `data`), leaving where they are.

        Raises:
            NoAnswerError: SOLVER_FAILED when one is not finite.
        """
        _check_finite(data)
        self._A.data[:] = data
        self._prepare_check()
        self._quick.update(A=self._A.data)
        self._careful = None

    def solve(self, q: Array) -> ConicSolution:
        """Minimise for the linear objective q (n,).

        Raises:
            NoAnswerError: SOLVER_FAILED: q not finite, no convergence within the caps, or the answer fails the check.
        """
        _check_finite(q)
        self._quick.update(q=q)
        raw = self._quick.solve()
        x, z = np.array(raw.x), np.array(raw.z)
        if raw.status == clarabel.SolverStatus.Solved and self._residuals(raw, x, z, q)[2]:
            return ConicSolution(Outcome.SOLVED, x, z, float(raw.obj_val), float(raw.obj_val_dual))
        if self._careful is None:
            self._careful = self._solver(careful=True)
        self._careful.update(q=q)
        raw = self._careful.solve()
        x, z = np.array(raw.x), np.array(raw.z)
        if raw.status in (clarabel.SolverStatus.PrimalInfeasible, clarabel.SolverStatus.AlmostPrimalInfeasible):
            return ConicSolution(Outcome.INFEASIBLE, x, z, np.inf, np.inf)
        if raw.status in (clarabel.SolverStatus.DualInfeasible, clarabel.SolverStatus.AlmostDualInfeasible):
            return ConicSolution(Outcome.UNBOUNDED, x, z, -np.inf, -np.inf)
        primal, dual, good = self._residuals(raw, x, z, q)
        if not good:
            free = self._free_descent(q)
            if free is not None:
                return ConicSolution(Outcome.UNBOUNDED, free, z, -np.inf, -np.inf)
            raise NoAnswerError(
                ErrorCode.SOLVER_FAILED,
                f"the conic solver stopped with {raw.status} after {raw.iterations} iterations and residuals "
                f"{primal:.1e}, {dual:.1e}; check masses, sizes and friction for values far apart",
            )
        return ConicSolution(Outcome.SOLVED, x, z, float(raw.obj_val), float(raw.obj_val_dual))

    def _free_descent(self, q: Array) -> Array | None:
        """(n,) a direction along which q x falls, unconstrained by rows and curvature; None when there is none.

        Without curvature such a line (a cylinder that may roll) is easily missed by an interior-point method.
        """
        if self._curvature is not None or self._A.shape[0] * self._A.shape[1] > _LARGEST_SVD:
            return None
        _, values, rows = np.linalg.svd(self._A.toarray())
        rank = int((values > 1e-10 * values.max(initial=1.0)).sum())
        descent = -rows[rank:].T @ (rows[rank:] @ q)
        return descent if _norm(descent) > 1e-8 * _norm(q) else None

    def _residuals(self, raw: "clarabel.DefaultSolution", x: Array, z: Array, q: Array) -> tuple[float, float, bool]:
        """Residuals of rows and gradient, and whether the answer is accepted, for any status of the solver."""
        primal = _norm(self._rows @ x + np.array(raw.s) - self._b)
        gradient = self._columns @ z + q
        if self._curvature is not None:
            gradient += self._curvature @ x
        dual = _norm(gradient)
        good = primal <= _ACCEPTED_RESIDUAL * (self._scale + _norm(x))
        good = good and dual <= _ACCEPTED_RESIDUAL * (1.0 + _norm(q) + _norm(z))
        gap = abs(raw.obj_val - raw.obj_val_dual)
        return primal, dual, good and gap <= 1e-4 * (1.0 + abs(raw.obj_val))


def _settings(tolerance: float, time_limit: float) -> "clarabel.DefaultSettings":
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = _MAX_ITERATIONS
    settings.time_limit = time_limit
    settings.max_threads = 1
    settings.presolve_enable = False  # it would forbid sending q alone
    settings.direct_solve_method = "qdldl"
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings


def _check_finite(data: Array) -> None:
    if not np.isfinite(data).all():
        raise NoAnswerError(ErrorCode.SOLVER_FAILED, "a number that is not finite was about to reach the conic solver")


def _norm(vector: Array) -> float:
    return float(np.sqrt(vector @ vector))
