"""Bota Systems sensors (SensONE, Rokubi, MegaONE) on RS-422 or USB: protocol, link and fake in one entry.

Source: Bota Systems, gitlab.com/botasys/python_interface, examples/bota_serial_example.py, and the serial section of
the SensONE user manual. 460800 baud, 8 data bits, no parity, 1 stop bit. Commands are ASCII: `C` enters the
configuration mode, `c,T,U,F,B` sets up the communication (temperature compensation, calibration, format, baud rate),
`f,S,C,F,D` the filter (sinc length, chop, fast, FIR off), `R` starts the stream; each is acknowledged by `r,0,` and its
letter and `,0`. A frame of the stream has 37 bytes, little endian: 0xAA, status (uint16), six float32 in N and N m,
device time (uint32, us), temperature (float32, deg C), and the CRC-16/X.25 of the 34 bytes between header and CRC.
"""

import binascii
import math
import struct
import time
from typing import Any

import numpy as np

from poise.errors import ErrorCode, SensorError
from poise.force_torque.sensors.base import Sensor, SensorSetting, SensorValues, limit_of, reports_of
from poise.force_torque.wire import (
    Calibration,
    FakeSensor,
    FakeSerialSensor,
    FrameParser,
    Link,
    SensorSamples,
    WrenchSource,
    reflected_crc16,
)
from poise.serial_bus import SerialLine

_BAUD_RATE = 460800
_HEADER = b"\xaa"
_CONTENT = struct.Struct("<H6fIf")
_FRAME_LENGTH = len(_HEADER) + _CONTENT.size + 2
_SINC_RATE = 51200.0
"""Hz of the converter: samples a second times the length of the sinc filter."""
_ANSWER_TIME = 0.4
"""s after which a command counts as not answered."""
_STATUS = {
    0: "processing took too long",
    1: "force or torque out of range",
    2: "invalid measurement",
    3: "raw measurement: the calibration is off",
}
_OVERRANGE, _INVALID, _RAW = 1 << 1, 1 << 2, 1 << 3
_crc_x25 = reflected_crc16(0x8408, final=0xFFFF)


class BotaSerial(Sensor):
    """Bota Systems' serial sensors."""

    name = "bota_serial"
    summary = "Bota Systems SensONE, Rokubi, MegaONE: RS-422 or USB"
    address = "path of the serial port"
    settings = (
        SensorSetting("sinc_length", 64, "bota: length of the sinc filter; 51200 / it is the rate in Hz", (51, 512)),
    )

    def link(self, values: SensorValues) -> Link:
        """The link to a Bota sensor."""
        calibration = Calibration(reports_of(values).sign, reports_of(values).sign, limit_of(values))
        return BotaSerialLink(values["address"], calibration, values["sinc_length"])

    def fake(self, source: WrenchSource, **options: Any) -> FakeSensor:
        """A device on a pseudo-terminal; options of `FakeBotaSensor`."""
        return FakeBotaSensor(source, **options)


