"""Robots and recordings as they are in the field: joint efforts without a wrist sensor."""

from dataclasses import dataclass, field

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading import MeasuredStreams, NominalModel, ReadRecording, read_streams
from poise.recording import JointStream
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory, IdealRobot
from poise.types import Array

_INERTIA = '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/>'


def urdf(*joints: tuple[str, str, str]) -> str:
    """A chain of joints (name, type, axis), each with a link of 2 kg that reaches 0.3 m."""
    inertial = f'<inertial><origin xyz="0.15 0 0.02"/><mass value="2"/>{_INERTIA}</inertial>'
    text = '<robot name="chain"><link name="link_0"/>'
    for number, (name, kind, axis) in enumerate(joints, start=1):
        text += (
            f'<link name="link_{number}">{inertial}</link><joint name="{name}" type="{kind}">'
            f'<parent link="link_{number - 1}"/><child link="link_{number}"/><origin xyz="0.3 0 0"/>'
            f'<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="3" effort="100"/></joint>'
        )
    return text + "</robot>"


ARM = urdf(("shoulder", "revolute", "0 1 0"), ("elbow", "revolute", "0 1 0"), ("wrist", "revolute", "1 0 0"))


@dataclass(frozen=True)
class Recorded:
    """A simulated recording of joint states.

    Args:
        text: the URDF.
        damping, coulomb: N m s/rad and N m (N s/m and N) of every joint.
        seconds, rate: length, s, and Hz of the states.
        seed: of motion and noise.
        effort_noise: N m, one sigma.
    """

    text: str = ARM
    damping: float = 0.0
    coulomb: float = 0.0
    seconds: float = 12.0
    rate: float = 125.0
    seed: int = 1
    effort_noise: float = 0.05
    moving: tuple[float, ...] = field(default=())

    def joints(self) -> JointStream:
        """As the driver reports them."""
        robot = RobotModel.from_urdf(self.text, f"link_{self.text.count('<joint')}")
        rng = np.random.default_rng(self.seed)
        motion = FourierTrajectory.random(robot, rng, duration=self.seconds, speed=0.5, frequency=0.15)
        scale = np.array(self.moving or (1.0,) * len(robot.joint_names))
        motion = FourierTrajectory(
            motion.centre, motion.sine * scale, motion.cosine * scale, motion.frequency, motion.duration, motion.ramp
        )
        at = np.arange(round(self.seconds * self.rate)) / self.rate
        moved = motion.at(at)
        effort = IdealRobot(robot, np.zeros(10)).effort(moved) + self.friction(moved.velocity)
        effort = effort + rng.normal(size=effort.shape) * self.effort_noise
        position = moved.position + rng.normal(size=effort.shape) * 1e-5
        stamps = np.round((at + 100.0) * 1e9).astype(np.int64)
        return JointStream(stamps, robot.joint_names, position, moved.velocity, effort)

    def friction(self, velocity: Array) -> Array:
        """(N, J) viscous and Coulomb friction."""
        return self.damping * velocity + self.coulomb * np.tanh(velocity / 5e-3)


def streams(joints: JointStream, text: str = ARM, commands: JointStream | None = None) -> MeasuredStreams:
    """Without a wrench."""
    return MeasuredStreams("test", None, lambda names: _chosen(joints, names), None, lambda: text, commands)


def read(joints: JointStream, text: str = ARM, model: NominalModel | None = None) -> ReadRecording:
    """As the tool reads it."""
    return read_streams(streams(joints, text), model or NominalModel())


def _chosen(joints: JointStream, names: tuple[str, ...]) -> JointStream:
    if not set(names) <= set(joints.names):
        raise InputError(ErrorCode.JOINT_MISSING, f"lack {names}", there=list(joints.names))
    columns = [joints.names.index(name) for name in names]
    parts = (values[:, columns] for values in (joints.position, joints.velocity, joints.effort))
    return JointStream(joints.stamps, names, *parts)
