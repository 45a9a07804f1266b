"""An independent judge for damaged bags: a sample bag, what a cut leaves of it, and whether damage passed silently."""

import struct
from collections import Counter
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard

from poise.errors import InputError
from poise.recording import JointStream, PoseStream, RawMessage, WrenchStream, open_recording, write_recording

GRAVITY = {"poise": {"gravity": "9.82085"}}
MESSAGE, CHUNK = 5, 6


def write_sample(path: Path, compression: str, samples: int = 6000) -> bytes:
    """Write a bag of several chunks and topics, and return its bytes."""
    rng = np.random.default_rng(7)
    stamps = 1_700_000_000_000_000_000 + np.arange(samples) * 1_000_000
    wrench = WrenchStream(stamps, rng.normal(size=(samples, 6)).round(4), "ft_sensor")
    few = stamps[::20]
    empty = np.full((len(few), 2), np.nan)
    joints = JointStream(few, ("shoulder", "elbow"), rng.normal(size=(len(few), 2)), empty, empty)
    eye = np.broadcast_to(np.eye(3), (len(few), 3, 3))
    poses = PoseStream(few, eye, rng.normal(size=(len(few), 3)), "base", "ft_sensor")
    write_recording(
        path,
        {"wrench": wrench, "joint_states": joints, "tf": poses},
        robot_description="<robot name='sample'/>",
        metadata=GRAVITY,
        compression=compression,
    )
    return path.read_bytes()


def chunk_offsets(content: bytes) -> list[int]:
    """Return where the chunk records of a whole bag start."""
    return [start - 9 + 8 for opcode, start, _ in _records(content[8:-8]) if opcode == CHUNK]


def _records(data: bytes) -> list[tuple[int, int, int]]:
    """Walk whole records: (opcode, start of the content, end)."""
    found, position = [], 0
    while position + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        if position + 9 + length > len(data):
            break
        found.append((opcode, position + 9, position + 9 + length))
        position += 9 + length
    return found


def messages_before(content: bytes, cut: int) -> Counter[tuple[int, bytes]]:
    """Return (log time, data) of the messages that the first `cut` bytes of a whole bag still hold.

    Of a chunk that is cut, those count whose bytes come out of the decompressor.
    """
    messages: Counter[tuple[int, bytes]] = Counter()
    for opcode, start, end in _records(content[8:-8]):
        if opcode != CHUNK:
            continue
        start, end = start + 8, end + 8
        (name_length,) = struct.unpack_from("<I", content, start + 28)
        name = content[start + 32 : start + 32 + name_length]
        payload = content[start + 40 + name_length : min(end, cut)] if cut > start + 40 + name_length else b""
        if name == b"zstd":
            payload = zstandard.ZstdDecompressor().decompressobj().decompress(payload) if payload else b""
        elif name == b"lz4":
            payload = lz4.frame.LZ4FrameDecompressor().decompress(payload) if payload else b""
        for kind, first, last in _records(payload):
            if kind == MESSAGE:
                (log_time,) = struct.unpack_from("<Q", payload, first + 6)
                messages[log_time, payload[first + 22 : last]] += 1
    return messages


def judge(path: Path, truth: Counter[RawMessage]) -> str:
    """Say what a reader notices of a damaged bag: "error", "loss", "same", or "silent", which must never be.

    A message that never was in the bag is silent damage too, whatever else is reported.
    """
    try:
        recording = open_recording(path)
        found = Counter(recording.messages())
    except InputError:
        return "error"
    if found - truth or any(recording.metadata[name] != GRAVITY[name] for name in recording.metadata):
        return "silent"
    if recording.losses:
        return "loss"
    return "same" if found == truth and recording.metadata == GRAVITY else "silent"
