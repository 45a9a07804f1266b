"""Means of the wrench and of its regressor over blocks of time, and robust fits of payloads to them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.inertia.estimators import LEAST_NOISE
from poise.inertia.model import motion_signals, signal_columns
from poise.recording import interpolate
from poise.robot import SensorMotion
from poise.types import Array, Indices, Mask, Stamps

_BLOCK = 100_000_000
"""ns."""

_TURNING = 0.02
"""rad/s, root mean square, from which on a block counts as motion; its errors are larger than those at rest."""

_ENOUGH = 12
"""Blocks of a kind from which on their own scatter is the scale of their errors."""

CAP = 50.0
"""Squared error of a block, of six channels, in units of its scale, from which on its size does not matter."""

_WINDOW = 20
"""Blocks whose scatter about a payload of their own is an error."""

_ROUNDS = 8
_MOST_LAGS, _MOST_CORRELATED = 10, 20.0
_MEDIAN_OF_SQUARE, MEDIAN_OF_SIX = 0.4549, 5.348
"""Medians of chi-square with one and with six degrees of freedom."""

_ACCURACY = 0.005
"""Share of the variation of the wrench by which a sensor errs; short spans do not show it."""

_ROUGH = 5.0
"""Times the usual scale that errors may have in two seconds; a heavier load has larger ones."""

PHI_SPREAD = np.array([10.0] + [2.0] * 3 + [0.5] * 6)
BIAS_SPREAD = np.repeat([100.0, 5.0], 3)
"""Prior standard deviations, wide, of phi (kg, kg m, kg m2) and of the bias (N, N m)."""

_LARGEST_GAP = 0.1
"""s across which the motion at a delayed stamp is interpolated."""


@dataclass(frozen=True, eq=False)
class BlockMeans:
    """B blocks in the order of time.

    Args:
        start, end: (B,) stamps of the first and the last sample, ns.
        matrix: (B, 6, 10) mean regressor of phi.
        wrench: (B, 6) mean wrench, N and N m.
        moving: (B,) the sensor turned.
        floor: (2,) standard deviation that the white noise of samples alone gives a mean, N and N m.
    """

    start: Stamps
    end: Stamps
    matrix: Array
    wrench: Array
    moving: Mask
    floor: Array

    def __len__(self) -> int:
        return len(self.wrench)

    @cached_property
    def time(self) -> Array:
        """(B,) from -1 at the first block to 1 at the last."""
        middle = (self.start / 2 + self.end / 2) - self.start[0]
        half = max(float(middle[-1]) / 2, 1.0)
        return np.asarray(middle / half - 1)

    @cached_property
    def bias_matrix(self) -> Array:
        """(B, 6, 6) of the bias: the identity."""
        return np.broadcast_to(np.eye(6), (len(self), 6, 6))

    def select(self, some: slice) -> "BlockMeans":
        """Some of them."""
        return BlockMeans(
            self.start[some], self.end[some], self.matrix[some], self.wrench[some], self.moving[some], self.floor
        )


def block_means(motion: SensorMotion, wrench: Array, gravity: Array, delay: float) -> BlockMeans:
    """Means over blocks of samples that may be used.

    Args:
        motion: N samples.
        wrench: (N, 6) at their stamps, N and N m.
        gravity: (3,) m/s2 in the world.
        delay: s by which the wrench is stamped later than the motion.
    """
    stamps = motion.stamps
    signals = motion_signals(
        motion.gravity_in_sensor(gravity) - motion.linear_acceleration_in_sensor,
        motion.angular_velocity_in_sensor,
        motion.angular_acceleration_in_sensor,
    )
    if delay:
        earlier = interpolate(stamps, signals, stamps - round(delay * 1e9), max_gap=_LARGEST_GAP)
        signals = np.where(earlier.found[:, None], earlier.values, signals)
    number = (stamps - stamps[0]) // _BLOCK
    first = np.flatnonzero(np.diff(number, prepend=-1))
    sizes = np.diff(np.append(first, len(stamps)))
    mean = np.add.reduceat(signals, first) / sizes[:, None]
    turning = mean[:, [6, 9, 11]].sum(axis=1)  # of omega omega
    jumps = np.diff(wrench, axis=0)
    white = np.median(np.abs(jumps), axis=0).reshape(2, 3).mean(axis=1) / (0.6745 * np.sqrt(2)) if len(jumps) else 0.0
    least = np.array([LEAST_NOISE.force, LEAST_NOISE.torque])
    return BlockMeans(
        stamps[first],
        stamps[np.append(first[1:], len(stamps)) - 1],
        signal_columns(mean)[:, :, :10],
        np.add.reduceat(wrench, first) / sizes[:, None],
        turning > _TURNING**2,
        np.maximum(white / np.sqrt(np.median(sizes)), least),
    )


@dataclass(frozen=True, eq=False)
class Term:
    """Unknowns that blocks share: (B, 6, c) their regressor, (c,) prior deviations, (B,) which set of them applies."""

    matrix: Array
    spread: Array
    labels: Indices


def payload_terms(
    blocks: BlockMeans,
    payloads: Indices,
    biases: Indices | None = None,
    *,
    drift: bool = False,
    leak: bool = False,
) -> list[Term]:
    """A payload for each label (B,), a bias for each label (B,); both may also change steadily."""
    one = np.zeros(len(blocks), dtype=np.int64)
    terms = [
        Term(blocks.matrix, PHI_SPREAD, payloads),
        Term(blocks.bias_matrix, BIAS_SPREAD, one if biases is None else biases),
    ]
    steadily = blocks.time[:, None, None]
    if drift:
        terms.append(Term(blocks.bias_matrix * steadily, BIAS_SPREAD, one))
    if leak:
        terms.append(Term(blocks.matrix[:, :, :4] * steadily, PHI_SPREAD[:4], one))
    return terms


@dataclass(frozen=True, eq=False)
class BlockFit:
    """A robust fit.

    Args:
        unknowns: (P,) of all terms, set by set.
        covariance: (P, P), for errors without correlation in time.
        residual: (B, 6) N and N m.
        scale: (B, 6) standard deviations of the residual.
        keep: (B,) blocks that the fit explains.
        cost: sum over blocks of squared errors in units of the scale, each no more than `CAP`.
        information: (P, P) without the prior, and
        spread: (P,) prior deviations.
    """

    unknowns: Array
    covariance: Array
    residual: Array
    scale: Array
    keep: Mask
    cost: float
    information: Array
    spread: Array

    def log_evidence(self, correlated: float) -> float:
        """Of the model, when so many neighbouring blocks err together."""
        scaled = self.information * np.outer(self.spread, self.spread) / correlated
        volume = float(np.linalg.slogdet(np.eye(len(scaled)) + scaled)[1])
        prior = float(np.sum((self.unknowns / self.spread) ** 2))
        return -(self.cost / correlated + volume + prior) / 2

    @property
    def correlated(self) -> float:
        """How many neighbouring blocks err together, at least one."""
        return _correlated((self.residual / self.scale) * self.keep[:, None])


def fit(
    blocks: BlockMeans, terms: Sequence[Term], scale: Array, *, widen: bool = False, start: Mask | None = None
) -> BlockFit:
    """Least squares of the blocks that agree with it.

    Args:
        blocks: the samples.
        terms: the unknowns.
        scale: (B, 6) of residuals, N and N m.
        widen: scale up the force and the torque where the residuals are larger.
        start: (B,) blocks to begin with; None: all.
    """
    layout = _Layout(terms)
    keep = np.ones(len(blocks), dtype=bool) if start is None else start
    ridge = np.diag(layout.spread**-2.0)
    for _ in range(_ROUNDS):
        information, vector = layout.normal(blocks.wrench, keep[:, None] / scale)
        covariance = np.linalg.inv(information + ridge)
        unknowns = covariance @ vector
        residual = blocks.wrench - layout.predicted(unknowns)
        before, agree = keep, agreeing(np.sum((residual / scale) ** 2, axis=1))
        keep = agree if agree.any() else keep
        if np.array_equal(keep, before):
            if not widen:
                break
            usual = np.median((residual / scale)[keep].reshape(-1, 2, 3) ** 2, axis=(0, 2)) / _MEDIAN_OF_SQUARE
            scale, widen = scale * np.repeat(np.sqrt(np.maximum(usual, 1.0)), 3), False
    cost = float(np.minimum(np.sum((residual / scale) ** 2, axis=1), CAP).sum())
    found = np.asarray(covariance, dtype=np.float64)
    return BlockFit(unknowns, found, residual, scale, keep, cost, information, layout.spread)


class _Layout:
    """Where the unknowns of terms are in one row: set by set, term by term. No block has more than one set of a term.

    Args:
        terms: in this order.
    """

    def __init__(self, terms: Sequence[Term]) -> None:
        counts = [int(term.labels.max()) + 1 for term in terms]
        self.spread = np.concatenate([np.tile(term.spread, count) for term, count in zip(terms, counts, strict=True)])
        self._matrix = np.concatenate([term.matrix for term in terms], axis=2)
        _, kinds = np.unique(np.stack([term.labels for term in terms], axis=1), axis=0, return_inverse=True)
        self._alike = [np.flatnonzero(kinds == kind) for kind in range(int(kinds.max()) + 1)]
        """Blocks with the same unknowns."""
        first = np.cumsum([0, *(len(term.spread) * count for term, count in zip(terms, counts, strict=True))])
        self._rows = np.concatenate(
            [
                start + term.labels[:, None] * len(term.spread) + np.arange(len(term.spread))
                for term, start in zip(terms, first[:-1], strict=True)
            ],
            axis=1,
        )

    def normal(self, wrench: Array, weight: Array) -> tuple[Array, Array]:
        """(P, P) and (P,) of the wrenches (B, 6) with weights (B, 6)."""
        design, right = self._matrix * weight[:, :, None], wrench * weight
        information, vector = np.zeros((len(self.spread), len(self.spread))), np.zeros(len(self.spread))
        for some in self._alike:
            where, rows = self._rows[some[0]], design[some].reshape(-1, design.shape[2])
            information[np.ix_(where, where)] += rows.T @ rows
            vector[where] += rows.T @ right[some].ravel()
        return information, vector

    def predicted(self, unknowns: Array) -> Array:
        """(B, 6) of unknowns (P,)."""
        return np.asarray((self._matrix @ unknowns[self._rows][:, :, None])[:, :, 0])


def agreeing(squares: Array) -> Mask:
    """(B,) blocks whose squared errors (B,) are below `CAP`; where most are far above, the smaller half and more."""
    return np.asarray(squares < CAP * max(1.0, float(np.median(squares)) / MEDIAN_OF_SIX))


def local_errors(blocks: BlockMeans) -> tuple[Array, float]:
    """(B, 6) scale of what a payload and a bias leave of short spans, and how many of these errors hang together.

    A change of the payload spoils the span in which it happens, and no others.
    """
    residual = np.empty_like(blocks.wrench)
    design = np.concatenate([blocks.matrix, blocks.bias_matrix], axis=2)
    spread = np.concatenate([PHI_SPREAD, BIAS_SPREAD])
    weight = 1 / np.repeat(blocks.floor, 3)
    for some in np.array_split(np.arange(len(blocks)), max(len(blocks) // _WINDOW, 1)):
        rows = (design[some] * weight[:, None]).reshape(-1, 16)
        information = rows.T @ rows + np.diag(spread**-2.0)
        unknowns = np.linalg.solve(information, rows.T @ (blocks.wrench[some] * weight).ravel())
        freedom = max(1 - 16 / (6 * len(some)), 0.1)
        residual[some] = (blocks.wrench[some] - design[some] @ unknowns) / np.sqrt(freedom)
    scale = _scatter(blocks, residual)
    for some in np.array_split(np.arange(len(blocks)), max(len(blocks) // _WINDOW, 1)):
        own = np.median(residual[some].reshape(-1, 2, 3) ** 2, axis=(0, 2)) / _MEDIAN_OF_SQUARE
        scale[some] = np.clip(np.repeat(np.sqrt(own), 3), scale[some], _ROUGH * scale[some])
    errors = residual / scale
    return scale, _correlated(errors * (np.sum(errors**2, axis=1) < CAP)[:, None])


def _correlated(errors: Array) -> float:
    """How many neighbours of errors (B, 6) hang together, at least one."""
    power = float(np.sum(errors**2))
    if not power or len(errors) < 4 * _MOST_LAGS:
        return 1.0
    lags = [float(np.sum(errors[lag:] * errors[:-lag])) / power for lag in range(1, _MOST_LAGS)]
    falling = np.cumprod(np.array(lags) > 0) * lags  # up to the first that is not positive
    return float(min(1 + 2 * falling.sum(), _MOST_CORRELATED))


def _scatter(blocks: BlockMeans, residual: Array) -> Array:
    """(B, 6) scale of residuals at rest and in motion, of force and of torque, by the median of their squares."""
    scale = np.empty_like(residual)
    kinds = [blocks.moving, ~blocks.moving]
    if min(int(kind.sum()) for kind in kinds) < _ENOUGH:
        kinds = [np.ones(len(blocks), dtype=bool)]
    for kind in kinds:
        for group, rows in enumerate((slice(0, 3), slice(3, 6))):
            usual = float(np.median(residual[kind, rows] ** 2)) / _MEDIAN_OF_SQUARE
            about = blocks.wrench[kind, rows] - np.median(blocks.wrench[kind, rows], axis=0)
            varied = float(np.sqrt(np.mean(about**2)))
            scale[kind, rows] = max(np.sqrt(usual), blocks.floor[group], _ACCURACY * varied)
    return scale
