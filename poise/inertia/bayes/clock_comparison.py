"""By how much wrenches are stamped later than the motion, from the samples alone: profile likelihood at many lags."""

import numpy as np

from poise.inertia.bayes.delay import Delay
from poise.inertia.bayes.recorder import ALPHA, LARGEST_GAP, OMEGA, SPECIFIC, WRENCH
from poise.inertia.model import ENTRIES, N_MOTION, N_SIGNALS, motion_signals
from poise.kernels import COMPILED, clock_sums
from poise.types import Array, Indices, Stamps

_LONGEST, STEP = 60_000_000, 2_000_000
"""ns: the range and the resolution of the lags. Shaking at 40 Hz turns around within 12 ms."""

_PERIOD = 4_000_000
"""ns: of the wrenches in each period, the first one is compared."""

_PARTS = 10
"""The samples are kept in this many parts of equal size, or up to twice as many. Leaving out one part at a time gives
the spread of the answer (jackknife, Tukey 1958)."""

_LEAST_PER_PART = 10
_LEAST_SPAN = 5_000_000_000
"""ns of samples. The errors of a smoothed motion are correlated over tenths of a second; the jackknife does not see
errors that its parts share, so the parts must be longer."""
_ITERATIONS = 4
_START_VARIANCE = np.repeat([0.1, 0.005], 3) ** 2
_NEIGHBOURS = 6
"""Lags on each side of the best one that are looked at again for the spread."""


