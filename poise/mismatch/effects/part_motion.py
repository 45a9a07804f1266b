"""Motion of a part on springs or between stops: exact for stamps that need not be uniform."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dtbtrs

from poise.geometry import cross
from poise.kernels import COMPILED, pendulum
from poise.mismatch.recorded import hermite
from poise.types import Array

_MOST_KNOCKS = 2000
_SWING_STEP, _LONGEST_STEP = 0.24, 0.03
"""rad of phase, and s: largest steps of a pendulum."""
_BLUR = 1e-3
"""s on either side over which the acceleration of a knock is averaged."""
_SEARCHED = 64
"""Samples that are searched at once for the end of a flight."""


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
    band = np.ones((2, len(seconds)), order="F")
    band[1, :-1] = -decay
    right = np.array(values, dtype=np.float64, order="F")
    right[1:] = newer[:, None] * values[1:] + (1.0 - decay - newer)[:, None] * values[:-1]
    return np.asarray(dtbtrs(band, right, uplo="L", overwrite_b=1)[0])


class Oscillator:
    """x'' + c x' + k x = f with f linear and k, c constant between stamps: exact.

    Args:
        seconds: (N,) ascending.
        stiffness: k > 0, 1/s2: a number, or (N - 1,) of each interval.
        damping: c, 1/s: a number, or (N - 1,).
    """

    def __init__(self, seconds: Array, stiffness: ArrayLike, damping: ArrayLike) -> None:
        self._step, self._k, self._c = np.broadcast_arrays(np.diff(seconds), stiffness, damping)
        self._matrix = _transition(self._step, self._k, self._c)
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


def _transition(h: Array, k: Array, c: Array) -> Array:
    """(2, 2, n) what x and dx become after h seconds without force."""
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
    drive = np.stack([np.interp(even, seconds, p) for p in (pull * (square / (1.0 + half))).T], axis=1)
    turn = np.stack([np.interp(even, seconds, w) for w in (rate * (damping * square / (1.0 + half))).T], axis=1)
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

    It rests against the stop that it is pushed to. When the push changes sign it moves freely, x'' = push (linear
    between stamps, exact), to the other stop; there its speed v decays without rebound as in a critically damped stop,
    x = v t exp(-t / settling).

    Args:
        seconds: (N,) ascending.
        push: (N,) m/s2 (or rad/s2) towards positive x.
        gap: from stop to stop, m (or rad); x lies within half of it on either side.
        settling: s.

    Returns:
        x, dx, ddx, each (N,).
    """
    flight = _Flight(seconds, push)
    position, velocity, acceleration = np.zeros((3, len(seconds)))
    side, since = 1.0 if push[0] >= 0.0 else -1.0, float(seconds[0])
    for _ in range(_MOST_KNOCKS):
        left = flight.departure(side, since)
        arrived, stop = flight.arrival(side * gap / 2, gap / 2, left)
        rests, flies = (slice(*np.searchsorted(seconds, span)) for span in ((since, left), (left, arrived)))
        position[rests] += side * gap / 2
        if left > seconds[-1]:
            break
        v0, x0 = flight.integrals(left)
        position[flies] += side * gap / 2 + flight.travel[flies] - x0 - v0 * (seconds[flies] - left)
        velocity[flies] += flight.speed[flies] - v0
        acceleration[flies] += push[flies]
        if arrived > seconds[-1]:
            break
        side, since = stop, arrived
        _knock(seconds, arrived, flight.integrals(arrived)[0] - v0, settling, (position, velocity, acceleration))
    return position, velocity, acceleration


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


def _knock(seconds: Array, start: float, speed: float, settling: float, onto: tuple[Array, Array, Array]) -> None:
    rows = slice(*np.searchsorted(seconds, [start - _BLUR, start + 30.0 * settling + _BLUR]))
    t = seconds[rows] - start
    s = np.maximum(t, 0.0) / settling
    onto[0][rows] += speed * settling * s * np.exp(-s)
    onto[1][rows] += np.where(t > 0.0, speed * (1.0 - s) * np.exp(-s), 0.0)
    onto[2][rows] += speed * knock_acceleration(t, settling)


