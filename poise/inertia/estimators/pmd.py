"""PMD: point masses inside the object's shape, and a model that trusts motion as far as it can (thesis section 3.1)."""

import clarabel
import numpy as np
import scipy

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.estimators.answer import answer
from poise.inertia.estimators.entry import EstimatorEntry
from poise.inertia.estimators.hps import static_regressor
from poise.inertia.estimators.sample_window import SampleWindow
from poise.inertia.model import IdentificationProblem, InertialSolution, phi_of_pseudo_inertia
from poise.types import Array

_NOISE_AMPLITUDES = (1.0, 1.0, 0.5)
"""n_1 m/s2, n_2 rad/s2 and n_3 rad/s of thesis eq. 3.5."""

_MAX_ITERATIONS = 100
_TIME_LIMIT = 5.0  # s

# The thesis wants every m_i > 0; an optimum may have zeros, which would leave a body flat. This share of the mean
# point mass is below what any sensor sees.
_LEAST_MASS = 1e-6


def pmd(problem: IdentificationProblem, *, c1: float = 300.0, regularisation: float = 0.1) -> InertialSolution:
    """Minimise ||(1-w) o (A~ m - b)||_2 + ||w o (A m - b)||_2 + lambda ||m||_2 subject to m >= 0 (Problem 1).

    A is the full model of point masses m at `shape_points`, A~ the one that knows gravity alone (eq. 3.10 and 3.11),
    w the trust in the full model sample by sample (eq. 3.13). Two readings of the print: (1-w)^T (...) would be one
    number and not a vector, so the weights must multiply element by element (o); and the norms are sums of norms, not
    of squares, as printed. The thesis writes the rows in the world, here they are in the sensor: the weights of a
    sample are all alike, so a rotation of its rows changes nothing.

    The K rows of a norm shrink to a triangle of 5 and of 11 rows (QR) before the cone solver sees them.

    Args:
        problem: with `shape_points`; neither noise levels nor parts are used, the sensor is taken for unbiased.
        c1: dynamism at which the full model has 99.5 % of the weight; 300 in the thesis' simulations, 5,000 and
            25,000 on its robot.
        regularisation: lambda, N/kg.

    Raises:
        InputError: UNSUPPORTED without shape points, OBJECT_INVALID when they lie in a plane.
        NoAnswerError: SOLVER_FAILED, or NOT_IDENTIFIABLE when nothing weighs.
    """
    if problem.shape_points is None:
        raise InputError(ErrorCode.UNSUPPORTED, "pmd needs points inside the object: give shape_points")
    points = unit_points(problem.shape_points)
    weight = full_model_weight(problem, c1)[:, None]
    full = _triangle(problem.regressor, problem.wrench, weight)
    static = _triangle(static_regressor(problem.gravity_in_sensor), problem.wrench, 1 - weight)
    norms = [(triangle[:, :-1] @ points[: triangle.shape[1] - 1], triangle[:, -1]) for triangle in (full, static)]
    n = points.shape[1]
    norms.append((regularisation * np.eye(n), np.zeros(n)))
    masses = minimise_sum_of_norms(norms)
    if not masses.sum() > 0:
        raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, "pmd: the wrench shows no weight; is the force's sign right?")
    return answer(problem, points @ np.maximum(masses, _LEAST_MASS * masses.mean()))


def dynamism(problem: IdentificationProblem) -> Array:
    """(N,) nu, the summed signal-to-noise ratios of acceleration and velocity (thesis eq. 3.4 to 3.6).

    Eq. 3.3 divides powers of whole signals; 3.5, which is used, puts the norm of each sample into that place.
    """
    signals = (problem.linear_acceleration, problem.angular_acceleration, problem.angular_velocity)
    ratios = [
        np.linalg.norm(signal, axis=1) / amplitude for signal, amplitude in zip(signals, _NOISE_AMPLITUDES, strict=True)
    ]
    return np.asarray(np.sum(np.square(ratios), axis=0))


def full_model_weight(problem: IdentificationProblem, c1: float) -> Array:
    """(N,) w = tanh(3 nu / c1), thesis eq. 3.13."""
    return np.asarray(np.tanh(3 * dynamism(problem) / c1))


def unit_points(points: Array) -> Array:
    """(10, P) phi of point masses of 1 kg at (P, 3) (thesis eq. 3.9).

    Raises:
        InputError: OBJECT_INVALID for points in a plane: no choice of masses would make a body of them.
    """
    homogeneous = np.column_stack([points, np.ones(len(points))])
    spread_of_points = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) if len(points) else np.zeros(1)
    if len(points) < 4 or spread_of_points[-1] < 1e-6 * spread_of_points[0]:
        raise InputError(
            ErrorCode.OBJECT_INVALID, f"pmd: the {len(points)} shape points lie in a plane; spread them over the volume"
        )
    return np.stack([phi_of_pseudo_inertia(np.outer(point, point)) for point in homogeneous], axis=1)


def minimise_sum_of_norms(norms: list[tuple[Array, Array]]) -> Array:
    """(n,) m >= 0 that minimises sum_i ||G_i m - h_i||_2, a second-order cone program.

    Args:
        norms: (G_i (k, n), h_i (k,)) in pairs.

    Raises:
        NoAnswerError: SOLVER_FAILED when the solver gives up within its iterations or time, or gives nonsense.
    """
    n, count = norms[0][0].shape[1], len(norms)
    rows, right = [np.hstack([-np.eye(n), np.zeros((n, count))])], [np.zeros(n)]
    cones = [clarabel.NonnegativeConeT(n)]
    for index, (matrix, offset) in enumerate(norms):  # (t_i, G_i m - h_i) lies in the cone
        bound = np.zeros((1, n + count))
        bound[0, n + index] = -1.0
        rows += [bound, np.hstack([-matrix, np.zeros((len(matrix), count))])]
        right += [np.zeros(1), -offset]
        cones.append(clarabel.SecondOrderConeT(1 + len(matrix)))
    cost = np.concatenate([np.zeros(n), np.ones(count)])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter, settings.time_limit = _MAX_ITERATIONS, _TIME_LIMIT
    nothing = scipy.sparse.csc_matrix((n + count, n + count))
    solver = clarabel.DefaultSolver(
        nothing, cost, scipy.sparse.csc_matrix(np.vstack(rows)), np.concatenate(right), cones, settings
    )
    result = solver.solve()
    solution = np.array(result.x)[:n]
    solved = result.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    if not solved or not np.all(np.isfinite(solution)):
        raise NoAnswerError(
            ErrorCode.SOLVER_FAILED,
            f"pmd: the cone solver stopped with {result.status} after {result.iterations} steps",
        )
    return np.asarray(np.maximum(solution, 0.0))


def _triangle(rows: Array, wrench: Array, weight: Array) -> Array:
    """(c + 1, c + 1) R with ||R (x, -1)|| = ||w o (rows x - wrench)||, for rows (N, 6, c) and weights (N, 1)."""
    augmented = np.concatenate([rows * weight[:, :, None], (wrench * weight)[:, :, None]], axis=2)
    columns = augmented.shape[2]
    # Zero rows change nothing and make the triangle whole however few the samples.
    stacked = np.concatenate([augmented.reshape(-1, columns), np.zeros((columns, columns))])
    return np.asarray(np.linalg.qr(stacked, mode="r"))


ENTRY = EstimatorEntry(
    "pmd",
    "point masses inside the shape",
    estimate=pmd,
    stream=lambda prior: SampleWindow(pmd, prior),
    needs_shape=True,
    estimates_bias=False,
)
