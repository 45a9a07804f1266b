"""Troubles that act on the load or on what the robot stands on; MuJoCo simulates them."""

from typing import Any

import numpy as np

from benchmarks.foreign.events import MassStep
from benchmarks.foreign.fault import LoadFault, direction
from benchmarks.foreign.motions import drive
from benchmarks.foreign.robots import Array
from benchmarks.foreign.world import GRAVITY, Scene, Track, World

RAMP = 0.15
"""s in which a contact is closed or opened."""


class Resting(LoadFault):
    """The load rests against something for a share of the recording; size: that share.

    A spring to a point of the world with a preload, a plate along which it slides with dry friction, or a constant
    force, for example of a hand or a balancer.
    """

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        weight = scene.load.whole.mass * GRAVITY
        slope = np.radians(rng.uniform(15, 70))
        aside = direction(rng, 2)
        return {
            "law": str(rng.choice(["spring", "plate", "constant"])),
            "where": str(rng.choice(["first", "last", "middle"])),
            "force": float(rng.uniform(0.3, 0.8)) * weight + float(rng.uniform(1.0, 3.0)),
            "along": [float(np.sin(slope) * aside[0]), float(np.sin(slope) * aside[1]), float(np.cos(slope))],
            "stiffness": float(rng.uniform(10, 40)),
            "friction": float(rng.uniform(0.2, 0.6)),
            "place": list(scene.load.tip),
        }

    def spans(self, length: float) -> tuple[float, float]:
        """Begin and end, s, in a recording of this length."""
        begin = {"first": 0.0, "last": 1 - self.size, "middle": (1 - self.size) / 2}[self.truth["where"]]
        return begin * length, (begin + self.size) * length

    def push(self, world: World) -> None:
        begin, end = self.spans(world.scene.steps * 1e-3)
        since = (world.time - begin) / RAMP if begin else 1.0
        closed = min(1.0, since, (end - world.time) / RAMP)
        if closed <= 0:
            return
        world.active = True
        at, velocity = world.point(self.spot())
        force = self.truth["force"] * np.array(self.truth["along"])
        if self.truth["law"] == "spring":
            force = force - self.truth["stiffness"] * (at - self.truth.setdefault("anchor", at.copy()))
        elif self.truth["law"] == "plate":
            slip = velocity / max(float(np.linalg.norm(velocity)), 0.01)
            force = force - self.truth["friction"] * self.truth["force"] * slip
        world.pull(closed * force, self.spot())

    def parameters(self) -> dict[str, float]:
        return {"share": self.size, "force": self.truth["force"]}


class Grasped(MassStep):
    """The load comes into the hand in the middle of the recording; the rest of the payload is the gripper."""

    @property
    def freed(self) -> float:
        return self.size


class Driving(LoadFault):
    """The base drives and the recording has the joints alone; size: m/s2, the peak.

    In the frame of the base, gravity is less the acceleration of the base.
    """

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        change = drive((scene.steps + 1) * 1e-3, rng)[2][:, :2]
        return {"shape": change / np.abs(change).max()}

    def push(self, world: World) -> None:
        row = round(world.time * 1e3)
        if row >= 0:
            world.active = True
            world.model.opt.gravity[:2] -= self.size * self.truth["shape"][row]


def turning(track: Track, seconds: Array) -> Array:
    """(n, 3, 3) the sensor's axes in the world at these times, from the nearest step."""
    rows = np.clip(np.round(seconds * 1e3).astype(int), 0, len(track.turn) - 1)
    return np.asarray(track.turn[rows])
