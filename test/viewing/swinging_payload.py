"""A known payload on a swinging sensor, identified from noisy wrenches: what the viewing tests draw."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from poise.geometry import GRAVITY_IN_WORLD
from poise.inertia import InformationAccumulator, solve
from poise.inertia.model import regressor
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.pipeline.estimate import Identification, InertialEstimate, RejectedInterval
from poise.robot import SensorMotion

START = 1_708_857_503_000_000_000
TRUTH = InertialParameters(0.932, np.array([0.001, -0.002, 0.0439]), np.diag([1.1e-3, 1.4e-3, 0.7e-3]))
BIAS = np.array([9.08, -1.02, 9.98, 0.43, -0.69, -0.15])
NOISE = np.array([0.09, 0.09, 0.09, 0.003, 0.003, 0.003])


def swing(n: int, duration: float = 6.0) -> SensorMotion:
    """A smooth turn about three axes that also shakes; the rates come from differences of the attitude."""
    t = np.linspace(0, duration, n)
    angles = np.stack([1.2 * np.sin(1.3 * t), 0.9 * np.sin(2.1 * t + 0.5), 1.1 * np.sin(1.7 * t + 1.0)], axis=1)
    rotation = Rotation.from_euler("xyz", angles)
    step = 1e-4
    ahead = Rotation.from_euler("xyz", angles + step * np.gradient(angles, t, axis=0))
    omega = (rotation.inv() * ahead).as_rotvec() / step
    alpha = np.gradient(omega, t, axis=0)
    acceleration = 0.4 * np.stack([np.sin(3 * t), np.cos(2 * t), np.sin(5 * t)], axis=1)
    return SensorMotion(START + np.round(t * 1e9).astype(np.int64), rotation.as_matrix(), omega, alpha, acceleration)


def estimate_of(
    rows: np.ndarray, wrench: np.ndarray, stamp: int, rejected: tuple[RejectedInterval, ...] = ()
) -> InertialEstimate:
    """Poise's own least squares."""
    information = InformationAccumulator()
    information.add(rows, wrench)
    return InertialEstimate.from_solution(
        solve(information), stamp=stamp, frame_id="ft_sensor", method="ols", rejected=rejected
    )


def identify_motion(motion: SensorMotion, seed: int = 1, estimates: int = 30) -> Identification:
    """Identify the known payload from a motion; 55 to 60 % of the samples are rejected."""
    rng = np.random.default_rng(seed)
    n = len(motion)
    specific = motion.gravity_in_sensor(GRAVITY_IN_WORLD) - motion.linear_acceleration_in_sensor
    rows = regressor(specific, motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor)
    wrench = rows @ TRUTH.phi + BIAS + rng.normal(size=(n, 6)) * NOISE
    first, end = int(0.55 * n), int(0.6 * n)
    interval = RejectedInterval(int(motion.stamps[first]), int(motion.stamps[end - 1]), end - first, "saturated")
    used = np.r_[0:first, end:n]
    rows, wrench, motion = rows[used], wrench[used], motion.select(used)
    counts = np.unique(np.geomspace(min(20, len(used)), len(used), estimates).astype(int))
    history = tuple(
        estimate_of(rows[:count], wrench[:count], int(motion.stamps[count - 1]), (interval,)) for count in counts
    )
    estimate = history[-1]
    predicted = rows @ np.nan_to_num(estimate.phi) + np.nan_to_num(estimate.bias)
    return Identification(estimate, motion.stamps, wrench, predicted, motion, history, "tf")


def with_estimate(identification: Identification, **changes: object) -> Identification:
    """The same identification with some of its estimate's fields changed."""
    return replace(identification, estimate=replace(identification.estimate, **changes))
