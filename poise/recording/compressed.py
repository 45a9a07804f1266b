"""Zstd as rosbag2 uses it: whole files are unpacked to a temporary file, single messages when they are read."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import zstandard

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import PIECE, Loss, LossKind, decompress, longest_chunk
from poise.recording.contents import Contents, MessageBlock, TemporaryFolder, UnpackingBudget, message_table

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # RFC 8878, section 3.1.1; CDR begins with a zero byte
_ENDING = ".zstd"
_UNKNOWN_SIZES = (-1, 2**64 - 1)  # of a frame that does not state how long its content is


def unpack_file(path: Path) -> tuple[TemporaryFolder, Path, list[Loss]]:
    """Decompress a file into a temporary folder, which is deleted when it is no longer referenced.

    A file that is cut gives what its last whole block holds, and a loss.

    Raises:
        InputError: FILE_UNREADABLE, FILE_UNWRITABLE (no space for the temporary file), FILE_CORRUPT (damaged),
            UNSUPPORTED (unpacks beyond `longest_file`).
    """
    folder = TemporaryFolder()
    target = folder.path / path.name.removesuffix(_ENDING)
    try:
        size = path.stat().st_size
        with path.open("rb") as source:
            expected = zstandard.get_frame_parameters(source.read(18)).content_size
            source.seek(0)
            written = _write(target, _pieces(path, source, UnpackingBudget(path, size)))
    except zstandard.ZstdError as error:
        sentence = f"{path} is damaged: its zstd frame does not decompress ({error}); copy it again from its source"
        raise InputError(ErrorCode.FILE_CORRUPT, sentence) from error
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error
    if not written:
        sentence = f"{path} is cut before the end of its first zstd block: copy it again from its source"
        raise InputError(ErrorCode.FILE_CORRUPT, sentence)
    losses = []
    if expected not in _UNKNOWN_SIZES and written < expected:
        sentence = f"{path.name}: the file is cut: {written} of {expected} decompressed bytes were read"
        losses.append(Loss(LossKind.TRUNCATED, size, None, None, sentence, None, path))
    return folder, target, losses


def _pieces(path: Path, source: Any, budget: UnpackingBudget) -> Iterator[bytes]:
    reader = zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(source, read_across_frames=True)
    while piece := reader.read(PIECE):
        budget.spend(len(piece))
        yield piece


def _write(target: Path, pieces: Iterator[bytes]) -> int:
    """Write the pieces; return how many bytes they have."""
    written = 0
    with target.open("wb") as file:
        for piece in pieces:
            try:
                file.write(piece)
            except OSError as error:
                sentence = f"{target} cannot be written: {error.strerror}; set TMPDIR to a larger disk"
                raise InputError(ErrorCode.FILE_UNWRITABLE, sentence) from error
            written += len(piece)
    return written


@dataclass(frozen=True, eq=False)
class UnpackedBlock:
    """A block whose messages are compressed one by one.

    Args:
        packed: the block as it is in the file.
        kept: (P,) the entries of its table that decompress.
        messages: (M,) of MESSAGE, of the decompressed messages.
    """

    packed: MessageBlock
    kept: npt.NDArray[np.void]
    messages: npt.NDArray[np.void]

    @property
    def checked(self) -> bool:
        """As the packed block."""
        return self.packed.checked

    def read(self) -> bytes:
        """Return the decompressed messages, one after another."""
        data = self.packed.read()
        sizes = self.messages["size"].tolist()
        entries = zip(self.kept["start"].tolist(), self.kept["size"].tolist(), sizes, strict=True)
        unpack = _Unpacker()
        return b"".join(unpack(data[start : start + size], length) for start, size, length in entries)


def unpack_messages(path: Path, contents: Contents[Any]) -> Contents[Any]:
    """Decompress the messages of a file that rosbag2 recorded with compression mode MESSAGE; others stay as they are.

    Raises:
        InputError: UNSUPPORTED when they unpack beyond `longest_file`; as the blocks' `read`.
    """
    if not contents.blocks or not _is_packed(contents.blocks[0]):
        return contents
    budget = UnpackingBudget(path, path.stat().st_size)
    damaged = 0
    blocks: list[UnpackedBlock] = []
    for block in contents.blocks:
        unpacked = _unpack(block, budget)
        damaged += len(block.messages) - len(unpacked.messages)
        if len(unpacked.messages):
            blocks.append(unpacked)
    if damaged:
        sentence = f"{damaged} compressed messages are damaged and were skipped"
        contents.lose(path, LossKind.DAMAGED, sentence, messages=damaged)
    contents.blocks = blocks
    return contents


def _is_packed(block: MessageBlock) -> bool:
    start = int(block.messages["start"][0])
    return block.read()[start : start + len(ZSTD_MAGIC)] == ZSTD_MAGIC


def _unpack(block: MessageBlock, budget: UnpackingBudget) -> UnpackedBlock:
    data, entries = block.read(), block.messages
    longest = longest_chunk(len(data))
    unpack = _Unpacker()
    sizes = np.zeros(len(entries), dtype=np.int64)
    for number, (start, size) in enumerate(zip(entries["start"].tolist(), entries["size"].tolist(), strict=True)):
        length = len(unpack(data[start : start + size], min(longest, budget.left)))
        budget.spend(length)
        longest -= length
        sizes[number] = length
    kept = sizes > 0
    table = message_table(entries["channel"][kept], entries["log_time"][kept], sizes[kept])
    return UnpackedBlock(block, entries[kept], table)


class _Unpacker:
    """Decompresses single messages."""

    def __init__(self) -> None:
        self._zstd = zstandard.ZstdDecompressor()

    def __call__(self, payload: bytes, longest: int) -> bytes:
        """Return a whole message; nothing when it is damaged, cut or unpacks to more than `longest` bytes."""
        try:
            expected = zstandard.get_frame_parameters(payload).content_size
            if expected in _UNKNOWN_SIZES:
                data = decompress(payload, "zstd", max(longest, 0))
            else:
                data = self._zstd.decompress(payload) if expected <= longest else b""
        except zstandard.ZstdError:
            return b""
        return data if len(data) <= longest else b""
