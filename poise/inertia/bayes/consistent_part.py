"""The blocks that one payload explains, however long the contact is: trimmed least squares on the means of blocks."""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import scipy
from numpy.typing import NDArray

from poise.errors import ErrorCode
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.model import (
    N_MOTION,
    N_UNKNOWNS,
    EstimateFinding,
    NoiseLevels,
    residual_covariance,
    signal_columns,
)
from poise.types import Array, Mask

LIMIT = 36.0
"""Squared distance of a mean (six channels, in units of `tolerance`) from which on something else touched the payload.
White noise reaches it once in 500,000 blocks."""

_CLOSE = 6.0
"""Squared distance of a close fit. The loss grows with the logarithm of the distance beyond it, as for noise of unknown
level: a contact that resembles a payload fits many blocks, but none closely."""

_FAR = float(np.log1p(LIMIT / _CLOSE))

_ACCURACY = 0.02
"""Share of the weight by which sensor, kinematics and gravity may be wrong without a contact: cross-talk and gain of
a calibrated sensor are of one to two percent."""

_ARM = 0.05
"""m: with it and the distance of the centre of mass, the accuracy of the force becomes that of the torque."""

_PRIOR = np.concatenate([[10.0], np.full(3, 1.0), np.full(6, 0.1), np.full(3, 100.0), np.full(3, 5.0)])
"""kg, kg m, kg m2, N, N m: of what a sensor holds and reads, at most."""

MOST_REACH = 1.0
"""m, beyond which nothing is held."""

_SAME_ATTITUDE = 0.05 * STANDARD_GRAVITY
"""m/s2: blocks whose specific forces differ by less show the same, and count as one."""

_LEAST_BLOCKS, _GROUPS = 6, 12
_LEAST_SHARE = 0.15
"""Of the attitudes, which a free part has to explain."""

_TRIM_STEPS, _STEPS = 2, 6
_BETTER = 0.1
"""Share of the attitudes that another payload must explain in addition to be preferred."""

NOTABLE = 0.05
"""Share of the samples in contact from which on a finding says so."""

_LOWER_QUARTILE = 1.213
"""Of chi-square with three degrees of freedom."""

_HALF = 0.5
"""Share of the attitudes; an answer that explains less of them is as uncertain as the hypotheses differ."""

_KNOWN = 0.2
"""Relative standard deviation of a mass that the blocks of a hypothesis make observable."""

_RIVAL, _SIGMAS = 0.5, 5.0
"""A second payload is reported if it explains this share of what the first one explains, in other blocks, and if the
masses differ by so many standard deviations."""

_NONE = np.zeros((N_UNKNOWNS, N_UNKNOWNS))


@dataclass(frozen=True, eq=False)
class ConsistentPart:
    """The blocks that a payload explains, and how far other hypotheses about them are.

    Args:
        free: (B,) the blocks; None: no payload explains notably more of them than the answer so far.
        spread: (16, 16) covariance of phi and bias about the answer, of hypotheses that are nearly as good.
        rival: kg, of a second payload that explains other blocks as well; None: there is none.
    """

    free: Mask | None
    spread: Array
    rival: float | None = None


@dataclass(frozen=True, eq=False)
class MeanCheck:
    """How far means over blocks may be from what a payload predicts.

    Args:
        left: (B, 6) residual means of an answer, N and N m.
        sizes: (B,) samples.
        noise: of one sample.
    """

    left: Array
    sizes: NDArray[np.int64]
    noise: NoiseLevels

    @cached_property
    def scatter(self) -> Array:
        """(2,) variance from block to block, of force and torque: noise may be correlated over a block.

        Third differences take away what changes slowly, and their lower quartile what changes fast in fewer than three
        quarters of the blocks. They have 20 times the variance of a mean, and chi-square of three channels.
        """
        if len(self.left) < _LEAST_BLOCKS:
            return np.zeros(2)
        squares = _by_group(np.diff(self.left, n=3, axis=0))
        place = 0.25 * (len(squares) - 1)  # as numpy.quantile, in a tenth of its time
        ordered, below = np.sort(squares, axis=0), int(place)
        above = min(below + 1, len(squares) - 1)
        quartile = ordered[below] + (place - below) * (ordered[above] - ordered[below])
        return np.asarray(quartile / (20 * _LOWER_QUARTILE))

    def tolerance(self, unknowns: Array) -> Array:
        """(..., B, 2) variances of means that are no contact, of force and torque, for payloads (..., 16)."""
        sample = np.diagonal(residual_covariance(unknowns[..., :10], self.noise), axis1=-2, axis2=-1)
        weight = STANDARD_GRAVITY * np.abs(unknowns[..., 0])
        moment = STANDARD_GRAVITY * np.linalg.norm(unknowns[..., 1:4], axis=-1) + weight * _ARM
        white = np.stack([sample[..., :3].mean(axis=-1), sample[..., 3:].mean(axis=-1)], axis=-1)
        model = (_ACCURACY * np.stack([weight, moment], axis=-1)) ** 2
        noise = np.maximum(white[..., None, :] / self.sizes[:, None], self.scatter)
        return np.asarray(noise + model[..., None, :])

    def distances(self, unknowns: Array) -> Array:
        """(B,) squared distances of the means from the answer (16,), in units of `tolerance`."""
        return np.asarray((_by_group(self.left) / self.tolerance(unknowns)).sum(axis=1))

    def doubted(self, distances: Array) -> bool:
        """A notable share of the samples is too far from the answer."""
        far = float(self.sizes[distances > LIMIT].sum() / self.sizes.sum())
        return far > _BETTER and len(self.sizes) >= _LEAST_BLOCKS


