"""Motion of a part between two stops, with dry friction: exact for stamps that need not be uniform."""

from functools import partial

import numpy as np

from poise.kernels import COMPILED
from poise.kernels import between_stops as compiled_stops
from poise.types import Array

_MOST_STEPS = 1e4
"""Steps in a time in which a part stays at a stop, at the most."""
_HALVINGS = 24
"""Of the time in which a contact ends."""
_MOST_TURNS = 1e3
"""Times that dry friction stops or releases a part in one step, at the most: rounding could do it again and again."""
_RESTS = 1e-9
"""Share of half a gap by which a part that rests at a stop may move without another contact."""
BLUR = 1e-3
"""s on either side over which the acceleration of a part is averaged."""


def between_stops(
    seconds: Array, push: Array, gap: float, settling: float, drag: Array | None = None, blur: float = BLUR
) -> tuple[Array, Array, Array]:
    """Position of a part between two stops, its velocity and acceleration, relative to its carrier.

    Between the stops x'' = push - drag sign(x') (linear between stamps, exact), and the part sticks while the drag can
    hold it. A stop pushes, and does not pull, as a critically damped spring on the part: x'' = push - drag sign(x') -
    2 x' / settling - d / settling^2 at a depth d. Without drag the part therefore rebounds with e^-2 of its speed,
    unless its push holds it. It begins at rest against the stop that it is pushed to.

    Args:
        seconds: (N,) ascending.
        push: (N,) m/s2 (or rad/s2) towards positive x.
        gap: from stop to stop, m (or rad).
        settling: s.
        drag: (N,) m/s2 (or rad/s2), the largest that dry friction takes; None for none.
        blur: s on either side over which ddx is averaged.

    Returns:
        x, dx, ddx, each (N,).
    """
    moved = compiled_stops if COMPILED else _stopped
    position, velocity, acceleration = moved(seconds, push, gap, settling, blur, drag)
    return position, velocity, acceleration


def _stopped(seconds: Array, push: Array, gap: float, settling: float, blur: float, drag: Array | None) -> Array:
    """See `poise.kernels.between_stops`. Plain floats."""
    half = gap / 2
    pairs = np.stack([push, np.zeros_like(push) if drag is None else drag], axis=1)
    x, v = (half if push[0] >= 0.0 else -half) + float(push[0]) * settling**2, 0.0
    since = before = 0.0
    out: list[tuple[float, float, float]] = []
    for begin, end, p, q in zip(seconds[:-1].tolist(), seconds[1:].tolist(), pairs[:-1], pairs[1:], strict=True):
        here, span = (x, v), end - begin
        near = span / 2 if span < 2.0 * blur else blur
        first, last = p + (q - p) / span * near, q - (q - p) / span * near
        x, v = _advanced(x, v, p, first, near, half, settling)
        out.append((*here, (v - before) / (since + near)))
        if span > 2.0 * near:
            x, v = _advanced(x, v, first, last, span - 2.0 * near, half, settling)
        before, since = v, near
        x, v = _advanced(x, v, last, q, near, half, settling)
    out.append((x, v, (v - before) / since if since else 0.0))
    return np.array(out).T


def _flown(x: float, v: float, push: float, rate: float, t: float) -> tuple[float, float]:
    """Place and speed after a free flight of t seconds under a push that grows by `rate`."""
    return x + t * (v + t * (push / 2 + rate * t / 6)), v + t * (push + rate * t / 2)


def _held(
    x: float, v: float, push: float, rate: float, t: float, side: float, half: float, settling: float
) -> tuple[float, float]:
    """Place and speed after t seconds at a stop: a critically damped spring, exact."""
    lag, fade = settling**2 * rate, np.exp(-t / settling)
    rest = side * half + settling**2 * push - 2.0 * settling * lag
    away = x - rest
    slope = v - lag + away / settling
    return rest + lag * t + (away + slope * t) * fade, lag + (v - lag - slope * t / settling) * fade


