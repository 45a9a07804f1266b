"""How samples are handed to an estimator, live and from a recording, and what is known before the first sample."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

import numpy as np

from poise.geometry import GRAVITY_IN_WORLD
from poise.inertia.bayes import LAG_STEP, LOAD_ACCURACY, LONGEST_DELAY, SHAPE_ACCURACY
from poise.inertia.estimators.accelerometer import Accelerometer
from poise.inertia.model import UNKNOWN_NOISE, InertialSolution, NoiseLevels, Parts, regressor
from poise.robot import IMU_LAG_STEP, SensorMotion
from poise.types import Array


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before the first sample.

    Args:
        parts: of the object, in the sensor frame; None when its shape is not known.
        accuracy: relative error of lengths in that shape.
        noise: of samples, and the spread of the bias; NaN where the samples have to show it.
        gravity: (3,) m/s2 in the world.
        window: s of samples, for estimators that keep samples; infinite: all since the start.
        tare: (6,) what the sensor is known to read without a load; `noise` gives its spread. N and N m.
        since: ns; earlier samples belong to another payload. None: they do not.
        longest_delay, lag_step: s, see `PoiseEstimator`.
        accelerometer: what gave the linear acceleration.
    """

    parts: Parts | None = None
    accuracy: float = SHAPE_ACCURACY
    noise: NoiseLevels = UNKNOWN_NOISE
    gravity: Array = field(default_factory=lambda: np.array(GRAVITY_IN_WORLD))
    window: float = np.inf
    tare: Array = field(default_factory=lambda: np.zeros(6))
    since: int | None = None
    longest_delay: float = LONGEST_DELAY
    lag_step: float = LAG_STEP
    accelerometer: Accelerometer = Accelerometer.NONE

    @property
    def options(self) -> dict[str, Any]:
        """Of a `PoiseEstimator`. Where the samples have to show the noise, they come from a real sensor."""
        real = np.isnan([self.noise.force, self.noise.torque]).any()
        load_accuracy = LOAD_ACCURACY if real else 0.0
        averaged = self.lag_step == IMU_LAG_STEP
        known = {"gravity": self.gravity, "shape_accuracy": self.accuracy}
        return known | {"load_accuracy": load_accuracy, "averaged": averaged}


@dataclass(frozen=True, eq=False)
class SampleEvidence:
    """What the pipeline knows of the samples, for an estimator that is asked for its solution.

    Args:
        noise: of samples, and the spread of the bias; no NaN.
        least_squares: what weighted least squares show when nothing is known of the bias; None: nothing.
    """

    noise: NoiseLevels
    least_squares: InertialSolution | None


class StreamingEstimator(Protocol):
    """Takes checked samples in the order of time. Its answer does not depend on the portions that they come in."""

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        """Take samples: a motion, and the wrench (N, 6) at its stamps."""

    def solve(self, evidence: SampleEvidence) -> InertialSolution:
        """Estimate from all samples so far.

        Raises:
            InputError: UNSUPPORTED when the estimator needs a shape and there is none.
            NoAnswerError: TOO_FEW_SAMPLES, NOT_IDENTIFIABLE, SOLVER_FAILED.
        """


def model_matrix(motion: SensorMotion, gravity: Array) -> Array:
    """(N, 6, 10) regressor of a motion, for a gravity vector (3,) in the world."""
    return regressor(
        motion.gravity_in_sensor(gravity) - motion.linear_acceleration_in_sensor,
        motion.angular_velocity_in_sensor,
        motion.angular_acceleration_in_sensor,
    )


def joined(motions: Sequence[SensorMotion]) -> SensorMotion:
    """Motions one after the other."""
    names = [each.name for each in fields(SensorMotion)]
    return SensorMotion(*(np.concatenate([getattr(motion, name) for motion in motions]) for name in names))
