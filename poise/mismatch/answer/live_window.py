"""Diagnosis of a running robot: the latest messages are kept, and examined like a recording."""

import math
from collections import deque
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.mismatch.answer.diagnosis import Diagnosis, diagnose
from poise.mismatch.effects import Effect, all_effects, effect_named
from poise.mismatch.reading import MeasuredStreams, NominalModel, ReadRecording, read_streams
from poise.recording import (
    JointStream,
    PoseStream,
    Stream,
    header_of,
    joint_states_in,
    trajectories_in,
    wrenches_in,
    write_recording,
)

_MOST_SAMPLES = 200_000
"""Most messages that are kept of each topic: a minute at more than 3 kHz."""
_LEAST_WINDOW = 8.0
"""s of wrenches that can be examined."""


@dataclass(frozen=True)
class LiveDiagnosis:
    """The result of one window.

    Args:
        found: the diagnosis; its seconds count from `start`.
        reading: the window as it was read.
    """

    found: Diagnosis
    reading: ReadRecording

    @property
    def start(self) -> int:
        """ns, the stamp that the seconds of the diagnosis count from."""
        return self.reading.recorded.start


class LiveWindow:
    """The last seconds of a running robot; add messages as they come, in any order of topics.

    Args:
        seconds: that are kept.
        expects_wrench: a sensor publishes wrenches; without one, joint efforts alone are examined.
    """

    def __init__(self, seconds: float, *, expects_wrench: bool = True) -> None:
        self.expects_wrench = expects_wrench
        self._length = round(seconds * 1e9)
        self.frame_id = ""
        """Of the wrench, by its first message."""
        self.description = ""
        """URDF."""
        self._frame = b""
        self.late = 0
        """Messages that arrived after a later one of their topic; left out."""
        self.foreign = 0
        """Wrenches of another frame than the first one; left out."""
        self._wrenches: deque[tuple[int, Any]] = deque(maxlen=_MOST_SAMPLES)
        self._joints: deque[tuple[int, Any]] = deque(maxlen=_MOST_SAMPLES)
        self._poses: deque[tuple[int, Any]] = deque(maxlen=_MOST_SAMPLES)
        self._commands: deque[tuple[int, Any]] = deque(maxlen=_MOST_SAMPLES)
        self._trajectories: deque[tuple[int, Any]] = deque(maxlen=_MOST_SAMPLES)
        self._frames = ("odom", "base_link")

    def add_wrench_message(self, data: bytes) -> None:
        """Take a geometry_msgs/WrenchStamped as CDR bytes; its content is read by `streams` alone.

        Raises:
            InputError: TYPE_MISMATCH when it has no header.
        """
        stamp, frame = header_of(data)
        if not self.frame_id:
            self.frame_id = frame.decode(errors="replace")
            self._frame = frame
        if frame != self._frame:
            self.foreign += 1
            return
        self._add(self._wrenches, stamp, data)

    def add_joint_state_message(self, data: bytes) -> None:
        """Take a sensor_msgs/JointState as CDR bytes; its content is read by `streams` alone.

        Raises:
            InputError: TYPE_MISMATCH when it has no header.
        """
        self._add(self._joints, header_of(data)[0], data)

    def add_command_message(self, data: bytes) -> None:
        """Take a commanded sensor_msgs/JointState as CDR bytes; its content is read by `streams` alone.

        Raises:
            InputError: TYPE_MISMATCH when it has no header.
        """
        self._add(self._commands, header_of(data)[0], data)

    def add_trajectory_message(self, data: bytes, arrival: int) -> None:
        """Take a trajectory_msgs/JointTrajectory as CDR bytes; without a stamp it begins at its arrival, ns.

        Trajectories are used where there are no commanded joint states, as in a recording.

        Raises:
            InputError: TYPE_MISMATCH when it has no header.
        """
        self._add(self._trajectories, header_of(data)[0] or arrival, (arrival, data))

    def add_odometry(self, stamp: int, frames: tuple[str, str], rotation: ArrayLike, translation: ArrayLike) -> None:
        """Take a pose of the base, (3, 3) and (3,) m, of frames (parent, child)."""
        self._frames = frames
        self._add(self._poses, stamp, (rotation, translation))

    def expect_wrench(self, expected: bool) -> None:
        """Whether a sensor publishes wrenches now; when it has stopped, earlier ones are forgotten."""
        if self.expects_wrench and not expected:
            self._wrenches.clear()
        self.expects_wrench = expected

    def clear(self) -> None:
        """Forget what was kept."""
        for kept in self._kept:
            kept.clear()

    @property
    def _kept(self) -> tuple[deque[tuple[int, Any]], ...]:
        return self._wrenches, self._joints, self._poses, self._commands, self._trajectories

    @property
    def _leading(self) -> deque[tuple[int, Any]]:
        """The messages whose stamps count: wrenches, or joint states where there is no sensor."""
        return self._wrenches if self.expects_wrench or self._wrenches else self._joints

    @property
    def seconds(self) -> float:
        """s from the first wrench that is kept to the last; without a sensor, of joint states."""
        kept = self._leading
        return (kept[-1][0] - kept[0][0]) * 1e-9 if kept else 0.0

    @property
    def newest(self) -> int:
        """ns, stamp of the last wrench (joint state); 0 for none."""
        return self._leading[-1][0] if self._leading else 0

    @property
    def counts(self) -> tuple[int, int]:
        """Wrenches and joint states that are kept."""
        return len(self._wrenches), len(self._joints)

    @property
    def lacks(self) -> str:
        """What is missing for an examination; "" when nothing is."""
        if self.expects_wrench and not self._wrenches:
            return "no wrench has come yet"
        if not self._joints:
            return "no joint state has come yet"
        if not self.description:
            return "no robot_description has come yet"
        if self.seconds < _LEAST_WINDOW:
            return f"{self.seconds:.0f} of {_LEAST_WINDOW:.0f} s of messages have come"
        return ""

    def snapshot(self) -> "LiveWindow":
        """A copy that later messages do not change, for another thread."""
        made = copy(self)
        made._wrenches, made._joints, made._poses, made._commands, made._trajectories = map(deque, self._kept)
        return made

    def streams(self) -> MeasuredStreams:
        """The messages of the window for the reading.

        Raises:
            InputError: EMPTY when nothing is kept; TYPE_MISMATCH for a message that is not of its type.
        """
        if not self._leading:
            what = "wrench" if self.expects_wrench else "joint state"
            raise InputError(ErrorCode.EMPTY, f"the window holds no {what}: wait until some have come")
        wrenches, joints = ([data for _, data in kept] for kept in (self._wrenches, self._joints))
        poses = list(self._poses)
        odometry, description = None, self.description
        if len(poses) > 1:
            rotation, translation = (np.array([value[k] for _, value in poses]) for k in (0, 1))
            odometry = PoseStream(_stamps(poses), rotation, translation, *self._frames)
        return MeasuredStreams(
            "the live window",
            wrenches_in(wrenches) if wrenches else None,
            lambda names: joint_states_in(joints, names),
            odometry,
            lambda: description,
            self._commanded(),
        )

    def _commanded(self) -> JointStream | None:
        if self._commands:
            return joint_states_in([data for _, data in self._commands], None)
        return trajectories_in([message for _, message in self._trajectories])

    def _add(self, kept: deque[tuple[int, Any]], stamp: int, value: Any) -> None:
        if kept and stamp <= kept[-1][0]:
            if kept[-1][0] - stamp < self._length:
                self.late += 1
                return
            # The clock was reset: a simulation or a replay was restarted. Commands may have a clock of their own.
            (kept if kept is self._commands or kept is self._trajectories else self).clear()
        kept.append((stamp, value))
        # The message before the window holds in it: a trajectory is sent once, and lasts.
        while stamp - kept[1 if kept is self._trajectories and len(kept) > 1 else 0][0] > self._length:
            kept.popleft()