def _advanced(
    x: float, v: float, begin: Array, end: Array, span: float, half: float, settling: float
) -> tuple[float, float]:
    """Place and speed after `span` seconds, in which push and drag, (2,), change from `begin` to `end`."""
    (push, drag), (rate, growth) = begin.tolist(), ((end - begin) / span).tolist()
    rubs = drag > 0.0 or growth > 0.0
    left, step = span, max(settling / 2, span / _MOST_STEPS)
    while left > 0.0:
        side, t = 1.0 if x > 0.0 else -1.0, min(left, step)
        moves = left * (abs(v) + left * max(abs(push), abs(end[0])))
        if abs(side * x - half) + moves < _RESTS * half:
            return _flown(x, v, push, rate, left)
        sense = float(np.sign(v)) if rubs else 0.0
        if rubs and v == 0.0:
            stop = side * max(side * x - half, 0.0) / settling**2
            stuck, sense = _stuck(push - stop, rate, drag, growth)
            if stuck > 0.0:
                t = min(max(stuck, span / _MOST_TURNS), left)
                push, drag, left = push + rate * t, drag + growth * t, left - t
                continue
        force, rise = push - sense * drag, rate - sense * growth
        if side * x < half:
            turn = _turned(v, force, rise, left) if rubs else left
            there = _flown(x, v, force, rise, turn)
            if abs(there[0]) <= half:
                if turn >= left:
                    return there
                t, x, v = turn, there[0], 0.0
            else:
                stop = 1.0 if there[0] > 0.0 else -1.0
                t = _met(x, v, force, rise, turn, stop, half)
                x, v = stop * half, _flown(x, v, force, rise, t)[1]
        else:
            t, x, v = _touched(x, v, force, rise, t, side, half, settling, sense)
            t = max(t, span / _MOST_TURNS) if rubs and v == 0.0 else t
        push, drag, left = push + rate * t, drag + growth * t, left - t
    return x, v


def _touched(
    x: float, v: float, force: float, rise: float, most: float, side: float, half: float, settling: float, sense: float
) -> tuple[float, float, float]:
    """How long, up to `most`, one law holds in a stop, and place and speed then.

    Until the contact ends, or begins again, or dry friction has stopped the part (`sense` is 0 without friction).
    """
    touches, early, t = _pushed(x, v, side, half, settling), 0.0, most
    law = partial(_held, side=side, half=half, settling=settling) if touches else _flown
    for halving in range(_HALVINGS + 1):
        middle = (early + t) / 2 if halving else t
        there = law(x, v, force, rise, middle)
        turns = sense != 0.0 and sense * there[1] <= 0.0
        if turns or (side * there[0] > half and _pushed(*there, side, half, settling) != touches):
            t = middle
        elif halving:
            early = middle
        else:
            break
    x, v = law(x, v, force, rise, t)
    return t, x, 0.0 if sense != 0.0 and sense * v <= 0.0 else v


def _stuck(force: float, rate: float, drag: float, growth: float) -> tuple[float, float]:
    """How long dry friction holds a part against a force that grows by `rate`, s, and the sense in which it starts."""
    if abs(force) > drag:
        return 0.0, float(np.sign(force))
    ways = [((drag - way * force) / (way * rate - growth), way) for way in (1.0, -1.0) if way * rate > growth]
    return min(ways, default=(np.inf, 0.0))


def _turned(v: float, force: float, rise: float, span: float) -> float:
    """When the speed of a flight first vanishes after its begin; `span` where it does not before."""
    root = force**2 - 2.0 * rise * v
    if root < 0.0:
        return span
    sum_ = -(force + np.copysign(np.sqrt(root), force))
    times = [top / low for top, low in ((sum_, rise), (2.0 * v, sum_)) if low != 0.0]
    return float(min((t for t in times if 0.0 < t < span), default=span))


def _pushed(x: float, v: float, side: float, half: float, settling: float) -> bool:
    """Whether a stop pushes: it cannot pull."""
    return (side * x - half) / settling + 2.0 * side * v > 0.0


