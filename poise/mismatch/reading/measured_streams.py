"""What a robot measured, as the reading takes it: from a recording, or from the buffers of a running robot."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

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


def recorded_streams(
    recording: Recording, wrench: WrenchStream | None, called: Mapping[str, str] | None = None
) -> MeasuredStreams:
    """The streams of a recording with joint states.

    Args:
        recording: the recording.
        wrench: of it.
        called: other names of its joints, by those that it has.
    """
    known = called or {}
    written = {new: old for old, new in known.items()}

    def joint_states(names: tuple[str, ...]) -> JointStream:
        stream = recording.joint_states(names=tuple(written.get(name, name) for name in names))
        return _named(stream, known)

    commands = recorded_commands(recording)
    return MeasuredStreams(
        str(recording.path),
        wrench,
        joint_states,
        recording.odometry() if holds(recording, "odom") else None,
        recording.robot_description,
        None if commands is None else _named(commands, known),
    )


def _named(stream: JointStream, called: Mapping[str, str]) -> JointStream:
    return replace(stream, names=tuple(called.get(name, name) for name in stream.names))


def holds(recording: Recording, name: str) -> bool:
    """Whether a recording has a topic of this name, in any namespace."""
    return any(topic.strip("/").rpartition("/")[2] == name for topic in recording.topics)
