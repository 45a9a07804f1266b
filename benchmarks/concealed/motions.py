"""What the robot does: Fourier series, pick and place, a driving base; exact to the second derivative."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.robot import SPEED_LIMITS
from poise.types import Array

DURATION = 35.0  # s, as the thesis' motion and the probe's
HOME = np.array([0.0, -1.9, 2.0, -np.pi / 2 - 0.1, -np.pi / 2, 0.0])
"""rad: the arm bent in front of the base, the tool pointing down."""

RAMP = 1.0  # s in which a series fades in and out
Curve = Callable[[Array], tuple[Array, Array, Array]]
"""(N,) s -> position, velocity, acceleration, each (N, K)."""


@dataclass(frozen=True)
class Motion:
    """Arm and base at (N,) s: position, velocity, acceleration of the 6 joints and of the base's x, y, yaw.

    Args:
        name: for the label.
        arm: curves of the joints, rad.
        base: curves of x, y [m] and yaw [rad], which odom reports.
    """

    name: str
    arm: Curve
    base: Curve


def fourier(rng: np.random.Generator, speed: float = 0.45, amplitude: float = 1.0) -> Curve:
    """A Fourier series of six harmonics about home that starts and ends at rest, up to `speed` of the speed limits."""
    frequency, harmonics = rng.uniform(0.07, 0.11), np.arange(1, 7)
    weights = rng.normal(size=(2, 6, 6)) / harmonics[:, None] ** 0.8
    reach = np.array([1.0, 0.45, 0.6, 1.0, 1.0, 1.6]) * amplitude
    centre = HOME + rng.uniform(-1, 1, 6) * [0.5, 0.15, 0.15, 0.3, 0.3, 1.0]
    rates = 2 * np.pi * frequency * harmonics

    def series(t: Array, scale: Array) -> tuple[Array, Array, Array]:
        sine, cosine = np.sin(np.outer(t, rates)), np.cos(np.outer(t, rates))
        d0 = sine @ weights[0] + cosine @ weights[1]
        d1 = (cosine * rates) @ weights[0] - (sine * rates) @ weights[1]
        d2 = -((sine * rates**2) @ weights[0]) - (cosine * rates**2) @ weights[1]
        e0, e1, e2 = (part[:, None] for part in _fade(t))
        return scale * e0 * d0, scale * (e1 * d0 + e0 * d1), scale * (e2 * d0 + 2 * e1 * d1 + e0 * d2)

    position, velocity, _ = series(np.arange(0.0, DURATION, 0.01), np.ones(6))
    scale = np.minimum(reach / np.abs(position).max(axis=0), speed * SPEED_LIMITS / np.abs(velocity).max(axis=0))

    def curve(t: Array) -> tuple[Array, Array, Array]:
        d0, d1, d2 = series(np.clip(t, 0.0, DURATION), scale)
        return centre + d0, d1, d2

    return curve


def pick_and_place(rng: np.random.Generator, speed: float = 1.5) -> Curve:
    """Poses visited in turn, a dip at every second one; S-curve moves at up to `speed` rad/s, short rests."""
    dip = np.array([0.0, 0.22, -0.1, -0.12, 0.0, 0.0])
    poses, pose = [HOME], HOME
    while len(poses) < 40:
        pose = HOME + rng.uniform(-1, 1, 6) * [1.1, 0.3, 0.4, 0.9, 0.9, 1.6]
        poses += [pose, pose + dip * rng.uniform(0.6, 1.0), pose]
    rests = rng.uniform(0.1, 0.5, len(poses))
    return through(np.array(poses), speed, acceleration=rng.uniform(2.5, 4.0), jerk_time=0.12, rests=rests)


def through(poses: Array, speed: float, acceleration: float, jerk_time: float, rests: Array) -> Curve:
    """Visit poses (K, J) at rest, along straight lines in joint space, with an S-curve in each move.

    Args:
        poses: (K, J) rad or m.
        speed, acceleration: of the joint that moves farthest.
        jerk_time: s in which the acceleration rises and falls.
        rests: (K,) s before the move from each pose.
    """
    moves = [_s_curve(float(np.abs(step).max()), speed, acceleration, jerk_time) for step in np.diff(poses, axis=0)]
    starts, begin = [], 0.0
    for rest, (edges, _, _) in zip(rests, moves, strict=False):
        starts.append(begin + rest)
        begin += rest + edges[-1]

    def curve(t: Array) -> tuple[Array, Array, Array]:
        move = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(moves) - 1)
        share = np.zeros((3, len(t)))
        for i in np.unique(move):
            here = move == i
            share[:, here] = _along(moves[i], t[here] - starts[i])
        step = (poses[1:] - poses[:-1])[move]
        return poses[move] + step * share[0][:, None], step * share[1][:, None], step * share[2][:, None]

    return curve


def drive(rng: np.random.Generator, acceleration: float = 0.5) -> Curve:
    """A base that drives to a few places around the origin and turns a little, with rests."""
    places = np.cumsum(rng.uniform(-1, 1, (12, 3)) * [0.7, 0.7, 0.5], axis=0)
    places = np.vstack([np.zeros((1, 3)), places - places.mean(axis=0) * np.linspace(0, 1, 12)[:, None]])
    return through(places, 0.4, acceleration, jerk_time=0.3, rests=rng.uniform(0.5, 3.0, len(places)))


def still(width: int) -> Curve:
    """Nothing moves."""
    return lambda t: (np.zeros((len(t), width)),) * 3


def _fade(t: Array) -> tuple[Array, Array, Array]:
    """A quintic step up at the beginning and down at the end, and its derivatives."""
    u = np.minimum(np.minimum(t, DURATION - t) / RAMP, 1.0)
    sign = np.where(t < DURATION / 2, 1.0, -1.0) / RAMP
    return (
        u**3 * (10 - 15 * u + 6 * u**2),
        30 * u**2 * (1 - u) ** 2 * sign,
        60 * u * (1 - u) * (1 - 2 * u) / RAMP**2,
    )


def _s_curve(distance: float, speed: float, acceleration: float, jerk_time: float) -> tuple[Array, Array, Array]:
    """Edges (8,) s, states (3, 7) at the begin of each phase and jerks (7,) of a unit move that takes as long."""
    a = max(distance, 1e-9)
    top = min(speed, acceleration * (np.sqrt(jerk_time**2 / 4 + a / acceleration) - jerk_time / 2))
    # Below this distance the acceleration is not reached in full: it is lowered instead of the jerk time.
    flat = max(top / acceleration - jerk_time, 0.0)
    cruise = max((a - top * (2 * jerk_time + flat)) / top, 0.0)
    spans = np.array([jerk_time, flat, jerk_time, cruise, jerk_time, flat, jerk_time])
    jerks = np.array([1.0, 0, -1, 0, -1, 0, 1])
    states, state = np.zeros((3, 7)), np.zeros(3)
    for i, (span, jerk) in enumerate(zip(spans, jerks, strict=True)):
        states[:, i] = state
        state = _advance(state, jerk, span)
    return np.concatenate([[0.0], np.cumsum(spans)]), states / state[0], jerks / state[0]


def _advance(state: Array, jerk: float | Array, span: float | Array) -> Array:
    position, velocity, acceleration = state
    return np.array(
        [
            position + span * (velocity + span * (acceleration / 2 + span * jerk / 6)),
            velocity + span * (acceleration + span * jerk / 2),
            acceleration + span * jerk,
        ]
    )


def _along(move: tuple[Array, Array, Array], t: Array) -> Array:
    """(3, N) share of a move, its rate and second derivative."""
    edges, states, jerks = move
    inside = np.clip(t, 0.0, edges[-1])
    phase = np.clip(np.searchsorted(edges, inside, side="right") - 1, 0, 6)
    share = _advance(states[:, phase], jerks[phase], inside - edges[phase])
    share[0] = np.clip(share[0], 0.0, 1.0)
    share[1:, (t <= 0.0) | (t >= edges[-1])] = 0.0
    return share
