"""What an exporter of models is: a kind, what it can express, and the text it writes."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import ClassVar

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia import InertialParameters

PAYLOAD = "payload"


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
        payload: None: it is as in the model, or no link is named for it.
        left_out: effects that are not written, each with the reason, as clauses.
    """

    joints: Mapping[str, JointChange] = field(default_factory=dict)
    payload: LinkLoad | None = None
    left_out: tuple[str, ...] = ()

    @property
    def kinds(self) -> tuple[str, ...]:
        """What it has: friction, damping, armature, payload."""
        named = {name for change in self.joints.values() for name in change.values}
        return (*sorted(named), *(PAYLOAD,) * (self.payload is not None))

    def without(self, kinds: tuple[str, ...]) -> "ModelChanges":
        """What a format can express; the rest is left out, and said."""
        lost = [name for name in kinds if name in self.kinds]
        joints = {
            joint: JointChange(**{name: value for name, value in change.values.items() if name not in lost})
            for joint, change in self.joints.items()
        }
        payload = None if PAYLOAD in lost else self.payload
        return replace(self, joints=joints, payload=payload, left_out=(*self.left_out, *map(_not_expressed, lost)))

    @property
    def remark(self) -> str:
        """For a comment at the head of the file; without two hyphens in a row, which end a comment of XML."""
        lines = ["changed by poise mismatch:"]
        for joint, change in self.joints.items():
            if change.values:
                lines.append(f"  {joint}: " + ", ".join(f"{name} {value:.6g}" for name, value in change.values.items()))
        if self.payload is not None:
            mass = self.payload.parameters.mass
            lines.append(f"  {self.payload.link}: the payload, {mass:.4f} kg")
        lines += [f"not written: {each}" for each in self.left_out]
        return "\n".join(lines).replace("--", "- -")


def _not_expressed(name: str) -> str:
    return f"{name}, which this format cannot express"


class ModelExporter(ABC):
    """A format for models.

    Attributes:
        kind: name for `--export`.
        summary: product and elements, for people.
        omits: of friction, damping, armature and payload, what the format cannot express.
        needs_source: it changes a file of the user.
    """

    kind: ClassVar[str]
    summary: ClassVar[str]
    omits: ClassVar[tuple[str, ...]] = ()
    needs_source: ClassVar[bool] = True

    @abstractmethod
    def written(self, changes: ModelChanges, source: bytes) -> bytes:
        """The changed file.

        Raises:
            InputError: BAD_INPUT when the source is not of this format, or lacks a joint or a link.
        """

    def changed(self, changes: ModelChanges, source: bytes = b"") -> bytes:
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
