"""Weighing for hours: the estimate improves during ordinary work, and starts again when the payload has changed."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from poise.errors import NoAnswerError
from poise.inertia.bayes.blocks import MomentBlocks
from poise.inertia.bayes.estimator import BayesSolution, PoiseEstimator
from poise.inertia.bayes.expectation import Contradiction, Expectation
from poise.inertia.model import N_MOTION, NoiseLevels, Parts
from poise.types import Array, Stamps

_BLOCK = 50_000_000
"""ns: a change begins within one, and only the next one is all of the new payload."""

_WINDOWS, _LONG_WINDOWS = (5, 6, 8), (12, 18, 27, 40)
"""Blocks, the newest of which may have begun just now, in which a change shows; small changes need longer ones."""

LEAST = 240_000_000
"""ns that they span; a knock is over before."""

_CERTAIN = 14.0
"""Log of the odds of a change against none: a million to one."""

_SUSPICIOUS = 3.0
"""Below this, what came last may become part of what is expected at once; above, when it is no change for long."""

_DOUBTFUL = -2.0
"""Log of the odds from which on another payload is a doubt, since it has one chance in eight. While a payload stays, 99
of 100 looks are below -5 (seven of nine runs of `benchmarks.weighing.live`), or below -0.9 (two of heavy objects)."""

_LEAST_CHANGE, _LEAST_SHARE = 0.015, 0.1
"""kg, and share of the mass, by which payloads differ that count as two; models of a motion err by less."""

_SIGMAS = 4.0
"""Standard deviations of the mass that was known, by which another payload must differ from it."""

_EXPLAINED = 8.0
"""Standard deviations by which a block may differ from the new payload and still be held for it."""

_LOOK, _LONG_LOOK = 50_000_000, 200_000_000
"""ns between looks for a change in short and in long windows."""

_REFERENCE, _PATIENCE = 1_000_000_000, 600_000_000
"""ns between what they compare with; and of doubt that was no change after all, or that later samples do not renew."""

_MEMORY = 2_500_000_000
"""ns of samples, for a new beginning; and of answers that samples are compared with."""

_SPREAD_AFTER, _LEAST_SPREAD = 3.0, np.array([0.01, 0.0005])
"""Of the bias after a change: in units of how well it was known before, but at least what sensors creep, N and N m."""

_OTHER_ZERO, _FORGOTTEN = 3.0, 10.0
"""Spreads by which a bias differs from that before the change only if something else touches the payload; and s of
samples after which the sensor itself may have moved."""

_EVEN, _IMITATED = 0.5, 0.2
"""Probability of another payload before it is certain, or while the bias contradicts the new one; and of a contact that
imitates the new payload: its force must point along gravity."""

_REACH = 0.1
"""m from the sensor, where payloads have their centre of mass."""

_TURNED, _LONG_AGO = np.cos(np.radians(30)), 3_000_000_000
"""Cosine of the angle between attitudes, and ns, after which a contact no longer imitates a payload."""


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


@dataclass(frozen=True, eq=False)
class PayloadDoubt:
    """Another payload than the estimated one may be held.

    Args:
        phi: (10,) of it. covariance: (10, 10).
        probability: of it.
    """

    phi: Array
    covariance: Array
    probability: float

    def spread(self, phi: Array) -> Array:
        """(10, 10) covariance that the doubt adds to an estimate phi (10,)."""
        apart = self.phi - phi
        return np.asarray(self.probability * (np.outer(apart, apart) + self.covariance))


class ContinuousEstimator:
    """A `PoiseEstimator` that notices when the payload has changed, and then starts again.

    A change differs from a push by what explains it: the newest blocks contradict the payload, and another payload
    explains them. The new one begins without a shape (see `hold`), but with the bias as it was known. A push that lasts
    and points along gravity is taken for a payload; until the sensor has turned, the `doubts` say so. A slow leak is
    not noticed.

    Args:
        parts: of the object held at the beginning; None when there is none, or its shape is not known.
        noise: of samples, and how large a bias to expect.
        offset: m/s2, one sigma of that of an accelerometer that gives the motion: times the mass, it is in the bias.
        options: of `PoiseEstimator`.
    """

    def __init__(
        self, parts: Parts | None = None, noise: NoiseLevels | None = None, offset: float = 0.0, **options: Any
    ) -> None:
        self.changes: list[PayloadChange] = []
        self._options, self._offset = options, offset
        self._tare = np.zeros(6)
        self._tare_mass: float | None = None
        self._memory: deque[tuple[Stamps, Array]] = deque()
        self._since = self._looked = self._looked_long = self._sure = np.iinfo(np.int64).min
        self._expected: deque[Expectation] = deque()
        self._solved: int | None = None
        self._other: Contradiction | None = None
        self._doubted = np.iinfo(np.int64).min
        self._before: Expectation | None = None
        self._imitated = False
        self._estimator = PoiseEstimator(parts, noise, block=_BLOCK, **options)

    def hold(self, parts: Parts | None) -> None:
        """Set the shape of what is held since the last change; to be called while its samples are remembered."""
        self._restart(self._since, parts, self._estimator.noise)

    def believe(self, noise: NoiseLevels) -> None:
        """Set the noise of samples from now on; what is known of the bias stays."""
        self._estimator.noise = replace(self._estimator.noise, force=noise.force, torque=noise.torque)

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
    def bias_spread(self) -> tuple[float, float]:
        """N and N m by which the bias may differ from the `tare`, one sigma.

        An accelerometer's offset times the mass is in the bias: only a mass other than that of the tare adds to it.
        """
        held, tared = self.mass, self._tare_mass
        lost = 0.0 if held is None or tared is None else self._offset * abs(held - tared)
        return float(np.hypot(self.noise.force_bias, lost)), float(np.hypot(self.noise.torque_bias, _REACH * lost))

    @property
    def mass(self) -> float | None:
        """kg that newer samples are compared with; None before there is an answer."""
        if self._expected:
            return self._expected[-1].mass
        return self.changes[-1].mass_after if self.changes else None

    @property
    def since(self) -> int:
        """ns from which on samples are of the payload held now."""
        return self._since

    def doubts(self, bias: Array) -> tuple[PayloadDoubt, ...]:
        """What else may be held than what was estimated, with a bias (6,), from all samples since the last change."""
        found = []
        if self._other is not None:
            found.append(PayloadDoubt(self._other.phi, self._other.covariance, _EVEN))
        touched = self._is_other_zero(bias - self._tare) and self._age < _FORGOTTEN
        if self._before is not None and (touched or self._imitated):
            phi, uncertain = self._before.unknowns[:10], self._before.covariance[:10, :10]
            found.append(PayloadDoubt(phi, uncertain, _EVEN if touched else _IMITATED))
        return tuple(found)

    @property
    def _age(self) -> float:
        """S of samples since the last change."""
        return (int(self._memory[-1][0][-1]) - self._since) * 1e-9 if self._memory else 0.0

    def _is_other_zero(self, bias: Array) -> bool:
        """A bias (6,) beside the tare is not that of the sensor at the last change."""
        if not self.noise.zeroed:  # no bias was known
            return False
        spread = np.repeat(self.bias_spread, 3)
        return bool(np.any(np.abs(bias) > _OTHER_ZERO * spread))

    def solve(self) -> BayesSolution:
        """Estimate the payload held now.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES soon after the beginning.
        """
        solution = self._estimator.solve()
        return replace(solution, bias=solution.bias + self._tare)

    def _look(self, now: int) -> PayloadChange | None:
        """Compare the newest samples with the expected ones, and update the expectation from time to time."""
        doubtful, other = False, None
        blocks = self._estimator.blocks
        for begin, known in self._windows(now):
            late = blocks.select(blocks.start >= begin)
            if not len(late) or late.end[-1] - late.start[0] < LEAST:
                continue
            found = known.contradiction(late)
            if _is_other(found, known) and found.log_odds > _CERTAIN:
                change = PayloadChange(now, found.since, known.mass, float(found.phi[0]))
                self._begin(found.since, known)
                self.changes.append(change)
                return change
            doubtful |= found.log_odds > _SUSPICIOUS
            if found.fits and found.log_odds > (_DOUBTFUL if other is None else other.log_odds):
                other = found
        if other is not None:
            self._other, self._doubted = other, now
        elif now - self._doubted > _PATIENCE:
            self._other = None
        if not doubtful:
            self._sure = now
            self._imitated = self._imitated and not _settled(blocks)
        settled = not doubtful or now - self._sure > _PATIENCE
        if settled and self._solved is not None and now - self._solved > _REFERENCE:
            self._expect(now)
        return None

    def _windows(self, now: int) -> Iterator[tuple[int, Expectation]]:
        """Begins of the newest samples, ns, each with the newest answer that contains none of them."""
        counts: tuple[int, ...] = _WINDOWS
        if now - self._looked_long >= _LONG_LOOK or self._other is not None:
            self._looked_long, counts = now, _WINDOWS + _LONG_WINDOWS
        for count in counts:
            begin = (now // _BLOCK - count + 1) * _BLOCK
            known = next((each for each in reversed(self._expected) if each.stamp < begin), None)
            if known is not None:
                yield begin, known

    def _expect(self, now: int) -> None:
        """Solve, and compare later samples with the answer."""
        try:
            self._estimator.solve()
        except NoAnswerError:  # too early
            return
        self._solved = now
        known = self._estimator.expectation
        if known is not None:
            self._expected.append(known)
        while len(self._expected) > 1 and self._expected[1].stamp < now - _MEMORY:
            self._expected.popleft()

    def _begin(self, since: int, known: Expectation) -> None:
        """Start over from a stamp on, with nothing but the bias; without it, if it was learnt in contact.

        A payload with another bias than the sensor's was a contact: what was held and known before it counts.
        """
        if self._tare_mass is None:
            self._tare_mass = known.mass
        other_zero = self._is_other_zero(known.unknowns[10:])
        in_contact = other_zero and known.seconds < _FORGOTTEN
        before = self._before if in_contact else known
        self._since, self._before, self._imitated, self._other = since, before, True, None
        self._expected.clear()
        if in_contact:
            self._restart(since, None, self._estimator.noise)
            return
        if known.touched and (other_zero or not self.noise.zeroed):
            self._tare = np.zeros(6)
            self._restart(
                since, None, replace(self._estimator.noise, force_bias=np.inf, torque_bias=np.inf, zeroed=0.0)
            )
            return
        self._tare, self._tare_mass = self._tare + known.unknowns[10:], known.mass
        deviation = np.sqrt(np.diag(known.covariance)[10:].reshape(2, 3).max(axis=1))
        noise = self._estimator.noise
        spread = np.maximum(_SPREAD_AFTER * deviation, _LEAST_SPREAD)
        spread_noise = replace(
            noise, force_bias=float(spread[0]), torque_bias=float(spread[1]), zeroed=1 / _SPREAD_AFTER
        )
        self._restart(since, None, spread_noise)

    def _restart(self, since: int, parts: Parts | None, noise: NoiseLevels) -> None:
        self._estimator = PoiseEstimator(parts, noise, block=_BLOCK, **self._options)
        self._solved = self._sure = since
        for stamps, rows in self._memory:
            late = stamps >= since
            self._feed(stamps[late], rows[late])

    def _feed(self, stamps: Stamps, rows: Array) -> None:
        self._estimator.add_rows(stamps, rows - np.concatenate([np.zeros(9), self._tare]))


def _is_other(found: Contradiction, known: Expectation) -> bool:
    """Another payload explains what contradicts the known one, and differs notably from it."""
    least = max(_LEAST_CHANGE, _LEAST_SHARE * known.mass, _SIGMAS * known.mass_std)
    return found.fits and found.surprise < _EXPLAINED and abs(float(found.phi[0]) - known.mass) > least


def _settled(blocks: MomentBlocks) -> bool:
    """The samples of a payload are from attitudes, or long enough, that a contact would no longer imitate it."""
    if blocks.end[-1] - blocks.start[0] > _LONG_AGO:
        return True
    specific = blocks.moments[:, 0, N_MOTION - 1, :3]
    directions = specific / np.linalg.norm(specific, axis=1, keepdims=True).clip(min=1e-9)
    return bool((directions @ directions.T).min() < _TURNED)
