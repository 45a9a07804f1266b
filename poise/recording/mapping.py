"""Reading columns.yaml: which columns of which tables are which signals of a robot, in which units."""

from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import yaml

from poise.errors import ErrorCode, InputError
from poise.recording.contents import reason_of
from poise.recording.units import PER_GAIN, TICKS, TIME, UNITS_BY_QUANTITY
from poise.types import Array

_MAX_MAPPING = 1 << 20  # bytes
_SHARED = ("file", "time", "delimiter", "header", "missing")
KEYS_BY_KIND = {
    "joints": (("position", "velocity", "effort"), ("joints", "rename", "transmission")),
    "wrench": (("force", "torque"), ("frame",)),
    "imu": (("angular_velocity", "linear_acceleration"), ("frame",)),
    "pose": (("translation", "quaternion", "rotation"), ("parent", "child")),
}
_WIDTHS = {"quaternion": 4, "rotation": 9}
_COLUMN_KEYS = ("file", "column", "columns", "unit", "gain", "offset", "side", "ticks_per_turn")


@dataclass(frozen=True)
class Clock:
    """Where the stamps of a topic come from.

    Args:
        column: the column of times; "" when the samples are equally spaced.
        unit: ns in one unit of the column.
        rate: Hz of equally spaced samples.
        start: ns, added to every stamp.
    """

    column: str
    unit: int
    rate: float
    start: int


@dataclass(frozen=True)
class TextFormat:
    """How a text table is written.

    Args:
        delimiter: between cells; "" to recognise it.
        header: whether the first line names the columns; otherwise they are called 1, 2, ...
        missing: cells that hold no value.
    """

    delimiter: str
    header: bool
    missing: frozenset[str]


@dataclass(frozen=True, eq=False)
class MappedColumns:
    """The columns of one quantity: value = factor * raw, through the transmission, plus offset.

    Args:
        file: the table.
        names: a column for each component, or one whose cells hold lists.
        width: number of components.
        units: (width,) names.
        factor: (width,) unit times gain.
        offset: (width,) SI, of the joint.
        motor: whether the values are those of the motors, before the transmission.
        where: the place in the mapping, for errors.
    """

    file: Path
    names: tuple[str, ...]
    width: int
    units: tuple[str, ...]
    factor: Array
    offset: Array
    motor: bool
    where: str


@dataclass(frozen=True, eq=False)
class MappedTopic:
    """What one topic is made of.

    Args:
        name: of the topic.
        kind: one of KEYS_BY_KIND.
        columns: by quantity.
        clock: its stamps, from the first file of `columns`.
        text: the format of its text tables.
        joints: names, of kind "joints".
        transmission: (J, J) motor = transmission @ joint; the identity without one.
        frames: frame of a wrench or an IMU; parent and child of a pose.
    """

    name: str
    kind: str
    columns: dict[str, MappedColumns]
    clock: Clock
    text: TextFormat
    joints: tuple[str, ...]
    transmission: Array
    frames: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class TableMapping:
    """A mapping file.

    Args:
        path: of the file.
        topics: what it maps.
        robot_description: the URDF file; None without one.
        gravity: m/s2; None when it is not given.
    """

    path: Path
    topics: tuple[MappedTopic, ...]
    robot_description: Path | None
    gravity: float | None


