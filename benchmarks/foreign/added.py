"""Effects that the tool learnt later than its first foreign cases: efforts, gears that bend and warm, and a rope.

They have seed sets of their own, so that the cases of the older seeds stay what they were.
"""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from benchmarks.foreign.drives import DriveFault, DryFault
from benchmarks.foreign.fault import Fault
from benchmarks.foreign.load import Body
from benchmarks.foreign.motions import STEP
from benchmarks.foreign.outside import HangingRope
from benchmarks.foreign.robots import links
from benchmarks.foreign.world import SETTLING, Scene, Track, World, give, linear


class EffortOffset(DriveFault):
    """Zeros of the torque readings; size: relative to the largest effort of each joint (0.99 quantile)."""

    name, usual, largest, steady, outside_tolerance = "effort_offset", 0.08, 0.5, True, 0.01

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        count = len(scene.robot.joints)
        large = np.quantile(np.abs(track.effort), 0.99, axis=0)
        return {"scale": list(large * rng.choice([-1, 1], count) * rng.uniform(0.5, 1.2, count)), "joint": 0}

    def afterwards(self, track: Track) -> Track:
        return replace(track, effort=track.effort + self.values())

    def parameters(self) -> dict[str, float]:
        return self.joints("offset")


class LinkParameters(DriveFault):
    """Two links are heavier, with another centre of mass, than the data sheet says; size: relative."""

    name, usual, largest, outside_tolerance = "link_parameters", 0.15, 0.8, 0.01

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        moved = [name for name in links(scene.robot) if name != "base_link"]
        chosen = rng.choice(moved, size=min(2, len(moved)), replace=False)
        shift = 0.03 * rng.normal(size=(len(chosen), 3))
        gain = rng.choice([-1.0, 1.0], len(chosen))
        return super().random(scene, track, rng) | {"links": list(chosen), "shift": shift.tolist(), "gain": list(gain)}

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        for name, shift, gain in zip(self.truth["links"], self.truth["shift"], self.truth["gain"], strict=True):
            link = tree.body(str(name))
            factor = 1.0 + self.size * gain
            link.mass, link.ipos = link.mass * factor, link.ipos + self.size * np.array(shift)
            link.inertia = link.inertia * factor

    def parameters(self) -> dict[str, float]:
        return {f"mass_{name}": self.size * g for name, g in zip(self.truth["links"], self.truth["gain"], strict=True)}


class PositionFriction(DryFault):
    """A tight spot: dry friction that is large about one angle of each joint and small elsewhere; size: N m."""

    name, usual, rotary = "position_friction", 4.0, True
    width = 0.8
    """rad, one sigma of the tight spot."""

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        low, high = track.position.min(axis=0), track.position.max(axis=0)
        return super().random(scene, track, rng) | {"spot": list(rng.uniform(low, high))}

    def push(self, world: World) -> None:
        q = world.data.qpos[world.address[world.recorded]]
        tight = np.exp((np.cos(q - self.truth["spot"]) - 1.0) / self.width**2)
        dofs = [world.dof(joint) for joint in range(len(q))]
        world.model.dof_frictionloss[dofs] = np.maximum(self.values() * tight, 1e-9)

    def parameters(self) -> dict[str, float]:
        return self.joints("torque")


class SeriesElasticity(DriveFault):
    """A spring between motor and link: a second joint. The encoder is the motor's, the effort what passes the gear.

    Size: rad (or m) that the chosen joint bends under its largest effort.
    """

    name, usual, largest = "series_elasticity", 0.006, 0.05

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        drawn = super().random(scene, track, rng)
        large = np.quantile(np.abs(track.effort), 0.99, axis=0)
        joint = int(np.argmax(large)) if scene.robot.prismatic.all() else drawn["joint"]
        moved = float(World(scene).inertia()[joint])
        return drawn | {
            "joint": joint,
            "large": float(large[joint]),
            "moved": moved,
            "ratio": float(rng.uniform(0.05, 0.15)),
        }

    @property
    def stiffness(self) -> float:
        """N m/rad or N/m."""
        return float(self.truth["large"] / self.size)

    def limit(self, scene: Scene) -> float:
        return 0.004 if scene.robot.prismatic[self.truth["joint"]] else self.largest

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        motor = tree.joint(scene.robot.joints[self.truth["joint"]])
        motor.armature = 0.5 * self.truth["moved"]
        bend = motor.parent.add_joint(name="bend", type=motor.type, axis=motor.axis, pos=motor.pos)
        bend.stiffness = linear(self.stiffness)
        bend.damping = linear(2 * self.truth["ratio"] * np.sqrt(self.stiffness * self.truth["moved"]))

    def afterwards(self, track: Track) -> Track:
        effort, joint = track.effort.copy(), self.truth["joint"]
        effort[:, joint] -= 0.5 * self.truth["moved"] * np.gradient(track.velocity[:, joint], STEP)
        return replace(track, effort=effort)

    def parameters(self) -> dict[str, float]:
        return {f"compliance_{self.truth['joint'] + 1}": 1 / self.stiffness}


class TemperatureDrift(DriveFault):
    """Cold grease: its viscosity falls exponentially with a temperature that rises to its end value.

    Nearly nothing of it is left when it is warm; size: N m s/rad or N s/m of the cold joint.
    """

    name, usual = "temperature_drift", 3.0

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        end = float(track.seconds[-1])
        return super().random(scene, track, rng) | {"warming": max(float(rng.uniform(0.3, 0.6)) * end, 10.0)}

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        for joint, value in zip(scene.robot.joints, self.values(), strict=True):
            tree.joint(joint).damping = linear(value)

    def push(self, world: World) -> None:
        warmth = 1.0 - np.exp(-max(world.time + SETTLING, 0.0) / self.truth["warming"])
        dofs = [world.dof(joint) for joint in range(len(self.values()))]
        world.model.dof_damping[dofs] = np.exp(-3.0 * warmth) * self.values()

    def parameters(self) -> dict[str, float]:
        return self.joints("damping") | {"warming": self.truth["warming"]}


class HangingChain(HangingRope):
    """A chain of five links with a weight at its end hangs from the load; counted as rigid at its upper end."""

    name, library, accept = "hanging_chain", True, ()

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        length, shares = self.truth["length"], np.array([1.0, 1.0, 1.0, 1.0, 2.0]) / 6.0
        parent, place = tree.body(scene.robot.frame), self.spot()
        for i, share in enumerate(shares.tolist()):
            mass = self.size * share
            link = parent.add_body(name=f"rope{i}", pos=place)
            give(link, Body(mass, np.array([0, 0, -length / 2]), mass * length**2 / 12 * np.diag([1.0, 1.0, 0.02])))
            damping = 0.02 * mass * length**2 * np.sqrt(9.8 / length)
            link.add_joint(name=f"rope_joint{i}", type=mujoco.mjtJoint.mjJNT_BALL, damping=linear(damping))
            parent, place = link, np.array([0.0, 0.0, -length])

    def parameters(self) -> dict[str, float]:
        return {"total_mass": self.size}


ADDED: tuple[type[Fault], ...] = (
    *(EffortOffset, LinkParameters, PositionFriction, SeriesElasticity, TemperatureDrift),
    HangingChain,
)
