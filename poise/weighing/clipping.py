"""Readings that reached the range of the sensor: one value is repeated at an end of a channel's range."""

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.verdict import FitSamples
from poise.types import Array, Mask
from poise.weighing.fitting import Explanation, plain_design
from poise.weighing.reading import Reading, Repair

_NEAR, _SAME = 1e-3, 1e-6
"""Of the range of a channel: readings this close to its end are at it; readings this close to each other are equal."""
_LEAST_SHARE, _LEAST_SAMPLES = 0.01, 5
_LEAST_STUCK = 0.05


def clipped(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """The channels that repeat their largest or smallest reading."""
    del plain
    limits = limits_of(samples.wrench)
    if not np.isfinite(limits).any():
        return []
    usable = within(samples.wrench, limits)
    if not usable.any(axis=1).sum() > len(samples) / 4:
        return []
    places = [(side, axis) for axis in range(6) for side in (0, 1) if np.isfinite(limits[side, axis])]
    names = [f"{'force' if axis < 3 else 'torque'} {'xyz'[axis % 3]}" for _, axis in places]
    ends = [float(limits[place]) for place in places]
    units = ["N" if axis < 3 else "N m" for _, axis in places]
    share = float(1 - usable.all(axis=1).mean())
    option = "--max-force" if places[0][1] < 3 else "--max-torque"
    what = ", ".join(f"{name} at {end:.4g} {unit}" for name, end, unit in zip(names, ends, units, strict=True))
    sentence = (
        f"the sensor is at the end of its range in {100 * share:.0f} % of the samples ({what}):"
        f" give {option} {abs(ends[0]):.4g}, and use a sensor with a larger range"
    )
    evidence = {"share": share, **{f"{name} limit": end for name, end in zip(names, ends, strict=True)}}
    return [
        Reading(
            ErrorCode.CLIPPED,
            plain_design,
            lambda found: (sentence, evidence),
            usable=usable,
            censored=limits,
            repair=lambda found: Repair(limits=limits),
        )
    ]


def stuck(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """Channels that repeat one value for a while, while the other channels change."""
    del plain
    same = np.abs(np.diff(samples.wrench, axis=0)) <= _SAME * np.ptp(samples.wrench, axis=0)
    alone = same & (same.sum(axis=1) <= 2)[:, None]
    held = np.zeros(samples.wrench.shape, dtype=bool)
    held[1:] |= alone
    held[:-1] |= alone
    share = held.mean(axis=0)
    worst = int(np.argmax(share))
    if not _LEAST_STUCK < share[worst] < 1 - _LEAST_STUCK:
        return []
    name = f"{'force' if worst < 3 else 'torque'} {'xyz'[worst % 3]}"
    sentence = (
        f"{name} repeats one value in {100 * share[worst]:.0f} % of the samples while the other channels change: its"
        " gauge or cable is broken: have the sensor repaired"
    )
    evidence = {"share": float(share[worst])}
    return [
        Reading(ErrorCode.SENSOR_FAULT, plain_design, lambda found: (sentence, evidence), usable=~held, ignores=True)
    ]


def limits_of(wrench: Array) -> Array:
    """(2, 6) the least and the largest reading of channels that repeat it; infinite where they do not."""
    limits = np.array([[-np.inf] * 6, [np.inf] * 6])
    least = max(_LEAST_SAMPLES, _LEAST_SHARE * len(wrench))
    for axis in range(6):
        if np.ptp(wrench[:, axis]) <= _SAME * np.abs(wrench[:, axis]).max():
            continue  # a dead channel
        for side, end in ((0, float(wrench[:, axis].min())), (1, float(wrench[:, axis].max()))):
            equal = np.abs(wrench[:, axis] - end) <= _SAME * np.ptp(wrench[:, axis])
            if least <= equal.sum() < len(wrench):
                limits[side, axis] = end
    return limits


def within(wrench: Array, limits: Array) -> Mask:
    """(N, 6) the readings that are inside their limits by more than rounding."""
    near = _NEAR * np.ptp(wrench, axis=0)
    return np.asarray((wrench > limits[0] + near) & (wrench < limits[1] - near))
