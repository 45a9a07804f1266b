"""A case before anything is wrong with it: what is carried, how the robot moves, and what that would look like."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from benchmarks.concealed.engine import Engine, Log
from benchmarks.concealed.motions import Motion
from benchmarks.concealed.payload import Payload
from poise.types import Array


@dataclass(frozen=True)
class Scene:
    """Payload and motion.

    Args:
        payload: what is carried in truth.
        motion: what the robot does.
    """

    payload: Payload
    motion: Motion

    @cached_property
    def preview(self) -> Log:
        """The motion of a rigid payload, at 100 Hz: effects are placed where they matter."""
        return Engine(self.payload, self.motion, step=0.01).run()

    def point(self, place: Array) -> Array:
        """(K, 3) m in the world, of a point of the load (3,), at the preview's times."""
        return np.asarray(self.preview.position_in_world + self.preview.rotation_world_sensor @ place)

    def carrying(self, payload: Payload) -> "Scene":
        """The same motion with another payload."""
        return replace(self, payload=payload)
