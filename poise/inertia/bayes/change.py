"""Weighing for hours: the estimate improves during ordinary work, and starts again when the payload has changed."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from poise.errors import NoAnswerError
from poise.inertia.bayes.estimator import EXTERNAL_CONTACT, BayesSolution, PoiseEstimator
from poise.inertia.model import NoiseLevels, Parts
from poise.types import Array, Stamps

_BLOCK = 50_000_000
"""ns: a change begins within one, and only the next one is all of the new payload."""

_WINDOWS = (5, 6, 8)
"""Blocks, the newest of which may have begun just now, in which a change shows."""

LEAST = 240_000_000
"""ns that they span; a knock is over before."""

_CERTAIN = 14.0
"""Log of the odds of a change against none: a million to one."""

_SUSPICIOUS = 3.0
"""Below this, what came last may become part of what is expected at once; above, when it is no change for long."""

_LEAST_CHANGE, _LEAST_SHARE = 0.03, 0.1
"""kg, and share of the mass, by which payloads differ that count as two; models of a motion err by less."""

_SIGMAS = 4.0
"""Standard deviations of the mass that was known, by which another payload must differ from it."""

_EXPLAINED = 8.0
"""Standard deviations by which a block may differ from the new payload and still be held for it."""

_LOOK, _REFERENCE, _PATIENCE = 50_000_000, 1_000_000_000, 600_000_000
"""ns between looks for a change, and between what they compare with; and of doubt that was no change after all."""

_MOST_REJECTED = 0.2
"""Share of the samples with which a bias is still that of the sensor; a press and an arm that is shaken give it."""

_MEMORY = 2_000_000_000
"""ns of samples, for a new beginning."""

_SPREAD_AFTER, _LEAST_SPREAD = 3.0, 0.1
"""Of the bias after a change: in units of how well it was known before, but at least this share of a sample's noise."""


@dataclass(frozen=True)
class PayloadChange:
    """The payload is another one from here on: grasped, released, spilt.

    Args:
        stamp: of the sample with which it became certain, ns.
        since: from which on samples belong to the new payload, ns.
        mass_before, mass_after: kg, the latter a first guess.
    """

    stamp: int
    since: int
    mass_before: float
    mass_after: float


