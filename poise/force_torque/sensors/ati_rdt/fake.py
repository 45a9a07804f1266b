"""An ATI sensor in software: RDT over loopback UDP and the web page, with faults on purpose."""

import contextlib
import itertools
import socket
import struct
import threading
import time
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

import numpy as np

from poise.force_torque.wire import WrenchSource

Fault = Callable[[list[bytes]], list[bytes]]
"""Takes the datagrams that are due, returns those that reach the driver."""

# Encoded apart from the driver's own module, so that one checks the other.
_REQUEST = struct.Struct("!HHI")
_RECORD = np.dtype(">u4,>u4,>u4,6>i4")
_STOP, _START_REALTIME, _START_BUFFERED, _BIAS = 0x0, 0x2, 0x3, 0x42
_BURST = 64
"""Most datagrams a millisecond: after a delay the fake catches up without flooding the reader's socket."""

_PAGE = """<?xml version="1.0" encoding="ISO-8859-1"?>
<netft><runstat>0x00000000</runstat><runft>0;0;0;0;0;0</runft><cfgcalsn>{serial_number}</cfgcalsn>
<cfgfu>2</cfgfu><scfgfu>{force_unit}</scfgfu><cfgtu>3</cfgtu><scfgtu>{torque_unit}</scfgtu>
<cfgcpf>{counts_per_force}</cfgcpf><cfgcpt>{counts_per_torque}</cfgcpt><cfgmr>{ratings}</cfgmr>
<comrdte>Enabled</comrdte><comrdtrate>{rate}</comrdtrate><prodname>{product}</prodname></netft>
"""


