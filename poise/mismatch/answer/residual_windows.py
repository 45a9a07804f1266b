"""Windows of a residual: times, channels, frequency band, correlated states, and share of the excess."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poise.mismatch.inference import SignalNoise, linear_bspline_basis
from poise.mismatch.recorded import RecordedMotion, linear_at
from poise.types import Array

_STRETCH = 0.25
"""s over which the energy of a residual is averaged."""
_ALERT, _CALM = 6.0, 2.5
"""Sigmas of that average at which a window opens, and closes."""
_JOINED = 0.5
"""s between windows that are joined."""
_MOST = 8
"""Most windows that are reported."""
_NOTABLE = 0.15
"""Share of a window's excess from which a channel or a state is named."""


@dataclass(frozen=True)
class ResidualWindow:
    """A stretch in which the recording and the model differ by more than noise.

    Args:
        start, end: s.
        kind: burst, change (from a moment to the end), trend (slow, all along) or throughout.
        channels: fx to tz, the strongest first.
        band_hz: between these frequencies lies the middle four fifths of the excess.
        depends_on: states that explain most of it, the best first.
        share: of the whole recording's excess energy.
    """

    start: float
    end: float
    kind: str
    channels: tuple[str, ...]
    band_hz: tuple[float, float]
    depends_on: tuple[str, ...]
    share: float


def locate(
    recorded: RecordedMotion, residual: Array, noise: SignalNoise, names: Sequence[str]
) -> tuple[ResidualWindow, ...]:
    """Windows in which a residual (N, C) is larger than its noise; none otherwise.

    Args:
        recorded: the recording.
        residual: measured minus predicted.
        noise: of the signal.
        names: (C) of the channels.
    """
    scaled = residual / noise.total
    excess = scaled**2 - 1.0
    # Of white noise z^2 - 1 has a variance of 2.
    spans = _spans(noise.seconds, excess.sum(axis=1), float(np.sum(2.0 / noise.band)))
    total = sum(float(excess[a:b].sum()) for a, b in spans)
    if not spans or total <= 0:
        return ()
    found = []
    for a, b in spans:
        energy = excess[a:b].sum(axis=0)
        whole = max(float(energy.clip(0).sum()), 1e-12)
        order = [int(c) for c in np.argsort(-energy) if energy[c] > _NOTABLE * whole]
        found.append(
            ResidualWindow(
                float(noise.seconds[a]),
                float(noise.seconds[b - 1]),
                _kind(noise.seconds, scaled, a, b),
                tuple(names[c] for c in order),
                _band(recorded, noise.seconds[a:b], scaled[a:b]),
                tuple(goes_with(recorded, noise.seconds, scaled, slice(a, b))),
                float(energy.sum() / total),
            )
        )
    return tuple(sorted(found, key=lambda window: -window.share)[:_MOST])


def _spans(seconds: Array, energy: Array, variance: float) -> list[tuple[int, int]]:
    """Rows (from, to) where the smoothed energy is significant: from `_ALERT` sigmas down to `_CALM`.

    Args:
        seconds, energy: (N,).
        variance: of the energy of a sample of noise, as if samples were independent.
    """
    period = float(np.median(np.diff(seconds)))
    half = max(round(_STRETCH / period / 2), 1)
    kernel = np.hanning(2 * half + 3)[1:-1]
    kernel /= kernel.sum()
    smooth = np.convolve(np.pad(energy, half, mode="reflect"), kernel, mode="valid")
    sigma = float(np.sqrt(variance * np.sum(kernel**2)))
    calm = smooth > _CALM * sigma
    edges = np.flatnonzero(np.diff(np.concatenate([[False], calm, [False]]).astype(int)))
    spans = [
        (int(a), int(b))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if float(smooth[a:b].max()) > _ALERT * sigma
    ]
    joined: list[tuple[int, int]] = []
    for a, b in spans:
        if joined and seconds[a] - seconds[joined[-1][1] - 1] < _JOINED:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    covered = sum(b - a for a, b in joined)
    return [(0, len(seconds))] if covered > 0.5 * len(seconds) and len(joined) > 2 else joined


