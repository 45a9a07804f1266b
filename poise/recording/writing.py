"""Writing bags: one .mcap file that rosbag2, rosbags and Foxglove read, with every checksum, whole or not at all."""

import contextlib
import heapq
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from mcap.writer import CompressionType, Writer

from poise.errors import ErrorCode, InputError
from poise.recording.encoding import definition_of, encode_stream, encode_text, message_type_of, qos_profile
from poise.recording.scan import METADATA_CHECK, metadata_checksum
from poise.recording.streams import Stream

COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
_CHUNK_SIZE = 256 << 10  # what one damaged byte can cost


class RecordingWriter:
    """Writes a bag message by message; use it in a `with` block.

    The file appears under its name (replacing another) when the block ends; when it ends by an exception, nothing is
    left behind.

    Args:
        path: the .mcap file to write.
        compression: "none", "lz4" or "zstd".
        metadata: mcap metadata records, by their name.

    Raises:
        InputError: FILE_UNWRITABLE (no such folder, no permission, disk full), here and from every method.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        compression: str = "zstd",
        metadata: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        if compression not in COMPRESSIONS:
            sentence = f"compression {compression!r} is unknown: choose one of {', '.join(COMPRESSIONS)}"
            raise InputError(ErrorCode.BAD_INPUT, sentence)
        self.path = Path(path)
        self._compression = COMPRESSIONS[compression]
        self._metadata = metadata or {}
        self._draft = self.path.with_name(f".{self.path.name}.{secrets.token_hex(4)}.tmp")
        self._file: IO[bytes] | None = None
        self._writer: Writer | None = None
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def __enter__(self) -> Self:
        with self._reported():
            if self.path.is_dir():
                sentence = f"{self.path} is a folder: give the name of a file"
                raise InputError(ErrorCode.FILE_UNWRITABLE, sentence)
            self._file = self._draft.open("xb")
            self._writer = Writer(
                self._file, chunk_size=_CHUNK_SIZE, compression=self._compression, enable_data_crcs=True
            )
            self._writer.start(profile="ros2", library=f"poise (mcap {version('mcap')})")
            for name, values in self._metadata.items():
                check = {METADATA_CHECK: metadata_checksum(name, dict(values))}
                self._writer.add_metadata(name, {**values, **check})
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._discard()
            return
        with self._reported():
            file, writer = self._opened()
            writer.finish()  # type: ignore[no-untyped-call]
            file.flush()
            os.fsync(file.fileno())
            file.close()
            self._draft.replace(self.path)

    def add_topic(
        self,
        topic: str,
        message_type: str,
        *,
        definition: str | None = None,
        definition_encoding: str = "ros2msg",
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        """Announce a topic.

        Args:
            topic: its name.
            message_type: as in "geometry_msgs/msg/WrenchStamped".
            definition: the message definition; None: known, when it is one of the common types.
            definition_encoding: language of the definition.
            metadata: what rosbag2 keeps with a topic; None: QoS and type hash by the type.

        Raises:
            InputError: UNSUPPORTED when the definition is neither given nor known.
        """
        if definition is None:
            definition, type_hash = definition_of(message_type)
            metadata = metadata or {"offered_qos_profiles": qos_profile(topic), "topic_type_hash": type_hash}
        _, writer = self._opened()
        with self._reported():
            if message_type not in self._schemas:
                schema = writer.register_schema(message_type, definition_encoding, definition.encode())
                self._schemas[message_type] = schema
            channel = writer.register_channel(topic, "cdr", self._schemas[message_type], dict(metadata or {}))
            self._channels[topic] = channel

    def write(self, topic: str, log_time: int, data: bytes) -> None:
        """Write one message.

        Args:
            topic: announced before.
            log_time: ns.
            data: the message in CDR.

        Raises:
            InputError: TOPIC_MISSING when the topic was not announced.
        """
        if topic not in self._channels:
            sentence = f"topic {topic} was not announced to the bag {self.path}: call add_topic first"
            raise InputError(ErrorCode.TOPIC_MISSING, sentence)
        _, writer = self._opened()
        with self._reported():
            writer.add_message(self._channels[topic], log_time=log_time, publish_time=log_time, data=data)

    def _opened(self) -> tuple[IO[bytes], Writer]:
        if self._file is None or self._writer is None:
            raise InputError(ErrorCode.BAD_INPUT, f"the writer of {self.path} is not open: use it in a `with` block")
        return self._file, self._writer

    @contextlib.contextmanager
    def _reported(self) -> Iterator[None]:
        """Discard the draft when anything fails, and turn an error of the file system into an InputError."""
        try:
            yield
        except OSError as error:
            self._discard()
            sentence = f"{self.path} cannot be written: {error.strerror}; nothing was left there"
            raise InputError(ErrorCode.FILE_UNWRITABLE, sentence) from error
        except BaseException:
            self._discard()
            raise

    def _discard(self) -> None:
        if self._file is None:
            return
        with contextlib.suppress(OSError):  # closing flushes, which fails again on a full disk
            self._file.close()
        self._draft.unlink(missing_ok=True)


def write_recording(
    path: str | Path,
    streams: Mapping[str, Stream | Sequence[Stream]],
    *,
    robot_description: str | None = None,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    compression: str = "zstd",
) -> None:
    """Write streams to a bag, in the order of their stamps, which are the log times too.

    Args:
        path: the .mcap file; one that exists is replaced once all is written.
        streams: by topic; several on one topic (the frames of `tf`) as a list.
        robot_description: the URDF, on that topic, at the first stamp.
        metadata: mcap metadata records, by their name.
        compression: "none", "lz4" or "zstd".

    Raises:
        InputError: FILE_UNWRITABLE, EMPTY (no samples), TYPE_MISMATCH (not streams, or of several types on one topic).
    """
    listed = {topic: [given] if isinstance(given, Stream) else list(given) for topic, given in streams.items()}
    flat = [(topic, stream) for topic, group in listed.items() for stream in group if len(stream)]
    if not flat:
        raise InputError(ErrorCode.EMPTY, f"nothing to write to {path}: the streams have no samples")
    with RecordingWriter(path, compression=compression, metadata=metadata) as writer:
        for topic, group in listed.items():
            types = {message_type_of(topic, stream) for stream in group}
            if len(types) != 1:
                sentence = f"topic {topic} cannot carry several types ({', '.join(sorted(types))}): use two topics"
                raise InputError(ErrorCode.TYPE_MISMATCH, sentence)
            writer.add_topic(topic, types.pop())
        if robot_description is not None:
            writer.add_topic("robot_description", "std_msgs/msg/String")
            start = min(int(stream.stamps[0]) for _, stream in flat)
            writer.write("robot_description", start, encode_text(robot_description))
        messages = [_named(topic, stream) for topic, stream in flat]
        for stamp, topic, data in heapq.merge(*messages, key=lambda message: message[0]):
            writer.write(topic, stamp, data)


def _named(topic: str, stream: Stream) -> Iterator[tuple[int, str, bytes]]:
    """Encode a stream with the topic beside each message."""
    for stamp, data in encode_stream(topic, stream):
        yield stamp, topic, data
