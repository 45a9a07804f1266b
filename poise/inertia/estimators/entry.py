"""What the registry knows of an estimator: what it needs, what it gives, and how it takes samples."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from poise.inertia.estimators.answer import Method
from poise.inertia.estimators.streaming import Prior, StreamingEstimator


class MotionNeed(Enum):
    """The samples that an estimator takes."""

    STILL = "poses held still"
    MOVING = "smoothed motion"
    EITHER = "smoothed motion, or poses held still where there is none"


@dataclass(frozen=True)
class EstimatorEntry:
    """One estimator of the registry.

    Args:
        name: by which users choose it.
        summary: one line for the help.
        estimate: the batch form: all samples of a problem at once; None when there is none.
        stream: makes the streaming form of a prior.
        motion: the samples that it takes.
        needs_shape: it gives no answer without the parts of the object.
        needs_every_parameter: it gives no answer when the motion hides a parameter.
        estimates_bias: it allows for a sensor that reads something without a load.
        gives_covariance: its covariance is finite where a parameter was seen.
        answers_hidden: with a prior of the bias it answers even where least squares see nothing.
        uses_imu: the linear acceleration of an IMU is worth having.
    """

    name: str
    summary: str
    estimate: Method | None
    stream: Callable[[Prior], StreamingEstimator]
    motion: MotionNeed = MotionNeed.EITHER
    needs_shape: bool = False
    needs_every_parameter: bool = False
    estimates_bias: bool = True
    gives_covariance: bool = False
    answers_hidden: bool = False
    uses_imu: bool = True
