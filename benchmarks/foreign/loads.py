"""Effects on the load and in it: forces, cables, air, rotors, and parts that move by themselves."""

from typing import Any

import mujoco
import numpy as np

from benchmarks.foreign.fault import LoadFault, direction, point_on, vector
from benchmarks.foreign.load import Body, Load, changed
from benchmarks.foreign.world import GRAVITY, Scene, Track, World, give, linear


class PayloadParameters(LoadFault):
    """Mass, centre of mass and inertia are not those of model.yaml; size: relative mass."""

    name, usual, largest, outside_tolerance = "payload_parameters", 0.06, 0.5, 0.01

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"sign": float(rng.choice([-1, 1])), "shift": list(0.2 * direction(rng))}

    def reload(self, load: Load) -> Load:
        factor = 1 + self.truth["sign"] * self.size
        return changed(load, factor, self.size * np.array(self.truth["shift"]), factor)

    def parameters(self) -> dict[str, float]:
        return {"mass_factor": 1 + self.truth["sign"] * self.size}


class WorldForce(LoadFault):
    """A constant force in the world, as of a weight on a pulley; size: N."""

    name, usual, largest = "world_force", 2.0, 25.0

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"along": list(direction(rng)), "place": point_on(scene, rng)}

    def push(self, world: World) -> None:
        world.pull(self.size * np.array(self.truth["along"]), self.spot())

    def parameters(self) -> dict[str, float]:
        return vector("force", np.array(self.truth["along"]), self.size)


class Cable(LoadFault):
    """An elastic cable from the tool to a fixed point, slack below its length (Hooke, with a damper); size: N/m."""

    name, usual, largest = "cable", 10.0, 400.0

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        place = point_on(scene, rng)
        path = track.place + track.turn @ np.array(place)
        anchor = path.mean(0) + rng.uniform(0.7, 1.3) * direction(rng)
        lengths = np.linalg.norm(path - anchor, axis=1)
        rest = lengths.min() * rng.uniform(0.8, 1.0) if rng.random() < 0.5 else np.quantile(lengths, 0.3)
        return {"place": place, "anchor": list(anchor), "rest": float(rest), "damping": float(rng.choice([0.0, 2.0]))}

    def push(self, world: World) -> None:
        at, velocity = world.point(self.spot())
        way = np.array(self.truth["anchor"]) - at
        length = float(np.linalg.norm(way))
        if length > self.truth["rest"]:
            rate = -float(velocity @ way) / length
            tension = self.size * (length - self.truth["rest"]) + self.truth["damping"] * rate
            world.pull(max(tension, 0.0) * way / length, self.spot())

    def parameters(self) -> dict[str, float]:
        return {"stiffness": self.size, "rest_length": self.truth["rest"]}


class AirDrag(LoadFault):
    """Quadratic drag of a broad load, -k |v| v at a point; size: k in N s2/m2."""

    name, usual, largest = "air_drag", 2.0, 12.0

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"place": point_on(scene, rng)}

    def push(self, world: World) -> None:
        _, velocity = world.point(self.spot())
        world.pull(-self.size * float(np.linalg.norm(velocity)) * velocity, self.spot())

    def parameters(self) -> dict[str, float]:
        return {"coefficient": self.size}


class Flywheel(LoadFault):
    """A spinning rotor in the load, a body of MuJoCo on a free hinge; size: N m s of angular momentum."""

    name, usual, largest, rotary = "flywheel", 0.1, 1.5, True
    radius = 0.035

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"axis": list(direction(rng)), "mass": scene.load.part, "place": list(scene.load.place)}

    @property
    def freed(self) -> float:
        return float(self.truth["mass"])

    @property
    def polar(self) -> float:
        """kg m2 about the axis of a flat ring."""
        return self.freed * self.radius**2

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        axis = np.array(self.truth["axis"])
        rotor = tree.body(scene.robot.frame).add_body(name="rotor", pos=self.spot())
        ring = self.polar * (np.outer(axis, axis) + 0.52 * (np.eye(3) - np.outer(axis, axis)))
        give(rotor, Body(self.freed, np.zeros(3), ring))
        rotor.add_joint(name="spin", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)

    def settle(self, world: World) -> None:
        world.data.qvel[world.model.joint("spin").dofadr[0]] = self.size / self.polar

    def parameters(self) -> dict[str, float]:
        return vector("momentum", np.array(self.truth["axis"]), self.size)