def knock_acceleration(t: Array, settling: float) -> Array:
    """1/s, acceleration over speed before the knock, at times after it (negative: before).

    It jumps to -2 / settling: a sensor measures its mean over a short time.
    """
    late, early = (np.maximum(t + shift, 0.0) / settling for shift in (_BLUR, -_BLUR))
    return np.asarray(((1.0 - late) * np.exp(-late) - (1.0 - early) * np.exp(-early)) / (2.0 * _BLUR))


class _Flight:
    """Integrals of a push that is linear between stamps, and the times at which they reach a value."""

    def __init__(self, seconds: Array, push: Array) -> None:
        self._seconds, self._push = seconds, push
        h = np.diff(seconds)
        self.speed = np.concatenate([[0.0], np.cumsum(h * (push[1:] + push[:-1]) / 2)])
        steps = h * self.speed[:-1] + h**2 * (2 * push[:-1] + push[1:]) / 6
        self.travel = np.concatenate([[0.0], np.cumsum(steps)])
        self._turns = np.flatnonzero(np.diff(np.signbit(push)))

    def integrals(self, time: float) -> tuple[float, float]:
        """Speed and travel at a time, of a part that is free throughout."""
        i = min(max(int(self._seconds.searchsorted(time)) - 1, 0), len(self._seconds) - 2)
        begin, p, rate, v, x = self._piece(i)
        t = time - begin
        return v + t * (p + rate * t / 2), x + t * (v + t * (p / 2 + rate * t / 6))

    def _piece(self, i: int) -> tuple[float, float, float, float, float]:
        """Of the piece after a stamp: its time, the push and its slope there, speed and travel; plain floats."""
        begin, p = float(self._seconds[i]), float(self._push[i])
        rate = (float(self._push[i + 1]) - p) / (float(self._seconds[i + 1]) - begin)
        return begin, p, rate, float(self.speed[i]), float(self.travel[i])

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

    def arrival(self, begin: float, half: float, left: float) -> tuple[float, float]:
        """When a flight that left at a time from `begin` meets a stop at +-half, and which; infinity for never."""
        if left > self._seconds[-1]:
            return np.inf, 0.0
        v0, x0 = self.integrals(left)
        first = int(np.searchsorted(self._seconds, left, side="right"))
        while first < len(self._seconds):
            rows = slice(first, first + _SEARCHED)
            place = begin + self.travel[rows] - x0 - v0 * (self._seconds[rows] - left)
            out = np.flatnonzero(np.abs(place) > half * (1.0 + 1e-9))
            if len(out):
                side = float(np.sign(place[out[0]]))
                early = max(float(self._seconds[first + out[0] - 1]), left)
                last = first + int(out[0])
                return self._met(early, last, begin - side * half, v0, x0, left), side
            first += _SEARCHED
        return np.inf, 0.0

    def _met(self, early: float, stamp: int, offset: float, v0: float, x0: float, left: float) -> float:
        """Between a time and the next stamp, by number: by bisection, then Newton's method."""
        begin, p, rate, v, x = self._piece(stamp - 1)

        def state(time: float) -> tuple[float, float]:
            t = time - begin
            speed, place = v + t * (p + rate * t / 2), x + t * (v + t * (p / 2 + rate * t / 6))
            return offset + place - x0 - v0 * (time - left), speed - v0

        late = float(self._seconds[stamp])
        outside = state(late)[0] > 0.0
        first, last = early, late
        for _ in range(6):
            middle = (early + late) / 2
            early, late = (early, middle) if (state(middle)[0] > 0.0) == outside else (middle, late)
        for _ in range(3):
            beyond, speed = state(late)
            late = min(max(late - beyond / speed, first), last) if speed else late
        return late
