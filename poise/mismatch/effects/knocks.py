"""Knocks in a force: time, axis, impulse and decay of each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.effects.starts import spans
from poise.mismatch.effects.stops import knock_acceleration
from poise.types import Array

_LOUD = 8.0
"""Jumps of the force, in units of its noise, that count as knocks."""
_ALONG = 0.8
"""Least cosine between the jump of a knock and the common axis."""
_APART = 0.06
"""s, the least time between two knocks."""
_MOST = 60
_SETTLINGS = tuple(0.002 * 2.0 ** (k / 4) for k in range(17))
"""s: 2 to 32 ms."""
_PLACES = 21
"""Moments between two samples that are tried as the start of a knock."""
_GIVES, _BESIDE = 0.01, 3.0
"""Share of the gap by which a stop gives way while it settles; samples beside it whose prediction it upsets."""


@dataclass(frozen=True, eq=False)
class Knocks:
    """K knocks of one part.

    Args:
        axis: (3,) unit vector.
        moments: (K,) s.
        impulses: (K,) N s along the axis.
        settling: s, of a critically damped stop.
        rows: (R,) between which samples the force jumps, for all jumps.
    """

    axis: Array
    moments: Array
    impulses: Array
    settling: float
    rows: NDArray[np.intp]


def find_knocks(seconds: Array, force: Array, sigma: Array) -> list[Knocks]:
    """The knocks in a force (N, 3) with white noise of sigma (3,); none when it does not jump.

    Few samples show the decay, and a later knock with slow decay resembles an earlier one with fast decay: each
    settling time that fits better than its neighbours is a candidate, the best first.
    """
    jumps = np.diff(force, axis=0)
    size = np.linalg.norm(jumps / sigma, axis=1)
    rows = np.flatnonzero(size > _LOUD)
    if len(rows) < 2:
        return []
    axis = np.linalg.eigh(jumps[rows].T @ jumps[rows])[1][:, 2]
    # Outliers of heavy-tailed noise jump in other directions.
    rows = rows[np.abs(jumps[rows] @ axis) > _ALONG * np.linalg.norm(jumps[rows], axis=1)]
    if len(rows) < 2:
        return []
    onsets = rows[np.concatenate([[True], np.diff(seconds[rows]) > _APART])]
    onsets = np.sort(onsets[np.argsort(-size[onsets])[:_MOST]])
    along = force @ axis
    tried = [[_knock(seconds, along, int(onset), settling) for onset in onsets] for settling in _SETTLINGS]
    misfit = np.array([sum(float(np.log(one[0] + 1e-12)) for one in found) for found in tried])
    walled = np.concatenate([[np.inf], misfit, [np.inf]])
    valleys = np.flatnonzero((misfit <= walled[:-2]) & (misfit <= walled[2:]))
    readings = []
    for i in sorted(valleys.tolist(), key=lambda i: float(misfit[i])):
        moments, impulses = np.array([one[1:] for one in tried[i]]).T
        readings.append(Knocks(axis, moments, impulses, _SETTLINGS[i], rows))
    return readings


def knocks_at(
    seconds: Array, place: Array, speed: Array, push: Array, gap: float, settling: float
) -> tuple[tuple[float, float], ...]:
    """Windows (start, end), s, in which a part between two stops knocks: while a stop gives way.

    Args:
        seconds, place, speed, push: (N,) of the part. gap, settling: see `between_stops`.
    """
    beyond = np.abs(place) - 0.5 * gap
    moves = np.abs(beyond - np.abs(push) * settling**2) + np.abs(speed) * settling
    gives = (beyond > 0.0) & (moves > _GIVES * gap)
    return tuple(spans(seconds, gives, _BESIDE * float(np.median(np.diff(seconds)))))


def _knock(seconds: Array, along: Array, onset: int, settling: float) -> tuple[float, float, float]:
    """(square left, moment, impulse) of the knock between two samples that fits the eight after them best.

    The force of a critically damped stop, beside a constant.
    """
    rows = slice(onset + 1, min(onset + 9, len(seconds)))
    starts = np.linspace(seconds[onset], seconds[onset + 1], _PLACES)
    shape = -knock_acceleration(seconds[rows] - starts[:, None], settling)
    shape -= shape.mean(axis=1, keepdims=True)
    wanted = along[rows] - along[rows].mean()
    power = np.maximum((shape**2).sum(axis=1), 1e-12)
    impulse = shape @ wanted / power
    left = float(wanted @ wanted) - impulse**2 * power
    best = int(np.argmin(left))
    return float(left[best]), float(starts[best]), float(impulse[best])
