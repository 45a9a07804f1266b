"""Effects of the wrench sensor, its clock, the encoders and the level of the base."""

from typing import Any

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from benchmarks.foreign.fault import Fault, direction, vector
from benchmarks.foreign.motions import STEP
from benchmarks.foreign.robots import Array
from benchmarks.foreign.world import Scene, Track, World

LEVER = 0.05
"""m that turns relative errors between force and torque into metres: the radius of a usual sensor."""
CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")


class SensorFault(Fault):
    """An effect in the wrench's chain: motion and load stay as they are."""

    needs, simulated = "wrench", False


class SensorBias(SensorFault):
    """A constant offset; size: N of force, and LEVER times as many N m of torque."""

    name, usual, largest, outside_tolerance, steady, stage = "sensor_bias", 2.0, 15.0, 0.4, True, 5

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"along": [*direction(rng), *(LEVER * direction(rng))]}

    def offset(self) -> Array:
        """(6,) N and N m."""
        return self.size * np.array(self.truth["along"])

    def sense(self, track: Track, wrench: Array) -> Array:
        return wrench + self.offset()

    def parameters(self) -> dict[str, float]:
        return vector("force", self.offset()[:3]) | vector("torque", self.offset()[3:])


class BiasDrift(SensorBias):
    """An offset that grows linearly; size: N at the end."""

    name, usual, largest, outside_tolerance, steady = "bias_drift", 1.0, 8.0, 0.12, False

    def sense(self, track: Track, wrench: Array) -> Array:
        return wrench + np.outer(track.seconds / track.seconds[-1], self.offset())


class SensorGain(SensorFault):
    """One or two entries of the calibration matrix are wrong; size: relative."""

    name, usual, largest, outside_tolerance, stage = "sensor_gain", 0.06, 0.4, 0.01, 3

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        strong = [int(i) for i in np.argsort(track.wrench.std(0) * np.repeat([1.0, 15.0], 3))[3:]]
        entries = []
        for row in rng.choice(strong, size=int(rng.integers(1, 3)), replace=False):
            column = int(row) if rng.random() < 0.6 else int(rng.integers(3)) + 3 * (int(row) // 3)
            entries.append([int(row), column, float(rng.choice([-1, 1]))])
        return {"entries": entries}

    def sense(self, track: Track, wrench: Array) -> Array:
        matrix = np.eye(6)
        for row, column, sign in self.truth["entries"]:
            matrix[row, column] += sign * self.size
        return np.asarray(wrench @ matrix.T)

    def parameters(self) -> dict[str, float]:
        return {f"gain_{CHANNELS[r]}_{CHANNELS[c]}": s * self.size for r, c, s in self.truth["entries"]}


class SensorNonlinearity(SensorFault):
    """A characteristic that bends: w + a |w| w / full; size: relative error at full scale."""

    name, usual, largest, outside_tolerance, stage = "sensor_nonlinearity", 0.06, 0.5, 0.0, 3

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        loud = [int(i) for i in np.argsort(track.wrench[:, :3].std(0))[1:]]
        chosen = [int(c) for c in rng.choice(loud, size=int(rng.integers(1, 3)), replace=False)]
        full = np.abs(track.wrench).max(0)
        return {"channels": chosen, "full": [float(full[c]) for c in chosen], "sign": float(rng.choice([-1, 1]))}

    def sense(self, track: Track, wrench: Array) -> Array:
        bent = wrench.copy()
        for channel, full in zip(self.truth["channels"], self.truth["full"], strict=True):
            w = wrench[:, channel]
            bent[:, channel] += self.truth["sign"] * self.size * w * np.abs(w) / full
        return bent

    def parameters(self) -> dict[str, float]:
        pairs = zip(self.truth["channels"], self.truth["full"], strict=True)
        return {f"quadratic_{CHANNELS[c]}": self.truth["sign"] * self.size / full for c, full in pairs}


class SensorRotation(SensorFault):
    """The sensor's axes are turned against the description; size: rad."""

    name, usual, largest, outside_tolerance, stage = "sensor_rotation", 0.03, 0.35, 0.004, 2

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"axis": list(direction(rng))}

    def sense(self, track: Track, wrench: Array) -> Array:
        return turned(wrench, self.size * np.array(self.truth["axis"]))

    def parameters(self) -> dict[str, float]:
        return vector("rotation", np.array(self.truth["axis"]), self.size)


class SensorCreep(SensorFault):
    """The reading creeps after the load (Maxwell element beside a spring); size: relative."""

    name, usual, largest, stage = "sensor_creep", 0.08, 0.6, 3

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"time_constant": float(rng.uniform(1.0, 6.0))}

    def sense(self, track: Track, wrench: Array) -> Array:
        return wrench + self.size * first_order(wrench, self.truth["time_constant"])

    def parameters(self) -> dict[str, float]:
        return {"fraction": self.size, "time_constant": self.truth["time_constant"]}


