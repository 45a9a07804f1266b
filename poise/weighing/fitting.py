"""Robust least squares of one explanation of the samples: its design, its parameters, and what it leaves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from poise.inertia.model import InertialParameters, signal_columns
from poise.inertia.verdict import FitSamples
from poise.kernels import COMPILED, robust_fit
from poise.types import Array, Indices, Mask

ReadingDesign = Callable[[FitSamples, Array], Array]
"""Of samples and values (k,): (N, 6, P) with wrench = design @ unknowns; the first ten unknowns are phi."""

N_BLOCKS = 40
"""Stretches of time that are compared one by one."""

_LEAST = np.array([2e-3, 1e-4])
"""N, N m: no sensor is better."""
_HUBER = 2.0
_ROUNDS = 4
_STEPS = 8
_ENOUGH_GAIN = 0.01
"""Nats below which a further step is not worth its time."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation fitted to samples.

    Args:
        values: (k,) of its non-linear parameters.
        unknowns: (P,) linear unknowns: phi (10), then what its design adds.
        covariance: (P + k, P + k) of unknowns and values, with clusters of time.
        residual: (N, 6) N and N m, of the measured wrench.
        levels: (B, 2) log of the root mean square of force and torque in each block.
        n_free: parameters beyond the ten of a payload and the six of a bias.
    """

    values: Array
    unknowns: Array
    covariance: Array
    residual: Array
    levels: Array
    n_free: int

    @property
    def phi(self) -> Array:
        """(10,)."""
        return self.unknowns[:10]

    @property
    def mass_std(self) -> float:
        """One sigma, kg."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def value_stds(self) -> Array:
        """(k,) one sigma of the values."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[len(self.unknowns) :]))

    def with_pull(self, mass: float) -> "Explanation":
        """With a mass that is uncertain by that of an unknown vertical pull, kg."""
        covariance = self.covariance.copy()
        covariance[0, 0] += mass**2
        return replace(self, covariance=covariance)

    @property
    def rms(self) -> Array:
        """(2,) of force and torque per axis, N and N m."""
        return np.asarray(np.sqrt(np.mean(self.residual.reshape(-1, 2, 3) ** 2, axis=(0, 2))))


def plain_design(samples: FitSamples, values: Array) -> Array:
    """The design of the pipeline: a payload and a constant bias."""
    del values
    return signal_columns(samples.signals)


def explain(
    samples: FitSamples,
    design: ReadingDesign,
    values: Sequence[float] = (),
    usable: Mask | None = None,
    quick: bool = False,
) -> Explanation:
    """Fit the linear unknowns, and the values by Gauss-Newton from a start.

    Args:
        samples: of the weighing.
        design: of the explanation.
        values: (k,) the start; empty for a design without values.
        usable: (N, 6) single readings that count; None: all.
        quick: without steps of the values, and without covariance.
    """
    at = np.asarray(values, dtype=np.float64)
    best = _linear(samples, design(samples, at), at, usable)
    if quick:
        return best
    for _ in range(_STEPS if len(at) else 0):
        step = _newton_step(samples, design, best, usable)
        better = None
        for share in (1.0, 0.3, 0.1):
            moved = best.values + share * step
            trial = _linear(samples, design(samples, moved), moved, usable)
            if trial.levels.sum() < best.levels.sum():
                better = trial
                break
        if better is None:
            break
        done = best.levels.sum() - better.levels.sum() < _ENOUGH_GAIN
        best = better
        if done:
            break
    return _with_covariance(samples, design, best, usable)


def block_levels(residual: Array, usable: Mask | None = None) -> Array:
    """(B, 2) log of the root mean square of force and torque, in each of at most `N_BLOCKS` stretches of samples."""
    weights = np.ones(residual.shape) if usable is None else usable.astype(np.float64)
    starts = block_starts(len(residual), min(N_BLOCKS, len(residual)))
    squares = np.add.reduceat((weights * residual**2).reshape(-1, 2, 3).sum(axis=2), starts, axis=0)
    counts = np.add.reduceat(weights.reshape(-1, 2, 3).sum(axis=2), starts, axis=0)
    return np.asarray(0.5 * np.log(squares / counts.clip(min=1.0) + _LEAST**2))


def block_starts(count: int, n_blocks: int) -> Indices:
    """(B,) first of each of the blocks that `numpy.array_split` makes of a number of samples."""
    length, longer = divmod(count, n_blocks)
    number = np.arange(n_blocks)
    return np.asarray(number * length + np.minimum(number, longer))


def _linear(samples: FitSamples, matrix: Array, values: Array, usable: Mask | None) -> Explanation:
    unknowns, _, residual = _weighted(matrix, samples.wrench, usable)
    n_free = matrix.shape[2] - 16 + len(values)
    return Explanation(values, unknowns, np.zeros((0, 0)), residual, block_levels(residual, usable), n_free)


def _weighted(matrix: Array, wrench: Array, usable: Mask | None) -> tuple[Array, Array, Array]:
    """Unknowns (P,), roots of the weights (N, 6) and residual (N, 6) of iteratively reweighted least squares."""
    if COMPILED:
        counts = None if usable is None else usable.astype(np.float64)
        return robust_fit(matrix, wrench, counts, least=_LEAST, huber=_HUBER, rounds=_ROUNDS)
    used = np.ones(wrench.shape) if usable is None else usable.astype(np.float64)
    flat = matrix.reshape(-1, matrix.shape[2])
    size = np.maximum(np.std(wrench.reshape(-1, 2, 3), axis=(0, 2)), _LEAST)
    root = used / np.repeat(size, 3)
    for _ in range(_ROUNDS):
        unknowns = _solved(flat, wrench.ravel(), np.square(root).ravel())
        residual = wrench - (flat @ unknowns).reshape(wrench.shape)
        norm = np.linalg.norm((used * residual).reshape(-1, 2, 3), axis=2) / np.sqrt(3)
        size = np.maximum(np.median(norm, axis=0) / 0.89, _LEAST)
        root = used * np.repeat(np.minimum(1.0, np.sqrt(_HUBER * size / np.maximum(norm, 1e-12))) / size, 3, axis=1)
    return unknowns, root, residual


def _solved(rows: Array, right: Array, weights: Array) -> Array:
    """(P,) unknowns of rows (R, P) with right sides (R,) and weights (R,)."""
    weighted = rows.T * weights
    normal = weighted @ rows
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0] = 1.0
    normal = normal / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    return np.asarray(np.linalg.solve(normal, weighted @ right / scale) / scale)


def _slopes(samples: FitSamples, design: ReadingDesign, found: Explanation) -> Array:
    """(N, 6, k) derivative of the prediction by the values."""
    predicted = samples.wrench - found.residual
    step = 1e-4
    slopes = [
        (design(samples, found.values + step * axis) @ found.unknowns - predicted) / step
        for axis in np.eye(len(found.values))
    ]
    return np.stack(slopes, axis=2) if slopes else np.zeros((*predicted.shape, 0))


def _newton_step(samples: FitSamples, design: ReadingDesign, found: Explanation, usable: Mask | None) -> Array:
    matrix = np.concatenate([design(samples, found.values), _slopes(samples, design, found)], axis=2)
    unknowns, _, _ = _weighted(matrix, samples.wrench, usable)
    return np.asarray(unknowns[len(found.unknowns) :])


def _with_covariance(
    samples: FitSamples, design: ReadingDesign, found: Explanation, usable: Mask | None
) -> Explanation:
    """Sandwich covariance with blocks as clusters (Liang and Zeger 1986), jointly for unknowns and values."""
    matrix = np.concatenate([design(samples, found.values), _slopes(samples, design, found)], axis=2)
    _, root, _ = _weighted(matrix, samples.wrench, usable)
    rows = (matrix * root[:, :, None]).reshape(-1, matrix.shape[2])
    normal = rows.T @ rows
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0] = 1.0
    inverse = np.linalg.inv(normal / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))) / np.outer(scale, scale)
    scores = rows * (found.residual * root).ravel()[:, None]
    n_blocks = len(found.levels)
    starts = 6 * block_starts(len(samples), n_blocks)
    clusters = np.add.reduceat(scores, starts, axis=0)
    pulls = clusters @ inverse
    covariance = pulls.T @ pulls * n_blocks / max(n_blocks - 1, 1)
    covariance[np.diag(normal) == 0, np.diag(normal) == 0] = np.inf
    return replace(found, covariance=covariance)


_USUAL_MASS, _USUAL_REACH = np.array([1.0, 1.5]), np.array([0.08, 0.9])
"""Median of what arms hold and one sigma of its logarithm: kg; m from the sensor."""
_WORST = -30.0
"""Nats: an implausible payload is worth this much evidence."""
FARTHEST = 0.5
"""m from the sensor; a centre of mass beyond it is implausible."""
_SURELY, _NOTHING = 3.0, 0.01
"""Standard deviations, and kg, below which a mass says nothing."""


def plausibility(found: Explanation) -> float:
    """Log of a wide prior of mass and distance of the centre of mass: what a robot's hand may hold; at most 0."""
    mass = float(found.phi[0])
    least = max(found.mass_std, 1e-3)
    if mass < least:
        return float(max(-0.5 * (np.log(least) / _USUAL_MASS[1]) ** 2 - 0.5 * (1 - mass / least) ** 2, _WORST))
    reach = max(float(np.linalg.norm(found.phi[1:4])) / mass, 1e-3)
    logs = [np.log(mass / _USUAL_MASS[0]) / _USUAL_MASS[1], np.log(reach / _USUAL_REACH[0]) / _USUAL_REACH[1]]
    return max(float(-0.5 * (logs[0] ** 2 + max(logs[1], 0.0) ** 2)), _WORST)


def impossible(found: Explanation) -> str:
    """Why no payload has the parameters of an explanation, as a clause; "" when one may."""
    return impossible_payload(found.phi, found.covariance[:10, :10])


def impossible_payload(phi: Array, covariance: Array) -> str:
    """Why no payload has phi (10,) with this covariance (10, 10), as a clause; "" when one may. Infinite: not seen."""
    mass, deviation = float(phi[0]), float(np.sqrt(covariance[0, 0]))
    if mass < -_SURELY * deviation and mass < -_NOTHING:
        return f"the mass would be {mass:.3g} kg"
    if mass < _SURELY * deviation or mass < _NOTHING:
        return ""
    reach = float(np.linalg.norm(phi[1:4])) / mass
    spread = float(np.sqrt(np.trace(covariance[1:4, 1:4]))) / mass
    if reach - _SURELY * spread > FARTHEST:
        return f"the centre of mass would be {reach:.2g} m from the sensor"
    uncertain = float(np.sqrt(np.diag(covariance)[[4, 7, 9]]).sum())
    if np.isfinite(uncertain) and np.trace(InertialParameters.from_phi(phi).inertia) < -_SURELY * uncertain:
        return "the inertia would be negative"
    return ""