class ContinuousEstimator:
    """A `PoiseEstimator` that notices when the payload has changed, and then starts again.

    A change differs from a push by what explains it: the newest blocks contradict the payload, and another payload
    explains them. The new one begins without a shape (see `hold`), but with the bias as it was known. A push that lasts
    and does not turn with the sensor is taken for a payload. A slow leak is not noticed.

    Args:
        parts: of the object held at the beginning; None when there is none, or its shape is not known.
        noise: of samples, and how large a bias to expect.
        options: of `PoiseEstimator`.
    """

    def __init__(self, parts: Parts | None = None, noise: NoiseLevels | None = None, **options: Any) -> None:
        self.changes: list[PayloadChange] = []
        self._options = options
        self._tare = np.zeros(6)
        self._memory: deque[tuple[Stamps, Array]] = deque()
        self._since = self._looked = self._sure = np.iinfo(np.int64).min
        self._solved: int | None = None
        self._mass: float | None = None
        self._estimator = PoiseEstimator(parts, noise, block=_BLOCK, **options)

    def hold(self, parts: Parts | None) -> None:
        """Set the shape of what is held since the last change; to be called while its samples are remembered."""
        self._restart(self._since, parts, self._estimator.noise)

    def add_rows(self, stamps: Stamps, rows: Array) -> PayloadChange | None:
        """Add samples, see `PoiseEstimator.add_rows`.

        Returns:
            The change that they made certain, if any.
        """
        if not len(stamps):
            return None
        self._memory.append((stamps, rows))
        self._feed(stamps, rows)
        now = int(stamps[-1])
        if self._solved is None:
            self._solved = self._sure = int(stamps[0])
        while self._memory[0][0][-1] < now - _MEMORY:
            self._memory.popleft()
        if now - self._looked < _LOOK:
            return None
        self._looked = now
        return self._look(now)

    @property
    def tare(self) -> Array:
        """(6,) what the sensor read with nothing on it when the payload changed last, N and N m."""
        return self._tare

    @property
    def noise(self) -> NoiseLevels:
        """Of samples; and how well that is known."""
        return self._estimator.noise

    @property
    def mass(self) -> float | None:
        """kg that newer samples are compared with; None before there is an answer."""
        return self._mass

    @property
    def since(self) -> int:
        """ns from which on samples are of the payload held now."""
        return self._since

    def solve(self) -> BayesSolution:
        """Estimate the payload held now.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES soon after the beginning.
        """
        solution = self._estimator.solve()
        return replace(solution, bias=solution.bias + self._tare)

    def _look(self, now: int) -> PayloadChange | None:
        """Compare the newest samples with the expected ones, and update the expectation from time to time."""
        most = 0.0
        for count in _WINDOWS:
            begin = (now // _BLOCK - count + 1) * _BLOCK
            if self._solved is None or begin <= self._solved:
                continue
            found = self._estimator.contradiction(begin, LEAST)
            if found is None:
                continue
            most = max(most, found.log_odds)
            before = float(self._known.phi[0])
            least = max(_LEAST_CHANGE, _LEAST_SHARE * before)
            differs = abs(found.mass - before) > max(least, _SIGMAS * self._known.covariance[0, 0] ** 0.5)
            if differs and found.log_odds > _CERTAIN and found.surprise < _EXPLAINED and found.fits:
                change = PayloadChange(now, begin, before, found.mass)
                self.changes.append(change)
                self._begin(begin)
                self._mass = found.mass
                return change
        if most < _SUSPICIOUS:
            self._sure = now
        settled = most < _SUSPICIOUS or now - self._sure > _PATIENCE
        if settled and self._solved is not None and now - self._solved > _REFERENCE:
            self._expect(now)
        return None

    def _expect(self, now: int) -> None:
        """Solve, and compare later samples with the answer."""
        try:
            solution = self._estimator.solve()
        except NoAnswerError:  # too early
            return
        self._solved, self._mass = now, float(solution.phi[0])
        self._known = solution

    def _begin(self, since: int) -> None:
        """Start over from a stamp on, with nothing but the bias; without it, if it was learnt in contact."""
        self._since = since
        if _touched(self._known):
            self._tare = np.zeros(6)
            self._restart(since, None, replace(self._estimator.noise, force_bias=np.inf, torque_bias=np.inf))
            return
        self._tare = self._tare + self._known.bias
        deviation = np.sqrt(np.diag(self._known.bias_covariance).reshape(2, 3).max(axis=1))
        noise = self._estimator.noise
        spread = np.maximum(_SPREAD_AFTER * deviation, _LEAST_SPREAD * np.array([noise.force, noise.torque]))
        known = replace(noise, force_bias=float(spread[0]), torque_bias=float(spread[1]))
        self._restart(since, None, known)

    def _restart(self, since: int, parts: Parts | None, noise: NoiseLevels) -> None:
        self._estimator = PoiseEstimator(parts, noise, block=_BLOCK, **self._options)
        self._solved = self._sure = since
        for stamps, rows in self._memory:
            late = stamps >= since
            self._feed(stamps[late], rows[late])

    def _feed(self, stamps: Stamps, rows: Array) -> None:
        self._estimator.add_rows(stamps, rows - np.concatenate([np.zeros(9), self._tare]))


def _touched(solution: BayesSolution) -> bool:
    """A notable share of the samples was rejected, so that the bias may be that of a contact."""
    rejected = sum(span.n_samples for span in solution.rejected if span.reason == EXTERNAL_CONTACT)
    return rejected > _MOST_REJECTED * (solution.n_samples + rejected)
