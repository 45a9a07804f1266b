"""Search for the most informative joint motion within its limits: barriers and quasi-Newton steps."""

import time
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.excitation.clamped_spline import ClampedSpline
from poise.excitation.hand import HandMotion, HandSlopes, hand_slopes
from poise.excitation.information import Information
from poise.excitation.limits import Guard, MotionLimits, position_range
from poise.inertia.model import motion_signals
from poise.robot import RobotModel
from poise.types import Array, Cancelled, Progress

SAMPLES_A_SECOND = 50
MOST_SAMPLES = 400
_BARRIERS = (0.3, 0.03, 0.003)
"""Nats that a constraint is feared by, from the first round to the last."""
_SMOOTH = 1e-3
"""m/s and rad/s: rounds off the absolute value of a velocity at zero."""
_SPARE = 0.985
"""Share of the speed limit that is searched in; the rest is for what happens between samples."""


@dataclass(frozen=True)
class SearchEffort:
    """How hard to search. The same effort gives the same motion.

    Args:
        starts: random motions that are improved a little; the best of them is improved further.
        first, steps: quasi-Newton steps of the former, and of each round of the latter.
        time_limit: s after which the best so far is taken.
    """

    starts: int = 4
    first: int = 15
    steps: int = 60
    time_limit: float = 20.0


class ExcitationObjective:
    """Barrier function of a motion: minus its information, plus what it fears of every bound.

    Unknowns are spline coefficients (F, A) of the A joints that may move, in units of `scale`.
    """

    def __init__(
        self,
        model: RobotModel,
        start: Array,
        active: Array,
        spline: ClampedSpline,
        guard: Guard,
        limits: MotionLimits,
        information: Information,
    ) -> None:
        self._model, self._start, self._spline, self._guard = model, start, spline, guard
        self._limits, self._information = limits, information
        self._columns = np.flatnonzero(active)
        lower, upper = position_range(model, start)
        speed = np.minimum(limits.joint_speed * model.velocity_limit, 1e3)[self._columns]
        self._bounds = (
            (np.maximum(lower - start, -10.0)[self._columns], np.minimum(upper - start, 10.0)[self._columns]),
            (-speed, speed),
            (np.full(len(speed), -limits.acceleration), np.full(len(speed), limits.acceleration)),
        )
        # Coefficients in units of what their acceleration would allow: then no direction is much steeper than another.
        self.scale = limits.acceleration / np.abs(spline.polygons[2]).max(axis=0)[:, None]

    @property
    def shape(self) -> tuple[int, int]:
        """(F, A)."""
        return self._spline.size, len(self._columns)

    def displacement(self, unknowns: Array) -> Array:
        """(F, J) coefficients in rad or m."""
        whole = np.zeros((self._spline.size, len(self._start)))
        whole[:, self._columns] = unknowns.reshape(self.shape) * self.scale
        return whole

    def __call__(self, unknowns: Array, fear: float) -> tuple[float, Array]:
        """Value and gradient; infinite where a bound is broken."""
        coefficients = self.displacement(unknowns)
        barrier, gradient = self._joint_barrier(coefficients[:, self._columns])
        if not np.isfinite(barrier):
            return np.inf, gradient.ravel()
        q, v, a = (basis @ coefficients for basis in self._spline.values)
        hand, slopes = hand_slopes(self._model, self._start + q, v, a)
        by_hand, felt = self._hand_barrier(hand, slopes)
        if not np.isfinite(by_hand):
            return np.inf, gradient.ravel()
        nats, gained = self._gained(hand, slopes)
        parts = [fear * f - t for f, t in zip(felt, gained, strict=True)]
        slope = sum(basis.T @ part[:, self._columns] for basis, part in zip(self._spline.values, parts, strict=True))
        return fear * (barrier + by_hand) - nats, ((fear * gradient + slope) * self.scale).ravel()

    def _joint_barrier(self, coefficients: Array) -> tuple[float, Array]:
        value, gradient = 0.0, np.zeros_like(coefficients)
        for polygon, (low, high) in zip(self._spline.polygons, self._bounds, strict=True):
            points = polygon @ coefficients
            inside = np.any(polygon != 0, axis=1)
            below, above = (points - low)[inside], (high - points)[inside]
            if (below <= 0).any() or (above <= 0).any():
                return np.inf, gradient
            width = (high - low) / 2
            value -= float(np.log(below / width).sum() + np.log(above / width).sum())
            gradient += polygon[inside].T @ (1 / above - 1 / below)
        return value, gradient

    def _hand_barrier(self, hand: HandMotion, slopes: HandSlopes) -> tuple[float, list[Array]]:
        """Of the speed of every guarded point, and of how far the tool goes."""
        points, radius = self._guard.points, self._guard.radius
        velocity = hand.velocity[:, None] + np.cross(hand.omega[:, None], points)
        speed = np.sqrt((velocity**2).sum(axis=2) + _SMOOTH**2)
        turning = np.sqrt((hand.omega**2).sum(axis=1) + _SMOOTH**2)
        limit = _SPARE * self._limits.speed
        room = limit - speed - radius * turning[:, None]
        tool = hand.position + hand.rotation @ self._guard.tcp
        away = tool - self._first_tool(tool)
        near = self._limits.room**2 - (away**2).sum(axis=1)
        if (room <= 0).any() or (near <= 0).any():
            return np.inf, []
        value = -float(np.log(room / limit).sum() / len(points) + np.log(near / self._limits.room**2).sum())
        weight = 1 / (room * len(points))
        push = velocity * (weight / speed)[:, :, None]
        by_velocity = push.sum(axis=1)
        by_omega = np.cross(points, push).sum(axis=1) + (radius * weight.sum(axis=1) / turning)[:, None] * hand.omega
        by_tool = np.einsum("nji,nj->ni", hand.rotation, 2 * away / near[:, None])
        arm = slopes.moving_a - np.cross(self._guard.tcp[None, :, None], slopes.turning_a, axis=1)
        by_q = _pull(by_velocity, slopes.velocity_q) + _pull(by_omega, slopes.omega_q) + _pull(by_tool, arm)
        by_v = _pull(by_velocity, slopes.moving_a) + _pull(by_omega, slopes.turning_a)
        return value, [by_q, by_v, np.zeros_like(by_v)]

    def _first_tool(self, tool: Array) -> Array:
        if not hasattr(self, "_tool"):
            still = np.zeros((1, len(self._start)))
            hand, _ = hand_slopes(self._model, self._start[None], still, still)
            self._tool: Array = hand.position[0] + hand.rotation[0] @ self._guard.tcp
        return self._tool

    def _gained(self, hand: HandMotion, slopes: HandSlopes) -> tuple[float, list[Array]]:
        """Information, and its derivative by joint positions, velocities and accelerations (N, J)."""
        signals = motion_signals(hand.specific, hand.omega, hand.alpha)
        nats, by_signal = self._information.slope(signals, self._spline.duration / len(signals))
        by_u, by_alpha, squares = by_signal[:, :3], by_signal[:, 3:6], by_signal[:, 6:12]
        matrix = squares[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3) * (1 + np.eye(3))
        by_omega = np.einsum("nij,nj->ni", matrix, hand.omega)
        by_q = _pull(by_u, slopes.specific_q) + _pull(by_alpha, slopes.alpha_q) + _pull(by_omega, slopes.omega_q)
        by_v = _pull(by_u, slopes.specific_v) + _pull(by_alpha, slopes.alpha_v) + _pull(by_omega, slopes.turning_a)
        by_a = _pull(by_alpha, slopes.turning_a) - _pull(by_u, slopes.moving_a)
        return nats, [by_q, by_v, by_a]


