"""From decoded messages to streams: in the order of their header stamps, one frame, columns by name."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError
from poise.geometry import rotation_of_quaternion
from poise.recording.cdr import Batch
from poise.recording.streams import ImuStream, JointStream, PoseStream, WrenchStream
from poise.recording.timeline import in_time_order
from poise.types import Array, Stamps

NoteLate = Callable[[str, int], None]
_Part = tuple[npt.NDArray[np.int64], dict[str, Any]]  # which messages of the topic, and their columns


def wrench_frames(topic: str, batches: Iterable[Batch]) -> dict[str, int]:
    """The frames that the wrenches of a topic name, and how many messages do, in the order of arrival."""
    counts: dict[str, int] = {}
    for index, columns in sorted(_parts(topic, batches), key=lambda part: int(part[0][0])):
        frame = str(columns["frame_id"])
        counts[frame] = counts.get(frame, 0) + len(index)
    return counts


def wrench_stream(
    topic: str, batches: Iterable[Batch], note_late: NoteLate, frame_id: str | None = None
) -> WrenchStream:
    """Assemble the wrenches of a topic, those of one frame when it is named."""
    parts = [part for part in _parts(topic, batches) if frame_id in (None, part[1]["frame_id"])]
    frame_id = _only(topic, parts, "frame_id")
    stamps, (wrench,) = _in_order(topic, parts, ["wrench"], note_late)
    return WrenchStream(stamps, wrench, frame_id)


def imu_stream(topic: str, batches: Iterable[Batch], note_late: NoteLate) -> ImuStream:
    """Assemble the IMU samples of a topic; a covariance that starts with -1 says that there is no measurement."""
    parts = _parts(topic, batches)
    frame_id = _only(topic, parts, "frame_id")
    for _, columns in parts:
        for name in ("angular_velocity", "linear_acceleration"):
            columns[name][columns[name + "_covariance"][:, 0] == -1] = np.nan
    stamps, (turning, acceleration) = _in_order(topic, parts, ["angular_velocity", "linear_acceleration"], note_late)
    return ImuStream(stamps, turning, acceleration, frame_id)


def joint_stream(
    topic: str, batches: Iterable[Batch], note_late: NoteLate, names: tuple[str, ...] | None
) -> JointStream:
    """Assemble the joint states of a topic, the columns in the order of the names (None: of the first message)."""
    parts = _parts(topic, batches)
    sets = {frozenset(columns["names"]) for _, columns in parts}
    there = "; ".join(" ".join(sorted(group)) or "none" for group in sets)
    if names is None:
        if len(sets) > 1:
            sentence = f"{topic}: messages hold different joints ({there}): say which to read"
            raise InputError(ErrorCode.JOINT_MISSING, sentence)
        names = tuple(min(parts, key=lambda part: int(part[0][0]))[1]["names"])
    parts = [part for part in parts if set(names) <= set(part[1]["names"])]
    if not parts:
        sentence = f"{topic}: no message holds the joints {' '.join(names)}; there are {there}: record them all"
        raise InputError(ErrorCode.JOINT_MISSING, sentence, there=sorted(frozenset().union(*sets)))
    fields = ["position", "velocity", "effort"]
    for index, columns in parts:
        order = [columns["names"].index(name) for name in names]
        for field in fields:
            columns[field] = _joint_columns(topic, index, columns[field], len(columns["names"]))[:, order]
    stamps, (position, velocity, effort) = _in_order(topic, parts, fields, note_late)
    return JointStream(stamps, names, position, velocity, effort)


def _joint_columns(topic: str, index: npt.NDArray[np.int64], values: Array, joints: int) -> Array:
    """Give a field that a message leaves out as NaN."""
    if values.shape[1] == joints:
        return values
    if values.shape[1]:
        sentence = f"{topic}: message {index[0]} has {values.shape[1]} values for {joints} joints: fix its publisher"
        raise InputError(ErrorCode.TYPE_MISMATCH, sentence)
    return np.full((len(values), joints), np.nan)


def pose_stream(
    topic: str, batches: Iterable[Batch], note_late: NoteLate, child: str | None = None, parent: str | None = None
) -> PoseStream:
    """Assemble the poses of a frame in its parent; None: there must be only one."""
    parts = [
        part
        for part in _parts(topic, batches)
        if child in (None, part[1]["child_frame_id"]) and parent in (None, part[1]["frame_id"])
    ]
    parent = _only(topic, parts, "frame_id")
    child = _only(topic, parts, "child_frame_id")
    fields = ["translation", "rotation", *(["twist"] if all("twist" in columns for _, columns in parts) else [])]
    stamps, (translation, quaternion, *twists) = _in_order(topic, parts, fields, note_late)
    twist = twists[0] if twists and not np.isnan(twists[0]).all() else None
    return PoseStream(stamps, rotation_of_quaternion(quaternion), translation, parent, child, twist)


def _parts(topic: str, batches: Iterable[Batch]) -> list[_Part]:
    parts = [(batch.index, element) for batch in batches for element in batch.elements]
    if not parts:
        raise InputError(ErrorCode.EMPTY, f"{topic}: no message in it: record again with its publisher running")
    return parts


def _only(topic: str, parts: list[_Part], name: str) -> str:
    """Return the one text that all parts share."""
    texts = sorted({str(columns[name]) for _, columns in parts})
    if len(texts) != 1:
        sentence = f"{topic}: {name} differs between messages ({', '.join(texts)}): choose one, or split the topic"
        raise InputError(ErrorCode.FRAME_UNKNOWN, sentence)
    return texts[0]


def _in_order(topic: str, parts: list[_Part], names: list[str], note_late: NoteLate) -> tuple[Stamps, list[Array]]:
    """Join the parts, in the order of arrival first, then of the stamps."""
    arrival = np.argsort(np.concatenate([index for index, _ in parts]), kind="stable")
    stamps = np.concatenate([columns["stamp"] for _, columns in parts])[arrival]
    order, late = in_time_order(stamps, topic)
    note_late(topic, late)
    chosen = arrival[order]
    return stamps[order], [np.concatenate([columns[name] for _, columns in parts])[chosen] for name in names]
