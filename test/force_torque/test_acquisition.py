"""The fault contract: what is noticed, what is handed on, what is said, in the order in which it happens."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from poise.errors import ErrorCode, NoAnswerError, SensorError
from poise.force_torque import (
    Acquisition,
    AcquisitionOptions,
    BlockAverages,
    SampleBatch,
    StreamReport,
)
from poise.force_torque.health import FIRST_SAMPLE_GRACE, HOLD, Health, Severity
from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor
from poise.force_torque.sensors.ati_rdt.link import RdtLink, RdtOptions
from poise.force_torque.wire import SensorSamples, WrenchSource

WRENCH = np.array([1.0, -2.0, 30.0, 0.4, -0.5, 0.6])


class Witness:
    """A sink that keeps everything, and waits for what is to come."""

    def __init__(self) -> None:
        self._arrived = threading.Condition()
        self.all_blocks: list[BlockAverages] = []
        self.batches: list[SampleBatch] = []
        self.reports: list[StreamReport] = []
        self.broken = False
        self.free = threading.Event()
        self.free.set()

    def blocks(self, blocks: BlockAverages) -> None:
        self._keep(self.all_blocks, blocks)
        self.free.wait(20.0)
        if self.broken:
            raise RuntimeError("a sink that fails")

    def batch(self, batch: SampleBatch) -> None:
        self._keep(self.batches, batch)

    def report(self, report: StreamReport) -> None:
        self._keep(self.reports, report)

    def _keep(self, where: list[Any], what: Any) -> None:
        with self._arrived:
            where.append(what)
            self._arrived.notify_all()

    @property
    def kinds(self) -> list[str]:
        """Conditions in order, each change once."""
        kinds = [report.condition.kind for report in self.reports]
        return [kind for index, kind in enumerate(kinds) if not index or kinds[index - 1] != kind]

    def wait_for(self, condition: Callable[[], Any]) -> None:
        """Wait until it holds; it is tried after every delivery, and without one every 20 ms."""
        end = time.monotonic() + 20.0
        with self._arrived:
            while not condition():
                assert time.monotonic() < end, self.kinds
                self._arrived.wait(0.02)

    def wait_for_wrench(self, wrench: np.ndarray) -> None:
        """Wait until no sample on its way shows another wrench (6,)."""
        self.wait_for(lambda: np.allclose(self.all_blocks[-1].wrench_in_sensor[-1], wrench, atol=1e-6))


@pytest.fixture
def sensor() -> Iterator[FakeRdtSensor]:
    with FakeRdtSensor(WrenchSource(WRENCH), rate=1000.0) as sensor:
        yield sensor


class Session:
    """An acquisition of a fake sensor, and its witness."""

    def __init__(self, sensor: FakeRdtSensor, **options: Any) -> None:
        self.witness = Witness()
        link = RdtLink(RdtOptions("127.0.0.1", sensor.port, sensor.http_port))
        options = {"publish_rate": 1000.0, **options}
        self.acquisition = Acquisition(link, AcquisitionOptions(**options), self.witness, np.random.default_rng(1))

    def __enter__(self) -> "Session":
        self.acquisition.start()
        return self

    def __exit__(self, *_: object) -> None:
        assert self.acquisition.stop()


def test_silence_is_reported_within_its_time_and_the_return_after_it(sensor: FakeRdtSensor) -> None:
    with Session(sensor, silence=0.05) as session:
        witness = session.witness
        witness.wait_for(lambda: witness.all_blocks)
        sensor.silent = True
        witness.wait_for(lambda: "silent" in witness.kinds)
        silent = next(report for report in witness.reports if report.condition.kind == "silent")
        assert silent.condition.severity is Severity.ERROR
        assert silent.age is not None
        assert silent.age > 0.05  # that it is below 0.1 s is for the benchmark
        before = len(witness.all_blocks)
        sensor.power_cycle()
        sensor.silent = False
        witness.wait_for(lambda: len(witness.all_blocks) > before)
        witness.wait_for(lambda: witness.kinds[-1] == "streaming")
    assert witness.kinds[0] in ("connecting", "streaming")
    order = [kind for kind in witness.kinds if kind in ("streaming", "silent")]
    assert order[:3] == ["streaming", "silent", "streaming"]


def test_a_cable_that_is_out_for_a_moment_costs_exactly_the_samples_of_that_moment(sensor: FakeRdtSensor) -> None:
    with Session(sensor, silence=2.0) as session:
        witness = session.witness
        witness.wait_for(lambda: witness.all_blocks)
        taken: list[int] = []

        def take(datagrams: list[bytes]) -> list[bytes]:
            taken.append(len(datagrams))
            return []

        sensor.fault = take
        witness.wait_for(lambda: sum(taken) > 100)
        sensor.fault = None
        witness.wait_for(lambda: "losing" in witness.kinds)
        report = session.acquisition.report()
    assert report.lost == sum(taken)
    assert report.connects == 1


def test_a_reader_that_was_held_up_loses_nothing_and_does_not_disturb_its_sensor(sensor: FakeRdtSensor) -> None:
    with Session(sensor, silence=0.05) as session:
        witness = session.witness
        witness.wait_for(lambda: witness.all_blocks)
        witness.free.clear()
        sent = sensor.sent
        witness.wait_for(lambda: sensor.sent > sent + 200)  # four times the silence
        witness.free.set()
        witness.wait_for(lambda: session.acquisition.report().received > sent + 200)
        report = session.acquisition.report()
    assert (report.lost, report.restarts, report.connects) == (0, 0, 1)
    assert "silent" not in witness.kinds


def test_batches_hold_every_sample_that_was_received(sensor: FakeRdtSensor) -> None:
    with Session(sensor, batch_rate=100.0) as session:
        witness = session.witness
        witness.wait_for(lambda: len(witness.batches) > 20)
    sequence = np.concatenate([batch.sequence for batch in witness.batches])
    np.testing.assert_array_equal(sequence, np.arange(1, len(sequence) + 1))
    last = witness.batches[-1]
    assert last.received == len(sequence)
    assert last.period == pytest.approx(1e-3, rel=0.01)
    assert last.wrench_in_sensor.shape == (len(last.sequence), 6)


def test_silence_ends_a_batch(sensor: FakeRdtSensor) -> None:
    with Session(sensor, batch_rate=0.01) as session:
        witness = session.witness
        witness.wait_for(lambda: session.acquisition.report().received > 50)
        sensor.silent = True
        witness.wait_for(lambda: witness.batches)
        assert len(witness.batches[0].sequence) == session.acquisition.report().received


@pytest.mark.parametrize(("publish_saturated", "withheld"), [(False, True), (True, False)])
def test_saturated_averages_are_withheld_unless_they_are_asked_for(
    sensor: FakeRdtSensor, publish_saturated: bool, withheld: bool
) -> None:
    sensor.status = 0x40000000  # an Axia's force out of range, without the error summary
    with Session(sensor, publish_saturated=publish_saturated, batch_rate=100.0) as session:
        witness = session.witness
        witness.wait_for(lambda: len(witness.batches) > 2)
        report = session.acquisition.report()
    assert report.condition.kind == "saturated"
    assert bool(witness.all_blocks) != withheld
    assert (report.withheld > 0) == withheld
    assert set(witness.batches[-1].status.tolist()) == {0x40000000}


def test_a_device_that_repeats_one_measurement_is_stalled(sensor: FakeRdtSensor) -> None:
    with Session(sensor) as session:
        witness = session.witness
        witness.wait_for(lambda: witness.all_blocks)
        sensor.stalled = True
        witness.wait_for(lambda: "stalled" in witness.kinds)
        before = len(witness.all_blocks)
        received = session.acquisition.report().received
        witness.wait_for(lambda: session.acquisition.report().received > received + 100)
        assert len(witness.all_blocks) == before


def test_a_sink_that_fails_is_reported_and_does_not_end_the_acquisition(sensor: FakeRdtSensor) -> None:
    with Session(sensor) as session:
        witness = session.witness
        witness.wait_for(lambda: witness.all_blocks)
        witness.broken = True
        witness.wait_for(lambda: "failed" in witness.kinds)
        failed = next(report for report in witness.reports if report.condition.kind == "failed")
        assert "a sink that fails" in failed.condition.text
        witness.broken = False
        witness.wait_for(lambda: witness.kinds[-1] == "streaming")


def test_a_bias_is_taken_off_what_follows(sensor: FakeRdtSensor) -> None:
    with Session(sensor) as session:
        witness = session.witness
        witness.wait_for(lambda: witness.all_blocks)
        bias = session.acquisition.zero(100, timeout=20.0)
        np.testing.assert_allclose(bias.wrench_in_sensor, WRENCH, atol=1e-6)
        witness.wait_for_wrench(np.zeros(6))
        np.testing.assert_allclose(session.acquisition.report().bias, WRENCH, atol=1e-6)
        again = session.acquisition.zero(100, timeout=20.0)  # of the raw samples, not of what is left of them
        np.testing.assert_allclose(again.wrench_in_sensor, WRENCH, atol=1e-6)


def test_a_bias_from_the_start_is_taken_off(sensor: FakeRdtSensor) -> None:
    with Session(sensor, bias=WRENCH) as session:
        witness = session.witness
        witness.wait_for(lambda: witness.all_blocks)
        np.testing.assert_allclose(witness.all_blocks[0].wrench_in_sensor[0], 0, atol=1e-6)


def test_a_device_that_does_not_zero_itself_is_found_out(sensor: FakeRdtSensor) -> None:
    with Session(sensor) as session:
        session.witness.wait_for(lambda: session.witness.all_blocks)
        sensor._source = WrenchSource([[0.0] * 6])  # what it zeroes at
        session.witness.wait_for_wrench(np.zeros(6))
        bias = session.acquisition.zero(50, timeout=20.0, hardware=True)
        assert bias.count == 50
        report = session.acquisition.report()
        assert (report.restarts, report.duplicates, report.lost) == (1, 0, 0)  # the stream restarted
        sensor._source = WrenchSource(WRENCH)
        session.witness.wait_for_wrench(WRENCH)
        sensor.deaf_to_bias = True
        with pytest.raises(SensorError, match="did not zero itself") as caught:
            session.acquisition.zero(50, timeout=20.0, hardware=True)
    assert caught.value.code == ErrorCode.SENSOR_FAULT


def test_without_samples_there_is_no_bias(sensor: FakeRdtSensor) -> None:
    sensor.silent = True
    with Session(sensor) as session, pytest.raises(SensorError) as caught:
        session.acquisition.zero(10, timeout=20.0)
    assert caught.value.code == ErrorCode.SENSOR_STALE


def test_a_bias_asked_for_while_the_stream_is_reconnected_is_answered(sensor: FakeRdtSensor) -> None:
    with Session(sensor, silence=0.05) as session:
        session.witness.wait_for(lambda: session.witness.all_blocks)
        sensor.silent = True
        session.witness.wait_for(lambda: "silent" in session.witness.kinds)
        threading.Timer(0.1, setattr, (sensor, "silent", False)).start()
        assert session.acquisition.zero(10, timeout=20.0).count == 10


def test_a_bias_that_gets_too_few_samples_gives_up_at_its_deadline(sensor: FakeRdtSensor) -> None:
    with Session(sensor) as session:
        session.witness.wait_for(lambda: session.witness.all_blocks)
        with pytest.raises(SensorError) as caught:
            session.acquisition.zero(1_000_000, timeout=0.05)
    assert caught.value.code == ErrorCode.DEADLINE


def test_a_moving_load_is_no_bias() -> None:
    moving = WrenchSource(np.outer(np.arange(10_000), [0.02, 0, 0, 0, 0, 0]))
    with FakeRdtSensor(moving) as sensor, Session(sensor) as session:
        session.witness.wait_for(lambda: session.witness.all_blocks)
        with pytest.raises(NoAnswerError, match="the load moves"):
            session.acquisition.zero(200, timeout=20.0)


def test_a_stopped_acquisition_frees_who_waits_for_a_bias(sensor: FakeRdtSensor) -> None:
    session = Session(sensor)
    session.acquisition.start()
    session.witness.wait_for(lambda: session.witness.all_blocks)
    errors: list[SensorError] = []

    def ask() -> None:
        try:
            session.acquisition.zero(1_000_000, timeout=60.0)
        except SensorError as error:
            errors.append(error)

    waiting = threading.Thread(target=ask)
    waiting.start()
    session.witness.wait_for(lambda: session.acquisition._job is not None)
    assert session.acquisition.stop()
    waiting.join(20.0)
    assert [error.code for error in errors] == [ErrorCode.CANCELLED]


def test_a_stopped_acquisition_has_silenced_its_sensor(sensor: FakeRdtSensor) -> None:
    with Session(sensor) as session:
        session.witness.wait_for(lambda: session.witness.all_blocks)
    session.witness.wait_for(lambda: not sensor.is_streaming)


def samples(
    status: int = 0, saturated: bool = False, faulty: bool = False, rejected: int = 0, n: int = 1
) -> SensorSamples:
    return SensorSamples(
        np.zeros(n, dtype=np.uint32),
        np.zeros((n, 6)),
        np.full(n, status, dtype=np.uint32),
        np.full(n, saturated),
        np.full(n, faulty),
        arrival=0,
        rejected=rejected,
    )


def kind(health: Health, now: float) -> str:
    health.check(now)
    return health.condition(now, "words").kind


def test_before_the_first_sample_patience_ends_after_the_grace_or_with_the_first_error() -> None:
    health = Health(0.05, now=0.0)
    assert kind(health, FIRST_SAMPLE_GRACE) == "connecting"
    assert kind(health, FIRST_SAMPLE_GRACE + 0.01) == "unreachable"
    health.failed(SensorError(ErrorCode.SENSOR_PROTOCOL, "no page"))
    condition = health.condition(0.1, "")
    assert (condition.kind, condition.code, condition.text) == ("unreachable", ErrorCode.SENSOR_PROTOCOL, "no page")


def test_the_worst_condition_is_named_and_passing_ones_are_held() -> None:
    health = Health(silence=10.0, now=0.0)
    health.take(samples(rejected=1), 0.0)
    assert kind(health, 0.0) == "rejecting"
    health.note("losing", "", 0.1)
    assert kind(health, 0.1) == "losing"
    health.take(samples(status=0x80000004, faulty=True), 0.2)
    assert kind(health, 0.2) == "faulty"
    health.take(samples(saturated=True), 0.3)
    assert kind(health, 0.3) == "saturated"
    assert kind(health, 0.3 + HOLD) == "saturated"
    assert kind(health, 0.31 + HOLD) == "streaming"
    health.take(samples(status=0x00010000), 2.0)
    assert kind(health, 2.0) == "flagged"
    assert kind(health, 13.0) == "silent"


def test_silence_is_judged_by_reads_and_not_by_the_clock() -> None:
    health = Health(silence=1.0, now=0.0)
    health.take(samples(), 0.0)
    assert health.condition(10.0, "").kind == "streaming"  # not checked since
    health.check(10.0)
    assert health.condition(10.0, "").kind == "silent"


def test_an_error_is_forgotten_with_the_next_sample() -> None:
    health = Health(silence=1.0, now=0.0)
    health.take(samples(), 0.0)
    health.failed(SensorError(ErrorCode.SENSOR_UNREACHABLE, "gone"))
    assert kind(health, 5.0) == "silent"
    assert "gone" in health.condition(5.0, "").text
    health.take(samples(), 6.0)
    assert kind(health, 6.0) == "streaming"
    assert kind(health, 9.0) == "silent"
    assert "gone" not in health.condition(9.0, "").text
