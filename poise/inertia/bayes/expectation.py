"""An answer that newer samples are compared with: the same payload, or another one."""

from dataclasses import dataclass

import numpy as np

from poise.inertia.bayes.blocks import MomentBlocks
from poise.inertia.bayes.consistent_part import LIMIT, MOST_REACH, MeanCheck
from poise.inertia.bayes.outliers import residuals
from poise.inertia.model import NoiseLevels, normal_equations
from poise.types import Array

_HEAVY, _REACH = 0.3, 0.15
"""kg and m: a payload changes by so much, or by its own mass."""

_DIFFERENT, _DRIFT, _CREEP = 0.02, 0.5, np.repeat([0.03, 0.0015], 3)
"""The same payload looks different by this share of itself, and the bias by this share of the noise of a sample, at
least by what sensors creep, N and N m."""

_YOUNG, _LOOK = 0.15, 0.1
"""After one second an answer is good to this share of the payload, after two to half of it; s it is from at least."""

_SIGMAS = 3.0
"""Standard deviations by which a payload may seem to be no body."""


@dataclass(frozen=True, eq=False)
class Contradiction:
    """Newer samples against an answer.

    Args:
        log_odds: of another payload against the same one.
        since: ns, from which on the other one explains the blocks better.
        phi: (10,) of the other one. covariance: (10, 10) of it.
        surprise: standard deviations by which its worst block differs from it.
        fits: it can be a body within reach, and the means of all blocks are as close to it as those of a payload
            without contact, see `MeanCheck`.
    """

    log_odds: float
    since: int
    phi: Array
    covariance: Array
    surprise: float
    fits: bool


@dataclass(frozen=True, eq=False)
class Expectation:
    """An answer, and how far the same payload may seem to be from it later on.

    Args:
        stamp: of the newest sample, ns. seconds: of samples.
        unknowns: (16,) phi and bias. covariance: (16, 16).
        noise: as believed. inflation: (2,) by how much the variances of force and torque are larger over a block.
        residual: (6, 6) covariance of a sample.
        lags: (L,) weights of the lags.
        touched: a notable share of the samples was rejected, so that the bias may be that of a contact.
    """

    stamp: int
    seconds: float
    unknowns: Array
    covariance: Array
    noise: NoiseLevels
    inflation: Array
    residual: Array
    lags: Array
    touched: bool

    @property
    def mass(self) -> float:
        """kg."""
        return float(self.unknowns[0])

    @property
    def mass_std(self) -> float:
        """kg."""
        return float(np.sqrt(self.covariance[0, 0]))

    def contradiction(self, blocks: MomentBlocks) -> Contradiction:
        """How much better another payload would explain blocks that came later.

        The same payload may look a little different: biases drift, models of the motion err, and an inertia that was
        learnt in slow motion is a guess, so that only mass and first moment count.
        """
        moments = blocks.mixed(self.lags)
        total, count = moments.sum(axis=0), float(self.lags @ blocks.counts.sum(axis=0))
        normal = normal_equations(total, count, self.residual, self.noise)
        units = np.array([1.0] + [_REACH] * 3 + [_REACH**2] * 6)
        change = max(_HEAVY, self.mass) * units
        drift = np.maximum(_DRIFT * self.noise.wrench * np.sqrt(np.repeat(self.inflation, 3)), _CREEP)
        different = max(_DIFFERENT, _YOUNG / max(self.seconds, _LOOK)) * self.mass
        slack = np.concatenate([different * units[:4], change[4:], drift])
        change = np.concatenate([change[:4], np.zeros(12)])
        gradient = normal.vector - normal.information @ self.unknowns
        expected = self.covariance + np.diag(slack**2)
        same, _, _ = _explained(expected, normal.information, gradient)
        other, step, covariance = _explained(expected + np.diag(change**2), normal.information, gradient)
        unknowns = self.unknowns + step
        left = residuals(moments, blocks.sizes, unknowns, self.residual)
        apart = MeanCheck(left.means, blocks.sizes, self.noise).distances(unknowns)
        fits = bool((apart < LIMIT).all()) and _is_body(unknowns[:4], np.sqrt(np.diag(covariance)[:4].clip(min=0.0)))
        before = residuals(moments, blocks.sizes, self.unknowns, self.residual)
        gain = MeanCheck(before.means, blocks.sizes, self.noise).distances(self.unknowns) - apart
        first = int(np.argmax(np.cumsum(gain[::-1])[::-1]))
        return Contradiction(
            log_odds=other - same,
            since=int(blocks.start[first + 1 if 0 < first < len(blocks) - 1 else first]),
            phi=unknowns[:10],
            covariance=covariance[:10, :10],
            surprise=float(left.surprise.max()),
            fits=fits,
        )


def _explained(covariance: Array, information: Array, gradient: Array) -> tuple[float, Array, Array]:
    """Log evidence of a deviation from an answer that is uncertain by (16, 16), the deviation (16,), its covariance."""
    system = np.eye(16) + covariance @ information
    found = np.asarray(np.linalg.solve(system, np.column_stack([covariance @ gradient, covariance])), dtype=np.float64)
    step = found[:, 0]
    return float(gradient @ step - np.linalg.slogdet(system)[1]) / 2, step, found[:, 1:]


def _is_body(moments: Array, deviations: Array) -> bool:
    """Mass and first moment (4,), with their deviations, can be those of something that is held, or of nothing."""
    most = moments[0] + _SIGMAS * deviations[0]
    least = np.linalg.norm(moments[1:]) - _SIGMAS * np.linalg.norm(deviations[1:])
    return bool(most > 0 and least < MOST_REACH * most)
