"""Reading bags: an .mcap file or a rosbag2 folder, opened as a Recording that gives the streams of its topics."""

import functools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError
from poise.notebooks import html_table
from poise.recording import decoding, timeline
from poise.recording.blocks import Loss, LossKind
from poise.recording.cdr import Batch, UndecodableError, decode
from poise.recording.contents import Contents, MessageBlock
from poise.recording.folders import find_files
from poise.recording.opening import read_contents
from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream

S = TypeVar("S", bound=Stream)

_BLOCKS_AT_HAND = 8  # kept decompressed while messages are read in the order of time


class RawMessage(NamedTuple):
    """A message as it is in the bag: log time ns, topic as recorded, CDR bytes."""

    log_time: int
    topic: str
    data: bytes


class Topic(NamedTuple):
    """What a bag says about a topic.

    `definition` is the message definition, `definition_encoding` its language ("ros2msg" or "ros2idl"), `metadata`
    what rosbag2 keeps with a topic (QoS, type hash).
    """

    name: str
    type: str
    encoding: str
    definition: str
    definition_encoding: str
    metadata: tuple[tuple[str, str], ...]


def open_recording(path: str | Path, *, strict: bool = False) -> "Recording":
    """Open a bag, check every checksum in it, and find every intact message.

    What is damaged or cut off is skipped and listed in `Recording.losses`, never passed silently.

    Args:
        path: an .mcap or .db3 file (or either with .zstd), a rosbag2 folder, a ROS 1 .bag, or a table or folder of
            tables with columns.yaml.
        strict: raise instead when anything at all is lost or damaged.

    Raises:
        InputError: FILE_UNREADABLE (missing, no permission, a folder without a bag), UNSUPPORTED (another storage),
            FILE_CORRUPT (not a recording; damage, when strict), EMPTY (no message in it), BAD_INPUT (columns.yaml).
    """
    path = Path(path)
    files, losses = find_files(path)
    recording = Recording(path, [read_contents(file) for file in files], losses)
    if strict and recording.losses:
        more = f" (and {len(recording.losses) - 1} more)" if len(recording.losses) > 1 else ""
        raise _unreadable(recording, f"is damaged{more}", "read it without strict")
    if not any(recording.counts.values()):
        if recording.losses:
            raise _unreadable(recording, "gives no message", "record again")
        raise InputError(ErrorCode.EMPTY, f"{path} holds no messages: record again with the topics published")
    return recording


def _unreadable(recording: "Recording", what: str, alternative: str) -> InputError:
    """UNSUPPORTED when all that is wrong is a compression that is not read, else FILE_CORRUPT."""
    unsupported = all(loss.kind is LossKind.UNSUPPORTED for loss in recording.losses)
    how_to_fix = (
        "convert it with `mcap compress` (of the mcap command-line tool)"
        if unsupported
        else "copy it again from its source"
    )
    return InputError(
        ErrorCode.UNSUPPORTED if unsupported else ErrorCode.FILE_CORRUPT,
        f"{recording.path} {what}: {recording.losses[0].sentence}; {how_to_fix}, or {alternative}",
        losses=recording.losses,
    )


