"""Few poses to rest in: gravity from the most informative directions for mass, centre of mass and bias; short moves."""

import itertools

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.excitation.certificate import certify
from poise.excitation.hand import HandMotion, hand_motion, hand_slopes
from poise.excitation.information import Information
from poise.excitation.limits import Guard, MotionLimits, position_range
from poise.excitation.search import check
from poise.inertia.model import motion_signals
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory
from poise.types import Array, Cancelled, Progress

_TILT = np.deg2rad(60.0)
_AZIMUTHS = 8
_ROUNDS = 30
_DAMPING = 0.05
"""Of inverse kinematics: how much, in m or gravity's share, a rad of joint motion is worth avoiding."""
_INSTANT = 1e-3
"""s: what the tool moves in it is kept from the end of the room, because the certificate bounds it between instants."""
_QUICKEST = 0.3
"""s that a move takes at the least."""


def tilted(
    model: RobotModel, start: Array, active: Array, guard: Guard, limits: MotionLimits, tilt: float = _TILT
) -> Array:
    """(C, J) poses near the start that tilt the hand about its tool centre point to all sides, as far as joints allow.

    Inverse kinematics by damped Gauss-Newton steps, all poses at once; a pose that does not get there still counts for
    the tilt it has, unless it takes the tool out of its room.
    """
    still = np.zeros((1, len(start)))
    first = hand_motion(model, start[None], still, still)
    down = _down(first)[0]
    tool = (first.position + first.rotation @ guard.tcp)[0]
    side = np.linalg.svd(down[None])[2][1:]
    angles = np.arange(_AZIMUTHS) * 2 * np.pi / _AZIMUTHS
    around = np.cos(angles)[:, None] * side[0] + np.sin(angles)[:, None] * side[1]
    targets = np.vstack([np.cos(t) * down + np.sin(t) * around for t in (tilt, tilt / 2)])
    lower, upper = position_range(model, start)
    poses = np.tile(start, (len(targets), 1))
    for _ in range(_ROUNDS):
        zeros = np.zeros_like(poses)
        hand, slopes = hand_slopes(model, poses, zeros, zeros)
        arm = slopes.moving_a - np.cross(guard.tcp[None, :, None], slopes.turning_a, axis=1)
        by_joint = (
            np.concatenate([hand.rotation @ arm, np.cross(_down(hand)[:, :, None], slopes.turning_a, axis=1)], axis=1)
            * active
        )
        away = np.concatenate([tool - hand.position - hand.rotation @ guard.tcp, targets - _down(hand)], axis=1)
        normal = by_joint.swapaxes(1, 2) @ by_joint + _DAMPING**2 * np.eye(len(start))
        step = np.linalg.solve(normal, (by_joint.swapaxes(1, 2) @ away[:, :, None]))[:, :, 0]
        poses = np.clip(poses + np.clip(step, -0.3, 0.3), lower, upper)
    zeros = np.zeros_like(poses)
    hand = hand_motion(model, poses, zeros, zeros)
    near = np.linalg.norm(hand.position + hand.rotation @ guard.tcp - tool, axis=1) <= limits.room
    return np.asarray(poses[near])


def choose(model: RobotModel, poses: Array, count: int, information: Information, dwell: float) -> list[int]:
    """The most informative set of poses, the first among them: greedily, then by exchange (Fedorov 1972)."""
    zeros = np.zeros_like(poses)
    hand = hand_motion(model, poses, zeros, zeros)
    signals = motion_signals(hand.specific, hand.omega, hand.alpha)

    def value(chosen: list[int]) -> float:
        return information.value(signals[chosen], dwell)

    chosen = [0]
    while len(chosen) < min(count, len(poses)):
        rest = [i for i in range(len(poses)) if i not in chosen]
        chosen.append(max(rest, key=lambda i: value([*chosen, i])))
    for _ in range(10):
        swaps = [
            [*chosen[:place], new, *chosen[place + 1 :]]
            for place in range(1, len(chosen))
            for new in range(len(poses))
            if new not in chosen
        ]
        best = max(swaps, key=value, default=chosen)
        if value(best) <= value(chosen) + 1e-9:
            break
        chosen = best
    return chosen


