"""A serial port: opened for this process alone, read without waiting longer than asked."""

import contextlib
import select
from typing import TYPE_CHECKING

from poise.errors import ErrorCode, SensorError

if TYPE_CHECKING:
    import serial


class SerialLine:
    """A port that can be opened again after it was closed or has vanished.

    Args:
        path: of the device file.
        baud_rate: bits per second; 8 data bits, no parity, 1 stop bit.
    """

    def __init__(self, path: str, baud_rate: int) -> None:
        self.path = path
        self._baud_rate = baud_rate
        self._port: serial.Serial | None = None

    def open(self) -> bool:
        """Open the port; return False when it was open already.

        Raises:
            SensorError: SENSOR_UNREACHABLE, when there is no such port, no permission, or another process holds it.
        """
        if self._port is not None:
            return False
        import serial

        try:
            self._port = serial.Serial(self.path, self._baud_rate, timeout=0, write_timeout=0.5, exclusive=True)
        except (OSError, ValueError) as error:
            raise unreachable_port(self.path, error) from error
        return True

    def read(self, timeout: float) -> bytes:
        """Wait at most `timeout` s for bytes; return all that are there, b"" for none.

        Raises:
            OSError: the port is closed, or has vanished.
        """
        port = self._opened()
        poll = select.poll()
        poll.register(port.fileno(), select.POLLIN)
        if not poll.poll(max(0.0, timeout) * 1000.0):
            return b""
        return bytes(port.read(4096))

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            OSError: as `read`.
        """
        self._opened().write(data)

    def close(self, farewell: bytes = b"") -> None:
        """Send `farewell` and close; never raises."""
        if self._port is None:
            return
        with contextlib.suppress(OSError):
            self._port.write(farewell)
            self._port.flush()
        with contextlib.suppress(OSError):
            self._port.close()
        self._port = None

    def _opened(self) -> "serial.Serial":
        if self._port is None:
            raise OSError("the link is not started")
        return self._port


def unreachable_port(path: str, error: Exception) -> SensorError:
    """The error for a port that cannot be opened."""
    return SensorError(ErrorCode.SENSOR_UNREACHABLE, f"{path}: {error}; check the port, its permissions, and the cable")
