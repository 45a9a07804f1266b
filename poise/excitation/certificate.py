"""Bounds that prove that a motion keeps its limits at every instant, also between samples."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import comb

from poise.excitation.hand import HandMotion, hand_motion
from poise.excitation.limits import Guard, MotionLimits, position_range
from poise.geometry import cross_matrix
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory
from poise.types import Array

_STEP = 1e-3
"""s between the instants whose neighbourhoods cover a motion."""
_MOST_STEPS = 60_000
_ENTRIES = 1 << 20
"""Speeds that are worked out at a time, which bounds the memory."""
_SPLITS = 4
"""Pieces that each stretch between waypoints is cut into, for tighter bounds of its polynomials."""


@dataclass(frozen=True)
class Certificate:
    """Upper bounds of a motion that hold at every instant of it.

    Args:
        speed: m/s of the fastest guarded point.
        joint_speed: largest share of a joint's velocity limit.
        acceleration: rad/s2 or m/s2, of any joint.
        overrun: rad or m that a joint leaves the range kept (a margin inside its own); zero when none does.
        room: m that the tool centre point goes from where it starts.
        duration: s.
    """

    speed: float
    joint_speed: float
    acceleration: float
    overrun: float
    room: float
    duration: float

    def slow_down(self, limits: MotionLimits) -> float:
        """By how much the motion has to be stretched in time to keep its limits; 1 or less when it does."""
        return max(
            self.speed / limits.speed,
            self.joint_speed / limits.joint_speed,
            float(np.sqrt(self.acceleration / limits.acceleration)),
        )

    def holds(self, limits: MotionLimits) -> bool:
        """The motion keeps to all limits."""
        return self.slow_down(limits) <= 1.0 and self.overrun <= 1e-9 and self.room <= limits.room * (1 + 1e-9)


def certify(model: RobotModel, motion: WaypointTrajectory, guard: Guard) -> Certificate:
    """Bound a motion everywhere.

    Joints: between waypoints they are polynomials, which stay within their Bernstein coefficients. Points: with
    p(t + s) = p + v s + a s^2 / 2 + ..., the speed at most h/2 away from a sample is at most the greater of
    |v +- a h/2|, plus h^2/8 times a bound of the third derivative (`_jerk`); norms are convex, so the ends are enough.
    """
    lower, upper = position_range(model, motion.position[0])
    bounds = _polynomial_bounds(motion)
    low, high = bounds[0]
    rate, change, third = (np.maximum(np.abs(least), np.abs(greatest)) for least, greatest in bounds[1:])
    step = max(_STEP, motion.duration / _MOST_STEPS)
    count = max(int(np.ceil(motion.duration / step)), 1)
    step = motion.duration / count
    hand = hand_motion(model, *motion.at(np.asarray((np.arange(count) + 0.5) * step, dtype=np.float64)))
    jerk, spin = (
        _jerk(_reaches(model, guard, high - low), rate, change, third),
        _jerk(np.ones_like(rate), rate, change, third),
    )
    half, left = step / 2, step**2 / 8
    turning = _largest(hand.omega, hand.alpha, half) + spin * left
    speed = _fastest(hand, guard.points, half) + jerk * left + guard.radius * turning
    tool_jerk = _jerk(_reaches(model, Guard.ball(guard.tcp, 0.0), high - low), rate, change, third)
    tool_speed = _fastest(hand, guard.tcp[None], half) + tool_jerk * left
    tool = hand.position + hand.rotation @ guard.tcp
    first = hand_motion(model, *motion.at(np.zeros(1)))
    away = np.linalg.norm(tool - first.position - first.rotation @ guard.tcp, axis=1)
    return Certificate(
        speed=float(speed.max()),
        joint_speed=float((rate / model.velocity_limit).max()),
        acceleration=float(change.max()),
        overrun=float(max((lower - low).max(), (high - upper).max(), 0.0)),
        room=float(away.max() + tool_speed.max() * half),
        duration=motion.duration,
    )


def joint_peaks(motion: WaypointTrajectory) -> tuple[Array, Array]:
    """(J,) twice: bounds of the speed (rad/s or m/s) and acceleration of each joint at every instant of a motion."""
    bounds = _polynomial_bounds(motion, (1, 2))
    rate, change = (np.maximum(np.abs(least), np.abs(greatest)) for least, greatest in bounds)
    return np.asarray(rate), np.asarray(change)


def slowed(motion: WaypointTrajectory, factor: float) -> WaypointTrajectory:
    """The same path, stretched in time."""
    velocity, acceleration = np.asarray(motion.velocity), np.asarray(motion.acceleration)
    return WaypointTrajectory(motion.times * factor, motion.position, velocity / factor, acceleration / factor**2)


def _fastest(hand: HandMotion, points: Array, half: float) -> Array:
    """(N,) m/s: the largest |v +- half a| of points (P, 3) rigid with the hand.

    In sensor axes v = v0 + omega x p, and its derivative as seen from the world is a = a0 + alpha x p + omega x (omega
    x p). v +- half a is affine in p and its square a quadratic form, so all points are done by one matrix product.
    """
    x, y, z = points.T
    monomials = np.array([np.ones_like(x), x, y, z, x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z])
    spin, change = cross_matrix(hand.omega), cross_matrix(hand.alpha)
    change = change + spin @ spin
    rows = max(_ENTRIES // len(points), 1)
    largest = np.zeros(len(spin))
    for sign in (half, -half):
        constant = hand.velocity + sign * hand.acceleration
        linear = spin + sign * change
        square = linear.swapaxes(1, 2) @ linear
        form = np.column_stack(
            [
                (constant**2).sum(axis=1),
                2 * np.einsum("ni,nij->nj", constant, linear),
                square[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
            ]
        )
        for at in range(0, len(form), rows):
            part = slice(at, at + rows)
            largest[part] = np.maximum(largest[part], (form[part] @ monomials).max(axis=1))
    return np.asarray(np.sqrt(largest))


def _largest(vector: Array, slope: Array, half: float) -> Array:
    """(N,) the larger of |vector +- half slope|."""
    step = half * slope
    return np.asarray(np.maximum(np.linalg.norm(vector + step, axis=1), np.linalg.norm(vector - step, axis=1)))


def _polynomial_bounds(motion: WaypointTrajectory, orders: Sequence[int] = (0, 1, 2, 3)) -> list[tuple[Array, Array]]:
    """(J,) least and greatest of derivatives of the joints: position (0), velocity, acceleration, jerk (3)."""
    if len(motion.times) == 1:
        still = np.zeros(motion.position.shape[1])
        return [(motion.position[0], motion.position[0]) if order == 0 else (still, still) for order in orders]
    powers = motion.polynomials
    span = np.diff(motion.times)[:, None]
    powers = powers * span ** np.arange(6)[:, None, None]  # in u = 0..1 of each stretch
    out = []
    for order in orders:
        points = (_bernstein(order) @ powers.reshape(6, -1)).reshape(-1, *powers.shape[1:])
        least, greatest = points.min(axis=0), points.max(axis=0)
        out.append(((least / span**order).min(axis=0), (greatest / span**order).max(axis=0)))
    return out


@functools.cache
def _bernstein(order: int) -> Array:
    """(P, 6) from a quintic's power coefficients on [0, 1] to the Bernstein coefficients of a derivative in pieces."""
    differentiated = np.eye(6)
    for _ in range(order):
        differentiated = differentiated[1:] * np.arange(1, len(differentiated))[:, None]
    degree = len(differentiated) - 1
    pieces = [_bernstein_piece(degree, piece / _SPLITS, 1 / _SPLITS) for piece in range(_SPLITS)]
    return np.asarray(np.vstack(pieces) @ differentiated)


