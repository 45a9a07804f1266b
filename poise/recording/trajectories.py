"""Commanded motion: joint commands as they were sent, and trajectories as they were to be executed."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.recording.images import decoded
from poise.recording.reading import Recording
from poise.recording.streams import JointStream, stamp_of
from poise.types import Array

STATE, TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
_Part = tuple[tuple[str, ...], Array, list[Array]]  # joints, (N,) stamps ns, [position, velocity, effort] (N, J)


def joint_commands(recording: Recording, topic: str | None = None) -> JointStream:
    """Read what the joints were commanded to do.

    A point of a trajectory is due at the stamp of its message plus `time_from_start`; a message without a stamp counts
    from its log time. A later trajectory replaces the rest of an earlier one.

    Args:
        recording: where.
        topic: of sensor_msgs/JointState or trajectory_msgs/JointTrajectory; None: `joint_commands`, else the only
            topic with trajectories.

    Raises:
        InputError: TOPIC_MISSING; TYPE_MISMATCH for another type, or points without a position for each joint;
            JOINT_MISSING when the messages hold different joints; EMPTY; as `Recording.joint_states`.
    """
    found = recording.topic(_chosen(recording) if topic is None else topic)
    if found.type == STATE:
        return recording.joint_states(found.name)
    if found.type != TRAJECTORY:
        sentence = f"{recording.path}: topic {found.name} carries {found.type}, not {STATE} or {TRAJECTORY}"
        raise InputError(ErrorCode.TYPE_MISMATCH, sentence)
    parts = list(_parts(recording, found.name))
    if not parts:
        sentence = f"{recording.path}: {found.name} has no points: record again with its publisher running"
        raise InputError(ErrorCode.EMPTY, sentence)
    names = parts[0][0]
    if any(set(part[0]) != set(names) for part in parts):
        sentence = f"{recording.path}: the trajectories of {found.name} hold different joints: record one robot a topic"
        raise InputError(ErrorCode.JOINT_MISSING, sentence)
    return _joined(names, parts)


def _chosen(recording: Recording) -> str:
    if any(name.strip("/").rpartition("/")[2] == "joint_commands" for name in recording.topics):
        return "joint_commands"
    found = [name for name, kind in recording.topics.items() if kind == TRAJECTORY]
    if len(found) == 1:
        return found[0]
    there = ", ".join(found) or "none"
    sentence = f"{recording.path} has no joint_commands, and trajectories on {there}: name the topic of the commands"
    raise InputError(ErrorCode.TOPIC_MISSING, sentence, topics=recording.topics)


def _parts(recording: Recording, topic: str) -> Iterator[_Part]:
    """The trajectory of each message that has points."""
    for raw in recording.messages([topic]):
        message = decoded(recording, TRAJECTORY, topic, raw.data)
        if not message.points:
            continue
        names = tuple(message.joint_names)
        start = stamp_of(message) or raw.log_time
        due = np.array([start + _nanoseconds(point.time_from_start) for point in message.points])
        fields = [
            np.array([_row(recording, topic, getattr(point, field), len(names), field) for point in message.points])
            for field in ("positions", "velocities", "effort")
        ]
        yield names, due, fields


def _nanoseconds(duration: Any) -> int:
    return int(duration.sec) * 10**9 + int(duration.nanosec)


def _row(recording: Recording, topic: str, values: Array, joints: int, field: str) -> Array:
    """A point's values; NaN when it leaves them out."""
    if not len(values) and field != "positions":
        return np.full(joints, np.nan)
    if len(values) != joints:
        sentence = f"{recording.path}: a point of {topic} has {len(values)} {field} for {joints} joints: record again"
        raise InputError(ErrorCode.TYPE_MISMATCH, sentence)
    return np.asarray(values, dtype=np.float64)


def _joined(names: tuple[str, ...], parts: list[_Part]) -> JointStream:
    ends = [int(part[1].min()) for part in parts[1:]] + [2**63 - 1]
    kept = []
    for (own, due, fields), end in zip(parts, ends, strict=True):
        columns = [own.index(name) for name in names]
        before = due < end
        kept.append((due[before], [field[before][:, columns] for field in fields]))
    stamps = np.concatenate([due for due, _ in kept])
    position, velocity, effort = (np.concatenate([fields[index] for _, fields in kept]) for index in range(3))
    return JointStream(stamps, names, position, velocity, effort)
