"""Families of noise, on a grid of 1 ms: white, first-order, band-limited, heavy-tailed, quantised."""

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from benchmarks.foreign.motions import STEP
from benchmarks.foreign.robots import Array

_EARLY = 2000


def white(count: int, channels: int, rng: np.random.Generator) -> Array:
    return rng.normal(size=(count, channels))


def first_order(count: int, channels: int, rng: np.random.Generator) -> Array:
    """Half of the variance white, half of it with a correlation time of 20 to 150 ms."""
    out = np.empty((count, channels))
    for channel in range(channels):
        keep = np.exp(-STEP / rng.uniform(0.02, 0.15))
        slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=count + _EARLY))[_EARLY:]
        out[:, channel] = np.sqrt(0.5) * (slow + rng.normal(size=count))
    return out


def band_limited(count: int, channels: int, rng: np.random.Generator) -> Array:
    """Between a random 3 to 10 Hz and 25 to 45 Hz, with a fifth of the deviation white."""
    band = [float(rng.uniform(3, 10)), float(rng.uniform(25, 45))]
    sos = butter(2, band, "bandpass", fs=1 / STEP, output="sos")
    limited = sosfilt(sos, rng.normal(size=(count + _EARLY, channels)), axis=0)[_EARLY:]
    return np.asarray(0.98 * limited / limited.std(axis=0) + 0.2 * rng.normal(size=(count, channels)))


def heavy_tailed(count: int, channels: int, rng: np.random.Generator) -> Array:
    """Student's t with three degrees of freedom."""
    return np.asarray(rng.standard_t(3, size=(count, channels)) / np.sqrt(3))


NOISES: dict[str, Callable[[int, int, np.random.Generator], Array]] = {
    "white": white,
    "first_order": first_order,
    "band_limited": band_limited,
    "heavy_tailed": heavy_tailed,
    "quantised": white,
}

QUANTUM = 0.5
"""Of one standard deviation: the step of a quantised signal in a healthy recording."""
