"""The device's web page: read when it is one, refused in time and size when it is not."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poise.errors import ErrorCode, SensorError
from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor
from poise.force_torque.sensors.ati_rdt.page import fetch_settings, parse_settings
from poise.force_torque.sensors.ati_rdt.protocol import RdtFamily
from poise.force_torque.wire import Reports, WrenchSource

PAGE = b"""<?xml version="1.0" encoding="ISO-8859-1"?>
<netft><runstat>0x00000000</runstat><runft>-8;47;1;0;0;0</runft><cfgcalsn>FT07209</cfgcalsn>
<cfgfu>0</cfgfu><scfgfu>Lbf</scfgfu><cfgtu>0</cfgtu><scfgtu>Lbf-in</scfgtu><cfgcpf>1000</cfgcpf><cfgcpt>500</cfgcpt>
<cfgmr>32;32;100;100;100;100</cfgmr><comrdtrate>7000</comrdtrate><prodname>Net F/T</prodname></netft>"""


def without(name: bytes) -> bytes:
    start, end = PAGE.index(b"<" + name + b">"), PAGE.index(b"</" + name + b">")
    return PAGE[:start] + PAGE[end + len(name) + 3 :]


@contextmanager
def server(answer: Callable[[socket.socket], None]) -> Iterator[int]:
    """A TCP server on loopback that answers one connection."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = listener.accept()
        with connection:
            connection.recv(4096)
            with suppress(OSError):  # the other side had enough
                answer(connection)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield listener.getsockname()[1]
    thread.join()
    listener.close()


def test_a_page_gives_units_counts_ratings_and_rate() -> None:
    settings = parse_settings(PAGE)
    assert settings.family is RdtFamily.NET_FT
    assert (settings.serial_number, settings.rate) == ("FT07209", 7000.0)
    calibration = settings.calibration(Reports.LOAD_ON_SENSOR)
    wrench = calibration.wrench([[1000, 0, 0, 500, 0, 0]])
    np.testing.assert_allclose(wrench, [[4.4482216152605, 0, 0, 0.1129848290276167, 0, 0]])
    np.testing.assert_allclose(calibration.limit[2], 100 * 4.4482216152605)


@pytest.mark.parametrize("name", [b"cfgmr", b"comrdtrate", b"cfgcalsn", b"prodname"])
def test_a_page_may_lack_what_is_not_needed(name: bytes) -> None:
    parse_settings(without(name))


@pytest.mark.parametrize("name", [b"cfgcpf", b"cfgcpt", b"scfgfu", b"scfgtu"])
def test_a_page_without_what_is_needed_is_refused_by_name(name: bytes) -> None:
    with pytest.raises(SensorError, match=name.decode()) as caught:
        parse_settings(without(name))
    assert caught.value.code == ErrorCode.SENSOR_PROTOCOL


@pytest.mark.parametrize(
    "declaration",
    [
        b'<!DOCTYPE netft [<!ENTITY a "1000000"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
        b'<!DOCTYPE netft [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
        b'<!DOCTYPE netft SYSTEM "http://127.0.0.1/netft.dtd">',
    ],
)
def test_a_page_that_declares_anything_is_refused(declaration: bytes) -> None:
    with pytest.raises(SensorError, match="document type"):
        parse_settings(declaration + PAGE.split(b"?>")[1])


@given(st.binary(max_size=300))
def test_a_page_of_any_bytes_is_refused_and_no_other_error_comes_out(page: bytes) -> None:
    with pytest.raises(SensorError):
        parse_settings(page)


@given(st.integers(0, len(PAGE) - 1))
def test_a_page_that_was_cut_off_is_refused(length: int) -> None:
    with pytest.raises(SensorError):
        parse_settings(PAGE[:length])


def test_the_fake_sensors_page_is_fetched() -> None:
    with FakeRdtSensor(WrenchSource(np.zeros(6)), rate=2000.0) as sensor:
        settings = fetch_settings("127.0.0.1", sensor.http_port)
    assert settings.rate == 2000.0
    assert settings.family is RdtFamily.AXIA


def test_nothing_listening_is_said_to_be_unreachable() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(SensorError, match="check address") as caught:
        fetch_settings("127.0.0.1", port)
    assert caught.value.code == ErrorCode.SENSOR_UNREACHABLE


def test_an_answer_without_end_is_cut_off() -> None:
    def flood(connection: socket.socket) -> None:
        while True:
            connection.sendall(b"HTTP/1.0 200 OK\r\n\r\n" + b"x" * 65536)

    with server(flood) as port, pytest.raises(SensorError, match="more than"):
        fetch_settings("127.0.0.1", port)


def test_an_answer_that_drips_is_cut_off() -> None:
    hung_up = threading.Event()

    def drip(connection: socket.socket) -> None:
        try:
            while not hung_up.wait(0.02):
                connection.sendall(b"H")
        except OSError:
            hung_up.set()

    with server(drip) as port:
        with pytest.raises(SensorError) as caught:
            fetch_settings("127.0.0.1", port, timeout=0.2)
        assert caught.value.code == ErrorCode.SENSOR_UNREACHABLE
    assert hung_up.is_set()


@pytest.mark.parametrize("answer", [b"HTTP/1.0 404 Not Found\r\n\r\n", b"SSH-2.0-OpenSSH_9.2\r\n", b""])
def test_another_server_is_told_from_a_sensor(answer: bytes) -> None:
    with server(lambda connection: connection.sendall(answer)) as port, pytest.raises(SensorError) as caught:
        fetch_settings("127.0.0.1", port)
    assert caught.value.code == ErrorCode.SENSOR_PROTOCOL
