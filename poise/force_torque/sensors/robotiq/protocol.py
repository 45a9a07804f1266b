"""Robotiq FT 300 and FT 300-S on a serial line: bytes of the stream and of the Modbus requests and registers.

Source: Robotiq FT 300-S instruction manual, section 4.4. 19200 baud, 8 data bits, no parity, 1 stop bit, slave 9.
No I/O here: see `link`.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, SensorError
from poise.force_torque.wire import FrameParser, reflected_crc16

BAUD_RATE = 19200
SLAVE = 9
STREAM_RATE = 100.0
"""Messages a second."""

COUNTS_PER_NEWTON = 100.0
COUNTS_PER_NEWTON_METRE = 1000.0
RANGE = (300.0, 300.0, 300.0, 30.0, 30.0, 30.0)
"""Rated load, N and N m."""

WRENCH_REGISTER = 180
FIRMWARE_REGISTER = 500
SERIAL_NUMBER_REGISTER = 510
YEAR_REGISTER = 514
OUTPUT_REGISTER = 410
OUTPUT_STREAM = 0x0200
"""Written to OUTPUT_REGISTER, it starts the stream; from then on the device answers no request."""
STOP_STREAM = b"\xff" * 50
"""Sent while the device streams, it returns to Modbus."""

_STREAM_HEADER = b"\x20\x4e"
STREAM_LENGTH = 16


crc = reflected_crc16(0xA001)
"""CRC-16 of Modbus, sent low byte first."""


def write_request(register: int, value: int, slave: int = SLAVE) -> bytes:
    """Encode Preset Multiple Registers (FC16) for one register."""
    body = struct.pack(">BBHHBH", slave, 16, register, 1, 2, value)
    return body + struct.pack("<H", crc(body))


def stream_message(counts: Sequence[int]) -> bytes:
    """Encode a message of the stream from six int16 counts."""
    body = _STREAM_HEADER + struct.pack("<6h", *counts)
    return body + struct.pack("<H", crc(body))


class StreamParser:
    """Finds and numbers the valid messages of the stream, see `FrameParser`."""

    def __init__(self) -> None:
        self._frames = FrameParser(_STREAM_HEADER, STREAM_LENGTH, _is_valid)

    @property
    def rejected(self) -> int:
        """Damaged messages so far."""
        return self._frames.rejected

    def feed(self, data: bytes) -> tuple[NDArray[np.uint32], NDArray[np.int16]]:
        """Take bytes in pieces of any size.

        Returns:
            number: (N,) of the messages completed by these bytes.
            counts: (N, 6).
        """
        found = self._frames.feed(data)
        counts = [struct.unpack_from("<6h", frame, len(_STREAM_HEADER)) for _, frame in found]
        number = np.array([number for number, _ in found], dtype=np.uint32)
        return number, np.array(counts, dtype=np.int16).reshape(-1, 6)


def _is_valid(frame: bytes) -> bool:
    return crc(frame[:-2]) == int.from_bytes(frame[-2:], "little")


def wrench_counts(registers: Sequence[int]) -> NDArray[np.int16]:
    """(6,) signed counts from the six registers at WRENCH_REGISTER."""
    return np.array(registers, dtype=np.uint16).view(np.int16)


@dataclass(frozen=True)
class RobotiqIdentity:
    """Which sensor it is; the texts are spelled as Robotiq's own software spells them."""

    firmware: str
    serial_number: str
    year: int

    @classmethod
    def from_registers(cls, firmware: Sequence[int], serial_number: Sequence[int], year: int) -> "RobotiqIdentity":
        """Decode three registers at FIRMWARE_REGISTER, four at SERIAL_NUMBER_REGISTER, one at YEAR_REGISTER.

        Raises:
            SensorError: SENSOR_PROTOCOL, when the firmware is not that of a force sensor (it begins with F).
        """
        first, second, third = (register.to_bytes(2, "big") for register in firmware)
        if first[:1] != b"F":
            raise SensorError(
                ErrorCode.SENSOR_PROTOCOL,
                f"firmware {first + second!r} is not that of a Robotiq force sensor; is it another Modbus device?",
            )
        version = f"{(first + second[:1]).decode('ascii', 'replace')}-{second[1]}.{third[0]}.{third[1]}"
        letters = (serial_number[0].to_bytes(2, "big") + serial_number[1].to_bytes(2, "big")[:1]).decode(
            "ascii", "replace"
        )
        number = serial_number[3] << 16 | serial_number[2]
        return cls(version, f"{letters}-{number:04d}" if number else "unknown", year)
