"""Effects of the joint drives, which show in the efforts: friction, rotors, gears and play."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from benchmarks.foreign.fault import Fault, dof_setter, joint_scale, moving_joint
from benchmarks.foreign.motions import STEP
from benchmarks.foreign.robots import Array
from benchmarks.foreign.world import Scene, Track, World, linear


class DriveFault(Fault):
    """An effect of the drives; forces are for the strongest joint, others are in proportion to their usual effort."""

    needs = "effort"

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        scale = joint_scale(scene) * rng.uniform(0.6, 1.2, len(scene.robot.joints))
        return {"scale": list(scale), "joint": moving_joint(scene, track, rng)}

    def values(self) -> Array:
        """(J,) the size for each joint."""
        return np.asarray(self.size * np.array(self.truth["scale"]))

    def one(self) -> float:
        """The size for the chosen joint."""
        return float(self.values()[self.truth["joint"]])

    def joints(self, stem: str) -> dict[str, float]:
        """`stem_1` and so on."""
        return {f"{stem}_{i + 1}": float(v) for i, v in enumerate(self.values())}


class ViscousFriction(DriveFault):
    """tau = d v (MuJoCo's joint damping); size: N m s/rad or N s/m."""

    name, usual = "viscous_friction", 2.0

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        for joint, value in zip(scene.robot.joints, self.values(), strict=True):
            tree.joint(joint).damping = linear(value)

    def parameters(self) -> dict[str, float]:
        return self.joints("damping")


class DryFault(DriveFault):
    """Friction with stiction, solved by MuJoCo as a constraint; it takes hold within some 10 mrad/s."""

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        for joint in scene.robot.joints:
            tree.joint(joint).frictionloss = 1e-9
            tree.joint(joint).solref_friction = [0.008, 1.0]


class CoulombFriction(DryFault):
    """tau = F sign(v), and less where the joint sticks; size: N m or N."""

    name, usual = "coulomb_friction", 3.0

    def push(self, world: World) -> None:
        dof_setter(world, tuple(range(len(self.values()))), lambda v, load: self.values())

    def parameters(self) -> dict[str, float]:
        return self.joints("torque")


class StribeckFriction(DryFault):
    """Friction that falls with the speed from stiction to Coulomb's and grows again (Armstrong 1994); size: N m."""

    name, usual, accept = "stribeck_friction", 4.0, ()

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        speed = rng.uniform(0.06, 0.15) * float(np.min(scene.robot.speed))
        return super().random(scene, track, rng) | {"velocity": float(speed), "kinetic": 0.5, "damping": 0.4}

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        super().attach(tree, scene)
        for joint, value in zip(scene.robot.joints, self.values(), strict=True):
            tree.joint(joint).damping = linear(self.truth["damping"] * value)

    def push(self, world: World) -> None:
        def rule(v: Array, load: Array) -> Array:
            fall = np.exp(-((v / self.truth["velocity"]) ** 2))
            return np.asarray(self.values() * (self.truth["kinetic"] + fall))

        dof_setter(world, tuple(range(len(self.values()))), rule)

    def parameters(self) -> dict[str, float]:
        return self.joints("stiction") | {"velocity": self.truth["velocity"]}


class LoadDependentFriction(DryFault):
    """Dry friction in proportion to the load of the gear, of each joint; size: ratio."""

    name, usual, largest = "load_dependent_friction", 0.08, 0.8

    def push(self, world: World) -> None:
        dof_setter(world, tuple(range(len(self.values()))), lambda v, load: self.size * np.abs(load))

    def parameters(self) -> dict[str, float]:
        return {f"ratio_{i + 1}": self.size for i in range(len(self.values()))}


class MotorInertia(DriveFault):
    """The rotors' inertia behind the gears (MuJoCo's armature); size: kg m2 or kg."""

    name, usual = "motor_inertia", 0.6

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        for joint, value in zip(scene.robot.joints, self.values(), strict=True):
            tree.joint(joint).armature = value

    def parameters(self) -> dict[str, float]:
        return self.joints("inertia")


class JointCoupling(DriveFault):
    """The rotor of one joint turns with the next one too: its kinetic energy couples both; size: kg m2."""

    name, usual = "joint_coupling", 0.6

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        first = min(moving_joint(scene, track, rng), len(scene.robot.joints) - 2)
        drawn = super().random(scene, track, rng)
        return drawn | {"joint": first, "damping": float(rng.uniform(1.0, 3.0))}

    def afterwards(self, track: Track) -> Track:
        effort, first = track.effort.copy(), self.truth["joint"]
        pair = track.velocity[:, [first + 1, first]]
        change = np.gradient(pair, STEP, axis=0)
        effort[:, first : first + 2] += self.one() * (change + self.truth["damping"] * pair)
        return replace(track, effort=effort)

    def parameters(self) -> dict[str, float]:
        return {"inertia": self.one(), "driving": self.truth["joint"] + 2, "driven": self.truth["joint"] + 1}


class GearRipple(DriveFault):
    """A torque that goes round with the gear of one joint; size: N m or N."""

    name, usual = "gear_ripple", 2.0

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        drawn = super().random(scene, track, rng)
        order = 2 * np.pi / 0.04 if scene.robot.prismatic[drawn["joint"]] else float(rng.integers(8, 40))
        return drawn | {"order": order, "phase": float(rng.uniform(0, 2 * np.pi))}

    def push(self, world: World) -> None:
        joint = self.truth["joint"]
        q = world.data.qpos[world.address[world.recorded][joint]]
        ripple = self.one() * np.sin(self.truth["order"] * q + self.truth["phase"])
        world.data.qfrc_applied[world.dof(joint)] -= ripple

    def parameters(self) -> dict[str, float]:
        return {"amplitude": self.one(), "order": self.truth["order"], "joint": self.truth["joint"] + 1}


class Backlash(DriveFault):
    """The link has play behind its motor: a second joint between two stops. The encoder is the motor's, the effort is
    what passes the gear; size: rad or m."""

    name, usual, largest = "backlash", 0.02, 0.06

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        drawn = super().random(scene, track, rng)
        return drawn | {"rotor": 0.5 * float(World(scene).inertia()[drawn["joint"]])}

    def limit(self, scene: Scene) -> float:
        return 0.004 if scene.robot.prismatic[self.truth["joint"]] else self.largest

    def attach(self, tree: mujoco.MjSpec, scene: Scene) -> None:
        motor = tree.joint(scene.robot.joints[self.truth["joint"]])
        motor.armature = self.truth["rotor"]
        play = motor.parent.add_joint(name="play", type=motor.type, axis=motor.axis, pos=motor.pos)
        play.limited, play.range, play.solref_limit = True, [-self.size / 2, self.size / 2], [0.006, 1.0]

    def afterwards(self, track: Track) -> Track:
        effort, joint = track.effort.copy(), self.truth["joint"]
        effort[:, joint] -= self.truth["rotor"] * np.gradient(track.velocity[:, joint], STEP)
        return replace(track, effort=effort)

    def parameters(self) -> dict[str, float]:
        return {"gap": self.size, "joint": self.truth["joint"] + 1}


DRIVES: tuple[type[Fault], ...] = (
    *(ViscousFriction, CoulombFriction, StribeckFriction, LoadDependentFriction),
    *(MotorInertia, JointCoupling, GearRipple, Backlash),
)
