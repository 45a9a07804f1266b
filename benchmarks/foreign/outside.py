"""Effects that the tool's library has no name for: the right answer is `unknown`."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from benchmarks.foreign.drives import DriveFault
from benchmarks.foreign.fault import LoadFault, direction, point_on
from benchmarks.foreign.load import Body
from benchmarks.foreign.loads import hang
from benchmarks.foreign.motions import STEP
from benchmarks.foreign.robots import Array
from benchmarks.foreign.sensors import SensorFault
from benchmarks.foreign.world import SETTLING, Scene, Track, World, give, linear


class Magnet(LoadFault):
    """A magnet beside the path pulls with the inverse cube of the distance; size: N at 0.15 m."""

    name, usual, largest, library = "magnet", 4.0, 120.0, False

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        path = track.place + track.turn @ scene.load.tip
        magnet = path[int(rng.integers(len(path)))] + 0.12 * direction(rng)
        return {"place": list(scene.load.tip), "magnet": list(magnet)}

    def push(self, world: World) -> None:
        at, _ = world.point(self.spot())
        way = np.array(self.truth["magnet"]) - at
        distance = max(float(np.linalg.norm(way)), 0.08)
        world.pull(self.size * (0.15 / distance) ** 3 * way / distance, self.spot())


class Gusts(LoadFault):
    """Wind that comes and goes: a random force between 0.1 and 1.5 Hz; size: N, root mean square."""

    name, usual, largest, library = "gusts", 2.0, 40.0, False

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        noise = rng.normal(size=(len(track.seconds) + 4000, 2))
        wind = sosfiltfilt(butter(2, [0.1, 1.5], "bandpass", fs=1 / STEP, output="sos"), noise, axis=0)[2000:-2000]
        return {"place": point_on(scene, rng), "wind": wind / wind.std(axis=0), "along": list(direction(rng))}

    def push(self, world: World) -> None:
        row = round(world.time / STEP)
        if row >= 0:
            x, y = self.truth["wind"][row]
            along = np.array(self.truth["along"])
            across = np.cross(along, [0.6, 0.0, 0.8])
            world.pull(self.size * (x * along + 0.5 * y * across), self.spot())


class HangingRope(LoadFault):
    """A rope of three links hangs from the load; model.yaml counts it as rigid at its upper end; size: kg."""

    name, usual, library = "hanging_rope", 0.3, False
    accept = ("hanging_chain", "pendulum_chain", "rope", "hose")
    links = 3

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"place": list(scene.load.place), "length": float(rng.uniform(0.1, 0.2))}

    @property
    def freed(self) -> float:
        return self.size

    def limit(self, scene: Scene) -> float:
        return scene.load.part

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        length, mass = self.truth["length"], self.size / self.links
        parent, place = tree.body(scene.robot.frame), self.spot()
        for i in range(self.links):
            link = parent.add_body(name=f"rope{i}", pos=place)
            give(link, Body(mass, np.array([0, 0, -length / 2]), mass * length**2 / 12 * np.diag([1.0, 1.0, 0.02])))
            damping = 0.02 * mass * length**2 * np.sqrt(9.8 / length)
            link.add_joint(name=f"rope_joint{i}", type=mujoco.mjtJoint.mjJNT_BALL, damping=linear(damping))
            parent, place = link, np.array([0.0, 0.0, -length])

    def settle(self, world: World) -> None:
        hang(world, "rope_joint0")


class WarmingGain(SensorFault):
    """The sensor's gain follows its temperature, which rises as it warms up; size: relative."""

    name, usual, largest, library, stage = "gain_drift", 0.06, 0.5, False, 3

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"time_constant": float(track.seconds[-1] * rng.uniform(0.2, 0.5))}

    def sense(self, track: Track, wrench: Array) -> Array:
        warmth = 1 - np.exp(-track.seconds / self.truth["time_constant"])
        return np.asarray(wrench * (1 + self.size * (warmth - warmth.mean()))[:, None])


class SensorHysteresis(SensorFault):
    """The reading lags behind the force by the play of a slipping element; size: N."""

    name, usual, largest, library, stage = "sensor_hysteresis", 1.5, 15.0, False, 3
    accept = ("hysteresis",)

    def sense(self, track: Track, wrench: Array) -> Array:
        middle = wrench[0, :3].copy()
        lag = np.empty((len(wrench), 3))
        for i, force in enumerate(wrench[:, :3]):
            middle = np.clip(middle, force - self.size, force + self.size)
            lag[i] = force - middle
        return wrench - np.hstack([lag, np.zeros_like(lag)])


class LooseFlange(SensorFault):
    """The sensor turns in its flange while a screw works loose, ever faster; size: rad at the end."""

    name, usual, largest, library, stage = "loose_flange", 0.05, 0.5, False, 2

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"axis": list(direction(rng)), "power": float(rng.uniform(1.0, 3.0))}

    def sense(self, track: Track, wrench: Array) -> Array:
        angle = self.size * (track.seconds / track.seconds[-1]) ** self.truth["power"]
        turn = Rotation.from_rotvec(angle[:, None] * np.array(self.truth["axis"])).inv()
        return np.hstack([turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])])


class MotorGain(DriveFault):
    """The torque constant of each drive is off by its own share; size: relative."""

    name, usual, largest, library = "motor_gain", 0.08, 0.5, False
    accept = ("motor_gain", "effort_gain")

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        count = len(scene.robot.joints)
        return {"scale": list(rng.choice([-1, 1], count) * rng.uniform(0.5, 1.2, count)), "joint": 0}

    def afterwards(self, track: Track) -> Track:
        return replace(track, effort=track.effort * (1 + self.values()))


class WarmingFriction(DriveFault):
    """Viscous friction that falls to a third as the grease warms up; size: N m s/rad or N s/m."""

    name, usual, largest, library = "warming_friction", 2.0, np.inf, False
    accept = ("temperature_drift",)

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        for joint, value in zip(scene.robot.joints, self.values(), strict=True):
            tree.joint(joint).damping = linear(value)

    def push(self, world: World) -> None:
        end = world.scene.steps * STEP
        warmth = 1 / 3 + 2 / 3 * np.exp(-max(world.time + SETTLING, 0.0) / (0.25 * end))
        dofs = [world.dof(joint) for joint in range(len(self.values()))]
        world.model.dof_damping[dofs] = warmth * self.values()


class CableChain(DriveFault):
    """A stiff cable chain bends with one joint: a torque that depends on its angle; size: N m or N."""

    name, usual, largest, library = "cable_chain", 3.0, np.inf, False
    accept = ("position_dependent_torque", "series_elasticity")

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        drawn = super().random(scene, track, rng)
        joint = drawn["joint"]
        middle = float(np.median(track.position[:, joint]))
        return drawn | {"middle": middle, "width": float(np.ptp(track.position[:, joint]) / 2)}

    def push(self, world: World) -> None:
        joint = self.truth["joint"]
        q = world.data.qpos[world.address[world.recorded][joint]]
        bend = (q - self.truth["middle"]) / max(self.truth["width"], 1e-3)
        world.data.qfrc_applied[world.dof(joint)] -= self.one() * (0.4 * bend + bend**3)


OUTSIDE = (
    *(Magnet, Gusts, HangingRope, WarmingGain, SensorHysteresis, MotorGain, WarmingFriction, CableChain),
    LooseFlange,
)
