"""What an entry of the registry of exporters is: a kind, what it needs and omits, and the text it writes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.geometry import Pose
from poise.inertia import InertialEstimate, InertialParameters
from poise.types import Array

EXPORTED_VALUES = {"mass": "kg", "com": "m", "inertia": "kg m2"}
"""What can be exported, and its unit."""


@dataclass(frozen=True, eq=False)
class ExportedPayload:
    """What an exporter writes.

    Args:
        frame_id: the frame of the values: the sensor frame, or the flange.
        parameters: mass kg, centre of mass m, inertia about it kg m2, in the axes of that frame.
        estimate: where they come from, in the sensor frame.
        in_flange: the values were moved from the sensor to the flange.
    """

    frame_id: str
    parameters: InertialParameters
    estimate: InertialEstimate
    in_flange: bool = False

    @classmethod
    def of(cls, estimate: InertialEstimate, flange_from_sensor: Pose | None = None) -> "ExportedPayload":
        """The estimate in the sensor frame or, given the pose of the sensor in the flange frame, in that."""
        parameters = estimate.parameters
        if flange_from_sensor is None:
            return cls(estimate.frame_id, parameters, estimate)
        rotation = flange_from_sensor.rotation
        com = rotation @ parameters.com + flange_from_sensor.translation
        moved = InertialParameters(parameters.mass, com, rotation @ parameters.inertia @ rotation.T)
        return cls("flange", moved, estimate, in_flange=True)

    @property
    def six(self) -> Array:
        """(6,) ixx ixy ixz iyy iyz izz about the centre of mass, kg m2."""
        return self.parameters.inertia[np.triu_indices(3)]

    @property
    def has_inertia(self) -> bool:
        """All of the inertia was identified."""
        return bool(np.isfinite(self.parameters.inertia).all())

    @property
    def remark(self) -> str:
        """One line on where the values come from, for a comment in any format."""
        mass = f"{self.parameters.mass:.4f} +- {self.estimate.mass_std:.4f} kg"
        name = "".join(letter if letter.isalnum() or letter in "_/." else "?" for letter in self.frame_id)
        frame = f"{name} frame" + ("" if self.in_flange else " (the sensor's)")
        return f"payload identified by poise ({self.estimate.method}): {mass}, in the {frame}"


class Exporter(ABC):
    """A format for identified payloads.

    Attributes:
        kind: name for `--export`.
        summary: product and element, for people.
        needs: what of mass, com and inertia has to be known.
        omits: what of them the format cannot express.
        physical: the target refuses a body that cannot exist.
        flange: the target takes values in the robot's flange frame.
    """

    kind: ClassVar[str]
    summary: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = tuple(EXPORTED_VALUES)
    omits: ClassVar[tuple[str, ...]] = ()
    physical: ClassVar[bool] = True
    flange: ClassVar[bool] = False

    @abstractmethod
    def text(self, payload: ExportedPayload) -> str:
        """The payload in this format, with a final newline."""

    def check(self, payload: ExportedPayload) -> None:
        """Refuse a payload that this format cannot express.

        Raises:
            NoAnswerError: NOT_IDENTIFIABLE for a value that it needs and that is not known; NOT_CONSISTENT for a mass
                that is not positive, or an inertia that no body has.
        """
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
            raise NoAnswerError(
                ErrorCode.NOT_CONSISTENT,
                f"export {self.kind}: no body has this mass ({payload.parameters.mass:.4g} kg) and inertia; use a"
                " method that keeps to possible bodies, as poise",
            )


def numbers(values: Array) -> str:
    """Values with a space between, to full precision."""
    return " ".join(repr(float(value)) for value in np.ravel(values))


def decimals(values: Array) -> str:
    """Values with a comma between, without exponents, for the languages of robot controllers."""
    return ", ".join(f"{float(value):.9f}" for value in np.ravel(values))