class Section:
    """A part of the mapping, read with errors that name the key."""

    def __init__(self, path: Path, where: str, content: Any, keys: tuple[str, ...]) -> None:
        self.path, self.where = path, where
        if not isinstance(content, dict):
            raise self.error("", f"must be a mapping of {', '.join(keys)}")
        unknown = [str(key) for key in content if key not in keys]
        if unknown:
            raise self.error(unknown[0], f"is not a key here: use one of {', '.join(keys)}")
        self.content: dict[str, Any] = content

    def error(self, key: str, problem: str) -> InputError:
        """An error about a key."""
        place = ".".join(part for part in (self.where, key) if part) or "the file"
        return InputError(ErrorCode.BAD_INPUT, f"{self.path}: {place} {problem}")

    def text(self, key: str, default: str | None = None) -> str:
        """A text; required without a default."""
        value = self.content.get(key, default)
        if not isinstance(value, str) or (default is None and not value):
            raise self.error(key, "must be a text" if key in self.content else "is missing: give it")
        return value

    def number(self, key: str, default: float) -> float:
        """A finite number."""
        return float(self.numbers(key, default, 1)[0])

    def numbers(self, key: str, default: float, count: int) -> Array:
        """(count,) finite numbers; one stands for all."""
        try:
            values = np.asarray(self.content.get(key, default), dtype=np.float64).reshape(-1)
        except (TypeError, ValueError) as error:
            raise self.error(key, "must be a number or a list of numbers") from error
        if len(values) not in (1, count) or not np.isfinite(values).all():
            raise self.error(key, f"must be one finite number or a list of {count}: it has {len(values)}")
        return np.array(np.broadcast_to(values, count))

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts; a single one counts as a list, numbers count by their digits."""
        value = self.content.get(key)
        values = value if isinstance(value, list) else [value]
        if not values or any(isinstance(item, bool) or not isinstance(item, str | int) for item in values):
            raise self.error(key, "must be a name or a list of names")
        return tuple(str(item) for item in values)

    def file(self, key: str) -> Path:
        """A file inside of the mapping's folder."""
        name = self.text(key)
        if PurePath(name).is_absolute() or ".." in PurePath(name).parts:
            raise self.error(key, f"{name!r} is outside of the mapping's folder: put the mapping beside the tables")
        return self.path.parent / name

    def section(self, key: str, keys: tuple[str, ...], default: Any = None) -> "Section":
        """A part of this part."""
        where = f"{self.where}.{key}" if self.where else key
        return Section(self.path, where, self.content.get(key, default), keys)


def load_mapping(path: Path) -> TableMapping:
    """Read a mapping file.

    Raises:
        InputError: FILE_UNREADABLE; BAD_INPUT, which names the key, what it must be, and what it is.
    """
    try:
        with path.open("rb") as file:
            content = yaml.safe_load(file.read(_MAX_MAPPING))
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{path} is not YAML: {reason_of(error)}") from error
    top = Section(path, "", content, ("topics", "robot_description", "gravity", *_SHARED))
    listed = top.content.get("topics")
    if not isinstance(listed, dict) or not listed:
        raise top.error("topics", "must map topic names to their columns")
    topics = []
    for name, entries in listed.items():
        many = entries if isinstance(entries, list) else [entries]
        topics += [_topic(top, str(name), entry) for entry in many]
    description = top.file("robot_description") if "robot_description" in top.content else None
    gravity = top.number("gravity", 0.0) if "gravity" in top.content else None
    return TableMapping(path, tuple(topics), description, gravity)


def _topic(top: Section, name: str, content: Any) -> MappedTopic:
    given = content if isinstance(content, dict) else {}
    kinds = [kind for kind, (quantities, _) in KEYS_BY_KIND.items() if any(key in given for key in quantities)]
    if len(kinds) != 1:
        every = ", ".join(key for quantities, _ in KEYS_BY_KIND.values() for key in quantities)
        raise top.error(f"topics.{name}", f"must have columns of one kind of message: some of {every}")
    quantities, more = KEYS_BY_KIND[kinds[0]]
    section = Section(top.path, f"topics.{name}", given, (*quantities, *more, *_SHARED))
    shared = {key: top.content[key] for key in _SHARED if key in top.content}
    section.content = shared | section.content
    joints = _joints(section) if kinds[0] == "joints" else ()
    columns = {
        quantity: _columns(section, quantity, len(joints) or _WIDTHS.get(quantity, 3))
        for quantity in quantities
        if quantity in given
    }
    return MappedTopic(
        name=name,
        kind=kinds[0],
        columns=columns,
        clock=_clock(section),
        text=_text_format(section),
        joints=joints,
        transmission=_transmission(section, len(joints)),
        frames=tuple(section.text(key) for key in more if key in ("frame", "parent", "child")),
    )


def _joints(section: Section) -> tuple[str, ...]:
    """Joint names: a list, or a file with one a line; `rename` gives them the names of the URDF."""
    if isinstance(section.content.get("joints"), str):
        file = section.file("joints")
        try:
            with file.open(encoding="utf-8") as lines:
                names = tuple(line.strip() for line in lines.read(_MAX_MAPPING).splitlines() if line.strip())
        except (OSError, UnicodeDecodeError) as error:
            raise section.error("joints", f"{file.name!r} is not a readable list of names: {error}") from error
    else:
        names = section.texts("joints")
    renamed = section.content.get("rename", {})
    if not isinstance(renamed, dict) or any(name not in names for name in renamed):
        raise section.error("rename", f"must map some of {', '.join(names)} to the names of the URDF")
    names = tuple(str(renamed.get(name, name)) for name in names)
    if len(set(names)) != len(names) or not names:
        raise section.error("joints", f"must be different names: {', '.join(names)}")
    return names


