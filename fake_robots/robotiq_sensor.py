"""A Robotiq FT 300 that is not there: the stream and Modbus RTU on a pseudo-terminal, with faults on purpose.

python -m poise.fake_robots.robotiq_sensor --bag bags/kuka_free_motion.mcap
"""

import argparse
import contextlib
import os
import select
import struct
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np
from pymodbus.framer.rtu import FramerRTU

from poise.fake_robots.wrench_source import WrenchSource

SLAVE = 9
STREAM_RATE = 100.0
READ, WRITE = 3, 16


def with_crc(message: bytes) -> bytes:
    """Append the CRC; computed by pymodbus, so that it checks the driver's own."""
    return message + FramerRTU.compute_CRC(message).to_bytes(2, "big")


class FakeRobotiqSensor:
    """A device on a pseudo-terminal while its context lasts; `port` is the path to open.

    Args:
        source: what it feels, N and N m, 100 samples a second.
        folder: for the link that stands for the port (default: a temporary one).

    Attributes:
        sent: stream messages so far, those that a fault took included.
        silent: sends nothing and hears nothing.
        fault: what happens to the bytes on the way; None: nothing.
        is_streaming: in stream mode it answers no request.
        requests: Modbus requests answered.
    """

    def __init__(self, source: WrenchSource, folder: Path | None = None) -> None:
        self._source = source
        self._folder = tempfile.TemporaryDirectory(dir=folder)
        self.port = str(Path(self._folder.name) / "ttyUSB0")
        self.sent = 0
        self.silent = False
        self.fault: Callable[[bytes], bytes] | None = None
        self.is_streaming = False
        self.requests = 0
        self._began = 0.0
        self._started_at = 0
        self._heard = b""
        self._powered_at = time.monotonic()
        self._lock = threading.Lock()
        self._master = self._slave = -1
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="fake robotiq", daemon=True)

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
        """Appear under the port's path, not streaming."""
        with self._lock:
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            Path(self.port).symlink_to(os.ttyname(self._slave))
            self.is_streaming, self._heard = False, b""

    def unplug(self) -> None:
        """Vanish, as a USB adapter does that is pulled out."""
        with self._lock, contextlib.suppress(OSError):
            Path(self.port).unlink(missing_ok=True)
            os.close(self._slave)
            os.close(self._master)
            self._master = self._slave = -1

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
                    self._hear(master)
                self._stream(master)

    def _hear(self, master: int) -> None:
        try:
            heard = os.read(master, 1024)
        except OSError:
            return
        if self.silent:
            return
        if self.is_streaming:
            if b"\xff" * 10 in heard:
                self.is_streaming = False
            return
        self._heard = (self._heard + heard).lstrip(b"\xff")
        while answer := self._answer():
            self._write(master, answer)

    def _answer(self) -> bytes:
        """Answer the first whole request; what is none is passed over."""
        heard = self._heard
        while len(heard) >= 8:
            function = heard[1]
            length = 9 + heard[6] if function == WRITE else 8
            request, rest = heard[:length], heard[length:]
            if len(request) < length:
                break
            if heard[0] == SLAVE and function in (READ, WRITE) and with_crc(request[:-2]) == request:
                self._heard = rest
                self.requests += 1
                address, count = struct.unpack_from(">HH", request, 2)
                return self._read(address, count) if function == READ else self._written(request, address)
            heard = heard[1:]
        self._heard = heard
        return b""

    def _read(self, address: int, count: int) -> bytes:
        registers = self._registers()
        values = [registers.get(register) for register in range(address, address + count)]
        if any(value is None for value in values):
            return with_crc(bytes([SLAVE, READ | 0x80, 2]))  # illegal data address
        return with_crc(struct.pack(f">BBB{count}H", SLAVE, READ, 2 * count, *values))

    def _written(self, request: bytes, address: int) -> bytes:
        if (address, request[7:9]) == (410, b"\x02\x00"):
            self.is_streaming = True
            self._began, self._started_at = time.monotonic(), self.sent
        return with_crc(request[:6])

    def _registers(self) -> dict[int, int]:
        now = int((time.monotonic() - self._powered_at) * STREAM_RATE)
        counts = self._counts(now)
        identity = {500: 0x4654, 501: 0x5301, 502: 0x0203, 510: 0x4654, 511: 0x5300, 512: 1234, 513: 0, 514: 2020}
        return identity | {180 + axis: count & 0xFFFF for axis, count in enumerate(counts)}

    def _counts(self, number: int) -> list[int]:
        wrench = self._source.samples(number, 1)[0] * np.repeat([100.0, 1000.0], 3)
        return [int(count) for count in np.clip(np.rint(wrench), -32768, 32767)]

    def _stream(self, master: int) -> None:
        if not self.is_streaming:
            return
        due = self._started_at + int((time.monotonic() - self._began) * STREAM_RATE)
        while self.sent < due:
            message = with_crc(b"\x20\x4e" + struct.pack("<6h", *self._counts(self.sent)))
            self.sent += 1
            if not self.silent:
                self._write(master, message)

    def _write(self, master: int, message: bytes) -> None:
        if self.fault is not None:
            message = self.fault(message)
        with contextlib.suppress(OSError):  # nobody reads: a serial line loses what it cannot hold
            os.write(master, message)


def main() -> None:
    """Run until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bag", type=Path, help="replay this bag's wrench (default: 10 N downwards)")
    options = parser.parse_args()
    source = WrenchSource.from_bag(options.bag, STREAM_RATE) if options.bag else WrenchSource([0, 0, -10, 0, 0, 0])
    with FakeRobotiqSensor(source) as sensor:
        print(f"Robotiq FT 300 at {sensor.port}", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


if __name__ == "__main__":
    main()
