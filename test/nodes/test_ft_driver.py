"""The driver through the real ROS graph, against sensors that are not there."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from driver_watch import Diagnostics, rdt_parameters
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import qos_profile_sensor_data
from ros_graph import Graph, NodeProcess
from std_srvs.srv import Trigger

from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor
from poise.force_torque.sensors.bota_serial import FakeBotaSensor
from poise.force_torque.sensors.robotiq.fake import FakeRobotiqSensor
from poise.force_torque.wire import WrenchSource
from poise_msgs.msg import WrenchBatch

pytestmark = pytest.mark.ros

WRENCH = np.array([1.0, -2.0, 30.0, 0.4, -0.5, 0.6])
COUNT = WrenchSource(np.column_stack([np.arange(100_000) * 1e-3, *np.zeros((5, 100_000))]))
"""A wrench whose fx, in mN, is the number of the measurement."""


@pytest.fixture
def rdt() -> Iterator[FakeRdtSensor]:
    with FakeRdtSensor(WrenchSource(WRENCH), rate=1000.0) as sensor:
        yield sensor


def vector(message: WrenchStamped) -> np.ndarray:
    force, torque = message.wrench.force, message.wrench.torque
    return np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])


def stamps(messages: list[WrenchStamped]) -> np.ndarray:
    return np.array([message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in messages])


def test_an_rdt_sensor_is_published_in_newtons_with_the_sign_of_the_contract(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor
) -> None:
    wrenches = graph.collect("wrench", WrenchStamped)
    start_node("ft_driver", rdt_parameters(rdt, frame_id="wrist"))
    graph.wait_for(lambda: len(wrenches) > 20, what="wrenches")
    np.testing.assert_allclose(vector(wrenches[-1]), WRENCH, atol=1e-6)
    assert wrenches[-1].header.frame_id == "wrist"


def test_a_sensor_that_reports_its_own_force_is_turned_round(
    graph: Graph, start_node: Callable[..., NodeProcess]
) -> None:
    with FakeRdtSensor(WrenchSource(WRENCH), sign=-1) as sensor:
        wrenches = graph.collect("wrench", WrenchStamped)
        start_node("ft_driver", rdt_parameters(sensor, reports="sensor_on_load"))
        graph.wait_for(lambda: wrenches, what="wrenches")
        np.testing.assert_allclose(vector(wrenches[-1]), WRENCH, atol=1e-6)


def test_best_effort_readers_are_served_too(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor
) -> None:
    wrenches = graph.collect("wrench", WrenchStamped, qos_profile_sensor_data)
    start_node("ft_driver", rdt_parameters(rdt))
    graph.wait_for(lambda: len(wrenches) > 5, what="wrenches")


def test_counts_from_parameters_need_no_web_page(graph: Graph, start_node: Callable[..., NodeProcess]) -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        wrenches = graph.collect("wrench", WrenchStamped)
        counts = {"counts_per_force": 1e6 * 4.4482216152605, "force_unit": "lbf"}
        counts |= {"counts_per_torque": 1e3, "torque_unit": "N-mm"}
        start_node("ft_driver", {"address": "127.0.0.1", "port": sensor.port, "http_port": 0, **counts})
        graph.wait_for(lambda: wrenches, what="wrenches")
        np.testing.assert_allclose(vector(wrenches[-1]), WRENCH, atol=1e-6)


def test_seven_kilohertz_arrive_whole_in_batches_and_averaged_in_wrenches(
    graph: Graph, start_node: Callable[..., NodeProcess]
) -> None:
    with FakeRdtSensor(COUNT, rate=7000.0) as sensor:
        wrenches = graph.collect("wrench", WrenchStamped)
        batches = graph.collect("wrench_batch", WrenchBatch)
        start_node("ft_driver", rdt_parameters(sensor, publish_rate=500.0, batch_rate=50.0, buffered=True))
        graph.wait_for(lambda: len(batches) > 40 and len(wrenches) > 500, what="batches and wrenches")
        gaps = 0
        for batch in batches:  # a busy reader may miss a whole one
            steps = np.diff(np.array(batch.sequence, dtype=np.int64))
            measurement = np.array(batch.wrench).reshape(-1, 6)[:, 0]
            np.testing.assert_allclose(np.diff(measurement), 1e-3 * steps, atol=1e-5)  # float32
            gaps += int(np.sum(steps - 1))
        assert gaps <= batches[-1].lost  # datagrams that a busy machine loses are counted
        assert sum(len(batch.sequence) for batch in batches) <= batches[-1].received
        blocks = np.diff([vector(message)[0] for message in wrenches[10:500]])
        assert np.median(blocks) == pytest.approx(14e-3, abs=1e-6)
        assert np.all(np.diff(stamps(wrenches)) > 0)


def test_a_robotiq_stream_is_published(graph: Graph, start_node: Callable[..., NodeProcess]) -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        wrenches = graph.collect("wrench", WrenchStamped)
        start_node("ft_driver", {"device": "robotiq_serial", "address": sensor.port})
        graph.wait_for(lambda: len(wrenches) > 20, what="wrenches")
        np.testing.assert_allclose(vector(wrenches[-1]), WRENCH, atol=0.005)


def test_a_bota_stream_is_published(graph: Graph, start_node: Callable[..., NodeProcess]) -> None:
    with FakeBotaSensor(WrenchSource(WRENCH)) as sensor:
        wrenches = graph.collect("wrench", WrenchStamped)
        start_node("ft_driver", {"device": "bota_serial", "address": sensor.port})
        graph.wait_for(lambda: len(wrenches) > 20, what="wrenches")
        np.testing.assert_allclose(vector(wrenches[-1]), WRENCH, atol=1e-5)


def test_a_robotiq_on_modbus_is_published_and_named(graph: Graph, start_node: Callable[..., NodeProcess]) -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        wrenches = graph.collect("wrench", WrenchStamped)
        diagnostics = Diagnostics(graph)
        start_node("ft_driver", {"device": "robotiq_modbus", "address": sensor.port, "silence": 0.5})
        graph.wait_for(lambda: len(wrenches) > 5, what="wrenches")
        np.testing.assert_allclose(vector(wrenches[-1]), WRENCH, atol=0.005)
        diagnostics.wait_for("streaming")
        assert "FTS-1234" in diagnostics.last.hardware_id


def test_bias_sensor_makes_the_present_load_the_zero(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor
) -> None:
    wrenches = graph.collect("wrench", WrenchStamped)
    start_node("ft_driver", rdt_parameters(rdt, bias_samples=100))
    graph.wait_for(lambda: wrenches, what="wrenches")
    response = graph.call(Trigger, "bias_sensor", Trigger.Request())
    assert response.success, response.message
    assert rdt.biases == 0
    graph.wait_for(lambda: np.allclose(vector(wrenches[-1]), 0, atol=1e-6), what="zero")


def test_a_hardware_bias_zeroes_the_device_itself(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor
) -> None:
    wrenches = graph.collect("wrench", WrenchStamped)
    start_node("ft_driver", rdt_parameters(rdt, bias_samples=100, hardware_bias=True))
    graph.wait_for(lambda: wrenches, what="wrenches")
    response = graph.call(Trigger, "bias_sensor", Trigger.Request())
    assert response.success, response.message
    assert rdt.biases == 1
    graph.wait_for(lambda: np.allclose(vector(wrenches[-1]), 0, atol=1e-6), what="zero")


def test_a_moving_load_is_no_zero(graph: Graph, start_node: Callable[..., NodeProcess]) -> None:
    with FakeRdtSensor(WrenchSource(np.outer(np.arange(10_000), [0.02, 0, 0, 0, 0, 0]))) as sensor:
        wrenches = graph.collect("wrench", WrenchStamped)
        start_node("ft_driver", rdt_parameters(sensor, bias_samples=200))
        graph.wait_for(lambda: wrenches, what="wrenches")
        response = graph.call(Trigger, "bias_sensor", Trigger.Request())
    assert not response.success
    assert "the load moves" in response.message


def test_silence_is_reported_and_samples_come_back(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor
) -> None:
    wrenches = graph.collect("wrench", WrenchStamped)
    diagnostics = Diagnostics(graph)
    start_node("ft_driver", rdt_parameters(rdt))
    diagnostics.wait_for("streaming")
    rdt.silent = True
    values = diagnostics.wait_for("silent")
    assert float(values["age_s"]) >= 0.05  # to the millisecond that is printed
    assert diagnostics.last.message.startswith("SENSOR_STALE: no sample for")
    before, seen = len(wrenches), len(diagnostics.conditions)
    rdt.power_cycle()
    rdt.silent = False
    diagnostics.wait_for("streaming", after=seen)
    graph.wait_for(lambda: len(wrenches) > before, what="wrenches after the return")


def test_a_driver_that_starts_before_its_sensor_waits_for_it(
    graph: Graph, start_node: Callable[..., NodeProcess]
) -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        address = rdt_parameters(sensor)
    diagnostics = Diagnostics(graph)
    wrenches = graph.collect("wrench", WrenchStamped)
    start_node("ft_driver", address)
    diagnostics.wait_for("unreachable")
    assert "check address" in diagnostics.last.message
    with FakeRdtSensor(WrenchSource(WRENCH), port=address["port"], http_port=address["http_port"]):
        graph.wait_for(lambda: wrenches, what="wrenches")


def test_a_serial_adapter_that_is_pulled_out_and_put_in_again_is_read_again(
    graph: Graph, start_node: Callable[..., NodeProcess]
) -> None:
    with FakeRobotiqSensor(WrenchSource(WRENCH)) as sensor:
        diagnostics = Diagnostics(graph)
        start_node("ft_driver", {"device": "robotiq_serial", "address": sensor.port})
        diagnostics.wait_for("streaming")
        sensor.unplug()
        diagnostics.wait_for("silent")
        seen = len(diagnostics.conditions)
        sensor.plug_in()
        diagnostics.wait_for("streaming", after=seen)


def test_saturated_samples_are_withheld_and_reported(graph: Graph, start_node: Callable[..., NodeProcess]) -> None:
    load = np.tile(WRENCH, (4000, 1))
    load[1000:1500, 2] = 1000.0  # beyond the 900 N of the page
    with FakeRdtSensor(WrenchSource(load)) as sensor:
        wrenches = graph.collect("wrench", WrenchStamped)
        diagnostics = Diagnostics(graph)
        start_node("ft_driver", rdt_parameters(sensor))
        values = diagnostics.wait_for("saturated")
        seen = len(diagnostics.conditions)
        diagnostics.wait_for("streaming", after=seen)
        assert max(vector(message)[2] for message in wrenches) == pytest.approx(WRENCH[2])
        assert int(values["withheld"]) > 0


@pytest.mark.parametrize(
    ("status", "condition", "text"),
    [
        (0x80000004, "faulty", "SENSOR_FAULT: status 0x80000004: broken gage"),
        (0xC0000000, "saturated", "SENSOR_SATURATED"),
        (0x80010000, "flagged", "monitor condition latched"),
    ],
)
def test_status_bits_are_put_into_words(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor, status: int, condition: str, text: str
) -> None:
    rdt.status = status
    diagnostics = Diagnostics(graph)
    start_node("ft_driver", rdt_parameters(rdt))
    diagnostics.wait_for(condition)
    assert text in diagnostics.last.message
