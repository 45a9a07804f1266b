"""Commanded motion: joint commands as they were sent, and trajectories as they were to be executed."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.recording.encoding import typestore
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
    raws = recording.messages([found.name])
    messages = ((raw.log_time, decoded(recording, TRAJECTORY, found.name, raw.data)) for raw in raws)
    joined = _joined(f"{recording.path}: {found.name}", messages)
    if joined is None:
        sentence = f"{recording.path}: {found.name} has no points: record again with its publisher running"
        raise InputError(ErrorCode.EMPTY, sentence)
    return joined


def trajectories_in(messages: Sequence[tuple[int, bytes]]) -> JointStream | None:
    """What trajectories command, as `joint_commands` reads them; None when they have no points.

    Args:
        messages: arrival in ns, and trajectory_msgs/JointTrajectory as CDR bytes.

    Raises:
        InputError: as `joint_commands`.
    """
    return _joined("the trajectories", ((arrival, _message(data)) for arrival, data in messages))


def _message(data: bytes) -> Any:
    try:
        return typestore().deserialize_cdr(data, TRAJECTORY)
    except Exception as error:  # whatever broken bytes provoke
        sentence = f"a message is not a {TRAJECTORY} ({error!r}): check its publisher"
        raise InputError(ErrorCode.TYPE_MISMATCH, sentence) from error


def _chosen(recording: Recording) -> str:
    if any(name.strip("/").rpartition("/")[2] == "joint_commands" for name in recording.topics):
        return "joint_commands"
    found = [name for name, kind in recording.topics.items() if kind == TRAJECTORY]
    if len(found) == 1:
        return found[0]
    there = ", ".join(found) or "none"
    sentence = f"{recording.path} has no joint_commands, and trajectories on {there}: name the topic of the commands"
    raise InputError(ErrorCode.TOPIC_MISSING, sentence, topics=recording.topics)


def _parts(where: str, messages: Iterable[tuple[int, Any]]) -> Iterator[_Part]:
    """The trajectory of each message that has points; a message without a stamp counts from its arrival, ns."""
    for arrival, message in messages:
        if not message.points:
            continue
        names = tuple(message.joint_names)
        start = stamp_of(message) or arrival
        due = np.array([start + _nanoseconds(point.time_from_start) for point in message.points])
        fields = [
            np.array([_row(where, getattr(point, field), len(names), field) for point in message.points])
            for field in ("positions", "velocities", "effort")
        ]
        yield names, due, fields


def _nanoseconds(duration: Any) -> int:
    return int(duration.sec) * 10**9 + int(duration.nanosec)


def _row(where: str, values: Array, joints: int, field: str) -> Array:
    """A point's values; NaN when it leaves them out."""
    if not len(values) and field != "positions":
        return np.full(joints, np.nan)
    if len(values) != joints:
        sentence = f"{where}: a point has {len(values)} {field} for {joints} joints: fix its publisher"
        raise InputError(ErrorCode.TYPE_MISMATCH, sentence)
    return np.asarray(values, dtype=np.float64)


def _joined(where: str, messages: Iterable[tuple[int, Any]]) -> JointStream | None:
    """The commands of all trajectories; None without points."""
    parts = list(_parts(where, messages))
    if not parts:
        return None
    names = parts[0][0]
    if any(set(part[0]) != set(names) for part in parts):
        sentence = f"{where}: the trajectories hold different joints: use a topic for each robot"
        raise InputError(ErrorCode.JOINT_MISSING, sentence)
    ends = [int(part[1].min()) for part in parts[1:]] + [2**63 - 1]
    kept = []
    for (own, due, fields), end in zip(parts, ends, strict=True):
        columns = [own.index(name) for name in names]
        before = due < end
        kept.append((due[before], [field[before][:, columns] for field in fields]))
    stamps = np.concatenate([due for due, _ in kept])
    position, velocity, effort = (np.concatenate([fields[index] for _, fields in kept]) for index in range(3))
    return JointStream(stamps, names, position, velocity, effort)