def _pull(weights: Array, slopes: Array) -> Array:
    """(N, J) derivative by joints of a number with derivative (N, 3) by a vector that moves by (N, 3, J)."""
    return np.asarray(np.einsum("nk,nkj->nj", weights, slopes))


def search(
    objective: ExcitationObjective,
    effort: SearchEffort,
    rng: np.random.Generator,
    progress: Progress,
    cancelled: Cancelled,
) -> Array:
    """(F, J) coefficients of the best motion found.

    Raises:
        PoiseError: CANCELLED.
        NoAnswerError: UNREACHABLE when not even a small motion keeps to the limits.
    """
    clock = _Clock(effort, progress, cancelled)
    found: list[tuple[float, Array]] = []
    for _ in range(effort.starts):
        unknowns = _feasible(objective, rng.normal(size=objective.shape).ravel())
        if unknowns is not None:
            found.append(_descend(objective, unknowns, _BARRIERS[0], effort.first, clock))
    if not found:
        raise NoAnswerError(
            ErrorCode.UNREACHABLE,
            "no motion from here keeps to the limits: the arm stands at the end of a joint's range, or the speed limit"
            " is too low for an object of this size; move the arm, or use stop-and-go",
        )
    best = min(found, key=lambda one: one[0])[1]
    for fear in _BARRIERS:
        best = _descend(objective, best, fear, effort.steps, clock)[1]
    return objective.displacement(best)


def check(cancelled: Cancelled) -> None:
    """Raise PoiseError CANCELLED when the caller asks for it."""
    if cancelled():
        raise PoiseError(ErrorCode.CANCELLED, "the planning of the motion was cancelled")


class _Clock:
    """Counts steps; says how far the search is, and when to stop."""

    def __init__(self, effort: SearchEffort, progress: Progress, cancelled: Cancelled) -> None:
        self._total = effort.starts * effort.first + len(_BARRIERS) * effort.steps
        self._deadline = time.monotonic() + effort.time_limit
        self._done, self._progress, self._cancelled = 0, progress, cancelled

    def out_of_time(self) -> bool:
        """One step more is wanted."""
        check(self._cancelled)
        self._done += 1
        self._progress(min(self._done / self._total, 1.0))
        return time.monotonic() > self._deadline


def _feasible(objective: ExcitationObjective, unknowns: Array) -> Array | None:
    """A random motion made so small that it keeps to the limits."""
    for _ in range(30):
        if np.isfinite(objective(unknowns, _BARRIERS[0])[0]):
            return np.asarray(unknowns / 2)
        unknowns = unknowns / 2
    return None


def _descend(
    objective: ExcitationObjective, unknowns: Array, fear: float, steps: int, clock: _Clock
) -> tuple[float, Array]:
    """BFGS with backtracking (Nocedal and Wright 2006, algorithm 6.1), which a barrier's infinity cannot upset."""
    value, gradient = objective(unknowns, fear)
    inverse = np.eye(len(unknowns)) * 0.1 / max(float(np.linalg.norm(gradient)), 1e-12)
    for step in range(steps):
        if clock.out_of_time():
            break
        direction = -inverse @ gradient
        descent = float(direction @ gradient)
        if descent > -1e-6:
            break
        length = 1.0
        for _ in range(25):
            there, slope = objective(unknowns + length * direction, fear)
            if there < value + 1e-4 * length * descent:
                break
            length /= 2
        else:
            break
        moved, turned = length * direction, slope - gradient
        unknowns, value, gradient = unknowns + moved, there, slope
        along = float(moved @ turned)
        if along > 1e-12:
            if step == 0:
                inverse = np.eye(len(unknowns)) * along / float(turned @ turned)
            left = np.outer(moved, turned) / along
            inverse = inverse - left @ inverse
            inverse = inverse - inverse @ left.T + np.outer(moved, moved) / along
    return value, unknowns
