"""Vibration measured by an accelerometer on the sensor: only its clock offset and its gain are unknown."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from poise.mismatch.effects.base import EffectParameter, Values
from poise.mismatch.effects.part_wrench import shaking, shaking_columns
from poise.mismatch.effects.starts import smoothed, spectrum
from poise.mismatch.recorded import RecordedMotion, at_times
from poise.types import Array

SLOWEST_VIBRATION = 2.0
"""Hz; slower accelerations belong to the commanded motion."""
_LATEST = 0.06
"""s, the largest offset of its clock."""
_STEP = 0.001
_STRETCH = 0.1
"""s over which the vibration amplitude is averaged."""
_CALM, _BLOW = 3.0, 2.2
"""Vibration: this many times the amplitude of the calmest tenth. Blow: this many times the median vibration."""
_APART = 0.5
"""s between blows."""
_RINGS = (0.05, 0.35)
"""s before and after a blow in which the bandwidth of the accelerometer is too low."""


def slow_part(seconds: Array, values: Array) -> Array:
    """(N, ...) low-passed by a Gaussian filter without delay: half the power is left at `SLOWEST_VIBRATION`."""
    period = float(np.median(np.diff(seconds)))
    width = np.sqrt(np.log(2.0)) / (2.0 * np.pi * SLOWEST_VIBRATION) / period
    return np.asarray(gaussian_filter1d(values, width, axis=0, mode="nearest"))


def parameters(recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
    """Start, length and frequency are found; clock offset, gain and smoothing are fitted.

    `smoothing` is the width of a Gaussian filter: accelerometer and wrench agree little at the highest frequencies.
    """
    first, last = float(recorded.seconds[0]), float(recorded.seconds[-1])
    return (
        EffectParameter("start", "s", low=first - 1.0, high=last, linear=False, resolution=_STRETCH),
        EffectParameter("length", "s", low=0.1, high=recorded.duration + 2.0, linear=False, resolution=_STRETCH),
        EffectParameter(
            "frequency",
            "Hz",
            low=0.0,
            high=0.5 / recorded.period,
            linear=False,
            resolution=1.0 / max(recorded.duration, 1.0),
        ),
        EffectParameter("accelerometer_late", "s", low=-_LATEST, high=_LATEST, linear=False),
        EffectParameter("smoothing", "s", low=2e-4, high=0.02, linear=False, log=True),
        EffectParameter("gain", "", 1.0),
    )


def starts(recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
    """The lag of best correlation between residual force and acceleration; start, length and frequency."""
    felt = _felt(recorded)
    wanted = recorded.to_sensor(shaking(recorded, residual))
    wanted = wanted - slow_part(recorded.seconds, wanted)
    lags = np.arange(-_LATEST + _STEP, _LATEST, _STEP)
    likeness = [float(np.sum(at_times(recorded.seconds, felt, recorded.seconds + lag) * wanted)) for lag in lags]
    begin, end = _span(recorded, felt)
    inside = (recorded.seconds >= begin) & (recorded.seconds <= end)
    frequency, power = spectrum(recorded, felt * inside[:, None])
    yield {
        "start": begin,
        "length": max(end - begin, _STRETCH),
        "frequency": float(frequency[int(np.argmax(power * (frequency > SLOWEST_VIBRATION)))]),
        "accelerometer_late": float(lags[int(np.argmax(likeness))]),
        "smoothing": 0.002,
    }


def columns(recorded: RecordedMotion, nonlinear: Values) -> Array:
    """(N, 6, 1) the payload's wrench under the measured acceleration."""
    felt = gaussian_filter1d(_felt(recorded), nonlinear["smoothing"] / recorded.period, axis=0, mode="nearest")
    late = at_times(recorded.seconds, felt, recorded.seconds + nonlinear["accelerometer_late"])
    answer = shaking_columns(recorded, recorded.rotation_world_sensor)
    return np.asarray(np.einsum("nci,ni->nc", answer, late)[:, :, None])


def windows(recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
    """The window of the vibration, and the blows in it."""
    blows = ((moment - _RINGS[0], moment + _RINGS[1]) for moment in blows_in(recorded))
    return ((values["start"], values["start"] + values["length"]), *blows)


def derived(recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
    """Root mean square and peak of the acceleration within the window."""
    size = np.linalg.norm(_felt(recorded), axis=1)
    start, end = values["start"], values["start"] + values["length"]
    inside = size[(recorded.seconds >= start) & (recorded.seconds <= end)]
    root = float(np.sqrt(np.mean(inside**2))) if len(inside) else 0.0
    return {"amplitude": (root * np.sqrt(2.0), "m/s2"), "peak": (float(inside.max(initial=0.0)), "m/s2")}


def sentence(recorded: RecordedMotion, values: Values) -> str:
    """Window, amplitude, frequency, single blows, and the offset of the accelerometer's clock."""
    sizes = derived(recorded, values)
    blows = blows_in(recorded)
    struck = f", with blows at {_listed(blows)} of up to {sizes['peak'][0]:.1f} m/s2" if blows else ""
    late = 1e3 * values["accelerometer_late"]
    when = f"{abs(late):.1f} ms {'late' if late > 0 else 'early'}"
    return (
        f"From {values['start']:.1f} s to {values['start'] + values['length']:.1f} s the robot vibrated, as the "
        f"accelerometer measured too: {sizes['amplitude'][0]:.1f} m/s2, most at {values['frequency']:.1f} Hz{struck}; "
        f"the nominal robot does not vibrate. The accelerometer's clock is {when}."
    )


def blows_in(recorded: RecordedMotion) -> list[float]:
    """Moments, s, at which the vibration is far above its median, in the order of time."""
    felt = _felt(recorded)
    begin, end = _span(recorded, felt)
    size = np.sqrt(smoothed(recorded, np.sum(felt**2, axis=1), _STRETCH))
    inside = (recorded.seconds >= begin) & (recorded.seconds <= end)
    usual = float(np.median(size[inside])) if inside.any() else np.inf
    raw = np.linalg.norm(felt, axis=1)
    found: list[float] = []
    for index in np.argsort(-size):
        if size[index] < _BLOW * usual or len(found) == 8:
            break
        near = np.abs(recorded.seconds - recorded.seconds[index]) <= _STRETCH
        moment = float(recorded.seconds[near][int(np.argmax(raw[near]))])
        if all(abs(moment - other) > _APART for other in found):
            found.append(moment)
    return sorted(found)


def _felt(recorded: RecordedMotion) -> Array:
    """(N, 3) m/s2 beyond the nominal motion, sensor axes."""
    if recorded.accelerometer is None:
        return np.zeros((len(recorded), 3))
    beyond = recorded.accelerometer - recorded.linear_acceleration
    return np.asarray(beyond - slow_part(recorded.seconds, beyond))


def _span(recorded: RecordedMotion, felt: Array) -> tuple[float, float]:
    """First and last moment of the vibration."""
    size = np.sqrt(smoothed(recorded, np.sum(felt**2, axis=1), _STRETCH))
    loud: NDArray[np.intp] = np.flatnonzero(size > _CALM * np.quantile(size, 0.1))
    first, last = (int(loud[0]), int(loud[-1])) if len(loud) else (0, len(size) - 1)
    return float(recorded.seconds[first]), float(recorded.seconds[last])


def _listed(moments: list[float]) -> str:
    named = [f"{moment:.1f} s" for moment in moments]
    return named[0] if len(named) == 1 else f"{', '.join(named[:-1])} and {named[-1]}"