class ClockComparison:
    """Sums over samples in order of time, at every lag between the two clocks.

    The log likelihood of a delay, with the payload, the bias and the noise of each channel at their best for it, is
    -n/2 sum log s_k^2. No prior and no shape take part, and no model of how errors hang together in time.
    """

    def __init__(self) -> None:
        self.lags = np.arange(-_LONGEST, _LONGEST + 1, STEP, dtype=np.int64)
        n = 2 * _PARTS
        self._moments, self._counts = np.zeros((n, len(self.lags), N_SIGNALS, N_SIGNALS)), np.zeros((n, len(self.lags)))
        self._part_size, self._n_summed, self._done = 2 * _LEAST_PER_PART, 0, 0
        self._begin: int | None = None

    def delay(self, stamps: Stamps, rows: Array) -> Delay | None:
        """The delay at which least squares leave least, and one sigma of it; None for too few samples in motion.

        Each call gives all samples so far; what earlier calls gave is not summed again.

        Args:
            stamps: (N,) ns, increasing.
            rows: (N, 15) see `BlockRecorder.add`.
        """
        if not len(stamps):
            return None
        end = int(np.searchsorted(stamps, stamps[-1] - _LONGEST, "right"))
        period = stamps[:end] // _PERIOD
        first = np.flatnonzero(np.diff(period[max(self._done - 1, 0) :], prepend=-1)) + max(self._done - 1, 0)
        chosen = first[first >= self._done]
        self._done = max(end, self._done)
        if self._begin is None and len(chosen):
            self._begin = int(stamps[chosen[0]])
        while len(chosen):
            room = self._part_size - self._n_summed % self._part_size
            self._sum(stamps, rows, chosen[:room])
            chosen = chosen[room:]
        if self._begin is None or stamps[end - 1] - self._begin < _LEAST_SPAN:
            return None
        return self._estimate()

    def _sum(self, stamps: Stamps, rows: Array, chosen: Indices) -> None:
        """Sum samples that lie in one part; merge the parts two by two when there is no room for another."""
        if self._n_summed == len(self._counts) * self._part_size:
            for sums in (self._moments, self._counts):
                sums[:_PARTS] = sums[::2] + sums[1::2]
                sums[_PARTS:] = 0.0
            self._part_size *= 2
        part = self._n_summed // self._part_size
        self._n_summed += len(chosen)
        low = max(int(np.searchsorted(stamps, stamps[chosen[0]] - 2 * _LONGEST)) - 1, 0)
        high = int(np.searchsorted(stamps, stamps[chosen[-1]] + 2 * _LONGEST, "right")) + 1
        when, motion = stamps[low:high], rows[low:high]
        signals = motion_signals(motion[:, SPECIFIC], motion[:, OMEGA], motion[:, ALPHA])
        if COMPILED:
            own = stamps[chosen], rows[chosen, WRENCH]
            sums, counts = clock_sums(when, signals, *own, self.lags, LARGEST_GAP)
            self._moments[part] += sums
            self._counts[part] += counts
            return
        wanted = stamps[chosen] - self.lags[:, None]  # (L, N)
        right = np.searchsorted(when, wanted, "left").clip(1, len(when) - 1)
        before, span = when[right - 1], when[right] - when[right - 1]
        share = (wanted - before) / np.maximum(span, 1)
        found = (share >= 0) & (share <= 1) & (span <= LARGEST_GAP)
        moved = np.diff(signals, axis=0).take(right - 1, axis=0)  # in place and without gaps: these arrays are large
        moved *= share[..., None]
        moved += signals.take(right - 1, axis=0)
        both = np.empty((*wanted.shape, N_SIGNALS))
        both[..., :N_MOTION], both[..., N_MOTION:] = moved, rows[chosen, WRENCH]
        both[~found] = 0.0
        self._moments[part] += both.swapaxes(1, 2) @ both
        self._counts[part] += found.sum(axis=1)

    def _estimate(self) -> Delay | None:
        n_parts = -(-self._n_summed // self._part_size)
        if n_parts < _PARTS or (self._counts[: n_parts - 1] < _LEAST_PER_PART).any():  # too few, at rest, or all gaps
            return None
        moments, counts = self._moments[:n_parts].sum(axis=0), self._counts[:n_parts].sum(axis=0)
        log = _log_likelihood(moments, counts)
        top = int(np.argmax(log))
        near = slice(max(top - _NEIGHBOURS, 0), top + _NEIGHBOURS + 1)
        without = _log_likelihood(
            moments[near] - self._moments[:n_parts, near], counts[near] - self._counts[:n_parts, near]
        )
        delays = np.array([self._peak(log), *(self._peak(each, near.start) for each in without)])
        if np.isnan(delays).any():
            return None
        spread = np.sqrt((n_parts - 1) / n_parts * np.sum((delays[1:] - delays[1:].mean()) ** 2))
        return Delay(float(delays[0]), float(spread))

    def _peak(self, log: Array, first: int = 0) -> float:
        """s: where a likelihood (K,) at lags from the `first` on has its peak, between samples; NaN at its ends."""
        top = int(np.argmax(log))
        if top in (0, len(log) - 1):
            return np.nan
        before, at, after = log[top - 1 : top + 2]
        return float((self.lags[first + top] + STEP * (before - after) / (2 * (before - 2 * at + after))) * 1e-9)


def _log_likelihood(moments: Array, counts: Array) -> Array:
    """(...,) per sample, of sums (..., 19, 19): the noise of each channel follows from the answer, and weighs it."""
    motion, cross = moments[..., :N_MOTION, :N_MOTION], moments[..., :N_MOTION, N_MOTION:]
    squares = np.diagonal(moments[..., N_MOTION:, N_MOTION:], axis1=-2, axis2=-1)
    by_channel = ENTRIES @ motion[..., None, :, :] @ ENTRIES.swapaxes(1, 2)  # (..., 6, 16, 16)
    right = (ENTRIES @ cross.swapaxes(-1, -2)[..., None])[..., 0]  # (..., 6, 16)
    variances = np.broadcast_to(_START_VARIANCE, squares.shape)
    for _ in range(_ITERATIONS):
        normal = np.sum(by_channel / variances[..., None, None], axis=-3)
        vector = np.sum(right / variances[..., None], axis=-2)
        scale = np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1).clip(min=1e-300))
        scaled = normal / (scale[..., :, None] * scale[..., None, :]) + 1e-11 * np.eye(normal.shape[-1])
        solved = np.linalg.solve(scaled, (vector / scale)[..., None])[..., 0] / scale
        predicted = (by_channel @ solved[..., None, :, None])[..., 0]  # (..., 6, 16)
        left = squares + np.sum((predicted - 2 * right) * solved[..., None, :], axis=-1)
        variances = left.clip(min=1e-12) / np.maximum(counts, 1)[..., None]
    return np.asarray(-np.sum(np.log(variances), axis=-1) / 2)
