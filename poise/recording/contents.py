"""What the readers of all formats give: blocks of messages, the topics by their channel numbers, and what was lost."""

import shutil
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import mkdtemp
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt
from mcap.records import Channel, Schema

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import MESSAGE, Loss, LossKind, longest_file

_MAX_CHANNELS = 1 << 16  # the channel of a message is an unsigned 16-bit number

ROS1_MAGIC = b"#ROSBAG V2.0\n"
"""With which a ROS 1 bag begins."""


class TemporaryFolder:
    """A folder that is deleted when it is no longer referenced, or when Python ends.

    Args (attributes, not to be changed):
        path: of the folder.
    """

    def __init__(self) -> None:
        self.path = Path(mkdtemp(prefix="poise-recording-"))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


class MessageBlock(Protocol):
    """A stretch of a recording that is read at once."""

    @property
    def messages(self) -> npt.NDArray[np.void]:
        """(M,) of MESSAGE; `start` counts from the first byte that `read` returns."""

    @property
    def checked(self) -> bool:
        """Whether the writer left a checksum that covers these messages."""

    def read(self) -> bytes:
        """Return the bytes, unchanged since the file was scanned.

        Raises:
            InputError: FILE_CORRUPT when the file has changed, FILE_UNREADABLE when it is gone.
        """


BlockT = TypeVar("BlockT", bound=MessageBlock)


@dataclass
class Contents(Generic[BlockT]):
    """What one file gave: blocks of messages in file order, topics by their numbers, and what was lost.

    Args:
        unpacked: the temporary folder with the decompressed file, which must live as long as the blocks.
    """

    blocks: list[BlockT] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)
    unpacked: TemporaryFolder | None = None

    def add_topic(
        self,
        path: Path,
        name: str,
        message_type: str,
        *,
        encoding: str = "cdr",
        definition: tuple[str, str] = ("", ""),
        metadata: Mapping[str, str] | None = None,
    ) -> int:
        """Announce a topic and return its channel number.

        Args:
            path: the file, for the error.
            name: of the topic.
            message_type: as in "sensor_msgs/msg/Imu".
            encoding: of the messages.
            definition: the message definition and its language.
            metadata: what rosbag2 keeps with a topic.

        Raises:
            InputError: UNSUPPORTED when there are more topics than channel numbers.
        """
        number = len(self.channels) + 1
        if number >= _MAX_CHANNELS:
            raise InputError(ErrorCode.UNSUPPORTED, f"{path} has more than {_MAX_CHANNELS - 2} topics: split it")
        text, language = definition
        self.schemas[number] = Schema(id=number, data=text.encode(), encoding=language, name=message_type)
        self.channels[number] = Channel(
            id=number, topic=name, message_encoding=encoding, metadata=dict(metadata or {}), schema_id=number
        )
        return number

    def lose(
        self,
        path: Path,
        kind: LossKind,
        sentence: str,
        *,
        offset: int = 0,
        since: int | None = None,
        messages: int | None = None,
    ) -> None:
        """Report something that was lost; `since` is the log time (ns) from which messages may be missing."""
        self.losses.append(Loss(kind, offset, since, None, f"{path.name}: {sentence}", messages, path))


@dataclass
class UnpackingBudget:
    """How many bytes the compressed parts of a file may still unpack to.

    Args:
        path: the file, for the error.
        size: bytes of the file.
    """

    path: Path
    size: int
    used: int = 0

    @property
    def left(self) -> int:
        """Bytes."""
        return longest_file(self.size) - self.used

    def spend(self, unpacked: int) -> None:
        """Count unpacked bytes.

        Raises:
            InputError: UNSUPPORTED when a file unpacks to more than `longest_file`.
        """
        self.used += unpacked
        if self.left < 0:
            allowed = longest_file(self.size) / 1e6
            raise InputError(
                ErrorCode.UNSUPPORTED,
                f"{self.path} unpacks from {self.size / 1e6:.3g} MB to more than {allowed:.3g} MB:"
                " write it without compression if its content is meant to be so",
            )


def reason_of(error: Exception) -> str:
    """What a library says about an error, in one line of bounded length."""
    return " ".join(str(error).split())[:120]


def message_table(
    channels: npt.ArrayLike, log_times: npt.ArrayLike, sizes: npt.NDArray[np.int64]
) -> npt.NDArray[np.void]:
    """(M,) of MESSAGE for messages that follow each other without gaps."""
    table = np.empty(len(sizes), dtype=MESSAGE)
    table["channel"], table["log_time"], table["size"] = channels, log_times, sizes
    table["start"] = np.cumsum(sizes) - sizes
    return table
