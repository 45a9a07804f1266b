"""Robotiq 2F-85 and 2F-140 over Modbus RTU: registers, and counts to m, m/s and N.

Source: Robotiq 2F-85 & 2F-140 instruction manual, sections 4.3 to 4.8 and 6. 115200 baud, 8 data bits, no parity,
1 stop bit, slave 9. No I/O here: see `driver`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

GRIPPER_BAUD_RATE = 115200
GRIPPER_SLAVE = 9
COMMAND_REGISTER, STATUS_REGISTER = 0x03E8, 0x07D0
REGISTERS = 3

_ACTIVATE, _GO = 0x01, 0x08


@dataclass(frozen=True)
class GripperModel:
    """What 0 to 255 counts are. The opening is nearly in proportion to the counts.

    Args:
        name: of the product.
        stroke: m between the open fingers.
        speeds: m/s, slowest and fastest.
        forces: N, least and greatest.
        opened, closed: counts at which the fingers are apart by the stroke, and touch.
    """

    name: str
    stroke: float
    speeds: tuple[float, float]
    forces: tuple[float, float]
    opened: int = 3
    closed: int = 230

    def counts(self, opening: float) -> int:
        """Position request for an opening, m; beyond the stroke the nearest."""
        share = float(np.clip(opening / self.stroke, 0.0, 1.0))
        return 0 if share == 1.0 else 255 if share == 0.0 else round(self.closed + share * (self.opened - self.closed))

    def opening(self, counts: int) -> float:
        """m between the fingers."""
        return self.stroke * float(np.clip((self.closed - counts) / (self.closed - self.opened), 0.0, 1.0))


GRIPPERS = {
    "2f85": GripperModel("Robotiq 2F-85", 0.085, (0.020, 0.150), (20.0, 235.0)),
    "2f140": GripperModel("Robotiq 2F-140", 0.140, (0.030, 0.250), (10.0, 125.0)),
}


class Activation(IntEnum):
    """gSTA."""

    RESET = 0
    RUNNING = 1
    DONE = 3


class Contact(IntEnum):
    """gOBJ: what the fingers do."""

    MOVING = 0
    STOPPED_OPENING = 1
    STOPPED_CLOSING = 2
    AT_REQUEST = 3


FAULTS = {
    0x05: "the activation must be completed first",
    0x07: "the gripper is not activated",
    0x08: "it is too hot: let it cool",
    0x09: "it heard nothing for 1 s",
    0x0A: "the supply voltage is too low",
    0x0B: "an automatic release is in progress",
    0x0C: "internal fault: contact Robotiq",
    0x0D: "the activation failed: something may be in the way of the fingers",
    0x0E: "overcurrent: something may block the fingers",
    0x0F: "an automatic release was completed",
}
"""gFLT; from 0x0A on the gripper works again only after a new activation."""
MAJOR_FAULT = 0x0A


@dataclass(frozen=True)
class GripperStatus:
    """What the device reports.

    Attributes:
        active, going: gACT and gGTO, echoes of the command.
        activation: gSTA.
        contact: gOBJ; it means something while `going`.
        fault: gFLT.
        requested: gPR, counts, echo of the position request.
        counts: gPO, position.
        current: A, of the motor.
    """

    active: bool
    going: bool
    activation: int
    contact: Contact
    fault: int
    requested: int
    counts: int
    current: float

    @classmethod
    def from_registers(cls, registers: Sequence[int]) -> "GripperStatus":
        """Decode the three registers at STATUS_REGISTER."""
        state, fault, requested = registers[0] >> 8, registers[1] >> 8 & 0x0F, registers[1] & 0xFF
        return cls(
            active=bool(state & 0x01),
            going=bool(state & 0x08),
            activation=state >> 4 & 0x03,
            contact=Contact(state >> 6 & 0x03),
            fault=fault,
            requested=requested,
            counts=registers[2] >> 8,
            current=(registers[2] & 0xFF) * 0.01,
        )


def command(active: bool, going: bool = False, counts: int = 0, speed: int = 0, force: int = 0) -> list[int]:
    """The three registers at COMMAND_REGISTER; speed and force from 0 (slowest, weakest) to 255."""
    action = (_ACTIVATE if active else 0) | (_GO if going else 0)
    return [action << 8, counts, speed << 8 | force]


def share_of(value: float, limits: tuple[float, float]) -> int:
    """0 to 255 for a value between two limits; beyond them the nearest."""
    least, greatest = limits
    return round(255 * float(np.clip((value - least) / (greatest - least), 0.0, 1.0)))
