"""The motion of a base that carries objects: straight ways and turns, as slow as the acceleration limits ask."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.types import Array

_PEAK_SPEED, _PEAK_ACCELERATION = 15 / 8, 10 / 3**0.5
"""Of a quintic step of length 1 in a time of 1: their largest values."""
MAIN_SHARE = 0.8
"""Of what may be used, for the motion that is planned; the rest is left for corrections, as shares add up."""
_STILL, _STRAIGHT = 1e-4, 1e-3
"""m and rad below which there is nothing to do."""
_MOST_POSES, _FARTHEST = 1000, 1e6
"""Poses of a path, and m."""
_LEAST_ACCELERATION = 1e-3
"""m/s2 or rad/s2 below which nothing can be carried."""


@dataclass(frozen=True, eq=False)
class BaseLimits:
    """What the objects on a base sustain, in the frame of the base, x forward.

    Args:
        normals, offsets: (F, 2), (F,) horizontal accelerations a with normals @ a <= offsets are sustained, m/s2.
        angular_acceleration: rad/s2 about z, alone.
        angular_speed: rad/s about z, alone.
    """

    normals: Array
    offsets: Array
    angular_acceleration: float
    angular_speed: float

    def __post_init__(self) -> None:
        """Refuse what limits nothing by mistake: InputError BAD_INPUT, NOT_FINITE."""
        if self.normals.shape != (len(self.offsets), 2):
            what = f"acceleration limits: {len(self.normals)} normals and {len(self.offsets)} offsets"
            raise InputError(ErrorCode.BAD_INPUT, what)
        turning = self.angular_acceleration, self.angular_speed
        if not np.isfinite(self.normals).all() or np.isnan([*self.offsets, *turning]).any():
            raise InputError(ErrorCode.NOT_FINITE, "acceleration limits: a value is not a number")

    def times(self, factor: float) -> "BaseLimits":
        """Limits that are this much larger."""
        turning = factor * self.angular_acceleration, factor * self.angular_speed
        return BaseLimits(self.normals, factor * self.offsets, *turning)

    def along(self, direction: Array) -> float:
        """m/s2 sustained along a direction (2,) and against it, whichever is less."""
        rates = self.normals @ (direction / np.linalg.norm(direction))
        with np.errstate(divide="ignore"):
            reach = np.where(np.abs(rates) > 1e-12, self.offsets / np.abs(rates), np.inf)
        return float(max(reach.min(initial=np.inf), 0.0))

    def share(self, acceleration: Array) -> float:
        """Share of the limits that a horizontal acceleration (2,), m/s2, takes."""
        rates = self.normals @ acceleration
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(rates > 0, rates / np.maximum(self.offsets, 0.0), 0.0)
        return float(shares.max(initial=0.0))

    def turning_share(self, acceleration: float, speed: float) -> float:
        """Share of the limits that turning takes, rad/s2 and rad/s."""
        return (
            abs(acceleration) / max(self.angular_acceleration, 1e-12) + speed**2 / max(self.angular_speed, 1e-12) ** 2
        )


@dataclass(frozen=True, eq=False)
class _Leg:
    """A straight way or a turn from rest to rest, by a quintic step."""

    start: Array  # (3,) x, y, yaw
    change: Array  # (3,)
    duration: float

    def at(self, seconds: float) -> tuple[Array, Array]:
        """(3,) pose and its rate."""
        u = float(np.clip(seconds / self.duration, 0.0, 1.0))
        step, rate = u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2 / self.duration
        return self.start + step * self.change, rate * self.change


@dataclass(frozen=True, eq=False)
class BaseDrive:
    """Legs, one after another.

    Args:
        legs: at least one.
        least: m/s2, the least limit along a way; infinite when it only turns.
    """

    legs: tuple[_Leg, ...]
    least: float

    @property
    def duration(self) -> float:
        """s."""
        return float(sum(leg.duration for leg in self.legs))

    @property
    def length(self) -> float:
        """m of all ways."""
        return float(sum(np.linalg.norm(leg.change[:2]) for leg in self.legs))

    def at(self, seconds: float) -> tuple[Array, Array, bool]:
        """(3,) x, y, yaw and their rates at a time, and whether it turns then."""
        seconds = max(seconds, 0.0)
        for leg in self.legs:
            if seconds < leg.duration:
                break
            seconds -= leg.duration
        else:
            leg, seconds = self.legs[-1], self.legs[-1].duration
        return *leg.at(seconds), bool(leg.change[2])


def plan_base_motion(
    start: Array,
    path: Sequence[Array],
    limits: BaseLimits,
    speed: float,
    turn_speed: float,
    share: float,
    holonomic: bool = True,
) -> BaseDrive:
    """A motion through the poses of a path, from rest to rest in each leg.

    Args:
        start: (3,) x, y, m, and yaw, rad.
        path: (3,) each.
        limits: in the frame of the base.
        speed, turn_speed: m/s and rad/s at most.
        share: of the limits that may be used, with corrections.
        holonomic: it may drive in any direction; otherwise it turns, drives forwards, and turns again.

    Raises:
        InputError: EMPTY without a way to go, NOT_FINITE, BAD_INPUT with more than 1,000 poses or poses too far away.
        NoAnswerError: UNSTABLE when a limit on the way is 0.
    """
    if len(path) > _MOST_POSES:
        raise InputError(ErrorCode.BAD_INPUT, f"path: {len(path)} poses; give {_MOST_POSES} at most")
    legs: list[_Leg] = []
    least, here, used = np.inf, np.asarray(start, dtype=np.float64), MAIN_SHARE * share
    for goal in path:
        if not (np.isfinite(goal).all() and np.isfinite(here).all()):
            raise InputError(ErrorCode.NOT_FINITE, f"path: {goal}, or where the base is, is not finite")
        if np.abs(goal).max() > _FARTHEST:
            raise InputError(ErrorCode.BAD_INPUT, f"path: {goal} is farther away than {_FARTHEST:g} m")
        way = goal[:2] - here[:2]
        length = float(np.linalg.norm(way))
        if length > _STILL and not holonomic:
            here = _turn(legs, here, float(np.arctan2(way[1], way[0])), limits, turn_speed, used)
        if length > _STILL:
            limit = limits.along(in_base(way, here[2]))
            _require(limit, "m/s2 along the way")
            least = min(least, limit)
            seconds = max(_PEAK_SPEED * length / speed, np.sqrt(_PEAK_ACCELERATION * length / (used * limit)))
            change = np.array([*way, 0.0])
            legs.append(_Leg(here, change, float(seconds)))
            here = here + change
        here = _turn(legs, here, float(goal[2]), limits, turn_speed, used)
    if not legs:
        raise InputError(ErrorCode.EMPTY, "path: the base is there already; give a pose to go to")
    return BaseDrive(tuple(legs), least)


def _turn(legs: list[_Leg], here: Array, yaw: float, limits: BaseLimits, turn_speed: float, used: float) -> Array:
    """Append a turn in place to a yaw, if it is one; where the base then is."""
    angle = float((yaw - here[2] + np.pi) % (2 * np.pi) - np.pi)
    if abs(angle) < _STRAIGHT:
        return here
    _require(limits.angular_acceleration, "rad/s2 of turning")
    _require(limits.angular_speed, "rad/s of turning")
    # The peaks of acceleration and speed do not come together: their sum is an upper bound.
    taken = _PEAK_ACCELERATION * abs(angle) / limits.angular_acceleration
    taken += (_PEAK_SPEED * angle / limits.angular_speed) ** 2
    seconds = max(_PEAK_SPEED * abs(angle) / turn_speed, np.sqrt(taken / used))
    legs.append(_Leg(here, np.array([0.0, 0.0, angle]), float(seconds)))
    return np.asarray(here + np.array([0.0, 0.0, angle]))


def _require(limit: float, what: str) -> None:
    if not limit > _LEAST_ACCELERATION:
        raise NoAnswerError(
            ErrorCode.UNSTABLE, f"the objects on the base sustain {limit:.2g} {what}: place them more firmly first"
        )


def in_base(vector: Array, yaw: float) -> Array:
    """(2,) of a vector of the odometry's frame, in a base with that yaw."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.array([[cosine, sine], [-sine, cosine]]) @ vector