@dataclass(frozen=True, eq=False)
class MomentMeans:
    """Means over blocks: (B, 6) wrench = (B, 6, 16) regressor times (phi, bias).

    Args:
        regressor, wrench: see above, N and N m.
        weights: (B,) shares of the attitudes; blocks with the same attitude share one.
        check: their tolerance.
    """

    regressor: Array
    wrench: Array
    weights: Array
    check: MeanCheck

    @classmethod
    def of(cls, moments: Array, check: MeanCheck) -> "MomentMeans":
        """From sums of blocks (B, 19, 19), see `signals`."""
        sizes = check.sizes
        means = moments[:, N_MOTION - 1] / sizes[:, None]
        alike = np.exp(
            -scipy.spatial.distance.cdist(means[:, :3], means[:, :3], "sqeuclidean") / (2 * _SAME_ATTITUDE**2)
        )
        weights = sizes / (alike @ sizes)
        return cls(signal_columns(means[:, :N_MOTION]), means[:, N_MOTION:], weights / weights.sum(), check)

    def distances(self, unknowns: Array) -> Array:
        """(..., B) squared distances of the means from what payloads (..., 16) predict, in units of `tolerance`."""
        flat = self.regressor.reshape(-1, N_UNKNOWNS)
        left = self.wrench - (unknowns @ flat.T).reshape(*unknowns.shape[:-1], *self.wrench.shape)
        return np.asarray((_by_group(left) / self.check.tolerance(unknowns)).sum(axis=-1))

    def explained(self, distances: Array) -> Array:
        """(...,) share of the attitudes that payloads with distances (..., B) explain; a close fit counts more."""
        return np.asarray((1 - np.log1p(np.minimum(distances, LIMIT) / _CLOSE) / _FAR) @ self.weights)


def consistent_part(means: MomentMeans, unknowns: Array, distances_before: Array) -> ConsistentPart:
    """The payload that explains most attitudes at the accuracy of a sensor, found from many subsets of the blocks.

    Fast least trimmed squares (Rousseeuw and Van Driessen 2006): each subset of runs of blocks gives a payload, and
    each payload the blocks that it explains, in turns. A contact is constant neither in the base nor in the sensor; it
    fits the geometry of gravity for few attitudes only.

    Args:
        means: of all blocks.
        unknowns: (16,) the answer so far.
        distances_before: (B,) of it.
    """
    before = float(means.explained(distances_before))
    found, deviations = _settled(means, unknowns)
    distances = means.distances(found)
    score, free = means.explained(distances), distances < LIMIT
    bodies = (found[:, 0] > 0) & (np.linalg.norm(found[:, 1:4], axis=1) < MOST_REACH * found[:, 0])
    possible = bodies & (deviations < _KNOWN * found[:, 0]) & (free @ means.weights > _LEAST_SHARE)
    best = int(np.argmax(np.where(possible, score, 0.0)))
    if not possible[best] or score[best] < before + _BETTER:
        similar = bodies & (score > _RIVAL * max(before, score[bodies].max(initial=0.0)))
        doubted = similar.any() and (distances_before < LIMIT) @ means.weights < _HALF
        return ConsistentPart(None, _about(unknowns, found, similar.astype(float)) if doubted else _NONE)
    elsewhere = np.where(possible, means.explained(np.where(free[best], LIMIT, distances)), 0.0)
    elsewhere *= np.abs(found[:, 0] - found[best, 0]) > _SIGMAS * np.hypot(deviations, deviations[best])
    second = int(np.argmax(elsewhere))
    if elsewhere[second] < _RIVAL * score[best]:
        return ConsistentPart(free[best], _NONE)
    return ConsistentPart(free[best], _about(found[best], found[[second]], np.ones(1)), float(found[second, 0]))