class Recording:
    """A bag. Messages are ordered by their header stamps, and by log times where they have none.

    Args (attributes, not to be changed):
        topics: type by topic, as recorded.
        counts: intact messages by topic.
        losses: what is wrong with the bag.
        metadata: the mcap metadata records, by their name.
        unchecked: messages that no checksum vouches for, because the writer left none (rosbag2 does by default).
        reordered: messages that came late and were put in their place, by topic; grows as streams are read.
        clocks: by topic, what is wrong with the stamps of its headers, and which times are used; grows likewise.
    """

    def __init__(self, path: Path, files: list[Contents[Any]], losses: Iterable[Loss] = ()) -> None:
        self.path = path
        self.losses = (*losses, *(loss for contents in files for loss in contents.losses))
        self.metadata = {name: values for contents in files for name, values in contents.metadata.items()}
        self.reordered: dict[str, int] = {}
        self.clocks: dict[str, str] = {}
        self._unpacked = [contents.unpacked for contents in files]  # temporary folders, deleted with this object
        self._topics: list[Topic] = []
        self._blocks: list[tuple[MessageBlock, npt.NDArray[np.int64]]] = []  # with the number of each message's topic
        for contents in files:
            self._add_file(contents)
        found = np.zeros(len(self._topics), dtype=int)
        for _, numbers in self._blocks:
            found += np.bincount(numbers, minlength=len(self._topics))
        self.unchecked = sum(len(block.messages) for block, _ in self._blocks if not block.checked)
        self.topics = {topic.name: topic.type for topic in self._topics}
        self.counts = dict.fromkeys(self.topics, 0)
        for topic, count in zip(self._topics, found, strict=True):
            self.counts[topic.name] += int(count)

    @property
    def newest(self) -> int:
        """The log time of the last message, ns."""
        return max(int(block.messages["log_time"].max()) for block, _ in self._blocks if len(block.messages))

    def __repr__(self) -> str:
        counts = ", ".join(f"{topic} {count}" for topic, count in self.counts.items())
        return f"Recording({self.path}: {counts}{f'; {len(self.losses)} losses' if self.losses else ''})"

    def _repr_html_(self) -> str:
        """Topics with their types and counts, and what is wrong with the bag, for notebooks."""
        rows = [(name, kind, self.counts[name]) for name, kind in self.topics.items()]
        return html_table(str(self.path), ("topic", "type", "messages"), rows, [loss.sentence for loss in self.losses])

    def _add_file(self, contents: Contents[Any]) -> None:
        number_by_channel = np.zeros(1 << 16, dtype=np.int64)
        for channel in contents.channels.values():
            schema = contents.schemas.get(channel.schema_id)
            topic = Topic(
                name=channel.topic,
                type=schema.name if schema else "",
                encoding=channel.message_encoding,
                definition=schema.data.decode(errors="replace") if schema else "",
                definition_encoding=schema.encoding if schema else "",
                metadata=tuple(channel.metadata.items()),
            )
            if topic not in self._topics:
                self._topics.append(topic)
            number_by_channel[channel.id] = self._topics.index(topic)
        self._blocks += [(block, number_by_channel[block.messages["channel"]]) for block in contents.blocks]

    # -- topics -----------------------------------------------------------------------------------------------

    def topic(self, name: str, message_type: str | None = None) -> Topic:
        """Find a topic by its name, with or without a leading slash, and in any namespace when only one fits.

        Raises:
            InputError: TOPIC_MISSING when none or several fit, TYPE_MISMATCH when the only one has another type.
        """
        wanted = name.strip("/")
        named = [topic for topic in self._topics if topic.name.strip("/") == wanted]
        named = named or [topic for topic in self._topics if topic.name.endswith("/" + wanted)]
        typed = [topic for topic in named if message_type in (None, topic.type)]
        there = ", ".join(f"{topic} ({kind})" for topic, kind in self.topics.items()) or "no topics"
        if named and not typed:
            raise InputError(
                ErrorCode.TYPE_MISMATCH,
                f"{self.path}: topic {named[0].name} carries {named[0].type}, not {message_type}; the bag has {there}",
            )
        if len({topic.name for topic in typed}) != 1:
            why = f"has several topics {name}: give the full name" if typed else f"has no topic {name}: name another"
            raise InputError(ErrorCode.TOPIC_MISSING, f"{self.path} {why} of {there}", topics=self.topics)
        return typed[0]

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[RawMessage]:
        """Give the messages of these topics (None: of all) as they are, in the order of their log times."""
        names = set(self.topics) if topics is None else {self.topic(name).name for name in topics}
        chosen = [number for number, topic in enumerate(self._topics) if topic.name in names]
        masks = [np.isin(numbers, chosen) for _, numbers in self._blocks]
        owner = np.repeat(np.arange(len(masks)), [int(mask.sum()) for mask in masks])
        entries = np.concatenate([block.messages[mask] for (block, _), mask in zip(self._blocks, masks, strict=True)])
        numbers = np.concatenate([own[mask] for (_, own), mask in zip(self._blocks, masks, strict=True)])
        read = functools.lru_cache(_BLOCKS_AT_HAND)(lambda number: self._blocks[number][0].read())
        for at in np.argsort(entries["log_time"], kind="stable"):
            _, log_time, start, size = entries[at].tolist()
            data = read(int(owner[at]))[start : start + size]
            yield RawMessage(log_time, self._topics[numbers[at]].name, data)

    # -- streams ----------------------------------------------------------------------------------------------

    def wrench(self, topic: str = "wrench", frame_id: str | None = None) -> WrenchStream:
        """Read geometry_msgs/WrenchStamped; what is not finite stays so and shows in `not_finite`.

        Args:
            topic: where.
            frame_id: the messages of this frame alone; None: all, which must name one frame.

        Raises:
            InputError: as `topic`; TIME_BACKWARDS when the clock was set back; TYPE_MISMATCH when a message does not
                decode; FRAME_UNKNOWN when the frame changes on the way; EMPTY when no message is left.
        """
        found, batches = self._decode(topic, "geometry_msgs/msg/WrenchStamped")
        return self._on_a_clock(decoding.wrench_stream(found, batches, self._note_late, frame_id), found)

    def wrench_frames(self, topic: str = "wrench") -> dict[str, int]:
        """The frames that wrenches name, and how many messages do, in the order of arrival.

        Raises:
            InputError: as `topic`; TYPE_MISMATCH when a message does not decode; EMPTY when no message is left.
        """
        return decoding.wrench_frames(*self._decode(topic, "geometry_msgs/msg/WrenchStamped"))

    def joint_states(self, topic: str = "joint_states", names: Iterable[str] | None = None) -> JointStream:
        """Read sensor_msgs/JointState.

        Args:
            topic: where.
            names: the joints to read, in this order, from the messages that hold them all; None when all messages hold
                the same joints, in whatever order.

        Raises:
            InputError: as `wrench`; JOINT_MISSING when no message holds the names, or None and the messages differ.
        """
        found, batches = self._decode(topic, "sensor_msgs/msg/JointState")
        wanted = None if names is None else tuple(names)
        return self._on_a_clock(decoding.joint_stream(found, batches, self._note_late, wanted), found)

    def imu(self, topic: str = "imu") -> ImuStream:
        """Read sensor_msgs/Imu; what a message declares as not measured (covariance -1) is NaN.

        Raises:
            InputError: as `wrench`.
        """
        found, batches = self._decode(topic, "sensor_msgs/msg/Imu")
        return decoding.imu_stream(found, batches, self._note_late)

    def odometry(self, topic: str = "odom") -> PoseStream:
        """Read the poses of nav_msgs/Odometry.

        Raises:
            InputError: as `wrench`.
        """
        found, batches = self._decode(topic, "nav_msgs/msg/Odometry")
        return decoding.pose_stream(found, batches, self._note_late)

    def poses(self, child: str, parent: str | None = None) -> PoseStream:
        """Read where a frame is in its parent, from tf, or from tf_static when tf does not hold it.

        Args:
            child: the frame.
            parent: its direct parent; None when it has only one in the bag.

        Raises:
            InputError: as `wrench`; FRAME_UNKNOWN when the bag does not hold this frame under this parent.
        """
        for found, decoded in self._transforms():
            if any(pair[0] == child and parent in (None, pair[1]) for pair in _child_and_parent(decoded)):
                return decoding.pose_stream(found, decoded, self._note_late, child, parent)
        there = ", ".join(f"{above} -> {below}" for below, above in self.frame_parents()) or "no frames"
        wanted = child if parent is None else f"{parent} -> {child}"
        raise InputError(ErrorCode.FRAME_UNKNOWN, f"{self.path}: no pose of {wanted}; the bag holds {there}")

    def frame_parents(self) -> list[tuple[str, str]]:
        """Every child frame of tf and tf_static with its parent, sorted.

        Raises:
            InputError: TYPE_MISMATCH when a message does not decode.
        """
        return sorted({pair for _, decoded in self._transforms() for pair in _child_and_parent(decoded)})

    def _transforms(self) -> Iterator[tuple[str, list[Batch]]]:
        for name in ("tf", "tf_static"):
            if any(topic.strip("/").rpartition("/")[2] == name for topic in self.topics):
                found, batches = self._decode(name, "tf2_msgs/msg/TFMessage")
                yield found, list(batches)

    def robot_description(self, topic: str = "robot_description") -> str:
        """Return the last URDF in the bag.

        Raises:
            InputError: ROBOT_DESCRIPTION_MISSING; TYPE_MISMATCH.
        """
        try:
            _, batches = self._decode(topic, "std_msgs/msg/String")
        except InputError as error:
            if error.code != ErrorCode.TOPIC_MISSING:
                raise
            fix = "record it too, or give a URDF file"
            sentence = f"{self.path} has no {topic}: {fix}"
            raise InputError(ErrorCode.ROBOT_DESCRIPTION_MISSING, sentence) from error
        last = max(batches, key=lambda batch: int(batch.index[-1]), default=None)
        if last is None:
            raise InputError(ErrorCode.ROBOT_DESCRIPTION_MISSING, f"{self.path}: {topic} has no message: record again")
        return str(last.elements[0]["data"])

    def _decode(self, name: str, message_type: str) -> tuple[str, Iterator[Batch]]:
        topic = self.topic(name, message_type)
        if topic.encoding != "cdr":
            sentence = f"{self.path}: topic {topic.name} is encoded as {topic.encoding!r}, only cdr is read: convert it"
            raise InputError(ErrorCode.UNSUPPORTED, sentence)
        return topic.name, self._batches(topic)

    def _batches(self, topic: Topic) -> Iterator[Batch]:
        """Decode a topic block by block; the batches' indices count through all of its messages, in file order."""
        chosen = np.array([other[:2] == topic[:2] for other in self._topics])
        done = 0
        for block, numbers in self._blocks:
            entries = block.messages[chosen[numbers]]
            if not len(entries):
                continue
            try:
                for batch in decode(topic.type, block.read(), entries["start"], entries["size"]):
                    yield Batch(batch.index + done, batch.elements)
            except UndecodableError as error:
                raise InputError(
                    ErrorCode.TYPE_MISMATCH,
                    f"{self.path}: message {done + error.index} of {topic.name} is not a {topic.type} ({error}): "
                    "record it again, or leave this topic out",
                ) from error
            done += len(entries)

    def _on_a_clock(self, stream: S, name: str) -> S:
        """A stream at times of one clock.

        Headers without stamps, as some simulators write them, get the log times. Where the clock was set forward during
        the recording, which the log times show, the other stamps are moved to the clock that is nearest to the log.
        """
        if len(stream) < 2 or (stream.stamps.any() and not len(timeline.holes(stream.stamps))):
            return stream
        logged = self._log_times(name)
        if stream.stamps.any():
            steps = timeline.clock_steps(stream.stamps, logged) if len(logged) == len(stream) else []
            if steps:
                since = (stream.stamps - stream.stamps[0]) * 1e-9
                places = ", ".join(f"{jump * 1e-9:.3f} s after {since[first - 1]:.2f} s" for first, jump in steps)
                self.clocks[name] = (
                    f"the clock of {name} was set forward by {places}, as the log times show: taken back"
                )
            return replace(stream, stamps=timeline.on_one_clock(stream.stamps, logged, steps)) if steps else stream
        if len(logged) != len(stream) or logged[0] == logged[-1]:
            raise InputError(
                ErrorCode.TIME_BACKWARDS,
                f"{self.path}: the headers of {name} have no stamps, and neither has the bag: let the simulator stamp"
                " its messages (use_sim_time with /clock)",
            )
        self.clocks[name] = f"the headers of {name} have no stamps: the times of the bag are used"
        return replace(stream, stamps=logged)

    def _log_times(self, name: str) -> npt.NDArray[np.int64]:
        """(N,) ns, ascending, of the messages of a topic."""
        chosen = np.array([topic.name == name for topic in self._topics])
        times = [block.messages["log_time"][chosen[numbers]] for block, numbers in self._blocks]
        return np.sort(np.concatenate(times).astype(np.int64), kind="stable")  # nearly sorted

    def _note_late(self, topic: str, count: int) -> None:
        self.reordered[topic] = count


def _child_and_parent(decoded: list[Batch]) -> set[tuple[str, str]]:
    return {(part["child_frame_id"], part["frame_id"]) for batch in decoded for part in batch.elements}