def examine(
    streams: MeasuredStreams,
    model: NominalModel,
    library: Sequence[Effect] | None = None,
    keep: Path | None = None,
    deadline: float = math.inf,
) -> LiveDiagnosis:
    """Compare a window with the model, as `poise mismatch` does with a bag.

    Args:
        streams: of `LiveWindow.streams`.
        model: the nominal simulation.
        library: effects to look for; None: all.
        keep: folder in which the window is kept as a bag when something is found in it; None: nowhere.
        deadline: s, see `diagnose`.

    Raises:
        InputError: as `read_streams`.
        NoAnswerError: as `read_streams`; NOT_IDENTIFIABLE without a wrench and without usable efforts, and why.
    """
    reading = read_streams(streams, model)
    if not (reading.recorded.has("wrench") or reading.recorded.has("effort")):
        raise NoAnswerError(
            ErrorCode.NOT_IDENTIFIABLE,
            " ".join(("There is no wrench and no usable joint effort.", *(each.sentence for each in reading.findings))),
        )
    made = LiveDiagnosis(diagnose(reading.recorded, reading.model, None, library, deadline=deadline), reading)
    if keep is not None and made.found.verdict != "none":
        keep.mkdir(parents=True, exist_ok=True)
        path = keep / f"window_{made.start}.mcap"
        kept = {
            "wrench": streams.wrench,
            "joint_states": reading.joints,
            "odom": streams.odometry,
            "joint_commands": streams.commands,
        }
        there: dict[str, Stream] = {topic: stream for topic, stream in kept.items() if stream is not None}
        write_recording(path, there, robot_description=streams.description())
    return made


def effects_called(names: Sequence[str]) -> list[Effect] | None:
    """Effects of the library by their names; None, all, for no names.

    Raises:
        InputError: BAD_INPUT for a name that the library does not have, naming those that it has.
    """
    found = [effect_named(name) for name in names]
    unknown = [name for name, effect in zip(names, found, strict=True) if effect is None]
    if unknown:
        there = ", ".join(effect.name for effect in all_effects())
        raise InputError(ErrorCode.BAD_INPUT, f"there is no effect {', '.join(unknown)}; there are {there}")
    return [effect for effect in found if effect is not None] or None


def _stamps(kept: list[tuple[int, Any]]) -> NDArray[np.int64]:
    return np.array([stamp for stamp, _ in kept], dtype=np.int64)
