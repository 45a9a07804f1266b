"""A recording from tables: the streams that a mapping describes, given as the messages that would carry them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError
from poise.geometry import rotation_of_quaternion
from poise.recording.contents import Contents, MessageBlock, message_table
from poise.recording.encoding import definition_of, encode_text, message_type_of, qos_profile
from poise.recording.mapping import KEYS_BY_KIND, MappedColumns, MappedTopic, TableMapping, load_mapping
from poise.recording.row_encoding import encode_rows, pattern_of
from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream
from poise.recording.tables import read_table
from poise.recording.text_tables import RecordedTable
from poise.recording.units import TIME, UNITS_BY_QUANTITY, same_unit
from poise.types import Array, Stamps

_BLOCK_ROWS = 4096
_MAX_DESCRIPTION = 64 << 20  # bytes of a URDF
_MAX_SKEW = 1e-3  # how far the columns of a rotation may be from orthonormal
_QUANTITIES_BY_KIND = {kind: quantities for kind, (quantities, _) in KEYS_BY_KIND.items()}


@dataclass(frozen=True, eq=False)
class StreamBlock:
    """Some samples of a stream, encoded when they are read.

    Args:
        topic: of the messages.
        stream: the samples, with row numbers for stamps: a table may hold its rows out of order.
        stamps: (M,) ns.
        messages: (M,) of MESSAGE.
        checked: never, as tables have no checksums.
    """

    topic: str
    stream: Stream
    stamps: Stamps
    messages: npt.NDArray[np.void]
    checked: bool = False

    def read(self) -> bytes:
        """Return the encoded messages, one after another."""
        return encode_rows(self.topic, self.stream, self.stamps).tobytes()


@dataclass(frozen=True, eq=False)
class BytesBlock:
    """Messages that are kept as they are.

    Args:
        data: the messages, one after another.
        messages: (M,) of MESSAGE.
        checked: never.
    """

    data: bytes
    messages: npt.NDArray[np.void]
    checked: bool = False

    def read(self) -> bytes:
        """Return the messages."""
        return self.data


def read_tables(path: Path) -> Contents[MessageBlock]:
    """Read the tables that a mapping file names.

    Raises:
        InputError: as `load_mapping` and `read_table`; SHAPE_MISMATCH when the tables of a topic differ in length;
            ROBOT_DESCRIPTION_MISSING when the URDF cannot be read; BAD_INPUT for a matrix that is not a rotation.
    """
    mapping = load_mapping(path)
    contents: Contents[MessageBlock] = Contents()
    if mapping.gravity is not None:
        contents.metadata["poise"] = {"gravity": repr(mapping.gravity)}
    channels: dict[str, int] = {}
    start = None
    for topic in mapping.topics:
        stream, stamps = _read_topic(mapping, topic, contents)
        start = int(stamps[0]) if start is None else min(start, int(stamps[0]))
        message_type = message_type_of(topic.name, stream)
        if topic.name not in channels:
            channels[topic.name] = _announce(contents, path, topic.name, message_type)
        channel = channels[topic.name]
        if contents.schemas[channel].name != message_type:
            sentence = f"{path}: topics.{topic.name} mixes kinds of messages: give each kind a topic"
            raise InputError(ErrorCode.BAD_INPUT, sentence)
        contents.blocks += _blocks(topic.name, stream, stamps, channel)
    if mapping.robot_description is not None:
        channel = _announce(contents, path, "robot_description", "std_msgs/msg/String")
        data = encode_text(_description(mapping.robot_description))
        contents.blocks.append(BytesBlock(data, message_table(channel, max(start or 0, 0), np.array([len(data)]))))
    return contents


def _announce(contents: Contents[MessageBlock], path: Path, name: str, message_type: str) -> int:
    definition, type_hash = definition_of(message_type)
    metadata = {"offered_qos_profiles": qos_profile(name), "topic_type_hash": type_hash}
    return contents.add_topic(path, name, message_type, definition=(definition, "ros2msg"), metadata=metadata)


def _blocks(topic: str, stream: Stream, stamps: Stamps, channel: int) -> list[StreamBlock]:
    blocks = []
    for first in range(0, len(stream), _BLOCK_ROWS):
        rows = slice(first, first + _BLOCK_ROWS)
        part = stream.select(rows)
        sizes = np.full(len(part), len(pattern_of(topic, part)))
        table = message_table(channel, stamps[rows].clip(0), sizes)
        blocks.append(StreamBlock(topic, part, stamps[rows], table))
    return blocks


def _description(file: Path) -> str:
    try:
        with file.open(encoding="utf-8") as text:
            return text.read(_MAX_DESCRIPTION)
    except (OSError, UnicodeDecodeError) as error:
        sentence = f"{file} cannot be read as a URDF ({error}): correct robot_description in the mapping"
        raise InputError(ErrorCode.ROBOT_DESCRIPTION_MISSING, sentence) from error


# -- topics ---------------------------------------------------------------------------------------------------


def _read_topic(mapping: TableMapping, topic: MappedTopic, contents: Contents[MessageBlock]) -> tuple[Stream, Stamps]:
    """Read a topic's tables, each once: its samples with row numbers for stamps, and (N,) ns."""
    files = list(dict.fromkeys(columns.file for columns in topic.columns.values()))
    tables: dict[Path, RecordedTable] = {}
    for file in files:
        names = [name for columns in topic.columns.values() if columns.file == file for name in columns.names]
        tables[file] = read_table(file, names, topic.clock if file == files[0] else None, topic.text)
        contents.losses += tables[file].losses
    values = {
        quantity: _si_values(mapping, topic, quantity, columns, tables[columns.file])
        for quantity, columns in topic.columns.items()
    }
    rows = {quantity: len(array) for quantity, array in values.items()}
    count = min(rows.values())
    if len(set(rows.values())) > 1 and not any(table.losses for table in tables.values()):
        listed = ", ".join(f"{quantity} {number}" for quantity, number in rows.items())
        sentence = f"{mapping.path}: the tables of topics.{topic.name} differ in their numbers of rows: {listed}"
        raise InputError(ErrorCode.SHAPE_MISMATCH, sentence)
    kept = np.arange(count)
    others = [columns.file for other in mapping.topics if other is not topic for columns in other.columns.values()]
    if set(files) & set(others):
        # In a table of several topics, the rows of the others have empty cells here.
        kept = np.flatnonzero(np.isfinite(np.hstack([array[:count] for array in values.values()])).any(axis=1))
    if not len(kept):
        raise InputError(ErrorCode.EMPTY, f"{mapping.path}: topics.{topic.name} has no values: correct its columns")
    stream = _stream(mapping, topic, {quantity: array[kept] for quantity, array in values.items()}, len(kept))
    return stream, _stamps(mapping, topic, tables[files[0]], count)[kept]


