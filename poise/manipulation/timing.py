"""From a way to a motion in time: within the limits of joints, tool and grip."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from poise.manipulation.arm import Arm
from poise.manipulation.cell import CHECK_STEP, Cell
from poise.simulation import WaypointTrajectory
from poise.types import Array

_SAMPLES = 400
"""Places in time at which limits are looked at."""
_SLACK = 1.02
"""A peak may lie between two of them."""
_WITHOUT_STOPS = 1.25
"""Times as long as with a stop at every corner, a motion without stops may take."""
_PERIOD = 0.05
"""s between waypoints of a motion."""


@dataclass(frozen=True)
class Limits:
    """How fast.

    Args:
        joint_speed: share of each joint's velocity limit.
        joint_acceleration: rad/s2.
        speed, acceleration: m/s and m/s2 of a point that moves with the tool.
    """

    joint_speed: float = 0.5
    joint_acceleration: float = 5.0
    speed: float = 0.5
    acceleration: float = 5.0


def timed(arm: Arm, way: Array, cell: Cell, point_in_tcp: Array, limits: Limits) -> list[WaypointTrajectory]:
    """Motions along a way (N, J), at rest before and after.

    One motion along a spline through the way, or one straight motion after another where the spline touches something
    or takes much longer. Each is a quintic step along its path, as slow as the tightest limit asks: uniform scaling
    divides speeds by the duration and accelerations by its square, so the duration follows in closed form.

    Args:
        arm: the robot.
        way: straight between its points, and free.
        cell: what the spline must not touch.
        point_in_tcp: (3,) the point that `limits.speed` and `limits.acceleration` are about (what is held).
        limits: how fast.
    """
    if np.abs(np.diff(way, axis=0)).max(initial=0.0) < 1e-9:
        return []
    pairs = (np.stack(pair) for pair in pairwise(way))
    straight = [_step(arm, _spline(pair), point_in_tcp, limits) for pair in pairs if np.ptp(pair, axis=0).any()]
    rounded = _spline(way)
    if len(straight) > 1 and _is_free(rounded, cell):
        at_once = _step(arm, rounded, point_in_tcp, limits)
        if at_once.duration < _WITHOUT_STOPS * sum(motion.duration for motion in straight):
            return [at_once]
    return straight


def _spline(way: Array) -> CubicSpline:
    """Through points at most `CHECK_STEP` apart on the way, over 0..1 in proportion to length."""
    keep = np.concatenate([[True], np.abs(np.diff(way, axis=0)).max(axis=1) > 1e-9])
    way = way[keep]
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    counts = np.maximum(np.ceil(np.diff(lengths) / (2 * CHECK_STEP)).astype(int), 1)
    spans = zip(lengths[:-1], lengths[1:], counts, strict=True)
    at = np.concatenate([*(np.linspace(a, b, n, endpoint=False) for a, b, n in spans), lengths[-1:]])
    points = np.stack([np.interp(at, lengths, column) for column in way.T], axis=1)
    return CubicSpline(at / lengths[-1], points)


def _is_free(path: CubicSpline, cell: Cell) -> bool:
    length = np.abs(path(path.x[1:]) - path(path.x[:-1])).max(axis=1).sum()
    places = path(np.linspace(0.0, 1.0, max(int(np.ceil(length / CHECK_STEP)) + 1, 3)))
    return all(cell.free(q) for q in places)


def _step(arm: Arm, path: CubicSpline, point_in_tcp: Array, limits: Limits) -> WaypointTrajectory:
    at = np.linspace(0.0, 1.0, _SAMPLES)
    position, velocity, acceleration = _motion(path, at)
    points = np.array([arm.tool(q).act(point_in_tcp) for q in position])
    speed = np.gradient(points, at, axis=0, edge_order=2)
    change = np.diff(points, 2, axis=0) / (at[1] - at[0]) ** 2
    duration = max(
        float((np.abs(velocity) / (limits.joint_speed * arm.velocity_limit)).max()),
        float(np.sqrt(np.abs(acceleration).max() / limits.joint_acceleration)),
        float(np.linalg.norm(speed, axis=1).max() / limits.speed),
        float(np.sqrt(np.linalg.norm(change, axis=1).max() / limits.acceleration)),
        2 * _PERIOD,
    )
    duration *= _SLACK
    times = np.linspace(0.0, duration, int(np.ceil(duration / _PERIOD)) + 1)
    position, velocity, acceleration = _motion(path, times / duration)
    return WaypointTrajectory(times, position, velocity / duration, acceleration / duration**2)


def _motion(path: CubicSpline, at: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration by a quintic step along a path, over 0..1."""
    u = at**3 * (10 - 15 * at + 6 * at**2)
    rate = (30 * at**2 * (1 - at) ** 2)[:, None]
    second = (60 * at * (1 - at) * (1 - 2 * at))[:, None]
    slope, bend = path(u, 1), path(u, 2)
    return path(u), slope * rate, bend * rate**2 + slope * second
