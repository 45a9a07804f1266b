"""Starting points in the residual: times of change, windows of activity, lines in the spectrum."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from poise.geometry import runs
from poise.mismatch.recorded import RecordedMotion, shown, white_level, wrench_rounding
from poise.types import Array, Mask

_GRID = 49
"""Times from which spans are searched."""
_ENDS = 12.0
"""Half the drop of the squared residual that the end of a span must win over a change that stays."""


def noise_in(recorded: RecordedMotion, residual: Array) -> Array:
    """(C,) white noise of a residual (N, C), > 0; of wrenches (C = 6), at least the rounding of the sensor.

    A channel that rests on one step of a coarse sensor shows no noise; what it follows between two steps is no effect.
    """
    level = np.maximum(white_level(residual), 1e-9)
    if residual.shape[1] != recorded.wrench.shape[1]:
        return level
    return np.asarray(np.maximum(level, wrench_rounding(recorded.wrench)))


def scaled(recorded: RecordedMotion, residual: Array) -> Array:
    """(N, C) residual in units of each channel's white noise."""
    return np.asarray(residual / noise_in(recorded, residual))


def steps(
    recorded: RecordedMotion, residual: Array, columns: Array, count: int = 3, apart: float = 0.5
) -> Iterator[tuple[float, float]]:
    """Times from which on `columns` explain the residual best, the best first; then the time that ends, if one does.

    The columns, zero outside a span of time, are fitted beside constants; the gains come from cumulative sums.

    Args:
        recorded: the recording.
        residual: (N, 6).
        columns: (N, 6, k) the response had it begun before the recording.
        count: how many at the most.
        apart: s between them.

    Yields:
        (begin, end), s; the end is infinite for what stays.
    """
    noise = noise_in(recorded, residual)
    spans = SpanFits(residual / noise, shown(recorded, columns) / noise[:, None])
    samples = len(recorded)
    gain = spans.gain(np.arange(1, samples), samples)
    middle = np.concatenate([recorded.seconds[:1], (recorded.seconds[1:] + recorded.seconds[:-1]) / 2])
    taken: list[float] = []
    for index in np.argsort(gain)[::-1]:
        time = float(middle[index + 1])
        if all(abs(time - other) > apart for other in taken):
            taken.append(time)
            yield time, np.inf
        if len(taken) == count:
            break
    first, after, best = spans.best()
    if best > gain.max() + _ENDS:
        yield float(middle[first]), float(middle[after])


