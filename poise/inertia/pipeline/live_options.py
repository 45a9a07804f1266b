"""The settings of a live estimator."""

from dataclasses import dataclass, field

import numpy as np

from poise.geometry import STANDARD_GRAVITY
from poise.inertia.bayes import SHAPE_ACCURACY
from poise.inertia.estimators import AUTO, DEFAULT_METHOD
from poise.inertia.model import UNKNOWN_NOISE, NoiseLevels, Parts
from poise.robot import PairingSettings

JOINTS, FRAMES = "joint_states", "tf"
SOURCES = (AUTO, JOINTS, FRAMES)

ALWAYS, NEVER = "always", "never"
IMUS = (AUTO, ALWAYS, NEVER)

FLUSH_AFTER = 0.5
"""s without any message after which the pipeline waits no longer, by default."""


@dataclass(frozen=True)
class LiveOptions:
    """The settings of a live estimator.

    Args:
        sensor_frame: frame of the wrench; empty: that of its first message.
        base_frame: gravity-aligned frame in tf; empty: the topmost.
        motion_source: `joint_states`, `tf`, or `auto`: joint states when they and a robot description come, else tf.
        imu: `always`, `never`, or `auto`: an IMU that tf_static joins to the sensor gives the linear acceleration where
            tf has attitudes only. On a base that moves, `always` gives what joint states cannot.
        gravity: m/s2.
        method: see `OnlineEstimator`.
        parts: of the payload, in the sensor frame; None when its shape is not known.
        accuracy, noise, window, continuous: see `OnlineEstimator`.
        saturation: force [N] and torque [N m] at which a channel counts as saturated.
        settings: how wrenches and motion are brought together.
        flush_after: s without any message after which wrenches wait no longer for later motion.
    """

    sensor_frame: str = ""
    base_frame: str = ""
    motion_source: str = AUTO
    imu: str = AUTO
    gravity: float = STANDARD_GRAVITY
    method: str = DEFAULT_METHOD
    parts: Parts | None = None
    accuracy: float = SHAPE_ACCURACY
    noise: NoiseLevels = UNKNOWN_NOISE
    window: float = np.inf
    continuous: bool = False
    saturation: tuple[float, float] = (np.inf, np.inf)
    settings: PairingSettings = field(default_factory=PairingSettings)
    flush_after: float = FLUSH_AFTER
