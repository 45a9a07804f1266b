"""Starting points in the residual: times of change, windows of activity, lines in the spectrum."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from poise.mismatch.recorded import RecordedMotion, white_level
from poise.types import Array, Mask


def scaled(recorded: RecordedMotion, residual: Array) -> Array:
    """(N, C) residual in units of each channel's white noise."""
    del recorded
    return np.asarray(residual / np.maximum(white_level(residual), 1e-12))


def steps(
    recorded: RecordedMotion, residual: Array, columns: Array, count: int = 3, apart: float = 0.5
) -> Iterator[float]:
    """Moments from which on `columns` explain the residual best, the best first.

    For every moment t the columns, zero before t, are fitted beside constants; the gain of that fit is found from
    sums that grow from the end, in one pass.

    Args:
        recorded: the recording.
        residual: (N, 6).
        columns: (N, 6, k) the response had it begun before the recording.
        count: how many at the most.
        apart: s between them.
    """
    gain = step_gain(scaled(recorded, residual), columns / np.maximum(white_level(residual), 1e-12)[:, None])
    middle = (recorded.seconds[1:] + recorded.seconds[:-1]) / 2
    taken: list[float] = []
    for index in np.argsort(gain[1:])[::-1]:
        time = float(middle[index])
        if all(abs(time - other) > apart for other in taken):
            taken.append(time)
            yield time
        if len(taken) == count:
            return


def step_gain(residual: Array, columns: Array) -> Array:
    """(N,) half the drop of the squared residual when the columns, zero before sample i, join six constants.

    Args:
        residual: (N, C) whitened.
        columns: (N, C, k) whitened.
    """
    n, _, k = columns.shape
    centred = residual - residual.mean(axis=0)

    def from_end(values: Array) -> Array:
        return np.cumsum(values[::-1], axis=0)[::-1]

    moments = from_end(np.einsum("nck,nc->nk", columns, centred))
    products = from_end(np.einsum("nck,ncl->nkl", columns, columns))
    sums = from_end(columns)
    gram = products - np.einsum("nck,ncl->nkl", sums, sums) / n
    # Constant columns equal the constants beside them: their remainder is too small to divide by.
    ridge = (1e-6 * np.trace(products[0]) / k + 1e-12) * np.eye(k)
    solved = np.linalg.solve(gram + ridge, moments[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("nk,nk->n", moments, solved) / 2)


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
    for begin, end in _runs(above):
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
    for begin, end in _runs(inside):
        yield float(seconds[begin]) - beside, float(seconds[end]) + beside


def within(seconds: Array, windows: Iterable[tuple[float, float]], beside: float = 0.0) -> Mask:
    """(N,) stamps inside any of some windows (start, end), s, or not farther than `beside`, s, from it."""
    inside = np.zeros(len(seconds), dtype=bool)
    for begin, end in windows:
        inside |= (seconds >= begin - beside) & (seconds <= end + beside)
    return inside


def _runs(inside: Mask) -> list[tuple[int, int]]:
    """First and last index of each run of a mask (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


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