class BotaSerialLink:
    """Link to the binary stream.

    Args:
        port: path of the serial device.
        calibration: from the device's N and N m to the contract's sign, with the rated load.
        sinc_length: of the device's filter.
    """

    def __init__(self, port: str, calibration: Calibration, sinc_length: int) -> None:
        self._line = SerialLine(port, _BAUD_RATE)
        self._calibration = calibration
        self._sinc_length = sinc_length
        self._frames = _frame_parser()
        self._number = 0
        self._device_time: int | None = None

    @property
    def name(self) -> str:
        return f"bota serial {self._line.path}"

    @property
    def rate(self) -> float:
        return _SINC_RATE / self._sinc_length

    def describe(self, status: int) -> str:
        return ", ".join(text for bit, text in _STATUS.items() if status >> bit & 1) or "healthy"

    def start(self) -> None:
        if self._line.open():
            self._frames = _frame_parser()
        for command in ("C", "c,0,1,0,4", f"f,{self._sinc_length},0,0,1", "R"):
            self._order(command)

    def bias(self) -> None:
        raise SensorError(ErrorCode.UNSUPPORTED, "a Bota sensor has no bias command here; use the software bias")

    def read(self, timeout: float) -> SensorSamples:
        data = self._line.read(timeout)
        rejected = self._frames.rejected
        rows = [_CONTENT.unpack_from(frame, len(_HEADER)) for _, frame in self._frames.feed(data)]
        table = np.array(rows, dtype=np.float64).reshape(-1, 9)
        wrench = self._calibration.wrench(table[:, 1:7])
        status = table[:, 0].astype(np.uint32)
        return SensorSamples(
            sequence=np.array([self._next(row[7]) for row in rows], dtype=np.uint32),
            wrench_in_sensor=wrench,
            status=status,
            saturated=self._calibration.saturated(wrench) | ((status & _OVERRANGE) != 0),
            faulty=((status & (_INVALID | _RAW)) != 0) | ~np.isfinite(wrench).all(axis=1),
            arrival=time.time_ns(),
            measured=self._device_time,
            rejected=self._frames.rejected - rejected,
        )

    def close(self) -> None:
        self._line.close(b"C")

    def _order(self, command: str) -> None:
        """Send a command and wait for its acknowledgement among the frames of a running stream.

        Raises:
            SensorError: SENSOR_UNREACHABLE, when it does not come.
        """
        self._line.write(command.encode())
        expected = f"r,0,{command[0]},0".encode()
        heard = b""
        deadline = time.monotonic() + _ANSWER_TIME
        while (left := deadline - time.monotonic()) > 0:
            heard = heard[-len(expected) :] + self._line.read(left)
            if expected in heard:
                return
        raise SensorError(
            ErrorCode.SENSOR_UNREACHABLE,
            f"{self._line.path}: no answer to the command {command!r}; check power and cable, and that a Bota sensor is"
            " connected",
        )

    def _next(self, device_time: int) -> int:
        """Number a sample by the device's clock, so that lost frames show as a gap."""
        elapsed = 0 if self._device_time is None else (device_time - self._device_time) % (1 << 32)
        steps = math.floor(elapsed * 1e-6 * self.rate + 0.5)
        self._number = (self._number + (steps if 0 < steps < self.rate else 1)) % (1 << 32)
        self._device_time = device_time
        return self._number


def _frame_parser() -> FrameParser:
    return FrameParser(
        _HEADER, _FRAME_LENGTH, lambda frame: _crc_x25(frame[1:-2]) == int.from_bytes(frame[-2:], "little")
    )


class FakeBotaSensor(FakeSerialSensor):
    """A device on a pseudo-terminal.

    Args:
        source: what it measures, N and N m.
        sinc_length: of its filter at power-up.

    Attributes:
        status: status word of the frames to come.
        stalled: repeats one measurement.
    """

    def __init__(self, source: WrenchSource, sinc_length: int = 64) -> None:
        super().__init__(source, _SINC_RATE / sinc_length)
        self.status = 0
        self.stalled = False
        self._is_configurable = False

    def power_up(self) -> None:
        self.stream()
        self._is_configurable = False

    def receive(self, data: bytes) -> None:
        letter = data[:1].decode("ascii", "replace")
        if letter == "C":
            self._is_configurable, self.is_streaming = True, False
        elif not self._is_configurable:
            return
        elif letter == "f":
            self._rate = 51200.0 / int(data.split(b",")[1])
        elif letter == "R":
            self._is_configurable = False
        elif letter != "c":
            return
        self.write(f"r,0,{letter},0\r\n".encode())
        if letter == "R":
            self.stream()

    def message(self, number: int) -> bytes:
        wrench = self._source.samples(number, 1)[0]
        device_time = round((0 if self.stalled else number) * 1e6 / self._rate) % (1 << 32)
        content = struct.pack("<H6fIf", self.status, *wrench, device_time, 31.5)
        # Bit by bit the mirror image of the link's own CRC.
        mirrored = bytes(int(f"{byte:08b}"[::-1], 2) for byte in content)
        crc = int(f"{binascii.crc_hqx(mirrored, 0xFFFF):016b}"[::-1], 2) ^ 0xFFFF
        return b"\xaa" + content + struct.pack("<H", crc)