class SpanFits:
    """Fits of columns that are zero outside a span of samples, beside six constants.

    Args:
        residual: (N, C) whitened.
        columns: (N, C, k) whitened.
    """

    def __init__(self, residual: Array, columns: Array) -> None:
        centred = residual - residual.mean(axis=0)
        self._moments = _sums(np.einsum("nck,nc->nk", columns, centred))
        self._products = _sums(np.einsum("nck,ncl->nkl", columns, columns))
        self._columns = _sums(columns)

    def gain(self, first: NDArray[np.intp] | int, after: NDArray[np.intp] | int) -> Array:
        """Half the drop of the squared residual when the columns from sample `first` to before `after` join."""
        moments = self._moments[after] - self._moments[first]
        sums = self._columns[after] - self._columns[first]
        gram = self._products[after] - self._products[first]
        gram = gram - np.swapaxes(sums, -1, -2) @ sums / (len(self._moments) - 1)
        # Constant columns equal the constants beside them: their remainder is too small to divide by.
        size = moments.shape[-1]
        ridge = (1e-6 * np.trace(self._products[-1]) / size + 1e-12) * np.eye(size)
        solved = np.linalg.solve(gram + ridge, moments[..., None])[..., 0]
        return np.asarray(np.sum(moments * solved, axis=-1) / 2)

    def best(self) -> tuple[int, int, float]:
        """(first, after) of the best span inside the recording, and its gain: on a grid, then sample by sample."""
        samples = len(self._moments) - 1
        grid = np.unique(np.linspace(0, samples - 1, _GRID).astype(np.intp)[1:])
        pairs = np.stack(np.triu_indices(len(grid), 1))
        first, after = grid[pairs[:, int(np.argmax(self.gain(grid[pairs[0]], grid[pairs[1]])))]]
        near = np.arange(-samples // _GRID, samples // _GRID + 1)
        for _ in range(2):
            firsts = np.unique(np.clip(first + near, 1, after - 1))
            first = firsts[int(np.argmax(self.gain(firsts, after)))]
            afters = np.unique(np.clip(after + near, first + 1, samples - 1))
            after = afters[int(np.argmax(self.gain(first, afters)))]
        return int(first), int(after), float(self.gain(first, after))


def _sums(values: Array) -> Array:
    """(N + 1, ...) sums of the values before each sample, and of all."""
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


def bursts(recorded: RecordedMotion, residual: Array, count: int = 3) -> Iterator[tuple[float, float]]:
    """Windows (start, end), s, in which the residual is far above its usual size, the strongest first.

    The energy of the residual, summed over channels and smoothed over 0.15 s, is cut at a level between its
    usual size and its peak; windows closer than 0.3 s are joined.
    """
    energy = smoothed(recorded, (scaled(recorded, residual) ** 2).mean(axis=1), 0.15)
    usual = float(np.median(energy))
    spread = 1.4826 * float(np.median(np.abs(energy - usual))) + 1e-12
    above = energy > usual + 5 * spread
    joined: list[tuple[int, int]] = []
    for begin, end in runs(above):
        if joined and recorded.seconds[begin] - recorded.seconds[joined[-1][1]] < 0.3:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((begin, end))
    ranked = sorted(joined, key=lambda span: -float((energy[span[0] : span[1] + 1] - usual).sum()))
    for begin, end in ranked[:count]:
        yield float(recorded.seconds[begin]), float(recorded.seconds[end])


def chained(spans: Sequence[tuple[float, float]], seed: tuple[float, float], apart: float) -> tuple[float, float]:
    """From the first to the last of the spans, s, that follow one another within `apart`, s, and include the seed."""
    begin, end = seed
    for _ in spans:
        for a, b in spans:
            if a < end + apart and b > begin - apart:
                begin, end = min(begin, a), max(end, b)
    return begin, end


def spans(seconds: Array, inside: Mask, beside: float) -> Iterator[tuple[float, float]]:
    """Windows (start, end), s, of the runs of a mask (N,), wider by `beside`, s, at both ends."""
    for begin, end in runs(inside):
        yield float(seconds[begin]) - beside, float(seconds[end]) + beside


def within(seconds: Array, windows: Iterable[tuple[float, float]], beside: float = 0.0) -> Mask:
    """(N,) stamps inside any of some windows (start, end), s, or not farther than `beside`, s, from it."""
    inside = np.zeros(len(seconds), dtype=bool)
    for begin, end in windows:
        inside |= (seconds >= begin - beside) & (seconds <= end + beside)
    return inside


def smoothed(recorded: RecordedMotion, values: Array, width: float) -> Array:
    """(N,) running mean over `width` seconds."""
    half = max(round(width / recorded.period / 2), 1)
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    low, high = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    return np.asarray((total[high] - total[low]) / (high - low))


def spectrum(recorded: RecordedMotion, values: Array) -> tuple[Array, Array]:
    """Frequencies (F,) Hz and the power (F,) of (N, C) values, channels summed, resampled evenly, windowed (Hann)."""
    even = np.arange(recorded.seconds[0], recorded.seconds[-1], recorded.period)
    power = np.zeros(len(even) // 2 + 1)
    for column in values.T:
        series = np.interp(even, recorded.seconds, column)
        power += np.abs(np.fft.rfft((series - series.mean()) * np.hanning(len(even)))) ** 2
    return np.asarray(np.fft.rfftfreq(len(even), recorded.period)), power


def lines(recorded: RecordedMotion, residual: Array, count: int = 3, low: float = 0.3) -> Iterator[float]:
    """Frequencies, Hz, of the strongest peaks of the residual's spectrum above its smooth background."""
    frequency, power = spectrum(recorded, scaled(recorded, residual))
    width = max(len(power) // 40, 5)
    padded = np.pad(power, width, mode="edge")
    background = np.array([np.median(padded[i : i + 2 * width + 1]) for i in range(len(power))])
    ratio = np.where(frequency >= low, power / np.maximum(background, 1e-30), 0.0)
    for _ in range(count):
        peak = int(np.argmax(ratio))
        if ratio[peak] <= 0.0:
            return
        yield float(frequency[peak])
        ratio[max(peak - 4, 0) : peak + 5] = 0.0
