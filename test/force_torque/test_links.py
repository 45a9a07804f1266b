"""The wires, against devices on loopback and on a pseudo-terminal."""

import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymodbus.client import ModbusSerialClient

from poise.errors import ErrorCode, SensorError
from poise.fake_robots.fake_sensor import wrench_source_from_bag
from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor, delaying, dropping, duplicating
from poise.force_torque.sensors.ati_rdt.link import RdtLink, RdtOptions
from poise.force_torque.sensors.ati_rdt.protocol import RdtFamily
from poise.force_torque.sensors.robotiq import protocol as robotiq
from poise.force_torque.sensors.robotiq.fake import FakeRobotiqSensor
from poise.force_torque.sensors.robotiq.link import RobotiqModbusLink, RobotiqStreamLink
from poise.force_torque.sequence import SequenceCounter
from poise.force_torque.wire import Calibration, Link, SensorSamples, WrenchSource
from poise.recording import open_recording
from poise.serial_bus.modbus import ModbusLine

BAG = Path(__file__).parents[2] / "bags" / "kuka_at_rest.mcap"

WRENCH = np.array([1.0, -2.0, 30.0, 0.4, -0.5, 0.6])
ROBOTIQ = Calibration.from_counts(robotiq.COUNTS_PER_NEWTON, robotiq.COUNTS_PER_NEWTON_METRE, limit=robotiq.RANGE)
DEADLINE = 20.0


def options(sensor: FakeRdtSensor, **more: Any) -> RdtOptions:
    return RdtOptions("127.0.0.1", sensor.port, sensor.http_port, **more)


def read_until(link: Link, enough: Callable[[list[SensorSamples]], bool]) -> list[SensorSamples]:
    """Read until there is enough; fail at the deadline."""
    reads: list[SensorSamples] = []
    end = time.monotonic() + DEADLINE
    while not enough(reads):
        assert time.monotonic() < end, "the samples did not come"
        reads.append(link.read(0.1))
    return reads


def count(reads: list[SensorSamples]) -> int:
    return sum(map(len, reads))


@pytest.mark.parametrize("buffered", [False, True])
def test_an_rdt_device_is_read_whole_in_either_mode(buffered: bool) -> None:
    with FakeRdtSensor(WrenchSource(WRENCH), rate=2000.0) as sensor:
        link = RdtLink(options(sensor, buffered=buffered))
        link.start()
        reads = read_until(link, lambda reads: count(reads) > 1000)
        link.close()
    sequence = np.concatenate([samples.sequence for samples in reads])
    np.testing.assert_array_equal(sequence, np.arange(1, len(sequence) + 1))
    np.testing.assert_allclose(reads[-1].wrench_in_sensor, np.tile(WRENCH, (len(reads[-1]), 1)), atol=1e-6)
    assert link.rate == 2000.0
    assert link.name.endswith("(Axia80 (fake) FT00000)")


def test_a_recording_comes_out_of_the_wire_as_it_went_in() -> None:
    recorded = open_recording(BAG).wrench()
    source = wrench_source_from_bag(BAG, rate=5000.0)
    with FakeRdtSensor(source, rate=5000.0) as sensor:
        link = RdtLink(options(sensor))
        link.start()
        reads = read_until(link, lambda reads: count(reads) > 2000)
        link.close()
    read = np.concatenate([samples.wrench_in_sensor for samples in reads])
    first = np.argmin(np.abs(source.samples(0, 5000) - read[0]).sum(axis=1))
    np.testing.assert_allclose(read, source.samples(first, len(read)), atol=0.6e-6)  # half a count
    assert np.all(read.min(axis=0) >= recorded.wrench_in_sensor.min(axis=0) - 1e-6)
    assert np.all(read.max(axis=0) <= recorded.wrench_in_sensor.max(axis=0) + 1e-6)


@pytest.mark.parametrize("fault", [dropping, duplicating, delaying])
def test_what_the_network_does_is_accounted_for(fault: Callable[..., Any]) -> None:
    with FakeRdtSensor(WrenchSource(WRENCH), rate=2000.0) as sensor:
        sensor.first_sequence = 2**32 - 500  # round the wrap
        link = RdtLink(options(sensor))
        link.start()
        counter = SequenceCounter()
        counter.account(read_until(link, count)[-1].sequence)
        sensor.fault = fault(0.1, np.random.default_rng(1))
        reads: list[SensorSamples] = []
        while count(reads) <= 1500 or (counter.lost and fault is not dropping and len(reads) < 10_000):
            reads += read_until(link, count)  # what was held back still comes
            counter.account(reads[-1].sequence)
        link.close()
    # The last read may hold late samples alone: the newest is among all of them.
    numbers = np.concatenate([read.sequence for read in reads]).astype(np.int64)
    assert counter.received + counter.lost == int(((numbers + 500) % 2**32).max()) + 1
    assert counter.restarts == 0
    assert (counter.lost > 0) == (fault is dropping)
    assert (counter.duplicates > 0) == (fault is duplicating)
    assert (counter.out_of_order > 0) == (fault is delaying)


