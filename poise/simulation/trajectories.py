"""Commanded motions of joints: Fourier series, quintic segments between waypoints, splines through samples."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.robot import RobotModel
from poise.types import Array


class JointMotion(NamedTuple):
    """Position (N, J) rad or m, velocity and acceleration of joints."""

    position: Array
    velocity: Array
    acceleration: Array


class Trajectory(Protocol):
    """A motion of J joints over `duration` seconds, at rest before and after it."""

    @property
    def duration(self) -> float:
        """s."""

    def at(self, seconds: Array) -> JointMotion:
        """The motion at (N,) s after the start."""


@dataclass(frozen=True)
class FourierTrajectory:
    """Excitation by a finite Fourier series about a centre (Swevers et al. 1997), faded in and out.

    q = centre + e(t) * sum_k (sine_k sin(2 pi k f t) + cosine_k cos(2 pi k f t)), with e a quintic step over `ramp`
    seconds at both ends, so that the motion starts and ends at rest.

    Args:
        centre: (J,) rad or m.
        sine, cosine: (H, J).
        frequency: f, Hz.
        duration, ramp: s.
    """

    centre: Array
    sine: Array
    cosine: Array
    frequency: float
    duration: float
    ramp: float

    @classmethod
    def random(
        cls,
        model: RobotModel,
        rng: np.random.Generator,
        *,
        duration: float = 20.0,
        speed: float = 0.3,
        amplitude: float = 0.8,
        frequency: float = 0.1,
        harmonics: int = 5,
        centre: ArrayLike | None = None,
    ) -> "FourierTrajectory":
        """A random series that keeps to the robot's limits.

        Args:
            model: the robot.
            rng: source of randomness.
            duration: s.
            speed: largest share of a joint's velocity limit.
            amplitude: largest distance from the centre, rad or m.
            frequency: of the first harmonic, Hz.
            harmonics: how many.
            centre: (J,); None: `home`.
        """
        middle = home(model) if centre is None else np.asarray(centre, dtype=np.float64)
        room = np.minimum(np.minimum(model.upper - middle, middle - model.lower), amplitude)
        sine, cosine = rng.normal(size=(2, harmonics, len(middle))) / np.arange(1, harmonics + 1)[:, None]
        made = cls(middle, sine, cosine, frequency, duration, min(1.0, duration / 4))
        motion = made.at(np.arange(0.0, duration, 0.01))
        reach = np.abs(motion.position - middle).max(axis=0)
        scale = np.minimum(room / reach, speed * model.velocity_limit / np.abs(motion.velocity).max(axis=0))
        scale *= 0.99  # a peak may lie between two of these samples
        return cls(made.centre, sine * scale, cosine * scale, frequency, duration, made.ramp)

    def at(self, seconds: Array) -> JointMotion:
        """The motion at (N,) s after the start."""
        t = np.clip(np.asarray(seconds, dtype=np.float64), 0.0, self.duration)
        rates = 2 * np.pi * self.frequency * np.arange(1, len(self.sine) + 1)
        sine, cosine = np.sin(np.outer(t, rates)), np.cos(np.outer(t, rates))
        d0 = sine @ self.sine + cosine @ self.cosine
        d1 = (cosine * rates) @ self.sine - (sine * rates) @ self.cosine
        d2 = -(sine * rates**2) @ self.sine - (cosine * rates**2) @ self.cosine
        e0, e1, e2 = (part[:, None] for part in self._envelope(t))
        return JointMotion(self.centre + e0 * d0, e1 * d0 + e0 * d1, e2 * d0 + 2 * e1 * d1 + e0 * d2)

    def _envelope(self, t: Array) -> tuple[Array, Array, Array]:
        into = np.minimum(t, self.duration - t) / self.ramp
        u = np.minimum(into, 1.0)
        sign = np.where(t < self.duration / 2, 1.0, -1.0) / self.ramp
        step = u**3 * (10 - 15 * u + 6 * u**2)
        rate = 30 * u**2 * (1 - u) ** 2 * sign
        second = 60 * u * (1 - u) * (1 - 2 * u) / self.ramp**2
        return step, rate, second


@dataclass(frozen=True)
class WaypointTrajectory:
    """Quintic segments between waypoints; at rest before the first and after the last.

    Args:
        times: (K,) s, ascending.
        position: (K, J) rad or m.
        velocity: (K, J); None: at rest at every waypoint.
        acceleration: (K, J); None: zero at every waypoint.

    Raises:
        InputError: BAD_INPUT when times do not ascend, shapes do not fit or a number is not finite.
    """

    times: Array
    position: Array
    velocity: Array | None = None
    acceleration: Array | None = None

    def __post_init__(self) -> None:
        times, position = np.asarray(self.times, dtype=np.float64), np.asarray(self.position, dtype=np.float64)
        derived = [
            np.zeros_like(position) if value is None else np.asarray(value, dtype=np.float64)
            for value in (self.velocity, self.acceleration)
        ]
        if times.ndim != 1 or len(times) < 1 or position.ndim != 2 or len(position) != len(times):
            raise _bad(f"{times.shape} times do not fit {position.shape} positions")
        if any(value.shape != position.shape for value in derived):
            raise _bad("velocities and accelerations must be as many as positions")
        if not all(np.isfinite(value).all() for value in (times, position, *derived)):
            raise _bad("a number is not finite")
        if (np.diff(times) <= 0).any():
            raise _bad(f"times must ascend; waypoint {int(np.argmax(np.diff(times) <= 0)) + 1} does not come later")
        values = (times, position, *derived)
        for name, value in zip(("times", "position", "velocity", "acceleration"), values, strict=True):
            object.__setattr__(self, name, value)

    @classmethod
    def stop_and_go(cls, position: ArrayLike, move: float, dwell: float) -> "WaypointTrajectory":
        """Visit (K, J) poses in turn: `move` s from one to the next (minimum jerk), `dwell` s at rest at each."""
        poses = np.asarray(position, dtype=np.float64)
        if not (move > 0 and dwell > 0):
            raise _bad(f"move and dwell must be positive, got {move} and {dwell}")
        arrivals = (move + dwell) * np.arange(len(poses))
        return cls(np.column_stack([arrivals, arrivals + dwell]).ravel(), np.repeat(poses, 2, axis=0))

    @property
    def duration(self) -> float:
        """s."""
        return float(self.times[-1])

    def at(self, seconds: Array) -> JointMotion:
        """The motion at (N,) s after the start."""
        t = np.asarray(seconds, dtype=np.float64)
        if len(self.times) == 1:
            still = np.zeros((len(t), self.position.shape[1]))
            return JointMotion(still + self.position, still, still)
        segment = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        span = np.diff(self.times)[segment]
        u = np.clip((t - self.times[segment]), 0.0, span)
        coefficients = self.polynomials[:, segment]
        out = []
        for _ in range(3):
            out.append(np.einsum("kn,knj->nj", u ** np.arange(len(coefficients))[:, None], coefficients))
            coefficients = coefficients[1:] * np.arange(1, len(coefficients))[:, None, None]
        outside = (t < self.times[0]) | (t > self.times[-1])
        out[1][outside] = out[2][outside] = 0.0
        return JointMotion(*out)

    @cached_property
    def polynomials(self) -> Array:
        """(6, K - 1, J) of each segment's polynomial in the time since its start (Craig 2005, eq. 7.18)."""
        velocity, acceleration = np.asarray(self.velocity), np.asarray(self.acceleration)
        span = np.diff(self.times)[:, None]
        step = np.diff(self.position, axis=0)
        v0, v1, a0, a1 = velocity[:-1], velocity[1:], acceleration[:-1], acceleration[1:]
        return np.stack(
            [
                self.position[:-1],
                v0,
                a0 / 2,
                (20 * step - (8 * v1 + 12 * v0) * span - (3 * a0 - a1) * span**2) / (2 * span**3),
                (-30 * step + (14 * v1 + 16 * v0) * span + (3 * a0 - 2 * a1) * span**2) / (2 * span**4),
                (12 * step - 6 * (v1 + v0) * span - (a0 - a1) * span**2) / (2 * span**5),
            ]
        )


