"""A Robotiq FT 300 in software: the stream and Modbus RTU on a pseudo-terminal, with faults on purpose."""

import struct
from pathlib import Path

import numpy as np
from pymodbus.framer.rtu import FramerRTU

from poise.force_torque.wire import FakeSerialSensor, WrenchSource

_SLAVE = 9
_STREAM_RATE = 100.0
_READ, _WRITE = 3, 16


def with_crc(message: bytes) -> bytes:
    """Append the CRC; computed by pymodbus, so that it checks the driver's own."""
    return message + FramerRTU.compute_CRC(message).to_bytes(2, "big")


class FakeRobotiqSensor(FakeSerialSensor):
    """A device that answers Modbus until it streams, and then nothing.

    Args:
        source: what it measures, N and N m, 100 samples a second.
        folder: for the link that stands for the port (default: a temporary one).

    Attributes:
        requests: Modbus requests answered.
    """

    def __init__(self, source: WrenchSource, folder: Path | None = None) -> None:
        super().__init__(source, _STREAM_RATE, folder)
        self.requests = 0
        self._heard = b""

    def power_up(self) -> None:
        self._heard = b""

    def receive(self, data: bytes) -> None:
        if self.is_streaming:
            if b"\xff" * 10 in data:
                self.is_streaming = False
            return
        self._heard = (self._heard + data).lstrip(b"\xff")
        while answer := self._answer():
            self.write(answer)

    def message(self, number: int) -> bytes:
        return with_crc(b"\x20\x4e" + struct.pack("<6h", *self._counts(number)))

    def _answer(self) -> bytes:
        """Answer the first whole request; what is none is passed over."""
        heard = self._heard
        while len(heard) >= 8:
            function = heard[1]
            length = 9 + heard[6] if function == _WRITE else 8
            request, rest = heard[:length], heard[length:]
            if len(request) < length:
                break
            if heard[0] == _SLAVE and function in (_READ, _WRITE) and with_crc(request[:-2]) == request:
                self._heard = rest
                self.requests += 1
                address, count = struct.unpack_from(">HH", request, 2)
                return self._read(address, count) if function == _READ else self._written(request, address)
            heard = heard[1:]
        self._heard = heard
        return b""

    def _read(self, address: int, count: int) -> bytes:
        registers = self._registers()
        values = [registers.get(register) for register in range(address, address + count)]
        if any(value is None for value in values):
            return with_crc(bytes([_SLAVE, _READ | 0x80, 2]))  # illegal data address
        return with_crc(struct.pack(f">BBB{count}H", _SLAVE, _READ, 2 * count, *values))

    def _written(self, request: bytes, address: int) -> bytes:
        if (address, request[7:9]) == (410, b"\x02\x00"):
            self.stream()
        return with_crc(request[:6])

    def _registers(self) -> dict[int, int]:
        counts = self._counts(self.now())
        identity = {500: 0x4654, 501: 0x5301, 502: 0x0203, 510: 0x4654, 511: 0x5300, 512: 1234, 513: 0, 514: 2020}
        return identity | {180 + axis: count & 0xFFFF for axis, count in enumerate(counts)}

    def _counts(self, number: int) -> list[int]:
        wrench = self._source.samples(number, 1)[0] * np.repeat([100.0, 1000.0], 3)
        return [int(count) for count in np.clip(np.rint(wrench), -32768, 32767)]
