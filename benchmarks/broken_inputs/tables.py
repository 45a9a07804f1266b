"""Tables (CSV) as programs write them, and mappings that misread them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.broken_inputs.way import Way
from benchmarks.foreign.case import Case
from benchmarks.foreign.robots import Array

Columns = dict[str, Array]
Write = Callable[[Columns], str]
RECORDING = "columns.yaml"
_XYZ = ("x", "y", "z")
_RATIO = 100.0


@dataclass
class Tables:
    """A recording as tables, and the model that it is held against."""

    columns: dict[str, Columns]
    mapping: dict[str, Any]
    description: str
    model: dict[str, Any]
    write_one: Write = field(default=lambda columns: text(columns))
    encoding: str = "utf-8"

    def topic(self, name: str) -> dict[str, Any]:
        """The mapping of a topic."""
        return dict(self.mapping["topics"])[name]

    def write(self, folder: Path) -> None:
        """The tables, the mapping, the robot and model.yaml."""
        folder.mkdir(parents=True)
        for name, columns in self.columns.items():
            (folder / name).write_bytes(self.write_one(columns).encode(self.encoding))
        for name, content in ((RECORDING, self.mapping), ("model.yaml", self.model)):
            (folder / name).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        (folder / "arm.urdf").write_text(self.description, encoding="utf-8")


def text(columns: Columns, delimiter: str = ",", values: str = ".7g", times: str = ".6f") -> str:
    """Columns as text; NaN is an empty cell."""
    lines = [delimiter.join(columns)]
    for row in zip(*columns.values(), strict=True):
        cells = [format(row[0], times), *("" if cell != cell else format(cell, values) for cell in row[1:])]
        lines.append(delimiter.join(cells))
    return "\n".join(lines) + "\n"


def tables_of(case: Case) -> Tables:
    """The streams of a case, one table for each topic; time begins at 0.2 s."""
    streams, names = case.streams, list(case.streams.names)
    start = int(streams.joints.stamps[0]) - 200_000_000
    columns: dict[str, Columns] = {}
    topics: dict[str, Any] = {}

    def add(topic: str, stamps: Any, values: dict[str, tuple[list[str], Array]], **more: Any) -> None:
        file = f"{topic}.csv"
        columns[file] = {"t": (stamps - start) * 1e-9}
        for each, array in values.values():
            columns[file] |= dict(zip(each, array.T, strict=True))
        topics[topic] = {"file": file, **more, **{quantity: each for quantity, (each, _) in values.items()}}

    joints = streams.joints
    given = {"position": joints.position, "velocity": joints.velocity, "effort": joints.effort}
    states = {key: ([f"{key}_{name}" for name in names], array) for key, array in given.items() if array.size}
    add("joint_states", joints.stamps, states, joints=names)
    if streams.wrench is not None:
        force, torque = ([f"{kind}{axis}" for axis in _XYZ] for kind in "ft")
        six = streams.wrench.values
        parts = {"force": (force, six[:, :3]), "torque": (torque, six[:, 3:])}
        add("wrench", streams.wrench.stamps, parts, frame=streams.frame)
    if streams.commands is not None:
        sent = {"position": ([f"position_{name}" for name in names], streams.commands.position)}
        add("joint_commands", streams.commands.stamps, sent, joints=names)
    if streams.odom is not None:
        x, y, yaw = streams.odom.pose.T
        still = np.zeros(len(x))
        turn = np.stack([still, still, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)
        place = {"translation": (["px", "py", "pz"], np.stack([x, y, still], axis=1))}
        place["quaternion"] = (["qx", "qy", "qz", "qw"], turn)
        add("odom", streams.odom.stamps, place, parent="odom", child="base_link")
    mapping = {"robot_description": "arm.urdf", "time": {"column": "t"}, "topics": topics}
    return Tables(columns, mapping, streams.robot_description, case.model)


# -- ways ---------------------------------------------------------------------------------------------------------

Broken = Callable[[Case], Tables | None]


def _written(write: Write, encoding: str = "utf-8") -> Broken:
    def change(case: Case) -> Tables:
        tables = tables_of(case)
        tables.write_one, tables.encoding = write, encoding
        return tables

    return change


def _lines(change: Callable[[list[str]], list[str]]) -> Broken:
    return _written(lambda columns: "\n".join(change(text(columns).splitlines())) + "\n")


def _columns(change: Callable[[str, Array], Array]) -> Broken:
    """Columns changed by their names."""
    return _written(lambda columns: text({name: change(name, values) for name, values in columns.items()}))


def _mapped(change: Callable[[Tables], object], needs: str = "joint_states", key: str = "position") -> Broken:
    """A mapping that is changed, where it has this topic with this key."""

    def broken(case: Case) -> Tables | None:
        tables = tables_of(case)
        if key not in tables.mapping["topics"].get(needs, {}):
            return None
        change(tables)
        return tables

    return broken


def _units_row(unit: str) -> Broken:
    def row(lines: list[str]) -> list[str]:
        units = [unit if name.startswith("position") else "s" if name == "t" else "-" for name in lines[0].split(",")]
        return [lines[0], ",".join(units), *lines[1:]]

    return _lines(row)


def _times_of_day(columns: Columns) -> str:
    lines = text(columns).splitlines()
    moments = np.datetime_as_string((1.7e15 + columns["t"] * 1e6).astype(np.int64).astype("datetime64[us]"))
    return (
        "\n".join(
            [lines[0], *(moment + line[line.index(",") :] for moment, line in zip(moments, lines[1:], strict=True))]
        )
        + "\n"
    )


def _merged(fill: str) -> Broken:
    """All topics in one table, whose rows have the times of each of them."""

    def change(case: Case) -> Tables | None:
        tables = tables_of(case)
        if len(tables.columns) < 2:
            return None
        times = np.unique(np.concatenate([columns["t"] for columns in tables.columns.values()]))
        whole: Columns = {"t": times}
        for topic in tables.mapping["topics"].values():
            file = topic["file"]
            own = tables.columns[file]
            for name, values in own.items():
                if name != "t":
                    whole[f"{file}/{name}"] = _filled(times, own["t"], values, fill)
            for key, names in topic.items():
                if key in ("position", "velocity", "effort", "force", "torque", "translation", "quaternion"):
                    topic[key] = [f"{file}/{name}" for name in names]
            topic["file"] = "all.csv"
        tables.columns = {"all.csv": whole}
        return tables

    return change


def _filled(times: Array, own: Array, values: Array, fill: str) -> Array:
    if fill == "line":
        return np.asarray(np.interp(times, own, values))
    last = np.searchsorted(own, times, side="right") - 1
    held = values[np.maximum(last, 0)]
    there = own[np.maximum(last, 0)] == times
    return np.asarray(held if fill == "last" else np.where(there, held, 0.0 if fill == "zero" else np.nan))


def _marked(value: float) -> Write:
    """One row in 300 has a number that stands for no value."""

    def write(columns: Columns) -> str:
        bad = np.random.default_rng(3).random(len(columns["t"])) < 1 / 300
        return text({name: array if name == "t" else np.where(bad, value, array) for name, array in columns.items()})

    return write


def _motor_side(name: str, values: Array) -> Array:
    return values * (_RATIO if name[:3] in ("pos", "vel") else 1 / _RATIO if name.startswith("eff") else 1.0)


def _inverted(case: Case) -> Tables:
    tables = tables_of(case)
    tables.write_one = lambda columns: text({name: _motor_side(name, values) for name, values in columns.items()})
    tables.topic("joint_states")["transmission"] = [1 / _RATIO] * len(tables.topic("joint_states")["joints"])
    return tables


def _own_zeros(case: Case) -> Tables | None:
    """The time of each table begins at zero, 0.37 s after that of the joint states."""
    tables = tables_of(case)
    if len(tables.columns) < 2:
        return None
    for name, columns in tables.columns.items():
        columns["t"] = columns["t"] - columns["t"][0] + 0.37 * (name != "joint_states.csv")
    return tables


def _at_a_rate(tables: Tables) -> None:
    """The joint states have no clock, and the stated rate is 2 % too high."""
    times = tables.columns["joint_states.csv"]["t"]
    rate = {"rate": float(1.02 / np.median(np.diff(times))), "start": float(times[0])}
    tables.topic("joint_states")["time"] = rate


def _reversed(topic: str, key: str) -> Callable[[Tables], object]:
    return lambda tables: tables.topic(topic)[key].reverse()


def _w_first(tables: Tables) -> None:
    *vector, scalar = tables.topic("odom")["quaternion"]
    tables.topic("odom")["quaternion"] = [scalar, *vector]


def _exchanged(tables: Tables) -> None:
    topic = tables.topic("wrench")
    topic["force"], topic["torque"] = topic["torque"], topic["force"]


ORDER = "in the order|were exchanged"
WAYS = {
    "as it is": Way(_written(text), harmless=True),
    "decimal commas": Way(_written(lambda columns: text(columns, ";").replace(".", ",")), harmless=True),
    "white space": Way(_written(lambda columns: text(columns, " ")), harmless=True),
    "comments above": Way(_lines(lambda lines: ["# of a logger", "# ur10, cell 3", *lines]), harmless=True),
    "header in a comment": Way(_lines(lambda lines: ["# " + lines[0], *lines[1:]]), harmless=True),
    "a row of units": Way(_units_row("rad"), harmless=True),
    "UTF-16, CRLF": Way(_written(lambda columns: text(columns).replace("\n", "\r\n"), "utf-16"), harmless=True),
    "empty cells at the end": Way(_lines(lambda lines: [lines[0], *(line + "," for line in lines[1:])]), harmless=True),
    "times of day": Way(_written(_times_of_day), harmless=True),
    "every row twice": Way(_lines(lambda lines: [lines[0], *(f"{line}\n{line}" for line in lines[1:])]), harmless=True),
    "three decimals": Way(_written(lambda columns: text(columns, values=".3f")), effect="quantisation", harmless=True),
    "merged, empty cells": Way(_merged("none"), harmless=True),
    "merged, last values": Way(_merged("last"), harmless=True),
    "merged, interpolated": Way(_merged("line"), "lie on lines between", harmless=True),
    "merged, zeros": Way(_merged("zero"), "publish|zero between"),
    "-999 for no value": Way(_written(_marked(-999.0)), "jump to -999"),
    "0 for no value": Way(_written(_marked(0.0)), "jump to 0"),
    "another unit than the mapping": Way(_units_row("deg"), "states the unit deg"),
    "two columns of one name": Way(_lines(lambda lines: [f"{line},{line}" for line in lines]), "rename all but one"),
    "no header": Way(_lines(lambda lines: lines[1:]), "header: false"),
    "degrees": Way(_columns(lambda name, v: np.degrees(v) if name[:3] in ("pos", "vel") else v), "in degrees|in mm"),
    "milliseconds": Way(_columns(lambda name, v: v * 1e3 if name == "t" else v), "unit of the stamps"),
    "seven digits of 1.7e9 s": Way(
        _written(lambda columns: text(columns | {"t": columns["t"] + 1.7e9}, times=".7g")),
        "too few|too slow|repeat the stamp",
    ),
    "seconds as ms": Way(_mapped(lambda tables: tables.mapping["time"].update(unit="ms")), "stamps are not in ns"),
    "no transmission": Way(_columns(_motor_side), "its range in the description"),
    "transmission inverted": Way(_inverted, "its range in the description"),
    "joints reversed": Way(_mapped(_reversed("joint_states", "position")), ORDER + "|its range in the description"),
    "efforts reversed": Way(_mapped(_reversed("joint_states", "effort"), key="effort"), ORDER),
    "each time from its zero": Way(_own_zeros, "the clocks of the wrench|their clocks differ"),
    "a rate 2 % too high": Way(_mapped(_at_a_rate), effect="clock_skew", harmless=True),
    "quaternion w first": Way(_mapped(_w_first, "odom", "quaternion"), "order w x y z"),
    "force and torque exchanged": Way(_mapped(_exchanged, "wrench", "force"), "force and torque are exchanged"),
    "two runs in one file": Way(_lines(lambda lines: [*lines, *lines[1:]]), "go back"),
    "header again": Way(_lines(lambda lines: lines * 2), "is not a number"),
}