def _columns(section: Section, quantity: str, width: int) -> MappedColumns:
    given = section.content[quantity]
    content = given if isinstance(given, dict) else {"columns": given}
    part = Section(section.path, f"{section.where}.{quantity}", content, _COLUMN_KEYS)
    if ("column" in content) == ("columns" in content):
        raise part.error("", "must have `columns`, or a `column` whose cells hold lists")
    names = part.texts("columns" if "columns" in content else "column")
    if len(names) not in (1, width):
        raise part.error("columns", f"must be {width} columns: it has {len(names)}")
    units = part.texts("unit") if "unit" in part.content else (next(iter(UNITS_BY_QUANTITY[quantity])),)
    side = part.text("side", "motor" if "transmission" in section.content else "joint")
    if side not in ("motor", "joint") or (side == "motor" and "transmission" not in section.content):
        raise part.error("side", "must be motor (with a transmission) or joint")
    return MappedColumns(
        file=(part if "file" in content else section).file("file"),
        names=names,
        width=width,
        units=tuple(np.broadcast_to(units, width).tolist()),
        factor=_unit_factors(part, quantity, units, width) * part.numbers("gain", 1.0, width),
        offset=part.numbers("offset", 0.0, width),
        motor=side == "motor",
        where=part.where,
    )


def _unit_factors(part: Section, quantity: str, given: tuple[str, ...], width: int) -> Array:
    """(width,) factors to SI of the unit, or of a unit for each component."""
    units = UNITS_BY_QUANTITY[quantity]
    ticks = TICKS[quantity == "velocity"] if quantity in ("position", "velocity") else ""
    unknown = [unit for unit in given if unit not in units and unit != ticks]
    if unknown or len(given) not in (1, width):
        allowed = ", ".join([*units, ticks] if ticks else units)
        raise part.error("unit", f"must be one of {allowed}, or a list of {width}: it is {', '.join(given)}")
    if "gain" not in part.content and any(unit in PER_GAIN for unit in given) and quantity == "effort":
        raise part.error("gain", f"is missing: give N m (or N) for each {given[0]}")
    if ticks in given and "ticks_per_turn" not in part.content:
        raise part.error("ticks_per_turn", "is missing: give the encoder counts of one turn")
    per_turn = part.numbers("ticks_per_turn", 1.0, width)
    if (per_turn == 0).any():
        raise part.error("ticks_per_turn", "must not be zero")
    factors = [units.get(unit, 2 * np.pi) for unit in given]
    counted = np.array([unit == ticks for unit in given])
    return np.where(counted, np.array(factors) / per_turn, np.broadcast_to(factors, width))


def _clock(section: Section) -> Clock:
    content = section.content.get("time", {})
    part = section.section("time", ("column", "unit", "rate", "start"), content)
    if ("column" in content) == ("rate" in content):
        raise part.error("", "must have the column of the times, or the rate (Hz) of equally spaced samples")
    unit = part.text("unit", "s")
    if unit not in TIME:
        raise part.error("unit", f"must be one of {', '.join(TIME)}: it is {unit}")
    rate = part.number("rate", 1.0)
    if rate <= 0:
        raise part.error("rate", f"must be more than zero: it is {rate}")
    column = part.texts("column")[0] if "column" in content else ""
    return Clock(column, TIME[unit], rate, round(part.number("start", 0.0) * 1e9))


def _text_format(section: Section) -> TextFormat:
    delimiter, header = section.text("delimiter", ""), section.content.get("header", True)
    if len(delimiter) > 1 or not isinstance(header, bool):
        key = "header" if len(delimiter) <= 1 else "delimiter"
        raise section.error(key, "must be true or false" if key == "header" else "must be one character")
    missing = section.texts("missing") if "missing" in section.content else ()
    return TextFormat(delimiter, header, frozenset(missing))


def _transmission(section: Section, joints: int) -> Array:
    """(J, J) motor positions for joint positions: a matrix, or its diagonal."""
    try:
        matrix = np.asarray(section.content.get("transmission", np.eye(joints)), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise section.error("transmission", "must be ratios, or rows of a matrix") from error
    matrix = np.diag(matrix) if matrix.ndim == 1 else matrix
    if matrix.shape != (joints, joints) or not np.isfinite(matrix).all():
        raise section.error("transmission", f"must be {joints} ratios or {joints} rows of {joints}")
    if joints and np.linalg.matrix_rank(matrix) < joints:
        raise section.error("transmission", "is singular: some joint would not move its motors")
    return matrix