class SplineTrajectory:
    """The quintic spline through all samples, at rest at both ends: for densely sampled motions.

    Args:
        times: (K,) s, ascending.
        position: (K, J) rad or m.

    Raises:
        InputError: BAD_INPUT as `WaypointTrajectory`, or for fewer than two samples.
    """

    def __init__(self, times: ArrayLike, position: ArrayLike) -> None:
        checked = WaypointTrajectory(np.asarray(times), np.asarray(position))
        if len(checked.times) < 2:
            raise _bad("a spline needs two samples at the least")
        rest: Any = [(1, np.zeros(checked.position.shape[1])), (2, np.zeros(checked.position.shape[1]))]
        self._start = float(checked.times[0])
        self._spline: scipy.interpolate.BSpline = scipy.interpolate.make_interp_spline(
            checked.times, checked.position, k=5, bc_type=(rest, rest)
        )
        self.duration = checked.duration

    def at(self, seconds: Array) -> JointMotion:
        """The motion at (N,) s after the start."""
        t = np.asarray(seconds, dtype=np.float64)
        inside = np.clip(t, self._start, self.duration)
        position, velocity, acceleration = (np.asarray(self._spline(inside, order)) for order in range(3))
        outside = inside != t
        velocity[outside] = acceleration[outside] = 0.0
        return JointMotion(position, velocity, acceleration)


def home(model: RobotModel) -> Array:
    """(J,) the home position: the middle of the range of joints that turn less than a full turn, zero for others."""
    narrow = model.upper - model.lower < 2 * np.pi
    return np.where(narrow, (np.where(narrow, model.upper, 0.0) + np.where(narrow, model.lower, 0.0)) / 2, 0.0)


def check_limits(model: RobotModel, trajectory: Trajectory, names: Sequence[str] | None = None) -> None:
    """Refuse a motion outside the robot's limits.

    Raises:
        InputError: JOINT_LIMIT, naming a joint that leaves its range or exceeds its speed, when and by how much.
    """
    seconds = np.linspace(0.0, trajectory.duration, min(max(int(trajectory.duration * 200), 200), 100_000))
    motion = trajectory.at(seconds)
    slack = 1e-9
    wrong = {
        "leaves its range": (motion.position < model.lower - slack) | (motion.position > model.upper + slack),
        "exceeds its speed limit": np.abs(motion.velocity) > model.velocity_limit * (1 + slack),
    }
    for what, where in wrong.items():
        if where.any():
            row, column = np.argwhere(where)[0]
            name = (names or model.joint_names)[column]
            raise InputError(
                ErrorCode.JOINT_LIMIT,
                f"joint {name} {what} at {seconds[row]:.2f} s: position {motion.position[row, column]:.3f}, "
                f"range {model.lower[column]:.3f} to {model.upper[column]:.3f}, velocity "
                f"{motion.velocity[row, column]:.3f}, limit {model.velocity_limit[column]:.3f}",
            )


def _bad(reason: str) -> InputError:
    return InputError(ErrorCode.BAD_INPUT, f"trajectory: {reason}")
