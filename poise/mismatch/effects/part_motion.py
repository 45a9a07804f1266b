"""Motion of a part on springs or between stops: exact for stamps that need not be uniform."""

from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dtbtrs

from poise.geometry import cross
from poise.kernels import COMPILED, pendulum
from poise.kernels import between_stops as compiled_stops
from poise.mismatch.recorded import hermite, linear_at
from poise.types import Array

_MOST_STEPS = 1e4
"""Steps in a time in which a part stays at a stop, at the most."""
_HALVINGS = 24
"""Of the time in which a contact ends."""
_RESTS = 1e-9
"""Share of half a gap by which a part that rests at a stop may move without another contact."""
_SWING_STEP, _LONGEST_STEP = 0.24, 0.03
"""rad of phase, and s: largest steps of a pendulum."""
_BLUR = 1e-3
"""s on either side over which the acceleration of a part is averaged."""


def crept(seconds: Array, values: Array, time_constant: float) -> Array:
    """(N, K) s with T ds/dt = w - s, w linear between stamps (exact); s = w at the first.

    Args:
        seconds: (N,) ascending.
        values: (N, K) w.
        time_constant: T, s.
    """
    step = np.diff(seconds)
    decay = np.exp(-step / time_constant)
    # 1 - (1 - e^-x) / x, the share of the newer value (Franklin, Powell, Workman 1998, section 6.3).
    newer = 1.0 - (1.0 - decay) * time_constant / step
    right = np.array(values, dtype=np.float64, order="F")
    right[1:] = newer[:, None] * values[1:] + (1.0 - decay - newer)[:, None] * values[:-1]
    return accumulated(decay, right)


def accumulated(kept: Array, added: Array) -> Array:
    """(N, K) s[k + 1] = kept[k] s[k] + added[k + 1], s = added at the first; `added` is overwritten.

    Args:
        kept: (N - 1,). added: (N, K), in Fortran's order.
    """
    band = np.ones((2, len(added)), order="F")
    band[1, :-1] = -kept
    return np.asarray(dtbtrs(band, added, uplo="L", overwrite_b=1)[0])


class Oscillator:
    """x'' + c x' + k x = f with f linear and k, c constant between stamps: exact.

    Args:
        seconds: (N,) ascending.
        stiffness: k > 0, 1/s2: a number, or (N - 1,) of each interval.
        damping: c, 1/s: a number, or (N - 1,).
    """

    def __init__(self, seconds: Array, stiffness: ArrayLike, damping: ArrayLike) -> None:
        self._step, self._k, self._c = np.broadcast_arrays(np.diff(seconds), stiffness, damping)
        self._matrix = transition(self._step, self._k, self._c)
        # s+ = M s + g for all stamps at once: a lower triangular system with three bands.
        self._band = np.zeros((4, 2 * len(seconds)), order="F")
        self._band[0] = 1.0
        self._band[2, :-2:2], self._band[3, :-2:2] = -self._matrix[0, 0], -self._matrix[1, 0]
        self._band[1, 1:-2:2], self._band[2, 1:-2:2] = -self._matrix[0, 1], -self._matrix[1, 1]

    def __call__(self, forcing: Array) -> tuple[Array, Array]:
        """Displacement x and velocity dx, (N, K), under forces f (N, K); at the first stamp at rest, x = f / k."""
        k, c = self._k[:, None], self._c[:, None]
        # Of a force that grows linearly, a motion that does too: x = (f - c f'/k) / k, dx = f'/k.
        slope = np.diff(forcing, axis=0) / (self._step[:, None] * k)
        lag = c * slope
        begin, end = (forcing[:-1] - lag) / k, (forcing[1:] - lag) / k
        (m00, m01), (m10, m11) = self._matrix[..., None]
        state = np.empty((len(forcing), 2, forcing.shape[1]))
        state[0, 0], state[0, 1] = forcing[0] / k[0], 0.0
        state[1:, 0] = end - m00 * begin - m01 * slope
        state[1:, 1] = slope - m10 * begin - m11 * slope
        right = np.asfortranarray(state.reshape(2 * len(forcing), -1))
        solved = dtbtrs(self._band, right, uplo="L", overwrite_b=1)[0]
        return np.asarray(solved[::2]), np.asarray(solved[1::2])