def stop_and_go(
    model: RobotModel,
    start: Array,
    active: Array,
    guard: Guard,
    limits: MotionLimits,
    information: Information,
    *,
    poses: int,
    dwell: float,
    progress: Progress,
    cancelled: Cancelled,
) -> WaypointTrajectory:
    """A round trip of poses from the start, `dwell` s at rest in each, in the order that takes least time.

    Raises:
        NoAnswerError: UNREACHABLE when the hand can be tilted to no side, or no poses have ways that keep to the room.
        PoiseError: CANCELLED.
    """
    candidates = np.vstack([start, tilted(model, start, active, guard, limits)])
    check(cancelled)
    progress(0.3)
    while True:
        picked = choose(model, candidates, poses, information, dwell)
        chosen = candidates[picked]
        if len(chosen) < min(poses, 3):
            raise NoAnswerError(
                ErrorCode.UNREACHABLE,
                "the hand cannot be tilted from here: joints are at the ends of their range, or the room is too small;"
                " move the arm, or allow more room",
            )
        times = _travel_times(model, chosen, guard, limits, progress, cancelled)
        orders = [(0, *order, 0) for order in itertools.permutations(range(1, len(chosen)))]
        best = min(orders, key=lambda order: sum(times[a, b] for a, b in itertools.pairwise(order)))
        legs = [times[a, b] for a, b in itertools.pairwise(best)]
        if np.isfinite(sum(legs)):
            break
        # No order keeps to the room: leave out the pose with the fewest ways, and choose again among the rest.
        worst = 1 + int(np.argmin(np.isfinite(times[1:]).sum(axis=1)))
        candidates = np.delete(candidates, picked[worst], axis=0)
    arrivals = np.concatenate([[0.0], np.cumsum(legs) + dwell * np.arange(1, len(legs) + 1)])
    position = chosen[list(best)]
    stops = np.column_stack([arrivals, arrivals + dwell]).ravel()
    return WaypointTrajectory(stops, np.repeat(position, 2, axis=0))


def _travel_times(
    model: RobotModel, poses: Array, guard: Guard, limits: MotionLimits, progress: Progress, cancelled: Cancelled
) -> Array:
    """(N, N) s between poses, the first of which is the start; progress goes from 0.3 to 1."""
    times = np.zeros((len(poses), len(poses)))
    for i, j in itertools.combinations(range(len(poses)), 2):
        check(cancelled)
        times[i, j] = times[j, i] = _travel_time(model, poses[i], poses[j], poses[0], guard, limits)
        progress(0.3 + 0.7 * (i + 1) / len(poses))
    return times


def _travel_time(
    model: RobotModel, here: Array, there: Array, start: Array, guard: Guard, limits: MotionLimits
) -> float:
    """s of the straight move (minimum jerk) within the limits; infinite when it takes the tool out of its room."""
    move = WaypointTrajectory(np.array([0.0, 1.0]), np.vstack([here, there]))
    found = certify(model, move, guard)
    still = np.zeros_like(start)
    first = hand_motion(model, start[None], still[None], still[None])
    along = hand_motion(model, *move.at(np.linspace(0.0, 1.0, 101)))
    tools = along.position + along.rotation @ guard.tcp
    away = np.linalg.norm(tools - first.position - first.rotation @ guard.tcp, axis=1).max()
    if away > limits.room - limits.speed * _INSTANT:
        return float(np.inf)
    return max(found.slow_down(limits) * (1 + 1e-6), _QUICKEST)


def _down(hand: HandMotion) -> Array:
    """(N, 3) the direction of gravity in sensor axes, for a hand at rest."""
    return np.asarray(hand.specific / np.linalg.norm(hand.specific, axis=1, keepdims=True))
