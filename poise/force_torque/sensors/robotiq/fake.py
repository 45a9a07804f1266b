"""A Robotiq FT 300 in software: the stream and Modbus RTU on a pseudo-terminal, with faults on purpose."""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from poise.force_torque.sensors.robotiq import protocol
from poise.force_torque.wire import FakeSerialSensor, WrenchSource
from poise.serial_bus import ModbusAnswers, with_modbus_crc


class FakeRobotiqSensor(FakeSerialSensor):
    """A device that answers Modbus until it streams, and then nothing.

    Args:
        source: what it measures, N and N m, 100 samples a second.
        folder: for the link that stands for the port (default: a temporary one).
    """

    def __init__(self, source: WrenchSource, folder: Path | None = None) -> None:
        super().__init__(source, protocol.STREAM_RATE, folder)
        self._modbus = ModbusAnswers(protocol.SLAVE, self._registers, self._written)

    @property
    def requests(self) -> int:
        """Modbus requests answered."""
        return self._modbus.requests

    def power_up(self) -> None:
        super().power_up()
        self._modbus.forget()

    def receive(self, data: bytes) -> None:
        if self.is_streaming:
            if b"\xff" * 10 in data:
                self.is_streaming = False
        elif answers := self._modbus.feed(data):
            self.write(answers)

    def message(self, number: int) -> bytes:
        return with_modbus_crc(b"\x20\x4e" + struct.pack("<6h", *self._counts(number)))

    def _written(self, address: int, values: Sequence[int]) -> None:
        if (address, values[0]) == (protocol.OUTPUT_REGISTER, protocol.OUTPUT_STREAM):
            self.stream()

    def _registers(self) -> dict[int, int]:
        counts = self._counts(self.now())
        identity = {500: 0x4654, 501: 0x5301, 502: 0x0203, 510: 0x4654, 511: 0x5300, 512: 1234, 513: 0, 514: 2020}
        return identity | {180 + axis: count & 0xFFFF for axis, count in enumerate(counts)}

    def _counts(self, number: int) -> list[int]:
        wrench = self._source.samples(number, 1)[0] * np.repeat([100.0, 1000.0], 3)
        return [int(count) for count in np.clip(np.rint(wrench), -32768, 32767)]