class Slosh(LoadFault):
    """A liquid as a spherical pendulum that model.yaml counts as rigid at its pivot; size: kg."""

    name, usual = "slosh", 0.3

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        length, ratio = float(rng.uniform(0.04, 0.1)), float(rng.uniform(0.05, 0.15))
        return {"length": length, "ratio": ratio, "place": list(scene.load.place)}

    @property
    def freed(self) -> float:
        return self.size

    def limit(self, scene: Scene) -> float:
        return scene.load.part

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        length = self.truth["length"]
        bob = tree.body(scene.robot.frame).add_body(name="bob", pos=self.spot())
        give(bob, Body(self.freed, np.array([0.0, 0.0, -length]), 0.02 * self.freed * length**2 * np.eye(3)))
        damping = 2 * self.truth["ratio"] * self.freed * length**2 * np.sqrt(GRAVITY / length)
        bob.add_joint(name="swing", type=mujoco.mjtJoint.mjJNT_BALL, damping=linear(damping))

    def settle(self, world: World) -> None:
        hang(world, "swing")

    def parameters(self) -> dict[str, float]:
        return {"mass": self.size, "length": self.truth["length"]}


class LoosePart(LoadFault):
    """A mass that slides between two stops (MuJoCo's joint limits); counted as rigid in the middle; size: kg.

    Dry friction takes a constant force, up to a share of the weight, whatever presses on its guide.
    """

    name, usual = "loose_part", 0.2

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        gap, axis = float(rng.uniform(0.008, 0.02)), list(direction(rng))
        return {"gap": gap, "axis": axis, "place": list(scene.load.place), "friction": float(rng.uniform(0.0, 0.15))}

    @property
    def freed(self) -> float:
        return self.size

    def limit(self, scene: Scene) -> float:
        return scene.load.part

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        part = tree.body(scene.robot.frame).add_body(name="loose", pos=self.spot())
        give(part, Body(self.freed, np.zeros(3), 1e-6 * np.eye(3)))
        half = self.truth["gap"] / 2
        joint = part.add_joint(name="slide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=np.array(self.truth["axis"]))
        joint.limited, joint.range, joint.solref_limit = True, [-half, half], [0.006, 1.0]
        joint.frictionloss = self.truth["friction"] * self.freed * GRAVITY

    def parameters(self) -> dict[str, float]:
        return {"mass": self.size, "gap": self.truth["gap"]}


class FlexibleMode(LoadFault):
    """A part of the load on a spring along an axis; rigid at its place without load; size: kg."""

    name, usual = "flexible_mode", 0.3

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        frequency, ratio = float(rng.uniform(3, 7)), float(rng.uniform(0.02, 0.08))
        return {"axis": list(direction(rng)), "frequency": frequency, "ratio": ratio, "place": list(scene.load.place)}

    @property
    def freed(self) -> float:
        return self.size

    def limit(self, scene: Scene) -> float:
        return scene.load.part

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        part = tree.body(scene.robot.frame).add_body(name="sprung", pos=self.spot())
        give(part, Body(self.freed, np.zeros(3), 1e-6 * np.eye(3)))
        pulsation = 2 * np.pi * self.truth["frequency"]
        joint = part.add_joint(name="spring", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=np.array(self.truth["axis"]))
        joint.stiffness = linear(self.freed * pulsation**2)
        joint.damping = linear(2 * self.truth["ratio"] * self.freed * pulsation)

    def parameters(self) -> dict[str, float]:
        return {"mass": self.size, "frequency": self.truth["frequency"]}


class GraspCompliance(LoadFault):
    """The load turns in the grasp about a point, held by a spring; size: rad/(N m)."""

    name, usual, largest = "grasp_compliance", 0.03, 0.12

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        return {"height": float(rng.uniform(0.02, 0.06)), "ratio": float(rng.uniform(0.1, 0.3))}

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        whole = scene.load.whole
        arm = whole.com - [0, 0, self.truth["height"]]
        moment = np.trace(whole.inertia) / 3 + whole.mass * float(arm @ arm)
        joint = tree.body("load").add_joint(name="grasp", type=mujoco.mjtJoint.mjJNT_BALL)
        joint.pos = [0, 0, self.truth["height"]]
        joint.stiffness = linear(1 / self.size)
        joint.damping = linear(2 * self.truth["ratio"] * np.sqrt(moment / self.size))

    def parameters(self) -> dict[str, float]:
        return {"stiffness": 1 / self.size, "height": self.truth["height"]}


def hang(world: World, joint: str) -> None:
    """Turn a ball joint so that its body's axes are the world's: a bob on -z hangs straight down."""
    inner = np.zeros(4)
    body = int(world.model.jnt_bodyid[world.model.joint(joint).id])
    parent = int(world.model.body_parentid[body])
    conjugate = np.zeros(4)
    mujoco.mju_negQuat(conjugate, world.data.xquat[parent])
    mujoco.mju_mulQuat(inner, conjugate, np.array([1.0, 0.0, 0.0, 0.0]))
    start = world.model.joint(joint).qposadr[0]
    world.data.qpos[start : start + 4] = inner
    mujoco.mj_forward(world.model, world.data)


LOADS: tuple[type[LoadFault], ...] = (
    *(PayloadParameters, WorldForce, Cable, AirDrag, Flywheel),
    *(Slosh, LoosePart, FlexibleMode, GraspCompliance),
)
