"""The second generator: a sensor on a course of sums of sines, the wrench of its load in closed form, poses as tf."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.foreign import bag
from benchmarks.foreign.load import Body
from benchmarks.foreign.noise import NOISES
from benchmarks.foreign.robots import Array
from benchmarks.foreign.world import GRAVITY
from benchmarks.weighing.readings import Moments

FRAME = "wrist_sensor"
STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Flight:
    """A recording of poses.

    Args:
        start: ns. seconds: (n,) of the wrenches. turn: (n, 3, 3) and wrench: (n, 6) with noise and offset, at these.
        poses: stamps (m,) s, place (m, 3) m and quaternion (m, 4) x, y, z, w, with noise.
    """

    start: int
    seconds: Array
    turn: Array
    wrench: Array
    poses: tuple[Array, Array, Array]

    def moments(self, load: Body, rng: np.random.Generator) -> Moments:
        """When the wrenches were taken."""
        return Moments(self.seconds, self.turn, load, rng)

    def messages(self, wrench: Array) -> list[bag.Entry]:
        """tf and wrench."""
        found: list[bag.Entry] = []
        for stamp, place, turn in zip(self._stamps(self.poses[0]), *self.poses[1:], strict=True):
            transform = bag.make(
                "geometry_msgs/msg/Transform",
                translation=bag.vector(place),
                rotation=bag.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, turn), strict=True))),
            )
            stamped = bag.make(
                "geometry_msgs/msg/TransformStamped",
                header=bag.header(stamp, "world"),
                child_frame_id=FRAME,
                transform=transform,
            )
            kind = "tf2_msgs/msg/TFMessage"
            found.append((int(stamp), "tf", kind, bag.make(kind, transforms=[stamped])))
        return found + bag.wrench_messages(bag.Wrenches(self._stamps(self.seconds), wrench), FRAME)

    def _stamps(self, seconds: Array) -> NDArray[np.int64]:
        return self.start + np.round(seconds * 1e9).astype(np.int64)


def fly(load: Body, length: float, way: str, rng: np.random.Generator) -> Flight:
    """Draw a course and record it.

    Args:
        load: in sensor axes. length: s. way: of WAYS; stop-and-go halts four to six times.
        rng: chance.
    """
    clock = np.arange(-0.5, length + 0.5, STEP)
    inner = _pace(clock, way, rng)
    place = _sines(inner, 0.25, rng)
    turn = Rotation.from_rotvec(_sines(inner, 1.3, rng) + rng.uniform(-1, 1, 3))
    body = closed_form(load, place, turn)
    rate, pose_rate = float(rng.choice([100.0, 200.0])), float(rng.choice([100.0, 200.0]))
    late = float(rng.uniform(-0.003, 0.003))
    at = np.arange(float(rng.uniform(0, 1 / rate)), length, 1 / rate)
    rows = np.round((at + 0.5) / STEP).astype(int)
    family = str(rng.choice(["white", "heavy_tailed", "quantised"]))
    level = float(np.exp(rng.uniform(np.log(0.02), np.log(0.15)))) * np.repeat([1.0, 0.05], 3)
    noise = NOISES[family](len(rows), 6, rng)
    offset = rng.uniform(-8, 8, 6) * np.repeat([1.0, 0.04], 3) * float(rng.choice([0.03, 1.0]))
    then = np.arange(0.0, length, 1 / pose_rate)
    seen = np.round((then + 0.5) / STEP).astype(int)
    quaternion = (turn[seen] * Rotation.from_rotvec(2e-5 * rng.normal(size=(len(seen), 3)))).as_quat()
    return Flight(
        start=int(rng.integers(1_600_000_000, 1_760_000_000)) * 10**9,
        seconds=at + late,
        turn=turn[rows].as_matrix(),
        wrench=body[rows] + offset + level * noise,
        poses=(then, place[seen] + 2e-5 * rng.normal(size=(len(seen), 3)), quaternion),
    )


def _pace(clock: Array, way: str, rng: np.random.Generator) -> Array:
    """The time of the course, which stands still at the halts of stop-and-go."""
    if way != "stop_and_go":
        return clock * (0.35 if way == "gentle" else 1.0)
    speed = np.ones_like(clock)
    for halt in np.linspace(clock[0], clock[-1], int(rng.integers(6, 8)))[1:-1]:
        speed *= 1 - _plateau(clock, halt, float(rng.uniform(0.4, 0.8)))
    return np.asarray(np.cumsum(speed) * STEP)


def _plateau(clock: Array, middle: float, half: float) -> Array:
    """1 near a moment, 0 beyond, with smooth flanks of 0.4 s."""
    beyond = np.clip((np.abs(clock - middle) - half) / 0.4, 0, 1)
    return np.asarray(1 - beyond**3 * (10 - 15 * beyond + 6 * beyond**2))


def _sines(clock: Array, size: float, rng: np.random.Generator) -> Array:
    """(n, 3) three sines an axis between 0.1 and 0.6 Hz."""
    frequency, phase = 2 * np.pi * rng.uniform(0.1, 0.6, (3, 3)), rng.uniform(0, 2 * np.pi, (3, 3))
    weight = rng.uniform(0.3, 1.0, (3, 3)) / frequency
    return np.asarray(size * np.einsum("ij,nij->ni", weight, np.sin(clock[:, None, None] * frequency + phase)))


def closed_form(load: Body, place: Array, turn: Rotation) -> Array:
    """(n, 6) what the load exerts on the sensor, in its axes, about its origin: Newton and Euler."""
    acceleration = np.gradient(np.gradient(place, STEP, axis=0), STEP, axis=0)
    matrices = turn.as_matrix()
    step = (turn[:-1].inv() * turn[1:]).as_rotvec() / STEP
    omega = np.vstack([step[:1], (step[1:] + step[:-1]) / 2, step[-1:]])
    alpha = np.gradient(omega, STEP, axis=0)
    felt = np.einsum("nji,nj->ni", matrices, [0, 0, -GRAVITY] - acceleration)
    c = load.com
    force = load.mass * (felt - np.cross(alpha, c) - np.cross(omega, np.cross(omega, c)))
    spin = alpha @ load.inertia + np.cross(omega, omega @ load.inertia)
    return np.hstack([force, np.cross(c, force) - spin])
