"""What an RDT device says about itself on its web page: units, counts per unit, ratings, output rate.

Source: ATI 9620-05-C-Ethernet Axia-02, section 11, netftapi2.xml; the Net Box serves the same page.
The page is untrusted input: capped in size and time, no document type, no entities.
"""

import http.client
import io
import math
import socket
import time
from dataclasses import dataclass
from xml.parsers import expat

from poise.errors import ErrorCode, SensorError
from poise.force_torque.sensors.ati_rdt.protocol import RdtFamily
from poise.force_torque.wire import Calibration, Reports

_PAGE = "/netftapi2.xml"
_MAX_BYTES = 256 * 1024
"""The page has about 5 kB."""
_MAX_FIELD = 256


@dataclass(frozen=True)
class RdtSettings:
    """The active configuration of a device.

    Attributes:
        product: name of the product.
        serial_number: of the calibration in use; empty where the page has none.
        counts_per_force, counts_per_torque: counts per unit.
        force_unit, torque_unit: as the device spells them.
        limit: six rated loads in those units, or None where the page has none.
        rate: RDT records per second, or None where the page has none.
    """

    product: str
    serial_number: str
    counts_per_force: float
    counts_per_torque: float
    force_unit: str
    torque_unit: str
    limit: tuple[float, ...] | None
    rate: float | None

    @property
    def family(self) -> RdtFamily:
        return RdtFamily.of_product(self.product)

    def calibration(self, reports: Reports) -> Calibration:
        """From counts to N and N m in the contract's sign."""
        return Calibration.from_counts(
            self.counts_per_force, self.counts_per_torque, self.force_unit, self.torque_unit, self.limit, reports
        )


def parse_settings(page: bytes) -> RdtSettings:
    """Read the page's XML.

    Raises:
        SensorError: SENSOR_PROTOCOL, when it is not XML, declares a document type or entities, or lacks a field.
    """
    fields = _text_of_elements(page)

    def number(name: str) -> float:
        try:
            return float(fields[name])
        except (KeyError, ValueError):
            raise SensorError(
                ErrorCode.SENSOR_PROTOCOL, f"the sensor's page has no number <{name}>; give the counts as parameters"
            ) from None

    def text(name: str) -> str:
        if not fields.get(name):
            raise SensorError(ErrorCode.SENSOR_PROTOCOL, f"the sensor's page has no <{name}>; give it as parameter")
        return fields[name]

    return RdtSettings(
        product=fields.get("prodname", ""),
        serial_number=fields.get("cfgcalsn", ""),
        counts_per_force=number("cfgcpf"),
        counts_per_torque=number("cfgcpt"),
        force_unit=text("scfgfu"),
        torque_unit=text("scfgtu"),
        limit=_ratings(fields.get("cfgmr", "")),
        rate=_rate(fields.get("comrdtrate", "")),
    )


def fetch_settings(host: str, port: int = 80, timeout: float = 1.0) -> RdtSettings:
    """Ask a device for its page.

    Args:
        host: address or name.
        port: of its web server.
        timeout: s, in total.

    Raises:
        SensorError: SENSOR_UNREACHABLE, when nothing answers in time; SENSOR_PROTOCOL, for an invalid answer.
    """
    deadline = time.monotonic() + timeout
    question = f"GET {_PAGE} HTTP/1.0\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode("ascii", "replace")
    try:
        with socket.create_connection((host, port), timeout) as connection:
            connection.sendall(question)
            answer = _receive_all(connection, deadline)
    except OSError as error:
        raise SensorError(
            ErrorCode.SENSOR_UNREACHABLE,
            f"no page from http://{host}:{port}{_PAGE} ({error}); check address, cable and power",
        ) from error
    response = http.client.HTTPResponse(_Received(answer))  # type: ignore[arg-type]  # reads from makefile() only
    try:
        response.begin()
        page = response.read()
    except (http.client.HTTPException, OSError, ValueError) as error:
        raise SensorError(ErrorCode.SENSOR_PROTOCOL, f"{host}:{port} does not speak HTTP ({error})") from error
    if response.status != http.client.OK:
        raise SensorError(ErrorCode.SENSOR_PROTOCOL, f"{host}:{port} answers {response.status} for {_PAGE}")
    return parse_settings(page)


def _receive_all(connection: socket.socket, deadline: float) -> bytes:
    """Read until the other side closes; a slow or long answer is cut off."""
    answer = bytearray()
    while True:
        remaining = deadline - time.monotonic()
        if remaining <= 0:
            raise TimeoutError("too slow")
        connection.settimeout(remaining)
        chunk = connection.recv(65536)
        if not chunk:
            return bytes(answer)
        answer += chunk
        if len(answer) > _MAX_BYTES:
            raise SensorError(ErrorCode.SENSOR_PROTOCOL, f"the sensor's page has more than {_MAX_BYTES} bytes")


class _Received:
    """A finished answer, in the shape in which http.client takes sockets."""

    def __init__(self, answer: bytes) -> None:
        self._answer = answer

    def makefile(self, mode: str) -> io.BytesIO:
        return io.BytesIO(self._answer)


def _text_of_elements(page: bytes) -> dict[str, str]:
    """The text of every leaf element by name; the first of a name counts."""
    fields: dict[str, str] = {}
    text: list[str] = []

    def refuse(*_: object) -> None:
        raise SensorError(ErrorCode.SENSOR_PROTOCOL, "the sensor's page declares a document type: not an ATI page")

    def start(name: str, attributes: object) -> None:
        text.clear()

    def end(name: str) -> None:
        fields.setdefault(name, "".join(text).strip()[:_MAX_FIELD])
        text.clear()

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse  # without one there are no entities to expand
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text.append
    try:
        parser.Parse(page, True)
    except expat.ExpatError as error:
        raise SensorError(ErrorCode.SENSOR_PROTOCOL, f"the sensor's page is not XML ({error})") from error
    return fields


def _ratings(text: str) -> tuple[float, ...] | None:
    """Six positive numbers, separated by semicolon, comma or space (section 11); anything else counts as absent."""
    try:
        numbers = tuple(float(part) for part in text.replace(";", " ").replace(",", " ").split())
    except ValueError:
        return None
    return numbers if len(numbers) == 6 and all(math.isfinite(x) and x > 0 for x in numbers) else None


def _rate(text: str) -> float | None:
    try:
        rate = float(text)
    except ValueError:
        return None
    return rate if math.isfinite(rate) and rate > 0 else None
