"""Bota Systems' serial protocol: frames, status words, losses and commands."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from poise.errors import ErrorCode, SensorError
from poise.force_torque.sensors.bota_serial import BotaSerialLink, FakeBotaSensor, _crc_x25, _frame_parser
from poise.force_torque.wire import Calibration, SensorSamples, WrenchSource

WRENCH = np.array([1.0, -2.0, 30.0, 0.4, -0.5, 0.6])
DEADLINE = 20.0


def link_to(sensor: FakeBotaSensor, sinc_length: int = 64) -> BotaSerialLink:
    link = BotaSerialLink(sensor.port, Calibration(1.0, 1.0), sinc_length)
    link.start()
    return link


def read_until(link: BotaSerialLink, enough: Callable[[list[SensorSamples]], Any]) -> list[SensorSamples]:
    reads: list[SensorSamples] = []
    end = time.monotonic() + DEADLINE
    while not enough(reads):
        assert time.monotonic() < end, "the samples did not come"
        reads.append(link.read(0.1))
    return reads


def count(reads: list[SensorSamples]) -> int:
    return sum(map(len, reads))


def test_the_crc_is_that_of_the_catalogue() -> None:
    assert _crc_x25(b"123456789") == 0x906E  # CRC-16/IBM-SDLC, alias X.25, in the catalogue of CRC algorithms


def test_a_frame_has_the_bytes_of_the_manufacturers_example() -> None:
    frame = FakeBotaSensor(WrenchSource(WRENCH)).message(0)
    assert len(frame) == 37
    assert frame[:1] == b"\xaa"
    np.testing.assert_allclose(np.frombuffer(frame[3:27], dtype="<f4"), WRENCH, rtol=1e-6)
    assert _frame_parser().feed(frame) == [(0, frame)]


@pytest.mark.parametrize(("sinc_length", "rate"), [(64, 800.0), (512, 100.0)])
def test_the_filter_sets_the_rate(sinc_length: int, rate: float) -> None:
    with FakeBotaSensor(WrenchSource(WRENCH)) as sensor:
        link = link_to(sensor, sinc_length)
        assert link.rate == rate
        assert sensor._rate == rate
        read_until(link, lambda reads: count(reads) > 5)
        link.close()


@pytest.mark.parametrize(
    ("status", "text", "saturated", "faulty"),
    [
        (0b0001, "processing took too long", False, False),
        (0b0010, "force or torque out of range", True, False),
        (0b0100, "invalid measurement", False, True),
        (0b1010, "force or torque out of range, raw measurement: the calibration is off", True, True),
    ],
)
def test_status_bits_say_what_is_wrong(status: int, text: str, saturated: bool, faulty: bool) -> None:
    with FakeBotaSensor(WrenchSource(WRENCH)) as sensor:
        sensor.status = status
        link = link_to(sensor)
        samples = read_until(link, count)[-1]
        link.close()
    assert link.describe(int(samples.status[-1])) == text
    assert samples.saturated.all() == saturated
    assert samples.faulty.all() == faulty


def test_a_nan_from_the_device_is_a_faulty_sample() -> None:
    with FakeBotaSensor(WrenchSource([np.nan, 0, 0, 0, 0, 0])) as sensor:
        link = link_to(sensor)
        assert read_until(link, count)[-1].faulty.all()
        link.close()


def test_lost_frames_show_as_a_gap_and_damaged_ones_are_counted() -> None:
    rng = np.random.default_rng(1)

    def noisy(message: bytes) -> bytes:
        kind = rng.integers(4)
        if kind == 0:
            return b""
        if kind == 1:
            return message[:20] + bytes([message[20] ^ 1]) + message[21:]
        return rng.bytes(int(rng.integers(5))) + message

    numbers = WrenchSource(np.outer(np.arange(100_000), [0.01, 0, 0, 0, 0, 0]))
    with FakeBotaSensor(numbers) as sensor:
        link = link_to(sensor)
        first = read_until(link, count)
        sensor.fault = noisy
        reads = first + read_until(link, lambda reads: count(reads) > 200)
        link.close()
    measured = np.rint(np.concatenate([samples.wrench_in_sensor[:, 0] for samples in reads]) * 100).astype(int)
    sequence = np.concatenate([samples.sequence for samples in reads]).astype(int)
    np.testing.assert_array_equal(np.diff(sequence), np.diff(measured))
    assert sum(samples.rejected for samples in reads) > 10


def test_a_device_that_repeats_one_measurement_shows_it() -> None:
    with FakeBotaSensor(WrenchSource(WRENCH)) as sensor:
        sensor.stalled = True
        link = link_to(sensor)
        reads = read_until(link, lambda reads: count(reads) > 5)
        link.close()
    assert {samples.measured for samples in reads if len(samples)} == {0}


def test_a_port_without_a_bota_sensor_is_unreachable() -> None:
    with FakeBotaSensor(WrenchSource(WRENCH)) as sensor:
        sensor.silent = True
        link = BotaSerialLink(sensor.port, Calibration(1.0, 1.0), 64)
        with pytest.raises(SensorError, match="no answer to the command 'C'") as caught:
            link.start()
        assert caught.value.code == ErrorCode.SENSOR_UNREACHABLE
        link.close()
