"""What happens in a benchmark: an object, a motion, noise, bias and delay become an identification problem."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.identification.motions import wrist_motion
from benchmarks.identification.objects import BenchmarkObject
from poise.errors import ErrorCode, InputError
from poise.inertia.model.metrics import predict_wrench
from poise.inertia.model.problem import IdentificationProblem, NoiseLevels
from poise.inertia.model.spread_points import spread
from poise.robot import SensorMotion
from poise.types import Array

# Thesis tables 3.2 and 3.7 (which are equal). Its code has 0.2 N and 0.01 N m for `high`; the print is followed.
NOISE = {
    "no": NoiseLevels(force=0.0, torque=0.0, linear_acceleration=0.0, angular_acceleration=0.0),
    "low": NoiseLevels(force=0.05, torque=0.0025, linear_acceleration=0.025, angular_acceleration=0.25),
    "moderate": NoiseLevels(force=0.1, torque=0.005, linear_acceleration=0.05, angular_acceleration=0.5),
    "high": NoiseLevels(force=0.33, torque=0.0067, linear_acceleration=0.1, angular_acceleration=1.0),
}
# Methods know the noise; without noise they get what rounding and drift leave in any sensor.
TOLD_WITHOUT_NOISE = NoiseLevels(force=5e-4, torque=2.5e-5, linear_acceleration=2.5e-4, angular_acceleration=2.5e-3)
FORCE_BIAS, TORQUE_BIAS = 0.5, 0.02  # N, N m: one standard deviation per axis, where a scenario has a bias

RATE = 100.0  # Hz
SAMPLES = 150  # 1.5 s, what a manipulation task leaves for identification (thesis section 3.1.4)
POINT_DENSITY = 0.04e6  # point masses per m3 (thesis section 3.1.4)
# Small tools would get no point at all at that density; they get as many as the thesis' object had.
MIN_POINTS = 56

# Seeds that methods may be tuned on, and fresh ones for the final figures.
DEVELOPMENT_SEEDS = range(0, 8)
FINAL_SEEDS = range(7_100, 7_108)


@dataclass(frozen=True)
class Scenario:
    """What is simulated.

    Args:
        name: for tables.
        speed: mean angular speed of a 1.5 s wrist motion, rad/s; None for the tool's own stop-and-go motion.
        noise: a key of `NOISE`.
        bias: the sensor reads something with nothing on it, unknown, drawn for each trial.
        delay: of the wrench against the kinematics, s: wrench stamps are late by this much.
    """

    name: str
    speed: float | None = None
    noise: str = "moderate"
    bias: bool = False
    delay: float = 0.0


@dataclass(frozen=True, eq=False)
class Trial:
    """One problem and what is true about it.

    Args:
        problem: what a method gets to see.
        clean: the same without noise and bias, with the wrench on time.
        bias: (6,) N and N m.
        subject: the object.
    """

    problem: IdentificationProblem
    clean: IdentificationProblem
    bias: Array
    subject: BenchmarkObject


def make_trial(subject: BenchmarkObject, scenario: Scenario, seed: int) -> Trial:
    """The problem of one object, scenario and seed; the same three give the same numbers.

    Raises:
        InputError: UNSUPPORTED for stop-and-go of an object that has no such motion.
    """
    rng = np.random.default_rng([seed, *subject.name.encode()])
    motion, wrench_at = _truth(subject, scenario, rng)
    given, level = _given(scenario), NOISE[scenario.noise]
    clean = IdentificationProblem.from_motion(
        motion,
        wrench_at(motion.seconds),
        noise=given,
        unit_parts=subject.unit_parts,
        part_volumes=subject.part_volumes,
        shape_points=point_masses(subject),
    )
    n = len(motion)
    bias = rng.normal(0.0, np.repeat([FORCE_BIAS, TORQUE_BIAS], 3)) if scenario.bias else np.zeros(6)
    problem = replace(
        clean,
        wrench=wrench_at(motion.seconds - scenario.delay) + bias + rng.normal(size=(n, 6)) * level.wrench,
        linear_acceleration=clean.linear_acceleration + rng.normal(size=(n, 3)) * level.linear_acceleration,
        angular_acceleration=clean.angular_acceleration + rng.normal(size=(n, 3)) * level.angular_acceleration,
    )
    return Trial(problem, clean, bias, subject)


def point_masses(subject: BenchmarkObject) -> Array:
    """(P, 3) m, the points of PMD inside an object."""
    return spread(subject.points, max(MIN_POINTS, round(POINT_DENSITY * subject.volume)))


def _given(scenario: Scenario) -> NoiseLevels:
    level = TOLD_WITHOUT_NOISE if scenario.noise == "no" else NOISE[scenario.noise]
    return replace(level, force_bias=FORCE_BIAS, torque_bias=TORQUE_BIAS) if scenario.bias else level


def _truth(
    subject: BenchmarkObject, scenario: Scenario, rng: np.random.Generator
) -> tuple[SensorMotion, Callable[[Array], Array]]:
    """The motion at its stamps, and the true wrench at any time in seconds since the first of them."""
    if scenario.speed is not None:
        seconds = np.arange(SAMPLES) / RATE
        motion_at = wrist_motion(rng, scenario.speed, seconds)
        return motion_at(seconds), lambda times: predict_wrench(subject.truth, motion_at(times))
    if subject.stop_and_go is None:
        raise InputError(ErrorCode.UNSUPPORTED, f"{subject.name} has no stop-and-go motion; give a speed")
    motion = subject.stop_and_go
    spline = CubicSpline(motion.seconds, predict_wrench(subject.truth, motion))
    # Before the first sample the robot stands.
    return motion, lambda times: np.asarray(spline(np.clip(times, 0.0, motion.seconds[-1])))
