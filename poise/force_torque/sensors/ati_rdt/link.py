"""An ATI device on the network: RDT over UDP, with the calibration from its web page or from parameters."""

import contextlib
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, SensorError
from poise.force_torque.sensors.ati_rdt import protocol as rdt
from poise.force_torque.sensors.ati_rdt.page import RdtSettings, fetch_settings
from poise.force_torque.wire import Calibration, Reports, SensorSamples, no_samples
from poise.types import Array

_DEFAULT_RATE = 7000.0
"""Records a second of a device whose page does not say."""
_RECEIVE_BUFFER = 4 << 20
"""Bytes asked of the kernel, so that a driver that is held up for a while loses nothing (it grants less)."""
_MAX_DATAGRAMS = 8192
"""At most this many in one read."""
_DATAGRAM = 4096
"""Bytes; the longest that a device sends is 40 records of 36."""


@dataclass(frozen=True)
class RdtOptions:
    """Which device, and what to take from the user instead of from its page.

    Attributes:
        host: address or name.
        port: UDP port of RDT.
        http_port: TCP port of its web page; 0: do not ask it (a calibration is needed then).
        calibration: instead of the page's, which is then not asked for.
        reports: whose force the device reports, for the page's calibration.
        limit: (6,) rated loads, N and N m, that replace the page's where they are finite.
        rate: records per second; 0: as the page says.
        family: meaning of the status bits; None: as the page says.
        buffered: several records a datagram.
        gather: s to wait after the first datagram of a read for more; fewer wake-ups at 7 kHz.
    """

    host: str
    port: int = rdt.PORT
    http_port: int = 80
    calibration: Calibration | None = None
    reports: Reports = Reports.LOAD_ON_SENSOR
    limit: Array = field(default_factory=lambda: np.full(6, np.inf))
    rate: float = 0.0
    family: rdt.RdtFamily | None = None
    buffered: bool = False
    gather: float = 0.0


class RdtLink:
    """Link to an ATI Axia or a Net F/T box.

    Args:
        options: which device.
        fetch: asks for the device's page.
    """

    def __init__(self, options: RdtOptions, fetch: Callable[[str, int], RdtSettings] = fetch_settings) -> None:
        self._options = options
        self._fetch = fetch
        self._command = rdt.RdtCommand.START_BUFFERED if options.buffered else rdt.RdtCommand.START_REALTIME
        self._calibration = options.calibration
        self._family = options.family or rdt.RdtFamily.NET_FT
        self._rate = options.rate or _DEFAULT_RATE
        self._product = ""
        self._socket: socket.socket | None = None

    @property
    def name(self) -> str:
        product = f" ({self._product})" if self._product else ""
        return f"rdt {self._options.host}:{self._options.port}{product}"

    @property
    def rate(self) -> float:
        return self._rate

    def describe(self, status: int) -> str:
        return self._family.describe(status)

    def start(self) -> None:
        if self._calibration is None:
            self._calibration = self._ask_page()
        if self._socket is None:
            self._socket = self._open()
        self._send(self._command)

    def bias(self) -> None:
        self._send(rdt.RdtCommand.BIAS)
        self._send(self._command)  # a command ends the one before it, the stream too

    def read(self, timeout: float) -> SensorSamples:
        if self._socket is None:
            raise OSError("the link is not started")
        poll = select.poll()
        poll.register(self._socket, select.POLLIN)
        if not poll.poll(max(0.0, timeout) * 1000.0):
            return no_samples(time.time_ns())
        if self._options.gather:
            time.sleep(self._options.gather)
        datagrams, rejected = self._drain(self._socket)
        arrival = time.time_ns()
        if not datagrams:
            return no_samples(arrival, rejected)
        return self._samples(rdt.parse_records(datagrams), arrival, rejected)

    def close(self) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.send(rdt.request(rdt.RdtCommand.STOP))
            self._socket.close()
            self._socket = None

    def _ask_page(self) -> Calibration:
        options = self._options
        if not options.http_port:
            raise SensorError(ErrorCode.SENSOR_PROTOCOL, "no counts per unit: give them, or the port of the web page")
        settings = self._fetch(options.host, options.http_port)
        self._product = " ".join(part for part in (settings.product, settings.serial_number) if part)
        self._family = options.family or settings.family
        self._rate = options.rate or settings.rate or _DEFAULT_RATE
        return settings.calibration(options.reports).with_limit(options.limit)

    def _open(self) -> socket.socket:
        connection = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            connection.connect((self._options.host, self._options.port))  # only this device is heard
            connection.setblocking(False)
        except OSError as error:
            connection.close()
            raise self._unreachable(str(error)) from error
        return connection

    def _send(self, command: rdt.RdtCommand) -> None:
        if self._socket is None:
            raise OSError("the link is not started")
        try:
            self._socket.send(rdt.request(command))
        except ConnectionRefusedError:  # the answer to an earlier request, reported late
            self._socket.send(rdt.request(command))

    def _drain(self, connection: socket.socket) -> tuple[bytes, int]:
        """Take every datagram that is there: the valid ones joined, and how many were not valid."""
        datagrams, rejected = [], 0
        for _ in range(_MAX_DATAGRAMS):
            try:
                datagram = connection.recv(_DATAGRAM)
            except BlockingIOError:
                break
            except ConnectionRefusedError as error:
                raise self._unreachable("nothing listens there") from error
            if datagram and len(datagram) % rdt.RECORD.itemsize == 0:
                datagrams.append(datagram)
            else:
                rejected += 1
        return b"".join(datagrams), rejected

    def _samples(self, records: NDArray[np.void], arrival: int, rejected: int) -> SensorSamples:
        if self._calibration is None:
            raise OSError("the link is not started")
        status = records["status"].astype(np.uint32)
        wrench = self._calibration.wrench(records["counts"])
        return SensorSamples(
            sequence=records["rdt_sequence"].astype(np.uint32),
            wrench_in_sensor=wrench,
            status=status,
            saturated=self._calibration.saturated(wrench) | (np.bitwise_and(status, self._family.saturation) != 0),
            faulty=rdt.is_fault(status),
            arrival=arrival,
            measured=int(records["ft_sequence"][-1]),
            rejected=rejected,
        )

    def _unreachable(self, why: str) -> SensorError:
        place = f"{self._options.host}:{self._options.port}"
        return SensorError(ErrorCode.SENSOR_UNREACHABLE, f"{place}: {why}; check address, port, cable and power")