def _met(x: float, v: float, push: float, rate: float, span: float, side: float, half: float) -> float:
    """When a flight that ends beyond a stop meets it: by bisection, then Newton's method."""
    early, late = 0.0, span
    for _ in range(6):
        middle = (early + late) / 2
        early, late = (early, middle) if side * _flown(x, v, push, rate, middle)[0] > half else (middle, late)
    for _ in range(3):
        place, speed = _flown(x, v, push, rate, late)
        if side * speed <= 0.0:
            break
        late = min(max(late - (side * place - half) / (side * speed), 0.0), span)
    return late


def travelled(seconds: Array, push: Array, arrivals: Array, sides: Array) -> tuple[Array, Array]:
    """Travel and speed of a free part when it knocks, (2, K) each and signed: two hypotheses.

    Either it was at rest until the push last changed sign; or at the stop of the knock before, until the push pointed
    away from there. The second holds when all knocks are known, the first when the knock before was not detected.

    Args:
        seconds, push: (N,) as in `between_stops`.
        arrivals: (K,) moments of the knocks.
        sides: (K,) -1 or 1, the stop of each.
    """
    flight = _Flight(seconds, push)
    out = np.empty((2, 2, len(arrivals)))
    for k, arrival in enumerate(arrivals.tolist()):
        turned = flight.last_turn(arrival)
        away = flight.departure(float(sides[k - 1]), float(arrivals[k - 1])) if k else turned
        for reading, left in enumerate((turned, away if away < arrival else turned)):
            (v0, x0), (v1, x1) = flight.integrals(left), flight.integrals(arrival)
            out[:, reading, k] = x1 - x0 - v0 * (arrival - left), v1 - v0
    return out[0], out[1]


def knock_acceleration(t: Array, settling: float) -> Array:
    """1/s, acceleration over speed before the knock, at times after it (negative: before).

    It jumps to -2 / settling: a sensor measures its mean over a short time.
    """
    late, early = (np.maximum(t + shift, 0.0) / settling for shift in (BLUR, -BLUR))
    return np.asarray(((1.0 - late) * np.exp(-late) - (1.0 - early) * np.exp(-early)) / (2.0 * BLUR))


class _Flight:
    """Integrals of a push that is linear between stamps, and the times at which it changes sign."""

    def __init__(self, seconds: Array, push: Array) -> None:
        self._seconds, self._push = seconds, push
        h = np.diff(seconds)
        self._speed = np.concatenate([[0.0], np.cumsum(h * (push[1:] + push[:-1]) / 2)])
        steps = h * self._speed[:-1] + h**2 * (2 * push[:-1] + push[1:]) / 6
        self._travel = np.concatenate([[0.0], np.cumsum(steps)])
        self._turns = np.flatnonzero(np.diff(np.signbit(push)))

    def integrals(self, time: float) -> tuple[float, float]:
        """Speed and travel at a time, of a part that is free throughout."""
        i = min(max(int(self._seconds.searchsorted(time)) - 1, 0), len(self._seconds) - 2)
        begin, p = float(self._seconds[i]), float(self._push[i])
        rate = (float(self._push[i + 1]) - p) / (float(self._seconds[i + 1]) - begin)
        travel, speed = _flown(float(self._travel[i]), float(self._speed[i]), p, rate, time - begin)
        return speed, travel

    def departure(self, side: float, since: float) -> float:
        """When the push first points away from the stop at `side`; infinity for never."""
        if side * np.interp(since, self._seconds, self._push) < 0.0:
            return since
        for i in self._turns[np.searchsorted(self._turns, np.searchsorted(self._seconds, since) - 1) :].tolist():
            at = self._crossing(i)
            if at > since and side * self._push[i + 1] < 0.0:
                return at
        return np.inf

    def last_turn(self, before: float) -> float:
        """When the push last changed sign before a time; the first stamp when it did not."""
        place = int(np.searchsorted(self._seconds[self._turns], before)) - 1
        if place >= 0 and self._crossing(int(self._turns[place])) >= before:
            place -= 1
        return self._crossing(int(self._turns[place])) if place >= 0 else float(self._seconds[0])

    def _crossing(self, i: int) -> float:
        a, b = self._push[i], self._push[i + 1]
        return float(self._seconds[i] + (self._seconds[i + 1] - self._seconds[i]) * a / (a - b))
