"""What fake sensors share: the wrench they measure, and a device on a pseudo-terminal."""

import contextlib
import os
import select
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray


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


class FakeSerialSensor:
    """A device on a pseudo-terminal; a derived class says what it answers and what it streams.

    Args:
        source: what it measures, N and N m.
        rate: messages of the stream per second.
        folder: for the link that stands for the port (default: a temporary one).

    Attributes:
        port: path to open.
        sent: stream messages so far, those that a fault took included.
        silent: sends nothing and receives nothing.
        fault: what happens to the bytes on the way; None: nothing.
        is_streaming: whether it sends the stream.
    """

    def __init__(self, source: WrenchSource, rate: float, folder: Path | None = None) -> None:
        self._source, self._rate = source, rate
        self._folder = tempfile.TemporaryDirectory(dir=folder)
        self.port = str(Path(self._folder.name) / "ttyUSB0")
        self.sent = 0
        self.silent = False
        self.fault: Callable[[bytes], bytes] | None = None
        self.is_streaming = False
        self._began = 0.0
        self._started_at = 0
        self._powered_at = time.monotonic()
        self._lock = threading.Lock()
        self._master = self._slave = -1
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="fake serial sensor", daemon=True)

    def __enter__(self) -> Self:
        self.plug_in()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()
        self.unplug()
        self._folder.cleanup()

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The driver's parameters that reach this device."""
        return {"address": self.port}

    def plug_in(self) -> None:
        """Appear under the port's path, as after power-up."""
        with self._lock:
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            Path(self.port).symlink_to(os.ttyname(self._slave))
            self.is_streaming = False
            self.power_up()

    def unplug(self) -> None:
        """Vanish, as a USB adapter that is pulled out."""
        with self._lock, contextlib.suppress(OSError):
            Path(self.port).unlink(missing_ok=True)
            os.close(self._slave)
            os.close(self._master)
            self._master = self._slave = -1

    def power_up(self) -> None:
        """Forget what was received."""

    def receive(self, data: bytes) -> None:
        """Take bytes of the driver; answer by `write`."""
        raise NotImplementedError

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

    def write(self, data: bytes) -> None:
        """Send bytes."""
        if self.fault is not None:
            data = self.fault(data)
        with contextlib.suppress(OSError):  # a serial line loses what is not read
            os.write(self._master, data)

    def _run(self) -> None:
        while not self._stopping.is_set():
            with self._lock:
                master = self._master
            if master < 0:
                self._stopping.wait(0.002)
                continue
            ready, _, _ = select.select([master], [], [], 0.002)
            with self._lock:
                if self._master != master:
                    continue
                if ready:
                    self._take(master)
                self._send_due()

    def _take(self, master: int) -> None:
        try:
            data = os.read(master, 1024)
        except OSError:
            return
        if not self.silent:
            self.receive(data)

    def _send_due(self) -> None:
        if not self.is_streaming:
            return
        due = self._started_at + int((time.monotonic() - self._began) * self._rate)
        while self.sent < due:
            message = self.message(self.sent)
            self.sent += 1
            if not self.silent:
                self.write(message)
