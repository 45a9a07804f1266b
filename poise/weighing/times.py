"""Readings of the clock: a wrench that is late, or that went through a slow filter."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.model import signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, ReadingDesign
from poise.weighing.reading import Family, Reading, Repair, Says

_DELAYS = (-0.1, 0.03, 0.1, 0.2, 0.35, 0.55, 0.8)
_FILTERS = (0.03, 0.1, 0.3)
_GRID, _LOG_TIMES = 0.005, (-6.0, 1.5)
"""s; limits of the log of a filter's time in s."""
_FEWEST, _SPARSE = 50, 0.1
"""Samples from which on clocks are compared; s between them beyond which their motion is not interpolated."""
_PRIORS = {"first": 0.0, "second": -1.0, "mean": -4.0}


def late_or_filtered(known: float) -> Family:
    """Delays up to a second beyond a known one, s; filters of first and second order and a moving mean."""

    def family(samples: FitSamples, plain: Explanation) -> list[Reading]:
        del plain
        if len(samples) < _FEWEST or float(np.median(np.diff(samples.seconds))) > _SPARSE:
            return []
        starts = tuple((float(np.log(time)),) for time in _FILTERS)
        late = Reading(
            ErrorCode.CLOCK_LATE,
            _late,
            _late_sentence(known),
            starts=tuple((delay,) for delay in _DELAYS),
            repair=lambda found: Repair(delay=known + float(found.values[0])),
        )
        kinds: tuple[FilterKind, ...] = ("first", "second", "mean")
        return [
            late,
            *(
                Reading(ErrorCode.FILTERED, _filtered(kind), _filter_sentence(kind), starts=starts, prior=_PRIORS[kind])
                for kind in kinds
            ),
        ]

    return family


FilterKind = Literal["first", "second", "mean"]


def _late(samples: FitSamples, values: Array) -> Array:
    return signal_columns(_at(samples.seconds, samples.signals, samples.seconds - values[0]))


def _at(seconds: Array, signals: Array, wanted: Array) -> Array:
    """(M, 13) signals at other times, held beyond the ends."""
    return np.stack([np.interp(wanted, seconds, column) for column in signals.T], axis=1)


def _late_sentence(known: float) -> Says:
    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        delay, deviation = known + float(found.values[0]), float(found.value_stds[0])
        word = "late" if delay > 0 else "early"
        return (
            f"the wrench is {1e3 * abs(delay):.0f} +- {1e3 * deviation:.1g} ms {word} against the motion: stamp it when"
            " it is measured, and synchronise the clocks",
            {"delay": delay, "delay_std": deviation},
        )

    return says


def _filtered(kind: FilterKind) -> ReadingDesign:
    def design(samples: FitSamples, values: Array) -> Array:
        seconds = samples.seconds
        grid = np.arange(seconds[0], seconds[-1] + _GRID, _GRID)
        even = _at(seconds, samples.signals, grid)
        smooth = _low_pass(kind, even, float(np.exp(np.clip(values[0], *_LOG_TIMES))) / _GRID)
        return signal_columns(_at(grid, smooth, seconds))

    return design


def _low_pass(kind: FilterKind, even: Array, time: float) -> Array:
    """Signals (M, C) through a filter with a time constant in samples; before the first one they are constant."""
    count = int(8 * time) + 2
    ages = np.arange(count)
    if kind == "mean":
        kernel = np.clip(2 * time + 1 - ages, 0.0, 1.0)  # its mean age is the time constant
    elif kind == "first":
        kernel = np.exp(-ages / time)
    else:
        kernel = (ages + 0.5) * np.exp(-2 * (ages + 0.5) / time)
    kernel = kernel / kernel.sum()
    padded = np.concatenate([np.repeat(even[:1], count - 1, axis=0), even])
    size = 1 << int(np.ceil(np.log2(len(padded) + count)))
    spectrum = np.fft.rfft(padded, size, axis=0) * np.fft.rfft(kernel, size)[:, None]
    return np.asarray(np.fft.irfft(spectrum, size, axis=0)[count - 1 : len(padded)])


def _filter_sentence(kind: FilterKind) -> Says:
    words = {"first": "a low-pass of first order", "second": "a low-pass of second order", "mean": "a moving mean"}[
        kind
    ]

    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        time = float(np.exp(np.clip(found.values[0], *_LOG_TIMES)))
        deviation = time * float(found.value_stds[0])
        return (
            f"the wrench is filtered: {words} with a mean age of {1e3 * time:.0f} +- {1e3 * deviation:.1g} ms explains"
            " it: set the filter of the sensor to a higher cut-off frequency, or move slowly",
            {"filter_time": time, "filter_time_std": deviation},
        )

    return says