def _kind(seconds: Array, scaled: Array, a: int, b: int) -> str:
    if b - a < 0.6 * len(seconds) and b < 0.97 * len(seconds):
        return "burst"
    if a > 0.05 * len(seconds) and b >= 0.97 * len(seconds):
        return "change"
    time = seconds - seconds.mean()
    slope = time @ scaled / (time @ time)
    trend = float(np.sum((time[:, None] * slope) ** 2))
    centred = scaled - scaled.mean(axis=0)
    return "trend" if trend > 0.5 * float(np.sum(centred**2) - centred.size) else "throughout"


def _band(recorded: RecordedMotion, seconds: Array, scaled: Array) -> tuple[float, float]:
    """Hz between which the middle four fifths of the power above the white floor lie."""
    if len(seconds) < 16:
        return 0.0, 0.5 / recorded.period
    even = np.arange(seconds[0], seconds[-1], recorded.period)
    values = linear_at(seconds, scaled, even)
    frequency, power = spectrum_of(values, recorded.period)
    above = np.clip(power - np.median(power[len(power) // 2 :]), 0.0, None)
    grown = np.cumsum(above)
    if grown[-1] <= 0:
        return 0.0, float(frequency[-1])
    low, high = np.searchsorted(grown / grown[-1], [0.1, 0.9])
    return float(frequency[low]), float(frequency[high])


def spectrum_of(values: Array, period: float) -> tuple[Array, Array]:
    """Frequencies and power (F,), channels summed, of even samples (N, C); a Hann window, the mean kept."""
    window = np.hanning(len(values) + 2)[1:-1, None]
    power = np.sum(np.abs(np.fft.rfft(values * window, axis=0)) ** 2, axis=1)
    return np.asarray(np.fft.rfftfreq(len(values), period)), power


def goes_with(recorded: RecordedMotion, seconds: Array, scaled: Array, rows: slice) -> list[str]:
    """States whose curves explain most of a residual in some rows, evaluated on blocks that were left out."""
    shares = {name: explained(curves[rows], scaled[rows]) for name, curves in _curves(recorded, seconds).items()}
    best = max(shares.values(), default=0.0)
    good = [name for name, share in shares.items() if share > max(_NOTABLE, 0.75 * best)]
    return sorted(good, key=lambda name: -shares[name])[:3]


def _curves(recorded: RecordedMotion, seconds: Array) -> dict[str, Array]:
    """(N, b) functions of each candidate state, at the signal's stamps."""

    def here(values: Array) -> Array:
        return values if seconds is recorded.seconds else np.interp(seconds, recorded.seconds, values)

    found = {"time": linear_bspline_basis(seconds, 8)}
    found["gravity_direction"] = np.stack([here(recorded.gravity[:, k]) / 9.81 for k in range(3)], axis=1)
    found["load"] = linear_bspline_basis(here(np.linalg.norm(recorded.nominal[:, :3], axis=1)), 6)
    if recorded.joints is not None:
        for kind in ("position", "velocity", "acceleration"):
            track = getattr(recorded.joints, kind)
            for j, name in enumerate(recorded.joints.names):
                if float(np.ptp(track[:, j])) > 0.05:
                    found[f"joint_{kind}:{name}"] = linear_bspline_basis(here(track[:, j]), 6)
    if recorded.base is not None:
        felt = np.einsum("nji,nj->ni", recorded.base.rotation_world_base, recorded.base.acceleration_in_world)
        if float(np.ptp(felt, axis=0).max()) > 0.05:
            found["base_acceleration"] = np.hstack([linear_bspline_basis(here(felt[:, k]), 4) for k in (0, 1)])
    return found


def explained(curves: Array, scaled: Array, blocks: int = 8) -> float:
    """Share of the energy (N, C) that curves (N, b) with a constant predict in held-out blocks."""
    columns = np.hstack([curves, np.ones((len(curves), 1))])
    if len(scaled) < 4 * blocks:
        return 0.0
    parts = np.array_split(np.arange(len(scaled)), blocks)
    grams = [(columns[part].T @ columns[part], columns[part].T @ scaled[part]) for part in parts]
    whole = np.sum([gram for gram, _ in grams], axis=0)
    moment = np.sum([vector for _, vector in grams], axis=0)
    ridge = 1e-3 * float(np.trace(whole)) / len(whole) * np.eye(len(whole))
    left = 0.0
    for part, (gram, vector) in zip(parts, grams, strict=True):
        fitted = np.linalg.solve(whole - gram + ridge, moment - vector)
        left += float(np.sum((scaled[part] - columns[part] @ fitted) ** 2))
    return 1.0 - left / max(float(np.sum(scaled**2)), 1e-12)