class LowPass(SensorFault):
    """A first-order filter in the sensor; size: s, its time constant."""

    name, usual, largest, outside_tolerance, stage = "low_pass", 0.08, 0.6, 0.004, 6

    def sense(self, track: Track, wrench: Array) -> Array:
        return first_order(wrench, self.size)

    def parameters(self) -> dict[str, float]:
        return {"time_constant": self.size}


class ClockOffset(SensorFault):
    """The wrench's stamps are late or early; size: s."""

    name, usual, largest, outside_tolerance = "clock_offset", 0.03, 0.2, 0.004

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"sign": float(rng.choice([-1, 1]))}

    def clock(self, seconds: Array) -> Array:
        return np.asarray(seconds + self.truth["sign"] * self.size)

    def parameters(self) -> dict[str, float]:
        return {"offset": self.truth["sign"] * self.size}


class ClockSkew(ClockOffset):
    """The wrench's clock runs fast or slow; size: relative."""

    name, usual, largest, outside_tolerance = "clock_skew", 0.002, 0.02, 0.0

    def clock(self, seconds: Array) -> Array:
        return np.asarray(seconds * (1 + self.truth["sign"] * self.size))

    def parameters(self) -> dict[str, float]:
        return {"skew": self.truth["sign"] * self.size}


class Saturation(SensorFault):
    """Force readings end at a limit; size: the share of the loudest reading that is cut off."""

    name, usual, largest, stage = "saturation", 0.35, 0.8, 7

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"loudest": float(np.abs(track.wrench[:, :3]).max())}

    def level(self) -> float:
        """N."""
        return float(self.truth["loudest"] * (1 - self.size))

    def read(self, wrench: Array) -> Array:
        return np.hstack([np.clip(wrench[:, :3], -self.level(), self.level()), wrench[:, 3:]])

    def parameters(self) -> dict[str, float]:
        return {"force_limit": self.level()}


class Quantisation(SensorFault):
    """A coarse converter; size: N a step, and LEVER times as many N m."""

    name, usual, largest, stage = "quantisation", 0.5, 5.0, 8

    def read(self, wrench: Array) -> Array:
        step = self.size * np.repeat([1.0, LEVER], 3)
        return np.asarray(np.round(wrench / step) * step)

    def parameters(self) -> dict[str, float]:
        return {"force_step": self.size, "torque_step": self.size * LEVER}


class JointOffset(Fault):
    """The zero of one encoder is off; size: rad."""

    name, usual, largest, outside_tolerance, simulated, rotary = "joint_offset", 0.03, 0.3, 0.001, False, True

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        # The last joint's zero is the sensor's rotation, the first one's is not seen by gravity.
        joint = int(rng.integers(1, len(scene.robot.joints) - 1)) if len(scene.robot.joints) > 2 else 0
        return {"joint": joint, "sign": float(rng.choice([-1, 1]))}

    def encode(self, position: Array) -> Array:
        shifted = position.copy()
        shifted[:, self.truth["joint"]] += self.truth["sign"] * self.size
        return shifted

    def parameters(self) -> dict[str, float]:
        return {f"offset_{self.truth['joint'] + 1}": self.truth["sign"] * self.size}


class BaseTilt(Fault):
    """What the robot stands on is not level; size: rad."""

    name, usual, largest, outside_tolerance, rotary = "base_tilt", 0.03, 0.3, 0.001, True

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"axis": [*direction(rng, 2), 0.0]}

    def push(self, world: World) -> None:
        leaning = Rotation.from_rotvec(-self.size * np.array(self.truth["axis"]))
        world.model.opt.gravity[:] = leaning.apply(world.model.opt.gravity)

    def parameters(self) -> dict[str, float]:
        return {f"rotation_{axis}": float(self.size * v) for axis, v in zip("xy", self.truth["axis"][:2], strict=True)}


def first_order(values: Array, time_constant: float) -> Array:
    """T y' = u - y, exact for inputs that are held over a step, from rest."""
    keep = np.exp(-STEP / time_constant)
    return np.asarray(lfilter([1 - keep], [1, -keep], values - values[0], axis=0) + values[0])


def turned(wrench: Array, rotation: Array) -> Array:
    """The wrench in axes that are turned by a rotation vector, about the same origin."""
    matrix = Rotation.from_rotvec(rotation).as_matrix()
    return np.hstack([wrench[:, :3] @ matrix, wrench[:, 3:] @ matrix])


SENSORS: tuple[type[Fault], ...] = (
    *(SensorBias, BiasDrift, SensorGain, SensorNonlinearity, SensorRotation, SensorCreep, LowPass),
    *(ClockOffset, ClockSkew, Saturation, Quantisation, JointOffset, BaseTilt),
)