def _bernstein_piece(degree: int, begin: float, width: float) -> Array:
    """(d + 1, d + 1) from power coefficients on [0, 1] to Bernstein coefficients on [begin, begin + width]."""
    k = np.arange(degree + 1)
    shift = np.array([[comb(j, i) * begin ** (j - i) * width**i if j >= i else 0.0 for j in k] for i in k])
    bernstein = np.array([[comb(b, i) / comb(degree, i) if i <= b else 0.0 for i in k] for b in k])
    return np.asarray(bernstein @ shift)


def _reaches(model: RobotModel, guard: Guard, travel: Array) -> Array:
    """(J,) m that no guarded point is ever farther from each joint than: the links between, laid end to end."""
    pinocchio = model.pinocchio
    sensor = pinocchio.frames[model.frame_id(model.sensor_frame)]
    length = float(np.linalg.norm(sensor.placement.translation)) + guard.reach
    by_joint = {}
    joint = sensor.parentJoint
    while joint > 0:
        name = pinocchio.names[joint]
        slides = name in model.joint_names and "Pris" in pinocchio.joints[joint].shortname()[10:]
        slides |= pinocchio.joints[joint].shortname() in ("JointModelPX", "JointModelPY", "JointModelPZ")
        if slides:
            index = model.joint_names.index(name)
            length += float(np.abs(np.nan_to_num([model.lower[index], model.upper[index]], posinf=0, neginf=0)).max())
            length = max(length + float(travel[index]), 1.0)  # a slide moves every point by its whole step
        by_joint[joint] = length
        length += float(np.linalg.norm(pinocchio.jointPlacements[joint].translation))
        joint = pinocchio.parents[joint]
    reaches = np.array([by_joint.get(i, 0.0) for i in range(1, pinocchio.njoints)])
    return np.asarray(np.abs(model.coupling).T @ reaches)


def _jerk(reach: Array, rate: Array, change: Array, third: Array) -> float:
    """A bound of the third derivative of a point of a chain of turning joints.

    A derivative of the point by joints i, j, k is a nest of cross products of unit axes with an arm from the outermost
    of them, no longer than its reach.
    """
    order = np.argsort(-reach)  # from the base outwards
    reach, rate, change, third = reach[order], rate[order], change[order], third[order]
    i = np.arange(len(reach))
    outer = np.maximum(i[:, None], i)
    pairs = reach[outer]
    triples = reach[np.maximum(outer[:, :, None], i)]
    cubic = np.einsum("ijk,i,j,k->", triples, rate, rate, rate)
    return float(cubic + 3 * rate @ pairs @ change + reach @ third)