def transition(h: Array, k: Array, c: Array) -> Array:
    """(2, 2, n) what x and dx of an `Oscillator` become after h seconds without force, for h, k and c (n,)."""
    rate = k - c**2 / 4.0
    root = np.sqrt(np.abs(rate)) + 1e-12
    # A damping beyond the critical one turns cosine and sine into the hyperbolic ones.
    fade = np.exp(-c * h / 2.0)
    cosine = fade * np.where(rate >= 0.0, np.cos(root * h), np.cosh(np.minimum(root * h, 300.0)))
    sine = fade * np.where(rate >= 0.0, np.sin(root * h), np.sinh(np.minimum(root * h, 300.0))) / root
    return np.array([[cosine + c / 2.0 * sine, sine], [-k * sine, cosine - c / 2.0 * sine]])


def hanging(seconds: Array, pull: Array, rate: Array, frequency: float, damping: float) -> tuple[Array, Array, Array]:
    """Direction of a spherical pendulum in the world, and its first and second derivative, (N, 3) each.

    u'' = b - (u.b + |u'|^2) u, b = pull - c (u' - omega x u), |u| = 1; it begins in steady state along the pull.
    Integrated by the SHAKE method (Hairer, Lubich, Wanner 2006, section VII.1.4), the step's square scaled so that a
    small swing has exactly the natural frequency.

    Args:
        seconds: (N,) ascending.
        pull: (N, 3) 1/s2, (gravity minus acceleration of the pivot) over the length, world axes.
        rate: (N, 3) rad/s of the vessel, world axes.
        frequency: rad/s, natural, of small swings.
        damping: c, 1/s, against the vessel.
    """
    # Step sizes from a geometric ladder: they do not change with every frequency that is tried.
    finer = max(np.ceil(2.0 * np.log2(frequency * _LONGEST_STEP / _SWING_STEP)), 0.0)
    count = int(np.ceil((seconds[-1] - seconds[0]) / _LONGEST_STEP * 2.0 ** (finer / 2.0))) + 1
    even = np.linspace(seconds[0], seconds[-1], count)
    step = float(even[1] - even[0])
    square = 2.0 * (1.0 - np.cos(frequency * step)) / frequency**2
    half = damping * square / (2.0 * step)
    drive = linear_at(seconds, pull * (square / (1.0 + half)), even)
    turn = linear_at(seconds, rate * (damping * square / (1.0 + half)), even)
    steady = drive[:3] / np.linalg.norm(drive[:3], axis=1, keepdims=True)
    before = 3.0 * steady[0] - 3.0 * steady[1] + steady[2]
    places = (pendulum if COMPILED else _shaken)(np.stack([steady[0], before]), drive, turn, half)
    # The same correction for the speed: of a sine, a central difference says sin(w h) / (w h) of it.
    speeds = np.gradient(places, axis=0, edge_order=2) * (frequency / np.sin(frequency * step))
    u, du = (hermite(even, places.T, speeds.T, seconds, derivative).T for derivative in (0, 1))
    return _with_second(pull, rate, damping, u, du)


def _with_second(pull: Array, rate: Array, damping: float, u: Array, du: Array) -> tuple[Array, Array, Array]:
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    force = pull - damping * (du - cross(rate, u))
    inward = np.einsum("ni,ni->n", u, force) + np.einsum("ni,ni->n", du, du)
    return u, du, force - inward[:, None] * u


