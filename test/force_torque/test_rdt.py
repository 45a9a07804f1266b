"""ATI's bytes, against the manual's structures and tables."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poise.errors import ErrorCode, SensorError
from poise.force_torque.sensors.ati_rdt.protocol import RdtCommand, RdtFamily, is_fault, parse_records, request

UINT32 = st.integers(0, 2**32 - 1)
INT32 = st.integers(-(2**31), 2**31 - 1)


@pytest.mark.parametrize(
    ("command", "count", "bytes_on_the_wire"),
    [
        (RdtCommand.START_REALTIME, 0, "1234000200000000"),
        (RdtCommand.START_BUFFERED, 1000, "12340003000003e8"),
        (RdtCommand.BIAS, 0, "1234004200000000"),
        (RdtCommand.STOP, 0, "1234000000000000"),
    ],
)
def test_requests_are_the_manuals_eight_bytes(command: RdtCommand, count: int, bytes_on_the_wire: str) -> None:
    assert request(command, count).hex() == bytes_on_the_wire


@given(st.lists(st.tuples(UINT32, UINT32, UINT32, st.tuples(*[INT32] * 6)), min_size=1, max_size=40))
def test_every_record_of_a_datagram_is_read(records: list[tuple[int, int, int, tuple[int, ...]]]) -> None:
    datagram = b"".join(struct.pack("!3I6i", number, ft, status, *counts) for number, ft, status, counts in records)
    parsed = parse_records(datagram)
    assert parsed["rdt_sequence"].tolist() == [record[0] for record in records]
    assert parsed["ft_sequence"].tolist() == [record[1] for record in records]
    assert parsed["status"].tolist() == [record[2] for record in records]
    assert parsed["counts"].tolist() == [list(record[3]) for record in records]


@given(st.binary(max_size=200).filter(lambda data: len(data) % 36 != 0 or not data))
def test_what_is_not_made_of_records_is_refused(data: bytes) -> None:
    with pytest.raises(SensorError) as caught:
        parse_records(data)
    assert caught.value.code == ErrorCode.SENSOR_PROTOCOL


# Table 4.9 of ATI 9610-05-Ethernet Axia-09: bit patterns as the device sends them.
AXIA = {
    0x80000001: "internal temperature out of range",
    0x80000002: "supply voltage out of range",
    0x80000004: "broken gage",
    0x80000020: "other error",
    0x88000000: "gage out of range",
    0xA0000000: "calibration checksum error",
    0xC0000000: "force or torque out of range",
    0x80000000: "error, not specified",
}


@pytest.mark.parametrize(("status", "text"), AXIA.items())
def test_the_axias_error_patterns_are_faults_in_words(status: int, text: str) -> None:
    assert RdtFamily.AXIA.describe(status) == text
    assert is_fault(np.array([status], dtype=np.uint32)).all()


def test_the_manuals_example_with_two_errors_is_read() -> None:
    assert RdtFamily.AXIA.describe(0x80000005) == "internal temperature out of range, broken gage"


@pytest.mark.parametrize("status", [0, 0x00010000, 0x80010000, 0x00000008])
def test_health_thresholds_and_being_busy_are_no_faults(status: int) -> None:
    assert not is_fault(np.array([status], dtype=np.uint32)).any()


def test_healthy_is_healthy_and_no_bit_is_silent() -> None:
    for family in RdtFamily:
        assert family.describe(0) == "healthy"
        for bit in range(32):
            assert family.describe(1 << bit) not in ("", "healthy")


@pytest.mark.parametrize(
    ("product", "family"),
    [
        ("Axia80-M20", RdtFamily.AXIA),
        ("ATI AXIA130", RdtFamily.AXIA),
        ("Net F/T", RdtFamily.NET_FT),
        ("", RdtFamily.NET_FT),
    ],
)
def test_the_family_is_told_by_the_product(product: str, family: RdtFamily) -> None:
    assert RdtFamily.of_product(product) is family


def test_the_families_saturate_by_different_bits() -> None:
    assert RdtFamily.AXIA.saturation == 0x48000000
    assert RdtFamily.NET_FT.saturation == 0x00020000
    assert "saturation" in RdtFamily.NET_FT.describe(0x80020000)
