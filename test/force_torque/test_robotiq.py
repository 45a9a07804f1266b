"""Robotiq's bytes: the manual's examples, and streams that begin anywhere and are damaged."""

import random
import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer.rtu import FramerRTU

from poise.errors import ErrorCode, SensorError
from poise.force_torque.sensors.robotiq import protocol as robotiq

COUNTS = st.lists(st.integers(-32768, 32767), min_size=6, max_size=6)


def independent_crc(data: bytes) -> bytes:
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")


def feed_in_pieces(data: bytes, cuts: list[int]) -> tuple[list[int], list[list[int]], robotiq.StreamParser]:
    parser = robotiq.StreamParser()
    numbers: list[int] = []
    counts: list[list[int]] = []
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    for begin, end in pairwise(edges):
        number, count = parser.feed(data[begin:end])
        numbers += number.tolist()
        counts += count.tolist()
    return numbers, counts, parser


@pytest.mark.parametrize("request_with_crc", ["090300b40001c564", "090300b4000684a6"])
def test_the_crc_is_that_of_the_manuals_requests(request_with_crc: str) -> None:
    data = bytes.fromhex(request_with_crc)
    assert robotiq.crc(data[:-2]).to_bytes(2, "little") == data[-2:]


@given(st.binary(max_size=64))
def test_the_crc_is_that_of_pymodbus(data: bytes) -> None:
    assert robotiq.crc(data).to_bytes(2, "little") == independent_crc(data)


def test_the_request_that_starts_the_stream_writes_0x0200_to_register_410() -> None:
    body = bytes.fromhex("09 10 019a 0001 02 0200")
    assert robotiq.write_request(410, 0x0200) == body + independent_crc(body)


def test_a_stream_message_is_sixteen_bytes_with_little_endian_counts() -> None:
    message = robotiq.stream_message([1, -1, 256, -32768, 32767, 0])
    assert message[:14].hex() == "204e" + "0100" + "ffff" + "0001" + "0080" + "ff7f" + "0000"
    assert message[14:] == independent_crc(message[:14])


@given(st.lists(COUNTS, max_size=20), st.lists(st.integers(0, 10_000), max_size=40))
def test_every_message_is_found_however_the_bytes_are_cut(messages: list[list[int]], cuts: list[int]) -> None:
    data = b"".join(map(robotiq.stream_message, messages))
    numbers, counts, parser = feed_in_pieces(data, cuts)
    assert counts == messages
    assert numbers == list(range(len(messages)))
    assert parser.rejected == 0


GARBAGE = st.one_of(
    st.binary(min_size=1, max_size=40),
    st.just(b"\x20"),
    st.just(b"\x20\x4e"),
    COUNTS.map(lambda counts: robotiq.stream_message(counts)[:-1]),  # a message that was cut short
    COUNTS.map(lambda counts: robotiq.stream_message(counts)[:-2] + b"\x00\x00"),
)


def valid_messages(data: bytes) -> list[list[int]]:
    """Every header that a matching CRC follows, leftmost first; by brute force and pymodbus' CRC."""
    found, at = [], 0
    while at + 16 <= len(data):
        message = data[at : at + 16]
        valid = message[:2] == b"\x20\x4e" and independent_crc(message[:14]) == message[14:]
        if valid:
            found.append(list(struct.unpack("<6h", message[2:14])))
        at += 16 if valid else 1
    return found


@given(st.lists(st.one_of(COUNTS, GARBAGE), max_size=20), st.lists(st.integers(0, 10_000), max_size=40))
def test_after_garbage_every_valid_message_is_found_and_no_invalid_one(
    pieces: list[list[int] | bytes], cuts: list[int]
) -> None:
    data = b"".join(piece if isinstance(piece, bytes) else robotiq.stream_message(piece) for piece in pieces)
    numbers, counts, parser = feed_in_pieces(data, cuts)
    assert counts == valid_messages(data)
    assert numbers == sorted(set(numbers))
    assert parser.rejected == (numbers[-1] + 1 - len(numbers) if numbers else 0)  # every gap is a rejected message


def test_a_message_with_any_bit_flipped_is_left_out_and_its_number_with_it() -> None:
    rng = random.Random(1)
    messages = [[rng.randrange(-32768, 32768) for _ in range(6)] for _ in range(5)]
    stream = [robotiq.stream_message(message) for message in messages]
    for bit in range(8 * robotiq.STREAM_LENGTH):
        flipped = bytearray(stream[2])
        flipped[bit // 8] ^= 1 << bit % 8
        parser = robotiq.StreamParser()
        numbers, counts = parser.feed(b"".join([*stream[:2], bytes(flipped), *stream[3:]]))
        assert counts.tolist() == [messages[index] for index in (0, 1, 3, 4)]
        assert numbers.tolist() == [0, 1, 3, 4]
        assert parser.rejected == 1


def test_what_comes_before_the_first_message_is_no_loss() -> None:
    parser = robotiq.StreamParser()
    numbers, _ = parser.feed(bytes.fromhex("0910019a0001") + robotiq.stream_message([0] * 6))
    assert numbers.tolist() == [0]
    assert parser.rejected == 0


@given(st.binary(max_size=4000))
def test_no_bytes_make_the_parser_keep_more_than_a_message(data: bytes) -> None:
    parser = robotiq.StreamParser()
    parser.feed(data)
    assert len(parser._frames._buffer) < robotiq.STREAM_LENGTH


def test_registers_are_signed() -> None:
    counts = robotiq.wrench_counts([1, 0xFFFF, 0x8000, 0x7FFF, 0, 256])
    assert counts.tolist() == [1, -1, -32768, 32767, 0, 256]


def test_the_identity_is_spelled_as_robotiqs_software_spells_it() -> None:
    identity = robotiq.RobotiqIdentity.from_registers([0x4654, 0x5301, 0x0203], [0x4654, 0x5300, 1234, 0], 2020)
    assert (identity.firmware, identity.serial_number, identity.year) == ("FTS-1.2.3", "FTS-1234", 2020)


def test_a_sensor_without_a_serial_number_is_unknown() -> None:
    assert (
        robotiq.RobotiqIdentity.from_registers([0x4654, 0x5301, 0x0203], [0, 0, 0, 0], 2020).serial_number == "unknown"
    )


def test_another_modbus_device_is_no_sensor() -> None:
    with pytest.raises(SensorError) as caught:
        robotiq.RobotiqIdentity.from_registers([0x4743, 0x5301, 0x0203], [0, 0, 0, 0], 2020)
    assert caught.value.code == ErrorCode.SENSOR_PROTOCOL