def _shaken(start: Array, drive: Array, turn: Array, half: float) -> Array:
    """See `poise.kernels.pendulum`. Plain floats: arrays of three numbers would be slower."""
    (x, y, z), (x0, y0, z0) = start.tolist()
    a, b = 2.0 / (1.0 + half), (1.0 - half) / (1.0 + half)
    out: list[float] = []
    for px, py, pz, wx, wy, wz in zip(*drive.T.tolist(), *turn.T.tolist(), strict=True):
        out += (x, y, z)
        fx = a * x - b * x0 + px + wy * z - wz * y
        fy = a * y - b * y0 + py + wz * x - wx * z
        fz = a * z - b * z0 + pz + wx * y - wy * x
        # Back to the sphere along the rod.
        along = fx * x + fy * y + fz * z
        beyond = along * along - (fx * fx + fy * fy + fz * fz - 1.0)
        held = along - (beyond**0.5 if beyond > 0.0 else 0.0)
        x0, y0, z0 = x, y, z
        x, y, z = fx - held * x, fy - held * y, fz - held * z
    return np.array(out).reshape(-1, 3)


def between_stops(seconds: Array, push: Array, gap: float, settling: float) -> tuple[Array, Array, Array]:
    """Position of a free part between two stops, its velocity and acceleration, relative to its carrier.

    Between the stops it flies freely, x'' = push (linear between stamps, exact). A stop pushes, and does not pull, as a
    critically damped spring on the part: x'' = push - 2 x' / settling - d / settling^2 at a depth d. The part therefore
    rebounds with e^-2 of its speed, unless its push holds it. It begins at rest against the stop that it is pushed to.

    Args:
        seconds: (N,) ascending.
        push: (N,) m/s2 (or rad/s2) towards positive x.
        gap: from stop to stop, m (or rad).
        settling: s.

    Returns:
        x, dx, ddx, each (N,); ddx is averaged over 1 ms on either side.
    """
    moved = compiled_stops if COMPILED else _stopped
    position, velocity, acceleration = moved(seconds, push, gap, settling, _BLUR)
    return position, velocity, acceleration


def _stopped(seconds: Array, push: Array, gap: float, settling: float, blur: float) -> Array:
    """See `poise.kernels.between_stops`. Plain floats."""
    half = gap / 2
    times, pushes = seconds.tolist(), push.tolist()
    x, v = (half if pushes[0] >= 0.0 else -half) + pushes[0] * settling**2, 0.0
    since = before = 0.0
    out: list[tuple[float, float, float]] = []
    for begin, end, p, q in zip(times[:-1], times[1:], pushes[:-1], pushes[1:], strict=True):
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
    x: float, v: float, push: float, end: float, span: float, half: float, settling: float
) -> tuple[float, float]:
    """Place and speed after `span` seconds, in which the push grows to `end`."""
    rate, left, step = (end - push) / span, span, max(settling / 2, span / _MOST_STEPS)
    while left > 0.0:
        side, t = 1.0 if x > 0.0 else -1.0, min(left, step)
        moves = left * (abs(v) + left * max(abs(push), abs(end)))
        if abs(side * x - half) + moves < _RESTS * half:
            return _flown(x, v, push, rate, left)
        if side * x < half:
            there = _flown(x, v, push, rate, left)
            if abs(there[0]) <= half:
                return there
            stop = 1.0 if there[0] > 0.0 else -1.0
            t = _met(x, v, push, rate, left, stop, half)
            x, v = stop * half, _flown(x, v, push, rate, t)[1]
        else:
            touches, early = _pushed(x, v, side, half, settling), 0.0
            law = partial(_held, side=side, half=half, settling=settling) if touches else _flown
            for halving in range(_HALVINGS + 1):  # until the contact ends, or begins again
                middle = (early + t) / 2 if halving else t
                there = law(x, v, push, rate, middle)
                if side * there[0] > half and _pushed(*there, side, half, settling) != touches:
                    t = middle
                elif halving:
                    early = middle
                else:
                    break
            x, v = law(x, v, push, rate, t)
        push += rate * t
        left -= t
    return x, v


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
    late, early = (np.maximum(t + shift, 0.0) / settling for shift in (_BLUR, -_BLUR))
    return np.asarray(((1.0 - late) * np.exp(-late) - (1.0 - early) * np.exp(-early)) / (2.0 * _BLUR))


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
