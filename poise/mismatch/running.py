"""Running the simulation along a recorded motion: the wrench that a model, with its effects, expects."""

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.diagnosis import with_components
from poise.mismatch.reading import Reading
from poise.recording import WrenchStream

Array = NDArray[np.float64]

NOISE = (0.1, 0.005)
"""N and N m: where a model states no noise, an FT-300's (thesis table 3.2, moderate)."""


def expected_wrench(reading: Reading, rng: np.random.Generator | None = None) -> WrenchStream:
    """What the sensor should read along a recording's motion.

    Args:
        reading: the motion, and the model with its effects; events in the model stay in the recording they are of.
        rng: adds the model's white noise; None: none.
    """
    model = reading.model
    world = with_components(reading.world, model.effects)
    wrench = np.array(world.prediction)
    if rng is not None:
        given = (model.noise_force or NOISE[0], model.noise_torque or NOISE[1])
        wrench += rng.normal(size=wrench.shape) * np.repeat(given, 3)
    stamps = world.start + np.round(world.seconds * 1e9).astype(np.int64)
    return WrenchStream(stamps, wrench, model.sensor_frame or "ft_sensor")
