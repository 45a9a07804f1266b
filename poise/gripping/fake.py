"""A Robotiq gripper in software, on a pseudo-terminal, with an object between its fingers and faults on purpose."""

import time
from collections.abc import Sequence
from pathlib import Path

from poise.gripping import robotiq
from poise.gripping.robotiq import Activation, Contact, GripperModel
from poise.serial_bus import ModbusAnswers, PseudoTerminalDevice

_ACTIVATION_TIME = 0.2
"""s; the real one takes about 3."""


class FakeGripper(PseudoTerminalDevice):
    """A device whose fingers move at the commanded speed and stop at an object.

    Args:
        model: of the gripper.
        active: it was activated before, by another program.
        folder: as of `PseudoTerminalDevice`.

    Attributes:
        object_width: m, of what is between the fingers; None: nothing.
        gripper_fault: gFLT.
        activations: how often it was activated.
        command: the last three registers that were written.
    """

    def __init__(
        self,
        model: GripperModel = robotiq.GRIPPERS["2f85"],
        active: bool = False,
        folder: Path | None = None,
    ) -> None:
        super().__init__(folder)
        self._model, self._was_active = model, active
        self._modbus = ModbusAnswers(robotiq.GRIPPER_SLAVE, self._registers, self._written)
        self.object_width: float | None = None
        self.activations = 0
        self.power_up()

    @property
    def parameters(self) -> dict[str, str]:
        """The driver's parameters that reach this device."""
        return {"address": self.port}

    @property
    def position(self) -> float:
        """Counts, of the fingers now."""
        return self._position

    def power_up(self) -> None:
        """Be reset, or active when another program has activated it."""
        self._modbus.forget()
        self.gripper_fault = 0
        self.command = robotiq.command(self._was_active)
        self._activated_at: float | None = -_ACTIVATION_TIME if self._was_active else None
        self._position, self._since, self._contact = 3.0, time.monotonic(), Contact.AT_REQUEST

    def receive(self, data: bytes) -> None:
        """Answer requests."""
        self._move()
        if answers := self._modbus.feed(data):
            self.write(answers)

    def tick(self) -> None:
        """Move the fingers."""
        self._move()

    def _written(self, address: int, values: Sequence[int]) -> None:
        if address != robotiq.COMMAND_REGISTER or len(values) != robotiq.REGISTERS:
            return
        active, was = bool(values[0] & 0x100), bool(self.command[0] & 0x100)
        self.command = list(values)
        if not active:
            self._activated_at, self.gripper_fault = None, 0
        elif not was or self._activated_at is None:
            self._activated_at = time.monotonic()
            self.activations += 1

    @property
    def _activation(self) -> Activation:
        if self._activated_at is None:
            return Activation.RESET
        running = time.monotonic() - self._activated_at < _ACTIVATION_TIME and self._activated_at > 0
        return Activation.RUNNING if running else Activation.DONE

    def _move(self) -> None:
        """Towards the request, until the fingers meet the object, the limit or the request."""
        now = time.monotonic()
        passed, self._since = now - self._since, now
        going = bool(self.command[0] & 0x800) and self._activation is Activation.DONE and not self.gripper_fault
        if not going:
            return
        slowest, fastest = self._model.speeds
        speed = slowest + (self.command[2] >> 8) / 255 * (fastest - slowest)
        step = passed * speed / self._model.stroke * (self._model.closed - self._model.opened)
        target = min(max(self.command[1] & 0xFF, self._model.opened), self._model.closed)
        stop = float(target)
        if self.object_width is not None and target > self._position:
            stop = min(stop, max(float(self._model.counts(self.object_width)), self._position))
        self._position = (
            min(self._position + step, stop) if stop >= self._position else max(self._position - step, stop)
        )
        if self._position != stop:
            self._contact = Contact.MOVING
        else:
            self._contact = Contact.STOPPED_CLOSING if stop < target else Contact.AT_REQUEST

    def _registers(self) -> dict[int, int]:
        going = self.command[0] & 0x800
        contact = self._contact if going else Contact.MOVING
        state = (self.command[0] >> 8 & 0x09) | self._activation << 4 | contact << 6
        moving = 0x10 if going and contact is Contact.MOVING else 0
        values = (state << 8, self.gripper_fault << 8 | self.command[1] & 0xFF, round(self._position) << 8 | moving)
        return {robotiq.STATUS_REGISTER + i: value for i, value in enumerate(values)}
