"""From a robot's state and an object's size to a motion that weighs it, with proof that it keeps to its limits."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.excitation.certificate import Certificate, certify, slowed
from poise.excitation.clamped_spline import ClampedSpline
from poise.excitation.hand import hand_motion
from poise.excitation.information import SENSOR, Information, PayloadBelief
from poise.excitation.limits import Guard, MotionLimits, check_start, moving_joints
from poise.excitation.search import (
    MOST_SAMPLES,
    SAMPLES_A_SECOND,
    ExcitationObjective,
    SearchEffort,
    search,
)
from poise.excitation.stop_and_go import stop_and_go
from poise.inertia.model import NoiseLevels, Parts, motion_signals
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory
from poise.types import Array, Cancelled, Progress

SHORTEST, LONGEST = 0.5, 60.0
"""s of a motion."""
_WORTHWHILE = 0.1
"""A motion that would leave the mass less certain than this share of it is not made."""


@dataclass(frozen=True)
class ExcitationOptions:
    """What is wanted of a motion.

    Args:
        duration: s of the optimal motion.
        poses: of stop-and-go, the start among them.
        dwell: s at rest in each of those.
        mass: kg, a guess at the payload.
        noise: of sensor and accelerations; how large a bias to expect.
        rate: Hz of the sensor.
        joints: that may move; empty: all but a driving base's.
        seed: of chance; the same one gives the same motion.
        effort: of the search.
    """

    duration: float = 1.5
    poses: int = 5
    dwell: float = 0.75
    mass: float = 1.0
    noise: NoiseLevels = SENSOR
    rate: float = 100.0
    joints: tuple[str, ...] = ()
    seed: int = 0
    effort: SearchEffort = field(default_factory=SearchEffort)

    def __post_init__(self) -> None:
        if not SHORTEST <= self.duration <= LONGEST:
            raise InputError(
                ErrorCode.BAD_INPUT, f"duration is {self.duration} s: between {SHORTEST} and {LONGEST:g} it must be"
            )
        if not (0.1 <= self.dwell <= 10 and 3 <= self.poses <= 7 and 0 < self.mass < 1e3 and 0 < self.rate < 1e5):
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"stop-and-go of {self.poses} poses of {self.dwell} s, payload of {self.mass} kg, sensor at {self.rate}"
                " Hz: 3 to 7 poses, 0.1 to 10 s, positive mass and rate are possible",
            )


@dataclass(frozen=True, eq=False)
class ExcitationPlan:
    """A motion that weighs a payload.

    Args:
        joint_names: (J), as the columns of the motion.
        motion: from the start back to it, at rest at both ends.
        certificate: what it never exceeds.
        information: nats it gives about the ten parameters, see `Information`.
        covariance: (10, 10) of phi that is to be expected, for the payload guessed at.
        belief: that payload.
    """

    joint_names: tuple[str, ...]
    motion: WaypointTrajectory
    certificate: Certificate
    information: float
    covariance: Array
    belief: PayloadBelief

    @property
    def mass_std(self) -> float:
        """kg, one sigma to be expected."""
        return float(np.sqrt(self.covariance[0, 0]))


def believe(guard: Guard, parts: Parts | None, mass: float) -> PayloadBelief:
    """What is thought of the payload: spread over its parts, or over the ball about the tool centre point."""
    if parts is not None:
        return PayloadBelief.of_parts(parts, mass)
    centre = guard.points.mean(axis=0)
    radius = float(np.linalg.norm(guard.points - centre, axis=1).max()) + guard.radius
    return PayloadBelief.ball(centre, radius, mass)


def plan_excitation(
    model: RobotModel,
    start: ArrayLike,
    guard: Guard,
    limits: MotionLimits | None = None,
    options: ExcitationOptions | None = None,
    *,
    parts: Parts | None = None,
    progress: Progress = lambda _: None,
    cancelled: Cancelled = lambda: False,
) -> ExcitationPlan:
    """The most informative motion about a payload in a given time: D-optimal B-splines in joint space.

    Args:
        model: the robot.
        start: (J,) where it is, and where it comes back to.
        guard: what has to stay slow: tool centre point and object.
        limits, options: see there.
        parts: of the object in the sensor frame, when its shape is known.
        progress: called with the share that is done.
        cancelled: asked every few ms.

    Raises:
        InputError: as `check_start` and `moving_joints`.
        NoAnswerError: UNREACHABLE when no motion keeps to the limits, NOT_IDENTIFIABLE when it would be too slow for
            this object to be worth making.
        PoiseError: CANCELLED.
    """
    limits, options = limits or MotionLimits(), options or ExcitationOptions()
    begin, active = check_start(model, start), moving_joints(model, options.joints)
    information = Information(believe(guard, parts, options.mass), options.noise, options.rate)
    spline = ClampedSpline.make(options.duration, min(round(options.duration * SAMPLES_A_SECOND), MOST_SAMPLES))
    objective = ExcitationObjective(model, begin, active, spline, guard, limits, information)
    found = search(objective, options.effort, np.random.default_rng(options.seed), progress, cancelled)
    return finish(model, spline.trajectory(begin, found), guard, limits, options, parts)


def plan_stop_and_go(
    model: RobotModel,
    start: ArrayLike,
    guard: Guard,
    limits: MotionLimits | None = None,
    options: ExcitationOptions | None = None,
    *,
    parts: Parts | None = None,
    progress: Progress = lambda _: None,
    cancelled: Cancelled = lambda: False,
) -> ExcitationPlan:
    """A few poses to rest in, tilted about the tool centre point; arguments and errors as of `plan_excitation`."""
    limits, options = limits or MotionLimits(), options or ExcitationOptions()
    begin, active = check_start(model, start), moving_joints(model, options.joints)
    information = Information(believe(guard, parts, options.mass), options.noise, options.rate)
    motion = stop_and_go(
        model,
        begin,
        active,
        guard,
        limits,
        information,
        poses=options.poses,
        dwell=options.dwell,
        progress=progress,
        cancelled=cancelled,
    )
    return finish(model, motion, guard, limits, options, parts)


def finish(
    model: RobotModel,
    motion: WaypointTrajectory,
    guard: Guard,
    limits: MotionLimits,
    options: ExcitationOptions,
    parts: Parts | None = None,
) -> ExcitationPlan:
    """Certify a motion, stretched in time as far as its limits ask for, and say what it is worth.

    Raises:
        NoAnswerError: SOLVER_FAILED when that does not make it keep to them, UNREACHABLE when it takes too long,
            NOT_IDENTIFIABLE as `plan_excitation`.
    """
    motion, certificate = _kept(model, motion, guard, limits)
    belief = believe(guard, parts, options.mass)
    information = Information(belief, options.noise, options.rate)
    signals, each = _felt(model, motion, options.rate)
    plan = ExcitationPlan(
        model.joint_names,
        motion,
        certificate,
        information.value(signals, each),
        information.covariance(signals, each),
        belief,
    )
    if plan.mass_std > _WORTHWHILE * options.mass:
        raise NoAnswerError(
            ErrorCode.NOT_IDENTIFIABLE,
            f"no motion of {options.duration:g} s under {limits.speed:g} m/s shows the mass of an object that reaches"
            f" {guard.reach:.2f} m from the sensor better than to {plan.mass_std / options.mass:.0%}: take more time,"
            " or stop-and-go",
        )
    return plan


def _kept(
    model: RobotModel, motion: WaypointTrajectory, guard: Guard, limits: MotionLimits
) -> tuple[WaypointTrajectory, Certificate]:
    """The motion, stretched in time as far as its limits ask for, and the proof."""
    certificate = certify(model, motion, guard)
    for _ in range(3):
        factor = certificate.slow_down(limits)
        if factor <= 1.0:
            break
        motion = slowed(motion, factor * (1 + 1e-6))
        certificate = certify(model, motion, guard)
    if motion.duration > LONGEST:
        raise NoAnswerError(
            ErrorCode.UNREACHABLE,
            f"at {limits.speed:g} m/s the motion would take {motion.duration:.0f} s, more than {LONGEST:g}: the object"
            f" reaches {guard.reach:.2f} m from the sensor; raise the limit, or give its shape instead of a radius",
        )
    if not certificate.holds(limits):
        raise NoAnswerError(
            ErrorCode.SOLVER_FAILED,
            f"the motion found could not be certified: {certificate.overrun:.3f} rad beyond a joint's range, tool"
            f" {certificate.room:.3f} m from its start; allow more room, or start elsewhere",
        )
    return motion, certificate


def _felt(model: RobotModel, motion: WaypointTrajectory, rate: float) -> tuple[Array, float]:
    """Motion signals (N, 13) along a motion, and the seconds that each stands for."""
    count = int(np.clip(round(motion.duration * min(rate, 100.0)), 50, 6000))
    each = motion.duration / count
    hand = hand_motion(model, *motion.at(np.asarray((np.arange(count) + 0.5) * each, dtype=np.float64)))
    return motion_signals(hand.specific, hand.omega, hand.alpha), each
