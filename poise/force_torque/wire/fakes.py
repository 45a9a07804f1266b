"""What fake sensors share: the wrench they measure, and a stream on a pseudo-terminal."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.serial_bus import PseudoTerminalDevice


class WrenchSource:
    """Wrenches that a fake sensor reports in turn, from the first again after the last.

    Args:
        wrench_in_sensor: (N, 6) or (6,) N and N m, what the load exerts on the sensor.
    """

    def __init__(self, wrench_in_sensor: ArrayLike) -> None:
        self._wrench = np.atleast_2d(np.asarray(wrench_in_sensor, dtype=float))
        if self._wrench.shape[1:] != (6,) or not len(self._wrench):
            raise ValueError(f"a wrench has six numbers a sample, not shape {self._wrench.shape}")

    def samples(self, first: int, count: int) -> NDArray[np.float64]:
        """SensorSamples number `first` to `first + count - 1`, (count, 6)."""
        return self._wrench[np.arange(first, first + count) % len(self._wrench)]


class FakeSensor(Protocol):
    """A device in software, on loopback or on a pseudo-terminal while its context lasts.

    Attributes:
        silent: sends nothing and receives nothing, as with a cable that is unplugged.
    """

    silent: bool

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The driver's parameters that reach this device."""

    @property
    def is_streaming(self) -> bool:
        """Whether it was asked for samples and sends them."""

    def __enter__(self) -> Self:
        """Switch the device on."""

    def __exit__(self, *_: object) -> None:
        """Switch it off."""


class FakeSerialSensor(PseudoTerminalDevice):
    """A sensor on a pseudo-terminal; a derived class says what it answers and what it streams.

    Args:
        source: what it measures, N and N m.
        rate: messages of the stream per second.
        folder: as of `PseudoTerminalDevice`.

    Attributes:
        sent: stream messages so far, those that a fault took included.
        is_streaming: whether it sends the stream.
    """

    def __init__(self, source: WrenchSource, rate: float, folder: Path | None = None) -> None:
        super().__init__(folder)
        self._source, self._rate = source, rate
        self.sent = 0
        self.is_streaming = False
        self._began = 0.0
        self._started_at = 0
        self._powered_at = time.monotonic()

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The driver's parameters that reach this device."""
        return {"address": self.port}

    def power_up(self) -> None:
        """Wait for the command that starts the stream."""
        self.is_streaming = False

    def message(self, number: int) -> bytes:
        """Message number `number` of the stream."""
        raise NotImplementedError

    def stream(self) -> None:
        """Begin the stream."""
        self.is_streaming = True
        self._began, self._started_at = time.monotonic(), self.sent

    def now(self) -> int:
        """Number of the present measurement since power-up."""
        return int((time.monotonic() - self._powered_at) * self._rate)

    def tick(self) -> None:
        """Send the messages that are due."""
        if not self.is_streaming:
            return
        due = self._started_at + int((time.monotonic() - self._began) * self._rate)
        while self.sent < due:
            message = self.message(self.sent)
            self.sent += 1
            if not self.silent:
                self.write(message)