def _si_values(
    mapping: TableMapping, topic: MappedTopic, quantity: str, columns: MappedColumns, table: RecordedTable
) -> Array:
    """(N, width) in SI units. With motor = T joint for positions, joint efforts are T^T times those of the motors."""
    raw = np.hstack([table.columns[name] for name in columns.names])
    if raw.shape[1] != columns.width:
        sentence = f"{columns.where} has {raw.shape[1]} values a row in {columns.file.name}, it must be {columns.width}"
        raise InputError(ErrorCode.BAD_INPUT, f"{mapping.path}: {sentence}: correct the columns or the joints")
    for name, unit in zip(columns.names, columns.units, strict=False):
        _check_unit(mapping, columns.where, table.units.get(name, unit), unit, UNITS_BY_QUANTITY[quantity])
    values = raw * columns.factor
    if columns.motor and quantity == "effort":
        values = values @ topic.transmission
    elif columns.motor:
        values = np.asarray(np.linalg.solve(topic.transmission, values.T).T, dtype=np.float64)
    return np.asarray(values + columns.offset)


def _check_unit(mapping: TableMapping, where: str, stated: str, named: str, units: Mapping[str, float]) -> None:
    """Refuse a unit that differs from the one that the table states."""
    if not same_unit(stated, named, units):
        sentence = (
            f"{mapping.path}: {where}: the table states the unit {stated}, the mapping {named}: correct one of them"
        )
        raise InputError(ErrorCode.BAD_INPUT, sentence)


def _stamps(mapping: TableMapping, topic: MappedTopic, table: RecordedTable, count: int) -> Stamps:
    if table.stamps is not None:
        named = next(name for name, unit in TIME.items() if unit == topic.clock.unit)
        _check_unit(mapping, f"topics.{topic.name}.time", table.units.get(topic.clock.column, named), named, TIME)
        return table.stamps[:count] + topic.clock.start
    return np.asarray(np.rint(np.arange(count) * (1e9 / topic.clock.rate)), dtype=np.int64) + topic.clock.start


def _stream(mapping: TableMapping, topic: MappedTopic, values: dict[str, Array], count: int) -> Stream:
    rows = np.arange(count)
    unknown = np.full((count, len(topic.joints) or 3), np.nan)
    parts = [values.get(quantity, unknown) for quantity in _QUANTITIES_BY_KIND[topic.kind]]
    if topic.kind == "joints":
        return JointStream(rows, topic.joints, *parts)
    if topic.kind == "wrench":
        return WrenchStream(rows, np.hstack(parts), *topic.frames)
    if topic.kind == "imu":
        return ImuStream(rows, parts[0], parts[1], topic.frames[0])
    return PoseStream(rows, _rotations(mapping, topic, values, count), parts[0], topic.frames[0], topic.frames[1])


def _rotations(mapping: TableMapping, topic: MappedTopic, values: dict[str, Array], count: int) -> Array:
    """(N, 3, 3) from quaternions x y z w, or from matrices row by row."""
    if "quaternion" in values:
        return rotation_of_quaternion(values["quaternion"])
    rotations = values["rotation"].reshape(-1, 3, 3) if "rotation" in values else np.tile(np.eye(3), (count, 1, 1))
    skew = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((skew > _MAX_SKEW) | (np.linalg.det(np.nan_to_num(rotations)) < 0))
    if wrong.size:
        where = f"{mapping.path}: topics.{topic.name}.rotation: row {wrong[0] + 1} of the table"
        sentence = f"{where} is not a rotation: name r11, r12, ... r33 in this order"
        raise InputError(ErrorCode.BAD_INPUT, sentence)
    return rotations