class FakeRdtSensor:
    """A device on loopback while its context lasts.

    Pacing is by an absolute schedule: no drift, and the fake catches up after a delay.

    Args:
        source: what it feels; numbers in the units it reports (N and N m here).
        rate: records per second.
        buffer_size: records a datagram in buffered mode.
        port, http_port: 0 takes free ones.
        sign: +1 reports the load on the sensor, -1 the sensor on the load.
        product: its name on the page; "Axia" in it makes it one.
        drop: probability that a datagram is lost.

    Attributes:
        sent: records of the present stream so far, those that a fault took included.
        status: status word of the records to come.
        silent: sends and receives nothing, while its time advances: the cable is unplugged.
        stalled: repeats one measurement.
        deaf_to_bias: ignores the bias command.
        length: records after which it falls silent for good; None: never.
        fault: what happens to datagrams on the way; None: nothing.
        first_sequence: RDT sequence number that a stream begins with.
        page: what the web server serves.
        starts, biases: requests received.
    """

    COUNTS = 1_000_000
    """Per N and per N m."""
    RATINGS = (500.0, 500.0, 900.0, 20.0, 20.0, 20.0)

    def __init__(
        self,
        source: WrenchSource,
        rate: float = 1000.0,
        buffer_size: int = 10,
        port: int = 0,
        http_port: int = 0,
        sign: int = 1,
        product: str = "Axia80 (fake)",
        drop: float = 0.0,
    ) -> None:
        self._source = source
        self._rate = rate
        self._buffer_size = buffer_size
        self._scale = sign * self.COUNTS
        self._bias = np.zeros(6)
        self._client: tuple[str, int] | None = None
        self._group = 1
        self._began = 0.0
        self._origin = 0
        self._powered_at = time.monotonic()
        self.sent = 0
        self.status = 0
        self.silent = False
        self.stalled = False
        self.deaf_to_bias = False
        self.length: int | None = None
        self.fault: Fault | None = dropping(drop, np.random.default_rng(0)) if drop else None
        self.first_sequence = 1
        self.starts = 0
        self.biases = 0
        self.page = _PAGE.format(
            serial_number="FT00000",
            force_unit="N",
            torque_unit="Nm",
            counts_per_force=self.COUNTS,
            counts_per_torque=self.COUNTS,
            ratings=";".join(str(rating) for rating in self.RATINGS),
            rate=f"{rate:g}",
            product=product,
        )
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._web = ThreadingHTTPServer(("127.0.0.1", http_port), self._handler())
        self._stopping = threading.Event()
        self._threads = [
            threading.Thread(target=self._run, name="fake rdt", daemon=True),
            threading.Thread(target=self._web.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True),
        ]

    @property
    def port(self) -> int:
        return int(self._socket.getsockname()[1])

    @property
    def http_port(self) -> int:
        return int(self._web.server_address[1])

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The driver's parameters that reach this device."""
        return {"address": "127.0.0.1", "port": self.port, "http_port": self.http_port}

    @property
    def is_streaming(self) -> bool:
        return self._client is not None

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._web.shutdown()
        for thread in self._threads:
            thread.join()
        self._web.server_close()
        self._socket.close()

    def power_cycle(self) -> None:
        """Forget the client, the bias and the count of measurements."""
        self._client = None
        self._bias = np.zeros(6)
        self._powered_at = time.monotonic()

    def _run(self) -> None:
        while not self._stopping.is_set():
            self._hear()
            self._send_due()

    def _hear(self) -> None:
        """Wait for the next record's time, at the least a millisecond, answering requests meanwhile."""
        self._socket.settimeout(max(0.001, 1.0 / self._rate if self._rate < 1000 else 0.001))
        try:
            request, client = self._socket.recvfrom(1024)
        except (TimeoutError, ConnectionRefusedError):
            return
        if self.silent or self.sent == self.length or len(request) != _REQUEST.size:
            return
        header, command, _ = _REQUEST.unpack(request)
        if header != 0x1234:
            return
        if command == _BIAS:
            self.biases += 1
            if not self.deaf_to_bias:
                self._bias = self._source.samples(self._measurement(), 1)[0]
        # Any command takes precedence over the one before it, so a bias ends a stream.
        self._client = client if command in (_START_REALTIME, _START_BUFFERED) else None
        if self._client:
            self.starts += 1
            self._group = self._buffer_size if command == _START_BUFFERED else 1
            self._began, self._origin, self.sent = time.monotonic(), self._measurement(), 0

    def _measurement(self) -> int:
        """How many measurements the device has made since it was switched on."""
        return int((time.monotonic() - self._powered_at) * self._rate)

    def _send_due(self) -> None:
        client = self._client
        if client is None:
            return
        due = int((time.monotonic() - self._began) * self._rate) - self.sent
        due = min(due - due % self._group, _BURST * self._group)
        if self.length is not None:
            due = min(due, self.length - self.sent)
        if due <= 0:
            return
        records = self._records(self.sent, due)
        self.sent += due
        length = self._group * _RECORD.itemsize
        datagrams = [records[at : at + length] for at in range(0, len(records), length)]
        if self.fault is not None:
            datagrams = self.fault(datagrams)
        if self.silent:
            return
        with contextlib.suppress(ConnectionRefusedError):  # the driver has gone without a word
            for datagram in datagrams:
                self._socket.sendto(datagram, client)

    def _records(self, first: int, count: int) -> bytes:
        records = np.zeros(count, dtype=_RECORD)
        numbers = np.arange(first, first + count)
        records["f0"] = (numbers + self.first_sequence) % (1 << 32)
        records["f1"] = (self._origin + (0 if self.stalled else numbers)) % (1 << 32)
        records["f2"] = self.status
        wrench = self._source.samples(self._origin + first, count) - self._bias
        records["f3"] = np.clip(np.rint(wrench * self._scale), -(1 << 31), (1 << 31) - 1)
        return records.tobytes()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        sensor = self

        class Handler(BaseHTTPRequestHandler):
            """Serves the one page."""

            def do_GET(self) -> None:
                if sensor.silent or self.path != "/netftapi2.xml":
                    self.send_error(404)
                    return
                body = sensor.page.encode("iso-8859-1")
                self.send_response(200)
                self.send_header("Content-Type", "text/xml")
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                pass

        return Handler


def dropping(probability: float, rng: np.random.Generator) -> Fault:
    """Lose datagrams at random."""
    return lambda datagrams: [datagram for datagram in datagrams if rng.random() >= probability]


def duplicating(probability: float, rng: np.random.Generator) -> Fault:
    """Deliver some datagrams twice."""
    return lambda datagrams: list(
        itertools.chain.from_iterable([each] * (2 if rng.random() < probability else 1) for each in datagrams)
    )


def delaying(probability: float, rng: np.random.Generator) -> Fault:
    """Hold some datagrams back until the next are sent: they arrive out of order."""
    held: list[bytes] = []

    def delay(datagrams: list[bytes]) -> list[bytes]:
        late, held[:] = held[:], [datagram for datagram in datagrams if rng.random() < probability]
        return [datagram for datagram in datagrams if datagram not in held] + late

    return delay