def _about(centre: Array, found: Array, weights: Array) -> Array:
    """(16, 16) second moment of payloads (H, 16) about one of them (16,), with weights (H,)."""
    apart = found - centre
    return np.asarray((apart.T * weights / weights.sum()) @ apart)


def _by_group(vectors: Array) -> Array:
    """(..., 2) squared lengths of force and torque (..., 6)."""
    squares = vectors**2
    return np.stack([squares[..., :3].sum(axis=-1), squares[..., 3:].sum(axis=-1)], axis=-1)


def _settled(means: MomentMeans, unknowns: Array) -> tuple[Array, Array]:
    """(H, 16) payloads from many starting subsets, and (H,) one sigma of their masses."""
    count = len(means.weights)
    scale = np.repeat(means.check.tolerance(unknowns), 3, axis=1)  # (B, 6)
    weighted = means.regressor / scale[:, :, None]
    informations = (weighted.swapaxes(1, 2) @ means.regressor).reshape(count, -1)
    vectors = np.einsum("bij,bi->bj", weighted, means.wrench)
    chosen = _starts(count)
    least = max(round(_LEAST_SHARE * count), _LEAST_BLOCKS - 1)
    for step in range(_TRIM_STEPS + _STEPS):
        shares = chosen.astype(np.float64)
        system = (shares @ informations).reshape(-1, N_UNKNOWNS, N_UNKNOWNS) + np.diag(_PRIOR**-2.0)
        inverse = np.linalg.inv(system)
        found = (inverse @ (shares @ vectors)[..., None])[..., 0]
        distances = means.distances(found)
        nearest = np.argsort(distances, axis=1, kind="stable")
        rank = np.argsort(nearest, axis=1, kind="stable")
        trimmed = rank < np.maximum(chosen.sum(axis=1, keepdims=True) if step < _TRIM_STEPS else least, least)
        chosen = trimmed if step < _TRIM_STEPS else trimmed | (distances < LIMIT)
        if step >= _TRIM_STEPS:
            chosen = np.unique(chosen, axis=0)
    return found, np.sqrt(inverse[:, 0, 0])


def _starts(count: int) -> Mask:
    """(H, B) subsets: every run of groups of consecutive blocks, and every two and three groups."""
    groups = min(_GROUPS, count // 2)
    which = np.arange(count) * groups // count
    runs = [range(first, past) for first in range(groups) for past in range(first + 1, groups + 1)]
    apart = [*combinations(range(groups), 2), *combinations(range(groups), 3)]
    return np.array([np.isin(which, list(each)) for each in (*runs, *apart)])


def away_from_contact(free: Mask) -> Mask:
    """The free blocks (B,) without the neighbours of others, in which a contact begins or ends; all if few are left."""
    inner = free.copy()
    inner[1:] &= free[:-1]
    inner[:-1] &= free[1:]
    return inner if inner.sum() >= _LEAST_BLOCKS else free


def in_contact(sizes: NDArray[np.int64], touched: Mask, mass: float, rival: float | None) -> EstimateFinding | None:
    """The finding that something else touched the payload for a notable share of the samples.

    A block counts if its mean does not fit the payload. Blocks that were rejected because the arm shook do not count.

    Args:
        sizes: (B,) samples of all blocks.
        touched: (B,) the blocks that were not used, and whose means are beyond `LIMIT`.
        mass: kg, of the answer.
        rival: see `ConsistentPart`.
    """
    share = float(sizes[touched].sum() / sizes.sum())
    if share < NOTABLE and rival is None:
        return None
    starts = np.flatnonzero(np.diff(touched, prepend=False) & touched)
    evidence = {"share": share, "spans": float(len(starts)), "mass": mass}
    sentence = f"something else touched the payload for {100 * share:.0f} % of the samples, which were left out"
    if rival is None:
        advice = "; weigh again without contact if more accuracy is needed"
    else:
        evidence["other_mass"] = rival
        advice = (
            f", or the payload changed: a payload of {mass:.4f} kg explains one part of the samples and one of"
            f" {rival:.4f} kg another part, and the samples do not decide between them: weigh again without contact"
        )
    return EstimateFinding(ErrorCode.IN_CONTACT, sentence + advice, evidence)
