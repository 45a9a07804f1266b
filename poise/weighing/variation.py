"""Readings that vary over time: a bias that drifts or steps, a payload that is grasped or released."""

from collections.abc import Callable, Mapping

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, ReadingDesign, explain, plain_design
from poise.weighing.reading import Reading, Says

_CANDIDATES = 24
"""Moments at which a step is tried, evenly over the samples."""
_MOST_STEPS, _LEAST_MASS = 3, 0.02
"""kg: a mass below it is none."""


def varied(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """Drifts of the bias, steps of it, and steps of the payload."""
    del plain
    if len(samples) < 20:
        return []
    found = [Reading(ErrorCode.SENSOR_DRIFT, _drifting(power), _drift_sentence(samples, power)) for power in (1, 2, 4)]
    bias = _steps(samples, slice(10, 16), 1)
    found.append(Reading(ErrorCode.SENSOR_DRIFT, _stepped(bias[0], slice(10, 16)), _step_sentence(bias[0]), prior=-4.0))
    found += [
        Reading(
            ErrorCode.PAYLOAD_CHANGED,
            _stepped(times, slice(0, count)),
            _change_sentence(times),
            holds=_one_or_more(len(times)),
            last=_last_payload(len(times)),
        )
        for times in _steps(samples, slice(0, 4), _MOST_STEPS)
        for count in (4, 10)
    ]
    return found


def _drifting(power: int) -> ReadingDesign:
    def design(samples: FitSamples, values: Array) -> Array:
        del values
        seconds = samples.seconds
        share = 2 * seconds / max(float(seconds[-1]), 1e-9) - 1
        course = np.polynomial.legendre.legvander(share, power)[:, 1:]
        drift = np.einsum("nk,ij->nikj", course, np.eye(6)).reshape(len(samples), 6, -1)
        return np.concatenate([plain_design(samples, share), drift], axis=2)

    return design


def _drift_sentence(samples: FitSamples, power: int) -> Says:
    duration = float(samples.seconds[-1])

    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        drift = found.unknowns[16:].reshape(power, 6)
        course = np.polynomial.legendre.legvander(np.linspace(-1, 1, 50), power)[:, 1:] @ drift
        force, torque = (float(np.linalg.norm(np.ptp(course[:, part], axis=0))) for part in (slice(0, 3), slice(3, 6)))
        return (
            f"the reading without a load drifts by {force:.2g} N and {torque:.2g} N m in {duration:.0f} s: let the"
            " sensor warm up, zero it, and record again",
            {"drift_force": force, "drift_torque": torque, "duration": duration},
        )

    return says


def _stepped(times: tuple[float, ...], columns: slice) -> ReadingDesign:
    def design(samples: FitSamples, values: Array) -> Array:
        matrix = plain_design(samples, values)
        after = [matrix[:, :, columns] * (samples.seconds >= time)[:, None, None] for time in times]
        return np.concatenate([matrix, *after], axis=2)

    return design


def _steps(samples: FitSamples, columns: slice, most: int) -> list[tuple[float, ...]]:
    """Times of one step, of two, ...; each next one is the best beside those before."""
    rows = np.unique(np.linspace(0, len(samples) - 1, _CANDIDATES + 2).astype(int))[1:-1]
    coarse = np.unique(np.linspace(0, len(samples) - 1, 300).astype(int))
    few = samples.select(coarse)
    known: tuple[float, ...] = ()
    found = []
    for _ in range(most):
        time = _best_time(few, known, samples.seconds[rows], columns)
        spacing = float(np.median(np.diff(samples.seconds[rows])))
        for part in (few, samples):
            near = np.linspace(time - spacing, time + spacing, 11)
            time = _best_time(part, known, near[(near > 0) & (near < samples.seconds[-1])], columns)
            spacing /= 5
        known = (*known, time)
        found.append(tuple(sorted(known)))
    return found


def _best_time(samples: FitSamples, known: tuple[float, ...], times: Array, columns: slice) -> float:
    levels = [
        float(np.sum(explain(samples, _stepped((*known, float(time)), columns), quick=True).levels)) for time in times
    ]
    return float(times[int(np.argmin(levels))])


def _step_sentence(times: tuple[float, ...]) -> Says:
    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        force = float(np.linalg.norm(found.unknowns[16:19]))
        return (
            f"the reading without a load steps by {force:.2g} N at {times[0]:.1f} s: the sensor was zeroed, or slipped,"
            " in the recording: zero it before the recording",
            {"time": times[0], "step_force": force},
        )

    return says


def _masses(found: Explanation, count: int) -> Array:
    """(count + 1,) kg before and after each step."""
    steps = found.unknowns[16:].reshape(count, -1)[:, 0]
    return np.cumsum(np.concatenate([found.phi[:1], steps]))


def _one_or_more(count: int) -> Callable[[Explanation], bool]:
    """All masses are possible, and one of them is that of an object."""
    return lambda found: bool(_masses(found, count).max() > _LEAST_MASS and _masses(found, count).min() > -_LEAST_MASS)


def _last_payload(count: int) -> Callable[[Explanation], Array]:
    def last(found: Explanation) -> Array:
        phi, steps = found.phi.copy(), found.unknowns[16:].reshape(count, -1)
        phi[: steps.shape[1]] += steps.sum(axis=0)
        return phi

    return last


def _change_sentence(times: tuple[float, ...]) -> Says:
    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        masses = _masses(found, len(times))
        events = ", ".join(
            f"from {before:.2f} to {after:.2f} kg at {time:.1f} s"
            for before, after, time in zip(masses[:-1], masses[1:], times, strict=True)
        )
        return (
            f"the payload changes in the recording, {events}: something was grasped, released or spilled; weigh each"
            " part separately",
            {f"time_{k}": time for k, time in enumerate(times)} | {f"mass_{k}": float(m) for k, m in enumerate(masses)},
        )

    return says
