"""When a motion on a base began: the motions that its acceleration can cause, fitted to the poses seen."""

import numpy as np
from scipy.special import softmax

from poise.types import Array

_BACK, _AFTER = 0.45, 0.1
"""s before and after the detection that are fitted."""
_RESTING = 0.6
"""s before those that show where the object stood."""
_STEP = 0.01
"""s between the moments that are tried."""
_AMPLITUDES = np.geomspace(0.5, 2.0, 9)
"""Of the motion against that of a body with the declared sizes, whose friction stays as it was at its release."""
_TAILS = 20.0
"""Degrees of freedom of the noise."""
_FREE = 1.5
"""What an amplitude that nothing predicts costs, in logarithms of a probability."""


def onset(
    seconds: Array,
    signal: Array,
    noise: float,
    seen: int,
    pulled: tuple[Array, Array],
    stiffness: float,
    gain: float,
    visible: float,
    waited: float,
) -> tuple[float, float, float, float]:
    """When an object was released, when it had moved by `visible`, one sigma of these, s, and how sudden that was.

    A released object is accelerated by what exceeds the acceleration at its release: by all of it if it slips, by a
    part of it, and by its own weight, if it tips, each within a factor of two. A third way is a steady acceleration, as
    after a push.

    Args:
        seconds, signal: (N,) s, (N,) m along the way it moves.
        noise: m, one sigma.
        seen: the sample where it is known to have moved.
        pulled: (T,) s, (T,) m/s2 against the acceleration of the base, the same way.
        stiffness: 1/s2, by which a deflection accelerates itself; 0 for slipping.
        gain: of the excess; 1 for slipping.
        visible: m.
        waited: s between the motion and its detection that the detection itself needs.
    """
    begin, end = seconds[seen] - _BACK - waited, seconds[seen] + _AFTER
    near = (seconds > begin) & (seconds < end)
    resting = (seconds > begin - _RESTING) & (seconds < begin)
    times, values = seconds[near], signal[near] - (signal[resting].mean() if resting.sum() > 3 else 0.0)
    clock = np.arange(begin, end + _STEP, _STEP)
    pull = np.interp(clock, *pulled)
    begins = clock[(clock < seconds[seen]) & (clock > begin + 2 * _STEP)]
    log, crossed = [], []
    for at in begins:
        excess = np.where(clock >= at, pull - max(float(np.interp(at, clock, pull)), 0.0), 0.0)
        for path in _paths(gain * excess, stiffness):
            log.append(_likelihood(np.interp(times, clock, path), values, noise))
            crossed.append((at, _crossing(clock, path, visible, at)))
        steady = np.maximum(clock - at, 0) ** 2
        shape = np.interp(times, clock, steady)
        size = max(float(shape @ values) / max(float(shape @ shape), 1e-12), 0.0)
        log.append(_likelihood(size * shape, values, noise) - _FREE)
        crossed.append((at, _crossing(clock, size * steady, visible, at)))
    weights = softmax(log)
    released, moved = weights @ np.array(crossed)
    spread = float(np.sqrt(weights @ (np.array(crossed)[:, 1] - moved) ** 2))
    least = float(np.median(np.diff(seconds))) / 2
    return float(released), float(moved), max(spread, least), _sudden(weights.reshape(len(begins), -1))


def _sudden(weights: Array) -> float:
    """Log likelihood of a steady acceleration, the last column, over that of what the base's acceleration can cause."""
    steady, caused = weights[:, -1].mean(), weights[:, :-1].mean()
    return float(np.log(max(steady, 1e-300)) - np.log(max(caused, 1e-300)))


def _paths(excess: Array, stiffness: float) -> list[Array]:
    """(C,) m for each amplitude; without stiffness they are in proportion."""
    if stiffness:
        return [_released(scale * excess, stiffness) for scale in _AMPLITUDES]
    return list(_AMPLITUDES[:, None] * _released(excess, 0.0))


def _released(excess: Array, stiffness: float) -> Array:
    """(C,) m: a motion from rest that does not turn back."""
    place = speed = 0.0
    found = np.empty_like(excess)
    for row, pull in enumerate(excess.tolist()):
        speed = max(speed + _STEP * (pull + stiffness * place), 0.0)
        place += _STEP * speed
        found[row] = place
    return found


def _likelihood(path: Array, values: Array, noise: float) -> float:
    """Logarithm, with 10 % of the path as its own error, and the tails of Student's t."""
    spread = np.sqrt(noise**2 + (0.1 * path) ** 2)
    square = ((values - path) / spread) ** 2
    return float(-0.5 * (_TAILS + 1) * np.sum(np.log1p(square / _TAILS)) - np.sum(np.log(spread)))


def _crossing(clock: Array, path: Array, visible: float, begin: float) -> float:
    over = path > visible
    return float(clock[np.argmax(over)]) if over.any() else float(max(begin, clock[-1] - _AFTER))
