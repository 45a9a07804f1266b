"""A Robotiq FT 300 or FT 300-S on a serial port: the stream at 100 Hz, or Modbus RTU, slower, on a shared line."""

import time

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, SensorError
from poise.force_torque.sensors.robotiq import protocol as robotiq
from poise.force_torque.wire import Calibration, SensorSamples, no_samples
from poise.serial_bus import ModbusLine, SerialLine


class _RobotiqLink:
    """What both ways share: counts to samples; no status word, no bias command."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration

    def bias(self) -> None:
        raise SensorError(ErrorCode.UNSUPPORTED, "a Robotiq sensor cannot zero itself; use the software bias")

    def describe(self, status: int) -> str:
        return "healthy"

    def _samples(self, number: NDArray[np.uint32], counts: NDArray[np.int16], rejected: int) -> SensorSamples:
        return self._calibration.samples(number, counts, time.time_ns(), rejected)


class RobotiqStreamLink(_RobotiqLink):
    """Link to the 100 Hz stream.

    Args:
        port: path of the serial device.
        calibration: from counts (0.01 N, 0.001 N m) to the contract's sign, with the rated load.
        slave: Modbus address.
    """

    rate = robotiq.STREAM_RATE

    def __init__(self, port: str, calibration: Calibration, slave: int = robotiq.SLAVE) -> None:
        super().__init__(calibration)
        self._line = SerialLine(port, robotiq.BAUD_RATE)
        self._slave = slave
        self._parser = robotiq.StreamParser()

    @property
    def name(self) -> str:
        return f"robotiq stream {self._line.path}"

    def start(self) -> None:
        if self._line.open():
            self._parser = robotiq.StreamParser()
        # A sensor that streams already ignores this.
        self._line.write(robotiq.write_request(robotiq.OUTPUT_REGISTER, robotiq.OUTPUT_STREAM, self._slave))

    def read(self, timeout: float) -> SensorSamples:
        data = self._line.read(timeout)
        rejected = self._parser.rejected
        number, counts = self._parser.feed(data)
        return self._samples(number, counts, self._parser.rejected - rejected)

    def close(self) -> None:
        self._line.close(robotiq.STOP_STREAM)


class RobotiqModbusLink(_RobotiqLink):
    """Link that asks for every sample.

    Args:
        port: path of the serial device.
        calibration: from counts (0.01 N, 0.001 N m) to the contract's sign, with the rated load.
        poll_rate: questions a second; at 19200 baud no more than about 50 are answered.
        slave: Modbus address.
    """

    rate = None

    def __init__(
        self, port: str, calibration: Calibration, poll_rate: float = 50.0, slave: int = robotiq.SLAVE
    ) -> None:
        super().__init__(calibration)
        self._line = ModbusLine(port, robotiq.BAUD_RATE, slave)
        self._period = 1.0 / poll_rate
        self._identity: robotiq.RobotiqIdentity | None = None
        self._number = 0
        self._next_poll = 0.0

    @property
    def name(self) -> str:
        serial_number = f" ({self._identity.serial_number})" if self._identity else ""
        return f"robotiq modbus {self._line.path}{serial_number}"

    @property
    def identity(self) -> robotiq.RobotiqIdentity | None:
        """Which sensor it is, once it has answered."""
        return self._identity

    def start(self) -> None:
        self._line.open(robotiq.STOP_STREAM)  # it may have been left streaming
        self._next_poll = time.monotonic()
        self._identity = robotiq.RobotiqIdentity.from_registers(
            self._firmware(),
            self._line.read_holding(robotiq.SERIAL_NUMBER_REGISTER, 4),
            self._line.read_holding(robotiq.YEAR_REGISTER, 1)[0],
        )

    def _firmware(self) -> list[int]:
        """The first answer; a sensor that has been streaming, or was just plugged in, may miss one question."""
        try:
            return self._line.read_holding(robotiq.FIRMWARE_REGISTER, 3)
        except SensorError:
            return self._line.read_holding(robotiq.FIRMWARE_REGISTER, 3)

    def read(self, timeout: float) -> SensorSamples:
        if not self._line.is_open:  # also before the next question is due
            raise OSError(f"{self._line.path} is closed")
        wait = self._next_poll - time.monotonic()
        if wait > timeout:
            time.sleep(max(0.0, timeout))
            return no_samples(time.time_ns())
        time.sleep(max(0.0, wait))
        self._next_poll = max(self._next_poll + self._period, time.monotonic())
        number = np.array([self._number], dtype=np.uint32)
        self._number = (self._number + 1) % (1 << 32)
        try:
            registers = self._line.read_holding(robotiq.WRENCH_REGISTER, 6)
        except SensorError:
            return no_samples(time.time_ns(), rejected=1)
        return self._samples(number, robotiq.wrench_counts(registers)[None], 0)

    def close(self) -> None:
        self._line.close()