def test_counts_from_the_user_leave_the_page_alone() -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        sensor.page = "no page"
        with pytest.raises(SensorError, match="not XML"):
            RdtLink(options(sensor)).start()
        link = RdtLink(options(sensor, calibration=Calibration.from_counts(1e6, 1e6)))
        link.start()
        reads = read_until(link, count)
        link.close()
    np.testing.assert_allclose(reads[-1].wrench_in_sensor[-1], WRENCH, atol=1e-6)


@pytest.mark.parametrize(
    ("family", "status", "saturated"),
    [
        (RdtFamily.AXIA, 0xC0000000, True),
        (RdtFamily.AXIA, 0x80020000, False),
        (RdtFamily.NET_FT, 0x80020000, True),
        (RdtFamily.NET_FT, 0xC0000000, False),
    ],
)
def test_saturation_is_read_from_the_bits_of_the_family(family: RdtFamily, status: int, saturated: bool) -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        sensor.status = status
        link = RdtLink(options(sensor, family=family))
        link.start()
        samples = read_until(link, count)[-1]
        link.close()
    assert samples.saturated.all() == saturated
    assert samples.faulty.all()


def test_a_load_at_the_rating_is_saturated_whatever_the_bits_say() -> None:
    at_rating = [FakeRdtSensor.RATINGS[0], 0, 0, 0, 0, 0]
    with FakeRdtSensor(WrenchSource([at_rating, np.zeros(6)])) as sensor:
        link = RdtLink(options(sensor))
        link.start()
        reads = read_until(link, lambda reads: count(reads) > 10)
        link.close()
    saturated = np.concatenate([samples.saturated for samples in reads])
    load = np.concatenate([samples.wrench_in_sensor[:, 0] for samples in reads])
    np.testing.assert_array_equal(saturated, load > 1)


def test_datagrams_that_are_no_records_are_counted_and_passed_over() -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        sensor.fault = lambda datagrams: [part for datagram in datagrams for part in (datagram, b"", datagram[:35])]
        link = RdtLink(options(sensor))
        link.start()
        reads = read_until(link, lambda reads: count(reads) > 50)
        link.close()
    sequence = np.concatenate([samples.sequence for samples in reads])
    np.testing.assert_array_equal(np.diff(sequence), 1)
    assert sum(samples.rejected for samples in reads) >= 2 * len(sequence) - 2


def test_another_sender_is_not_heard() -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        link = RdtLink(options(sensor))
        link.start()
        read_until(link, count)
        for _ in range(20):
            other.sendto(bytes(36), link._socket.getsockname())  # type: ignore[union-attr]
        reads = read_until(link, lambda reads: count(reads) > 100)
        link.close()
    assert all(np.allclose(samples.wrench_in_sensor, WRENCH, atol=1e-6) for samples in reads)


def test_a_device_that_is_not_there_is_unreachable_and_can_come_later() -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        where = options(sensor, calibration=Calibration.from_counts(1e6, 1e6))
    link = RdtLink(where)
    link.start()
    with pytest.raises(SensorError, match="nothing listens there") as caught:
        read_until(link, lambda reads: False)
    assert caught.value.code == ErrorCode.SENSOR_UNREACHABLE
    with FakeRdtSensor(WrenchSource(WRENCH), port=where.port):
        link.start()
        read_until(link, count)
    link.close()


def test_a_bias_zeroes_the_device_and_the_stream_goes_on() -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        link = RdtLink(options(sensor))
        link.start()
        read_until(link, count)
        link.bias()
        reads = read_until(link, lambda reads: count(reads) > 0 and np.allclose(reads[-1].wrench_in_sensor[-1], 0))
        link.close()
        assert sensor.biases == 1
    assert count(reads) > 0


def test_a_closed_link_has_silenced_its_device() -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        link = RdtLink(options(sensor))
        link.start()
        read_until(link, count)
        link.close()
        end = time.monotonic() + DEADLINE
        while sensor.is_streaming:
            assert time.monotonic() < end


def test_a_robotiq_stream_is_read_through_noise_on_the_line() -> None:
    rng = np.random.default_rng(1)

    def noisy(message: bytes) -> bytes:
        kind = rng.integers(4)
        if kind == 0:
            return message + rng.bytes(int(rng.integers(1, 20)))
        if kind == 1:
            return message[: int(rng.integers(1, 16))]
        return message

    with FakeRobotiqSensor(WrenchSource(np.outer(np.arange(200), [0.01, 0, 0, 0, 0, 0]))) as sensor:
        link = RobotiqStreamLink(sensor.port, ROBOTIQ)
        link.start()
        sensor.fault = noisy
        reads = read_until(link, lambda reads: count(reads) > 30)
        link.close()
    read = np.rint(np.concatenate([samples.wrench_in_sensor[:, 0] for samples in reads]) * 100)
    number = np.concatenate([samples.sequence for samples in reads]).astype(int)
    assert np.all(np.diff(read) >= 1)  # in order, nothing twice, nothing that was not sent
    assert np.all(np.diff(number) >= 1)
    assert sum(samples.rejected for samples in reads) > 0


