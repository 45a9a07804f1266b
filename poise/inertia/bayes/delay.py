"""How late wrenches are against the kinematics: evidence at a few lags becomes a delay and its uncertainty."""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.types import Array

LAG_STEP = 0.02
"""s: what a robot does hardly changes in this time, so that a parabola through three lags is enough."""

_PROFILE_DEGREE = 4
"""Of the polynomial through the log evidence: its curvature counts, and not how noise differs from lag to lag."""

_FINE_STEPS = 1200
"""Of the grid on which the delay is integrated over."""

PRIOR_SPREAD = 0.03
"""s: clocks are hardly further apart."""


@dataclass(frozen=True)
class Delay:
    """Wrench stamps minus kinematics stamps.

    Args:
        mean, std: s.
        log_integral: log of the evidence integrated over the delay and its prior, less that at the mean.
    """

    mean: float = 0.0
    std: float = 0.0
    log_integral: float = 0.0


class LagGrid:
    """Delays at which samples are paired: multiples of a step from -longest to longest, at least five.

    Args:
        longest: s; with 0 the delay is known to be `about`, and there is a single lag.
        step: s between lags.
        about: s, the delay in the middle of the grid.
    """

    def __init__(self, longest: float, step: float = LAG_STEP, about: float = 0.0) -> None:
        steps = max(2, round(longest / step)) if longest > 0 else 0
        self.nanoseconds = np.arange(-steps, steps + 1, dtype=np.int64) * round(step * 1e9) + round(about * 1e9)
        self.lags = self.nanoseconds * 1e-9
        self.about = float(self.lags[steps])
        self._step = step
        self._smooth, self._powers, self._log_prior = _fine_grid(steps, step, self.about)

    def __len__(self) -> int:
        return len(self.lags)

    @property
    def arrays(self) -> dict[str, Array]:
        """What the compiled search is given of the grid: (F, L) the map to the fine delays, and these, (F,)."""
        return {"smooth": self._smooth, "beyond": self._powers[1]}

    @property
    def numbers(self) -> dict[str, float]:
        """The same, s."""
        first = float(self.lags[0])
        return {"first_lag": first, "lag_step": self._step, "about": self.about, "prior_spread": PRIOR_SPREAD}

    def weights(self, delays: ArrayLike) -> Array:
        """(..., L) with which quantities at the lags add up to those at delays (...,): parabolas through three lags."""
        if len(self) == 1:
            return np.ones((*np.shape(delays), 1))
        place = (np.asarray(delays, dtype=np.float64)[..., None] - self.lags[0]) / self._step
        nearest = np.rint(place).clip(1, len(self) - 2)
        beyond, steps = place - nearest, np.arange(len(self)) - nearest
        at, beside = 1 - beyond**2, beyond * (beyond + steps) / 2
        return np.asarray(np.where(steps == 0, at, np.where(np.abs(steps) == 1, beside, 0.0)))

    def estimate(self, log_evidence: Array) -> Delay:
        """Mean and spread of the delay under a normal prior about zero, from the log evidence (L,)."""
        smooth = self._smooth @ log_evidence
        log = smooth + self._log_prior
        most = float(log.max())
        probability = np.exp(log - most)
        total, first, second = (float(sum_) for sum_ in self._powers @ probability)
        step = float(self._powers[1, 1] - self._powers[1, 0])
        beyond = first / total  # from the middle of the lags
        std = math.sqrt(max(second / total - beyond**2, 0.0) + step**2 / 12)
        mean = self.about + beyond
        at_mean = float(np.interp(beyond, self._powers[1], smooth))
        norm = step / (math.sqrt(2 * math.pi) * PRIOR_SPREAD)
        return Delay(mean, std, math.log(total * norm) + most - at_mean)


@functools.lru_cache(maxsize=64)
def _fine_grid(steps: int, step: float, about: float) -> tuple[Array, Array, Array]:
    """See `_polynomial`, then (3, F) powers of the fine delays (s, from `about`), and (F,) the log of their prior."""
    fine, smooth = _polynomial(steps)
    beyond = fine * step
    return smooth, beyond ** np.arange(3)[:, None], -(((about + beyond) / PRIOR_SPREAD) ** 2) / 2


@functools.cache
def _polynomial(steps: int) -> tuple[Array, Array]:
    """(F,) delays in steps, and the (F, L) map from values at the lags to the polynomial through them."""
    if steps == 0:
        return np.zeros(1), np.ones((1, 1))
    coarse, fine = np.linspace(-1.0, 1.0, 2 * steps + 1), np.linspace(-1.0, 1.0, _FINE_STEPS + 1)
    smooth = np.vander(fine, _PROFILE_DEGREE + 1) @ np.linalg.pinv(np.vander(coarse, _PROFILE_DEGREE + 1))
    return fine * steps, smooth
