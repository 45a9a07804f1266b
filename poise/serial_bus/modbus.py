"""The registers of one device behind Modbus RTU, by pymodbus."""

import contextlib
import inspect
import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from poise.errors import ErrorCode, SensorError
from poise.serial_bus.serial_line import unreachable_port

if TYPE_CHECKING:
    from pymodbus.client import ModbusSerialClient


class ModbusLine:
    """One device on a serial port; it can be opened again after it was closed or has vanished.

    Every request ends within `answer_time`.

    Args:
        path: of the device file.
        baud_rate: bits per second; 8 data bits, no parity, 1 stop bit.
        slave: Modbus address.
        answer_time: s after which a request counts as not answered.
    """

    def __init__(self, path: str, baud_rate: int, slave: int, answer_time: float = 0.1) -> None:
        self.path, self.slave = path, slave
        self._baud_rate, self._answer_time = baud_rate, answer_time
        self._client: ModbusSerialClient | None = None
        self._device: dict[str, int] = {}

    @property
    def is_open(self) -> bool:
        """The port was opened and has not been closed since."""
        return self._client is not None

    def open(self, greeting: bytes = b"") -> bool:
        """Open the port and send `greeting`; return False when it was open already.

        Raises:
            SensorError: SENSOR_UNREACHABLE, when the port cannot be opened.
        """
        if self._client is not None:
            return False
        from pymodbus.client import ModbusSerialClient

        # The caller reports a device that does not answer; pymodbus would print a line for every request.
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        client = ModbusSerialClient(self.path, baudrate=self._baud_rate, timeout=self._answer_time, retries=0)
        if not client.connect():
            raise unreachable_port(self.path, OSError("cannot open"))
        self._client = client
        # pymodbus 3.10 renamed the argument; Ubuntu 24.04 has an older one.
        known = inspect.signature(ModbusSerialClient.read_holding_registers).parameters
        self._device = {"device_id" if "device_id" in known else "slave": self.slave}
        if greeting and client.socket is not None:
            client.socket.write(greeting)
        return True

    def read_holding(self, address: int, count: int) -> list[int]:
        """Registers from `address` on (function 3).

        Raises:
            OSError: the port is closed, or has vanished.
            SensorError: SENSOR_UNREACHABLE without an answer, SENSOR_PROTOCOL for a refusal.
        """
        return self._read("read_holding_registers", address, count)

    def read_input(self, address: int, count: int) -> list[int]:
        """Input registers from `address` on (function 4).

        Raises:
            OSError, SensorError: as `read_holding`.
        """
        return self._read("read_input_registers", address, count)

    def write(self, address: int, values: Sequence[int]) -> None:
        """Set registers from `address` on (function 16).

        Raises:
            OSError, SensorError: as `read_holding`.
        """
        self._ask("write_registers", address, list(values))

    def close(self) -> None:
        """Close the port; never raises."""
        if self._client is not None:
            with contextlib.suppress(OSError):
                self._client.close()  # type: ignore[no-untyped-call]
            self._client = None

    def _read(self, function: str, address: int, count: int) -> list[int]:
        registers = list(self._ask(function, address, count=count).registers)
        if len(registers) != count:
            raise self._refused(address, f"{len(registers)} registers instead of {count}")
        return registers

    def _ask(self, function: str, address: int, *arguments: Any, **named: Any) -> Any:
        from pymodbus.exceptions import ModbusException

        if self._client is None or not self._client.connected:
            raise OSError(f"{self.path} is closed")
        try:
            answer = getattr(self._client, function)(address, *arguments, **named, **self._device)
        except ModbusException as error:
            if not self._client.connected:
                raise OSError(f"{self.path} is gone") from error
            raise SensorError(
                ErrorCode.SENSOR_UNREACHABLE, f"{self.path}: slave {self.slave} does not answer ({error})"
            ) from error
        if answer.isError():
            raise self._refused(address, answer)
        return answer

    def _refused(self, address: int, why: object) -> SensorError:
        return SensorError(ErrorCode.SENSOR_PROTOCOL, f"{self.path}: registers {address} and on refused ({why})")
