"""Robotiq FT 300 and FT 300-S on a serial line: bytes of the stream and of the Modbus requests and registers.

Source: Robotiq FT 300-S instruction manual, section 4.4. 19200 baud, 8 data bits, no parity, 1 stop bit, slave 9.
No I/O here: see robotiq_link.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, SensorError

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

STREAM_HEADER = b"\x20\x4e"
STREAM_LENGTH = 16


def crc(data: bytes) -> int:
    """CRC-16 of Modbus (polynomial 0xA001 reflected, start 0xFFFF), sent low byte first."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return register


def write_request(register: int, value: int, slave: int = SLAVE) -> bytes:
    """Encode Preset Multiple Registers (FC16) for one register."""
    body = struct.pack(">BBHHBH", slave, 16, register, 1, 2, value)
    return body + struct.pack("<H", crc(body))


def stream_message(counts: Sequence[int]) -> bytes:
    """Encode a message of the stream from six int16 counts."""
    body = STREAM_HEADER + struct.pack("<6h", *counts)
    return body + struct.pack("<H", crc(body))


class StreamParser:
    """Finds the valid messages in a stream of bytes that may begin anywhere and be damaged.

    Messages carry no number; this numbers them. Bytes between two valid messages are messages that were damaged, and
    their numbers are left out, so that the loss shows as a gap.

    Attributes:
        rejected: damaged messages so far.
    """

    def __init__(self) -> None:
        self.rejected = 0
        self._buffer = b""
        self._skipped = 0
        self._next: int | None = None

    def feed(self, data: bytes) -> tuple[NDArray[np.uint32], NDArray[np.int16]]:
        """Take bytes in pieces of any size.

        Returns:
            number: (N,) of the messages completed by these bytes.
            counts: (N, 6).
        """
        numbers: list[int] = []
        counts: list[tuple[int, ...]] = []
        buffer = self._buffer + data
        at = 0
        while True:
            header = buffer.find(STREAM_HEADER, at)
            if header < 0:  # keep a last byte that may be half a header
                header = len(buffer) - (1 if buffer.endswith(STREAM_HEADER[:1]) else 0)
                header = max(header, at)
            self._skipped += header - at
            at = header
            message = buffer[at : at + STREAM_LENGTH]
            if len(message) < STREAM_LENGTH:
                break
            if crc(message[:-2]) == int.from_bytes(message[-2:], "little"):
                numbers.append(self._number())
                counts.append(struct.unpack_from("<6h", message, 2))
                at += STREAM_LENGTH
            else:
                self._skipped += 1
                at += 1
        self._buffer = buffer[at:]
        return np.array(numbers, dtype=np.uint32), np.array(counts, dtype=np.int16).reshape(-1, 6)

    def _number(self) -> int:
        damaged = max(1, round(self._skipped / STREAM_LENGTH)) if self._skipped else 0
        self._skipped = 0
        if self._next is None:  # what came before the first message is the middle of another, or an answer
            damaged, self._next = 0, 0
        self.rejected += damaged
        number = self._next + damaged
        self._next = (number + 1) % (1 << 32)
        return number % (1 << 32)


def wrench_counts(registers: Sequence[int]) -> NDArray[np.int16]:
    """(6,) signed counts from the six registers at WRENCH_REGISTER."""
    return np.array(registers, dtype=np.uint16).view(np.int16)


@dataclass(frozen=True)
class Identity:
    """Which sensor it is; the texts are spelled as Robotiq's own software spells them."""

    firmware: str
    serial_number: str
    year: int

    @classmethod
    def from_registers(cls, firmware: Sequence[int], serial_number: Sequence[int], year: int) -> "Identity":
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
