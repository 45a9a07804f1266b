"""What a robot measured, as the reading takes it: from a recording, or from the buffers of a running robot."""

from collections.abc import Callable
from dataclasses import dataclass

from poise.mismatch.reading.commands import recorded_commands
from poise.recording import JointStream, PoseStream, Recording, WrenchStream


@dataclass(frozen=True, eq=False)
class MeasuredStreams:
    """Streams that move a robot model.

    Args:
        name: of the recording or the window, for error sentences.
        wrench: of the sensor; None without one.
        joint_states: the states of these joints, in this order; raises JOINT_MISSING when they were not measured.
        odometry: poses of the robot's base; None when they were not measured.
        commands: of the joints; None without them.
        description: the robot's URDF; raises ROBOT_DESCRIPTION_MISSING.
    """

    name: str
    wrench: WrenchStream | None
    joint_states: Callable[[tuple[str, ...]], JointStream]
    odometry: PoseStream | None
    description: Callable[[], str]
    commands: JointStream | None = None


def recorded_streams(recording: Recording, wrench: WrenchStream | None) -> MeasuredStreams:
    """The streams of a recording with joint states."""
    return MeasuredStreams(
        str(recording.path),
        wrench,
        lambda names: recording.joint_states(names=names),
        recording.odometry() if holds(recording, "odom") else None,
        recording.robot_description,
        recorded_commands(recording),
    )


def holds(recording: Recording, name: str) -> bool:
    """Whether a recording has a topic of this name, in any namespace."""
    return any(topic.strip("/").rpartition("/")[2] == name for topic in recording.topics)
