"""The contract of an entry in the registry of sensors: each is held against its own fake."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError, PoiseError, SensorError
from poise.force_torque import Acquisition, AcquisitionOptions, BlockAverages, SampleBatch, StreamReport
from poise.force_torque.sensors import Sensor, SensorSetting, all_sensors, sensor_named, sensor_settings
from poise.force_torque.wire import Link, SensorSamples, WrenchSource

WRENCH = np.array([1.0, -2.0, 30.0, 0.4, -0.5, 0.6])
DEADLINE = 20.0
COMMON = {"reports": "load_on_sensor", "force_limit": 0.0, "torque_limit": 0.0, "publish_rate": 1000.0}
"""The driver's parameters that entries may read."""
DEFAULTS = {**COMMON, **{setting.name: setting.default for setting in sensor_settings()}}

pytestmark = pytest.mark.parametrize("sensor", all_sensors(), ids=lambda sensor: sensor.name)


class Sink:
    """Keeps what the acquisition delivers."""

    def __init__(self) -> None:
        self.averages: list[BlockAverages] = []
        self.kinds: list[str] = []

    def blocks(self, blocks: BlockAverages) -> None:
        self.averages.append(blocks)

    def batch(self, batch: SampleBatch) -> None:
        pass

    def report(self, report: StreamReport) -> None:
        self.kinds.append(report.condition.kind)


def until(done: Callable[[], Any]) -> None:
    end = time.monotonic() + DEADLINE
    while not done():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.002)


def started(link: Link) -> bool:
    """Start it, as the acquisition does: again when an answer came too late, as on a busy machine."""
    try:
        link.start()
    except SensorError:
        link.close()
        return False
    return True


def read(sensor: Sensor, count: int, **values: Any) -> list[SensorSamples]:
    """Start a link to a fake and read this many samples."""
    reads: list[SensorSamples] = []
    with sensor.fake(WrenchSource(WRENCH)) as fake:
        link = sensor.link({**DEFAULTS, **fake.parameters, **values})
        until(lambda: started(link))
        end = time.monotonic() + DEADLINE
        while sum(map(len, reads)) < count:
            assert time.monotonic() < end, "the samples did not come"
            reads.append(link.read(0.1))
        link.close()
    return reads


def start_and_read_for_ever(link: Link) -> None:
    link.start()
    while True:
        link.read(0.05)


def test_an_entry_describes_itself(sensor: Sensor) -> None:
    assert sensor_named(sensor.name) is sensor
    assert sensor.summary
    assert sensor.address
    assert all(isinstance(setting, SensorSetting) and setting.description for setting in sensor.settings)
    for setting in sensor.settings:
        same = {other for entry in all_sensors() for other in entry.settings if other.name == setting.name}
        assert same == {setting}, "two sensors mean different things by one parameter"
        assert setting.name not in COMMON


def test_samples_come_in_the_units_and_the_sign_of_the_contract(sensor: Sensor) -> None:
    reads = read(sensor, 10)
    wrench = np.concatenate([samples.wrench_in_sensor for samples in reads])
    np.testing.assert_allclose(wrench, np.tile(WRENCH, (len(wrench), 1)), atol=0.005)
    assert not any(samples.saturated.any() or samples.faulty.any() for samples in reads)
    number = np.concatenate([samples.sequence for samples in reads]).astype(np.int64)
    assert np.all(np.diff(number) >= 1)
    turned = read(sensor, 1, reports="sensor_on_load")[-1]
    np.testing.assert_allclose(turned.wrench_in_sensor[-1], -WRENCH, atol=0.005)


def test_a_load_at_the_limit_of_the_parameters_is_saturated(sensor: Sensor) -> None:
    assert read(sensor, 1, force_limit=29.0)[-1].saturated.all()
    assert read(sensor, 1, torque_limit=0.55)[-1].saturated.all()
    assert not read(sensor, 1, force_limit=31.0, torque_limit=0.65)[-1].saturated.any()


def test_a_stream_falls_silent_and_returns_and_its_load_becomes_the_zero(sensor: Sensor) -> None:
    sink = Sink()
    with sensor.fake(WrenchSource(WRENCH)) as fake:
        link = sensor.link({**DEFAULTS, **fake.parameters})
        options = AcquisitionOptions(publish_rate=1000.0, silence=0.3)
        acquisition = Acquisition(link, options, sink, np.random.default_rng(0))
        acquisition.start()
        until(lambda: "streaming" in sink.kinds)
        acquisition.zero(20, DEADLINE)
        until(lambda: np.allclose(sink.averages[-1].wrench_in_sensor[-1], 0.0, atol=0.005))
        fake.silent = True
        until(lambda: sink.kinds[-1] == "silent")
        assert acquisition.report().condition.code == ErrorCode.SENSOR_STALE
        fake.silent = False
        until(lambda: sink.kinds[-1] == "streaming")
        assert fake.parameters["address"] in acquisition.report().device
        assert acquisition.stop()


def test_a_device_without_a_bias_command_says_so(sensor: Sensor) -> None:
    with sensor.fake(WrenchSource(WRENCH)) as fake:
        link = sensor.link({**DEFAULTS, **fake.parameters})
        link.start()
        if sensor.can_zero_itself:
            link.bias()
        else:
            with pytest.raises(SensorError, match="software bias") as caught:
                link.bias()
            assert caught.value.code == ErrorCode.UNSUPPORTED
        link.close()


def test_an_absent_device_is_an_error_with_a_code_and_never_a_hang(sensor: Sensor) -> None:
    with sensor.fake(WrenchSource(WRENCH)) as fake:
        parameters = fake.parameters
    link = sensor.link({**DEFAULTS, **parameters})
    with pytest.raises((PoiseError, OSError)) as caught:
        start_and_read_for_ever(link)
    if isinstance(caught.value, PoiseError):
        assert caught.value.code in (ErrorCode.SENSOR_UNREACHABLE, ErrorCode.SENSOR_PROTOCOL)
    link.close()
    link.close()


def test_a_closed_link_refuses_to_read_and_can_be_started_again(sensor: Sensor) -> None:
    with sensor.fake(WrenchSource(WRENCH)) as fake:
        link = sensor.link({**DEFAULTS, **fake.parameters})
        for _ in range(2):
            with pytest.raises(OSError):
                link.read(0.0)
            link.start()
            until(lambda: len(link.read(0.3)) or link.start())  # a request that came too early is sent again
            link.close()


def test_a_name_that_is_not_there_is_refused_with_those_that_are(sensor: Sensor) -> None:
    with pytest.raises(InputError, match=sensor.name):
        sensor_named("jr3")
