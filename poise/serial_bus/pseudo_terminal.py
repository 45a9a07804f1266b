"""A device in software on a pseudo-terminal, and what it answers to Modbus RTU."""

import contextlib
import os
import select
import struct
import tempfile
import threading
import tty
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Self

_READS = (3, 4)
_WRITE = 16


class PseudoTerminalDevice:
    """A serial device while its context lasts; a derived class says what it answers.

    Args:
        folder: for the link that stands for the port (default: a temporary one).

    Attributes:
        port: path to open.
        silent: sends nothing and receives nothing, as with a cable that is unplugged.
        fault: what happens to the bytes on the way; None: nothing.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = tempfile.TemporaryDirectory(dir=folder)
        self.port = str(Path(self._folder.name) / "ttyUSB0")
        self.silent = False
        self.fault: Callable[[bytes], bytes] | None = None
        self._lock = threading.Lock()
        self._master = self._slave = -1
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="fake serial device", daemon=True)

    def __enter__(self) -> Self:
        self.plug_in()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()
        self.unplug()
        self._folder.cleanup()

    def plug_in(self) -> None:
        """Appear under the port's path, as after power-up."""
        with self._lock:
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            Path(self.port).symlink_to(os.ttyname(self._slave))
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

    def tick(self) -> None:
        """Do what is due; called every 2 ms."""

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
                self.tick()

    def _take(self, master: int) -> None:
        try:
            data = os.read(master, 1024)
        except OSError:
            return
        if not self.silent:
            self.receive(data)


class ModbusAnswers:
    """What a device with registers answers: functions 3, 4 and 16.

    Args:
        slave: its address.
        registers: called for a read; values by address.
        written: called for a write, with the first address and the values.

    Attributes:
        requests: answered so far.
    """

    def __init__(
        self,
        slave: int,
        registers: Callable[[], Mapping[int, int]],
        written: Callable[[int, Sequence[int]], None],
    ) -> None:
        self._slave, self._registers, self._written = slave, registers, written
        self.requests = 0
        self._heard = b""

    def forget(self) -> None:
        """Forget the beginning of a request."""
        self._heard = b""

    def feed(self, data: bytes) -> bytes:
        """The answers to the requests that these bytes complete; what is no request is passed over."""
        self._heard = (self._heard + data).lstrip(b"\xff")
        answers = []
        while answer := self._answer():
            answers.append(answer)
        return b"".join(answers)

    def _answer(self) -> bytes:
        heard = self._heard
        while len(heard) >= 8:
            function = heard[1]
            length = 9 + heard[6] if function == _WRITE else 8
            request, rest = heard[:length], heard[length:]
            if len(request) < length:
                break
            known = heard[0] == self._slave and function in (*_READS, _WRITE)
            if known and with_modbus_crc(request[:-2]) == request:
                self._heard = rest
                self.requests += 1
                return self._write(request) if function == _WRITE else self._read(request)
            heard = heard[1:]
        self._heard = heard
        return b""

    def _read(self, request: bytes) -> bytes:
        address, count = struct.unpack_from(">HH", request, 2)
        registers = self._registers()
        values = [registers.get(register) for register in range(address, address + count)]
        if any(value is None for value in values):
            return with_modbus_crc(bytes([self._slave, request[1] | 0x80, 2]))  # illegal data address
        return with_modbus_crc(struct.pack(f">BBB{count}H", self._slave, request[1], 2 * count, *values))

    def _write(self, request: bytes) -> bytes:
        address, count = struct.unpack_from(">HH", request, 2)
        self._written(address, struct.unpack_from(f">{count}H", request, 7))
        return with_modbus_crc(request[:6])


def with_modbus_crc(message: bytes) -> bytes:
    """Append the CRC; computed by pymodbus, so that it checks the driver's own."""
    from pymodbus.framer.rtu import FramerRTU

    return message + FramerRTU.compute_CRC(message).to_bytes(2, "big")
