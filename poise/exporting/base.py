"""What an entry of the registry of exporters is: a kind, what it needs and omits, and the text it writes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.exporting.settings import ExportSettings
from poise.inertia import InertialEstimate, InertialParameters
from poise.inertia.model import EstimateFinding
from poise.types import Array

EXPORTED_VALUES = {"mass": "kg", "com": "m", "inertia": "kg m2"}
"""What can be exported, and its unit."""


_WRONG = frozenset(
    {ErrorCode.NOT_IDENTIFIABLE, ErrorCode.SENSOR_FAULT, *(code for code in ErrorCode if 70 <= code < 90)}
)
"""Findings that say that the number itself may be wrong: nothing weighs significantly, a channel is
broken, or the fit failed."""
_SEPARATE = (ErrorCode.PAYLOAD_CHANGED, ErrorCode.IN_CONTACT)
"""What was weighed apart from the rest; where that failed, the fit is poor as well, or another mass is as likely."""
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True, eq=False)
class ExportedPayload:
    """What an exporter writes.

    Args:
        frame_id: the frame of the values: the sensor frame, the flange, or the one that was asked for.
        parameters: mass kg, centre of mass m, inertia about it kg m2, in the axes of that frame.
        estimate: where they come from, in the sensor frame, the gripper taken off.
        settings: what the user asked for.
    """

    frame_id: str
    parameters: InertialParameters
    estimate: InertialEstimate
    settings: ExportSettings = field(default_factory=ExportSettings)

    @classmethod
    def of(cls, estimate: InertialEstimate, settings: ExportSettings, flange: bool) -> "ExportedPayload":
        """The estimate in the frame of the settings; without one, in the flange (`flange`) or the sensor frame."""
        gripper = settings.gripper
        left = estimate if gripper is None else gripper.taken_off(estimate)
        name, pose = settings.frame_id, settings.frame_from_sensor
        if name is None and flange and settings.flange_from_sensor is not None:
            name, pose = "flange", settings.flange_from_sensor
        if name is None or pose is None:
            return cls(left.frame_id, left.parameters, left, settings)
        return cls(name, left.parameters.in_frame(pose.rotation, pose.translation), left, settings)

    @property
    def six(self) -> Array:
        """(6,) ixx ixy ixz iyy iyz izz about the centre of mass, kg m2."""
        return self.parameters.inertia_vector

    @property
    def has_inertia(self) -> bool:
        """All of the inertia was identified."""
        return bool(np.isfinite(self.parameters.inertia).all())

    @property
    def assumed(self) -> tuple[str, ...]:
        """Entries of the inertia that the motion does not show: the values are those expected of such a payload."""
        return tuple(name for name in _INERTIA if name in self.estimate.unidentified) if self.has_inertia else ()

    @property
    def remark(self) -> str:
        """One line on where the values come from, for a comment in any format."""
        mass = f"{self.parameters.mass:.4f} +- {self.estimate.mass_std:.4f} kg"
        name = "".join(letter if letter.isalnum() or letter in "_/." else "?" for letter in self.frame_id)
        frame = f"{name} frame" + (" (the sensor's)" if self.frame_id == self.estimate.frame_id else "")
        gripper = self.settings.gripper
        without = "" if gripper is None else f", a gripper of {gripper.parameters.mass:.4f} kg taken off"
        assumed = f"; {', '.join(self.assumed)} expected, not measured" if self.assumed else ""
        findings = ", ".join(finding.code.name for finding in self.estimate.findings)
        found = f"; findings: {findings}" if findings else ""
        return f"payload identified by poise ({self.estimate.method}): {mass}{without}, in the {frame}{assumed}{found}"


class Exporter(ABC):
    """A format for identified payloads.

    Attributes:
        kind: name for `--export`.
        summary: product and element, for people.
        needs: what of mass, com and inertia has to be known.
        omits: what of them the format cannot express.
        physical: the target refuses a body that cannot exist.
        flange: the target takes values in the robot's flange frame.
        doubtful: it also takes an estimate whose findings say that the number may be wrong.
        robot: it writes into the robot's URDF, `ExportSettings.robot_description`.
    """

    kind: ClassVar[str]
    summary: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = tuple(EXPORTED_VALUES)
    omits: ClassVar[tuple[str, ...]] = ()
    physical: ClassVar[bool] = True
    flange: ClassVar[bool] = False
    doubtful: ClassVar[bool] = False
    robot: ClassVar[bool] = False

    @abstractmethod
    def text(self, payload: ExportedPayload) -> str:
        """The payload in this format, with a final newline."""

    def check(self, payload: ExportedPayload) -> None:
        """Refuse a payload that this format cannot express.

        Raises:
            NoAnswerError: the code of a finding by which the estimate may be wrong; NOT_IDENTIFIABLE for a value that
                the format needs and that is not known; NOT_CONSISTENT for a mass that is not positive, or an inertia
                that no body has.
        """
        doubts = [] if self.doubtful else [each for each in payload.estimate.findings if is_doubtful(each)]
        if doubts:
            raise NoAnswerError(
                doubts[0].code,
                f"export {self.kind} refused, because the estimate may be wrong: {doubts[0].message}"
                " (--export json writes it with its findings)",
            )
        values = {name: getattr(payload.parameters, name) for name in EXPORTED_VALUES}
        missing = [name for name in self.needs if not np.isfinite(values[name]).all()]
        if missing:
            raise NoAnswerError(
                ErrorCode.NOT_IDENTIFIABLE,
                f"export {self.kind} needs {', '.join(missing)}, which this motion does not show: weigh along a motion"
                " that turns about all axes, or give the object's shape",
            )
        impossible = payload.parameters.mass <= 0 or (payload.has_inertia and not payload.parameters.is_consistent)
        if self.physical and impossible:
            advice = "use a method that keeps to possible bodies, as poise"
            if payload.settings.gripper is not None:
                advice = "the gripper that was taken off is not part of what was weighed: check its values and frame"
            raise NoAnswerError(
                ErrorCode.NOT_CONSISTENT,
                f"export {self.kind}: no body has this mass ({payload.parameters.mass:.4g} kg) and inertia; {advice}",
            )


def is_doubtful(finding: EstimateFinding) -> bool:
    """The number may be wrong: the finding is not about samples left out, nor about an error that was repaired."""
    if finding.code not in _WRONG or finding.message.startswith("repaired: "):
        return False
    return finding.code not in _SEPARATE or "other_mass" in finding.evidence


def decimals(values: Array) -> str:
    """Values with a comma between, without exponents, for the languages of robot controllers."""
    return ", ".join(f"{float(value):.9f}" for value in np.ravel(values))
