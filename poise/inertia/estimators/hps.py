"""HPS: the masses of an object's homogeneous parts from a sensor that stands still (thesis section 3.2)."""

import numpy as np
import scipy

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.estimators.answer import answer
from poise.inertia.estimators.entry import EstimatorEntry
from poise.inertia.estimators.sample_window import SampleWindow
from poise.inertia.model import IdentificationProblem, InertialSolution, regressor
from poise.types import Array

MAX_PARTS = 4
"""At rest the data matrix has rank four (thesis, footnote 3): more parts cannot be distinguished."""

_STANDSTILL = 1.0
"""m/s2 and rad/s2: samples below both count as standing still (thesis section 3.2.4)."""


def hps(problem: IdentificationProblem) -> InertialSolution:
    """Minimise ||A m - b||_2 subject to m >= 0 over part masses m (thesis eq. 3.25 and 3.26), phi = unit_parts m.

    Only samples with both accelerations below `_STANDSTILL` are used, and their motion is taken for none. The sensor
    is taken for unbiased, every row has the same weight, and more than four parts are merged into four, the smallest
    into its nearest neighbour first (the thesis stops its segmentation at four).

    Raises:
        InputError: UNSUPPORTED when the problem has no parts or no volumes.
        NoAnswerError: TOO_FEW_SAMPLES when the sensor never stands still, NOT_IDENTIFIABLE when nothing weighs.
    """
    if problem.unit_parts is None or problem.part_volumes is None:
        raise InputError(ErrorCode.UNSUPPORTED, "hps needs the parts of the object: give unit_parts and part_volumes")
    still = standing_still(problem)
    if not np.any(still):
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"hps: none of {len(problem)} samples is below {_STANDSTILL} m/s2 and {_STANDSTILL} rad/s2; stop and go",
        )
    unit_parts = merge_parts(problem.unit_parts, problem.part_volumes, MAX_PARTS)
    rows = static_regressor(problem.gravity_in_sensor[still]) @ unit_parts[:4]
    masses, _ = scipy.optimize.nnls(rows.reshape(-1, rows.shape[2]), problem.wrench[still].ravel(), maxiter=1000)
    if not np.sum(masses) > 0:
        raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, "hps: the wrench shows no weight; is the force's sign right?")
    return answer(problem, unit_parts @ masses)


def standing_still(problem: IdentificationProblem) -> Array:
    """(N,) bool, samples whose accelerations, as measured, are both below `_STANDSTILL`."""
    return np.asarray(
        (np.linalg.norm(problem.linear_acceleration, axis=1) < _STANDSTILL)
        & (np.linalg.norm(problem.angular_acceleration, axis=1) < _STANDSTILL)
    )


def merge_parts(unit_parts: Array, volumes: Array, count: int) -> Array:
    """(10, count) homogeneous parts made of (10, K): the smallest joins the part with the nearest centroid, until done.

    What joins is taken to have the same density, so that unit-mass parameters mix by volume (thesis eq. 3.32).
    """
    parts, sizes = unit_parts.copy(), volumes.copy()
    while parts.shape[1] > count:
        smallest = int(np.argmin(sizes))
        distance = np.linalg.norm(parts[1:4] - parts[1:4, [smallest]], axis=0)
        distance[smallest] = np.inf
        nearest = int(np.argmin(distance))
        together = sizes[nearest] + sizes[smallest]
        parts[:, nearest] = (parts[:, nearest] * sizes[nearest] + parts[:, smallest] * sizes[smallest]) / together
        sizes[nearest] = together
        parts, sizes = np.delete(parts, smallest, axis=1), np.delete(sizes, smallest)
    return parts


def static_regressor(gravity: Array) -> Array:
    """(n, 6, 4) of (m, m c): f = m g, tau = m c x g."""
    zeros = np.zeros_like(gravity)
    return regressor(gravity, zeros, zeros)[:, :, :4]


ENTRY = EstimatorEntry(
    "hps",
    "masses of homogeneous parts, at rest",
    estimate=hps,
    stream=lambda prior: SampleWindow(hps, prior),
    needs_shape=True,
    estimates_bias=False,
)