def test_a_robotiq_that_streams_already_is_read() -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        first = RobotiqStreamLink(sensor.port, ROBOTIQ)
        first.start()
        read_until(first, count)
        first._line._port.close()  # type: ignore[union-attr]  # gone without a word
        second = RobotiqStreamLink(sensor.port, ROBOTIQ)
        second.start()
        read_until(second, lambda reads: count(reads) > 5)
        second.close()


def test_a_robotiq_beyond_its_rating_is_saturated() -> None:
    with FakeRobotiqSensor(WrenchSource([0, 0, 0, 0, 0, -30.0])) as sensor:
        link = RobotiqStreamLink(sensor.port, ROBOTIQ)
        link.start()
        assert read_until(link, count)[-1].saturated.all()
        link.close()


def test_a_port_that_another_program_holds_is_refused() -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        holder = RobotiqStreamLink(sensor.port, ROBOTIQ)
        holder.start()
        with pytest.raises(SensorError, match="check the port"):
            RobotiqStreamLink(sensor.port, ROBOTIQ).start()
        holder.close()


def test_a_robotiq_answers_modbus_through_garbage_and_after_streaming() -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        stream = RobotiqStreamLink(sensor.port, ROBOTIQ)
        stream.start()
        read_until(stream, count)
        stream._line._port.close()  # type: ignore[union-attr]  # left streaming
        link = RobotiqModbusLink(sensor.port, ROBOTIQ)
        for _ in range(5):
            try:
                link.start()
                break
            except SensorError:
                continue
        assert link.identity is not None
        assert link.identity.serial_number == "FTS-1234"
        answers = iter([b"\x00\xff\x09", b"", b"\x09\x03\x0c" + bytes(14)])
        sensor.fault = lambda message: next(answers, message)
        reads = read_until(link, lambda reads: count(reads) >= 3)
        link.close()
    assert sum(samples.rejected for samples in reads) == 3
    np.testing.assert_allclose(reads[-1].wrench_in_sensor, WRENCH[None], atol=0.005)
    number = np.concatenate([samples.sequence for samples in reads])
    assert number.tolist() == [3, 4, 5]  # three questions were not answered


def test_the_fake_robotiq_speaks_modbus_by_pymodbus_own_client() -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        client = ModbusSerialClient(sensor.port, baudrate=19200, timeout=1.0)
        assert client.connect()
        answer = client.read_holding_registers(180, count=6, device_id=9)
        assert np.array(answer.registers, dtype=np.uint16).view(np.int16).tolist() == [100, -200, 3000, 400, -500, 600]
        assert client.read_holding_registers(600, count=1, device_id=9).isError()
        assert not client.write_registers(410, [0x0200], device_id=9).isError()
        client.close()
        assert sensor.is_streaming


def test_a_slave_that_does_not_answer_is_unreachable() -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        link = RobotiqModbusLink(sensor.port, ROBOTIQ, slave=7)
        with pytest.raises(SensorError, match="slave 7 does not answer") as caught:
            link.start()
        link.close()
    assert caught.value.code == ErrorCode.SENSOR_UNREACHABLE


def test_a_slave_may_miss_the_first_question(monkeypatch: pytest.MonkeyPatch) -> None:
    answer, asked = ModbusLine.read_holding, []

    def late(line: ModbusLine, address: int, count: int) -> list[int]:
        asked.append(address)
        if len(asked) == 1:
            raise SensorError(ErrorCode.SENSOR_UNREACHABLE, "no answer yet")
        return answer(line, address, count)

    monkeypatch.setattr(ModbusLine, "read_holding", late)
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        link = RobotiqModbusLink(sensor.port, ROBOTIQ)
        link.start()
        assert link.identity is not None
        assert asked[0] == asked[1]
        link.close()


@pytest.mark.parametrize("make", [RobotiqStreamLink, RobotiqModbusLink])
def test_a_port_that_vanishes_is_an_os_error(make: Callable[..., Link]) -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        link = make(sensor.port, ROBOTIQ)
        link.start()
        read_until(link, count)
        sensor.unplug()
        with pytest.raises(OSError):
            read_until(link, lambda reads: False)
        link.close()
        with pytest.raises(SensorError, match="check the port"):
            link.start()
        sensor.plug_in()
        link.start()
        read_until(link, count)
        link.close()
