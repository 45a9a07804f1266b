"""What an exporter of models is: a kind, what it can express, and the text it writes."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia import InertialParameters
from poise.types import Array

PAYLOAD = "payload"
_OF_SENSOR = {
    "sensor_turn": ("turn",),
    "sensor_limit": ("force_limit", "torque_limit"),
    "sensor_delay": ("delay",),
    "sensor_noise": ("force_noise", "torque_noise"),
}
"""Fields of `SensorChange` by the kinds of what is changed."""
_WORDS = {
    "gain": "the gain of drives",
    "rate_gain": "the rate gain of drives",
    "delay": "the delay of drives",
    "sensor_turn": "the rotation of the sensor",
}


@dataclass(frozen=True)
class JointChange:
    """The values of a joint that a diagnosis gives; None: it says nothing of it. For a slide N, N s/m and kg.

    Args:
        friction: dry friction, N m.
        damping: viscous friction, N m s/rad.
        armature: inertia of the rotor, reflected to the joint, kg m2.
    """

    friction: float | None = None
    damping: float | None = None
    armature: float | None = None

    @property
    def values(self) -> dict[str, float]:
        """What is given, by name."""
        named = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: value for name, value in named.items() if value is not None}


@dataclass(frozen=True)
class DriveChange:
    """What the drive of a joint differs in; None: nothing is said.

    Args:
        gain: of a position drive at the joint, N m/rad, N/m of a slide.
        rate_gain: of the joint's speed, N m s/rad or N s/m.
        delay: s by which its commands are late.
    """

    gain: float | None = None
    rate_gain: float | None = None
    delay: float | None = None

    @property
    def values(self) -> dict[str, float]:
        """What is given, by name."""
        named = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: value for name, value in named.items() if value is not None}


@dataclass(frozen=True, eq=False)
class SensorChange:
    """What the sensor of a wrench differs in; None: nothing is said.

    Args:
        frame: its site or name.
        force_noise, torque_noise: one sigma of its white noise, N and N m.
        turn: (3,) rotation vector from its described axes to the true ones, rad.
        force_limit, torque_limit: readings at which it saturates, N and N m.
        delay: s by which its readings are late.
    """

    frame: str
    force_noise: float | None = None
    torque_noise: float | None = None
    turn: Array | None = None
    force_limit: float | None = None
    torque_limit: float | None = None
    delay: float | None = None

    @property
    def kinds(self) -> tuple[str, ...]:
        """Which of rotation, limit and delay are given; noise is no difference."""
        given = (("turn", self.turn), ("limit", self.force_limit), ("limit", self.torque_limit), ("delay", self.delay))
        return tuple(dict.fromkeys(f"sensor_{name}" for name, value in given if value is not None))


@dataclass(frozen=True, eq=False)
class LinkLoad:
    """A link or body that is the payload, and its parameters in its own frame."""

    link: str
    parameters: InertialParameters


@dataclass(frozen=True)
class ModelChanges:
    """What a diagnosis changes in a model.

    Args:
        joints: by name.
        drives: by the names of joints.
        sensor: None: nothing is said of it.
        payload: None: it is as in the model, or no link is named for it.
        left_out: effects that are not written, each with the reason, as clauses.
        unsure: values that the recording shows badly, as clauses.
    """

    joints: Mapping[str, JointChange] = field(default_factory=dict)
    payload: LinkLoad | None = None
    left_out: tuple[str, ...] = ()
    drives: Mapping[str, DriveChange] = field(default_factory=dict)
    sensor: SensorChange | None = None
    unsure: tuple[str, ...] = ()

    @property
    def kinds(self) -> tuple[str, ...]:
        """What it has: friction, damping, armature, gain and delay of drives, sensor_*, payload."""
        named = {name for change in self.joints.values() for name in change.values}
        named |= {name for change in self.drives.values() for name in change.values}
        sensor = () if self.sensor is None else self.sensor.kinds
        return (*sorted(named), *sensor, *(PAYLOAD,) * (self.payload is not None))

    def without(self, kinds: tuple[str, ...], reason: str = "which this format cannot express") -> "ModelChanges":
        """Without some kinds of changes; they are left out, and said with the reason."""
        lost = [name for name in kinds if name in self.kinds]
        joints = {
            joint: JointChange(**{name: value for name, value in change.values.items() if name not in lost})
            for joint, change in self.joints.items()
        }
        drives = {
            joint: DriveChange(**{name: value for name, value in change.values.items() if name not in lost})
            for joint, change in self.drives.items()
        }
        sensor = self.sensor
        if sensor is not None:
            lost_fields: dict[str, Any] = {name: None for kind in kinds for name in _OF_SENSOR.get(kind, ())}
            sensor = replace(sensor, **lost_fields)
        payload = None if PAYLOAD in lost else self.payload
        left_out = (*self.left_out, *(f"{_WORDS.get(name, name.replace('_', ' '))}, {reason}" for name in lost))
        return replace(self, joints=joints, drives=drives, sensor=sensor, payload=payload, left_out=left_out)

    def leaving_out(self, *clauses: str) -> "ModelChanges":
        """With further clauses on what is not written."""
        return replace(self, left_out=(*self.left_out, *clauses))

    @property
    def remark(self) -> str:
        """For a comment at the head of the file; without two hyphens in a row, which end a comment of XML."""
        lines = ["changed by poise mismatch:"]
        for joint, change in self.joints.items():
            if change.values:
                lines.append(f"  {joint}: " + ", ".join(f"{name} {value:.6g}" for name, value in change.values.items()))
        for joint, drive in self.drives.items():
            if drive.values:
                said = ", ".join(f"{name} {value:.6g}" for name, value in drive.values.items())
                lines.append(f"  drive of {joint}: {said}")
        if self.sensor is not None and self.sensor.kinds:
            lines.append(f"  sensor {self.sensor.frame}: {', '.join(self.sensor.kinds)}")
        if self.payload is not None:
            mass = self.payload.parameters.mass
            lines.append(f"  {self.payload.link}: the payload, {mass:.4f} kg")
        lines += [f"unsure: {each}" for each in self.unsure]
        lines += [f"not written: {each}" for each in self.left_out]
        return "\n".join(lines).replace("--", "- -")


@dataclass(frozen=True)
class WrittenModel:
    """A file, and what is not in it, as clauses; its head has them too."""

    content: bytes
    left_out: tuple[str, ...]


class ModelExporter(ABC):
    """A format for models.

    Attributes:
        kind: name for `--export`.
        summary: product and elements, for people.
        omits: of `ModelChanges.kinds`, what the format cannot express.
        needs_source: it changes a file of the user.
    """

    kind: ClassVar[str]
    summary: ClassVar[str]
    omits: ClassVar[tuple[str, ...]] = ()
    needs_source: ClassVar[bool] = True

    @abstractmethod
    def written(self, changes: ModelChanges, source: bytes) -> "WrittenModel":
        """The changed file.

        Raises:
            InputError: BAD_INPUT when the source is not of this format, or lacks a joint or a link.
        """

    def changed(self, changes: ModelChanges, source: bytes = b"") -> "WrittenModel":
        """The file with what this format can express of some changes; what it cannot is named in its head.

        Raises:
            InputError: as `written`.
            NoAnswerError: NOT_IDENTIFIABLE when nothing is left to write.
        """
        kept = changes.without(self.omits)
        if self.needs_source and not kept.kinds:
            reasons = "; ".join(kept.left_out) or "the diagnosis names no effect"
            raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, f"export {self.kind}: nothing to write: {reasons}")
        return self.written(kept, source)
