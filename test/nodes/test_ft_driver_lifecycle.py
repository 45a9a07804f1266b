"""The driver's lifecycle, its parameters, its start and its end."""

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from driver_watch import Diagnostics, rdt_parameters
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from ros_graph import Graph, NodeProcess
from std_srvs.srv import Trigger

from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor
from poise.force_torque.wire import WrenchSource
from poise.nodes.ft_driver_parameters import FT_DRIVER_PARAMETERS

pytestmark = pytest.mark.ros

CONFIG = Path(__file__).parents[2] / "config" / "ft_driver.yaml"
WRENCH = np.array([1.0, -2.0, 30.0, 0.4, -0.5, 0.6])


@pytest.fixture
def rdt() -> Iterator[FakeRdtSensor]:
    with FakeRdtSensor(WrenchSource(WRENCH), rate=1000.0) as sensor:
        yield sensor


def change_state(graph: Graph, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(graph.call(ChangeState, "ft_driver/change_state", request).success)


def state(graph: Graph) -> int:
    return int(graph.call(GetState, "ft_driver/get_state", GetState.Request()).current_state.id)


def test_the_lifecycle_goes_round_and_refuses_what_is_impossible(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor
) -> None:
    wrenches = graph.collect("wrench", WrenchStamped)
    diagnostics = Diagnostics(graph)
    start_node("ft_driver", rdt_parameters(rdt, autostart=False))
    assert state(graph) == State.PRIMARY_STATE_UNCONFIGURED
    assert not change_state(graph, Transition.TRANSITION_ACTIVATE)
    for _ in range(2):
        assert change_state(graph, Transition.TRANSITION_CONFIGURE)
        diagnostics.wait_for("inactive", after=len(diagnostics.conditions))
        assert not graph.call(Trigger, "bias_sensor", Trigger.Request()).success
        assert change_state(graph, Transition.TRANSITION_ACTIVATE)
        before = len(wrenches)
        graph.wait_for(lambda before=before: len(wrenches) > before, what="wrenches")
        assert not change_state(graph, Transition.TRANSITION_CONFIGURE)
        assert change_state(graph, Transition.TRANSITION_DEACTIVATE)
        graph.wait_for(lambda: not rdt.is_streaming, what="the sensor's rest")
        assert change_state(graph, Transition.TRANSITION_CLEANUP)
    assert change_state(graph, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
    assert state(graph) == State.PRIMARY_STATE_FINALIZED


def test_activation_needs_no_sensor(graph: Graph, start_node: Callable[..., NodeProcess]) -> None:
    with FakeRdtSensor(WrenchSource(WRENCH)) as sensor:
        address = rdt_parameters(sensor)
    start_node("ft_driver", {**address, "autostart": False})
    assert change_state(graph, Transition.TRANSITION_CONFIGURE)
    assert change_state(graph, Transition.TRANSITION_ACTIVATE)
    assert state(graph) == State.PRIMARY_STATE_ACTIVE
    assert change_state(graph, Transition.TRANSITION_DEACTIVATE)


def test_parameters_do_not_change_under_a_configured_driver(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor
) -> None:
    start_node("ft_driver", rdt_parameters(rdt))
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=10.0)
    graph.wait_for(lambda: rdt.is_streaming, what="the stream")
    request = SetParameters.Request(parameters=[Parameter(name="publish_rate", value=value)])
    result = graph.call(SetParameters, "ft_driver/set_parameters", request).results[0]
    assert not result.successful
    assert "deactivate" in result.reason


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"device": "jr3"}, "parameter device is 'jr3'; use one of bota_serial, rdt, robotiq_modbus, robotiq_serial"),
        ({"publish_rate": 0.0}, "parameter publish_rate"),
        ({"publish_rate": 100}, "write a float with a point"),
        ({"bias": [1.0, 2.0]}, "six finite numbers"),
        ({"counts_per_force": 1000.0}, "counts per torque must be positive"),
        ({"force_unit": "stone", "counts_per_force": 1.0, "counts_per_torque": 1.0}, "'stone' is not known"),
        ({"http_port": 0}, "counts_per_force and counts_per_torque are needed"),
        ({"device": "robotiq_serial", "hardware_bias": True}, "cannot zero itself"),
    ],
)
def test_a_bad_parameter_ends_the_start_with_one_line(
    start_node: Callable[..., NodeProcess], params: dict[str, Any], text: str
) -> None:
    driver = start_node("ft_driver", params)
    assert driver.wait() == 2
    lines = driver.output.strip().splitlines()
    assert len(lines) == 1
    assert text in lines[0]


def test_the_parameter_file_holds_every_parameter_with_its_default() -> None:
    content = yaml.safe_load(CONFIG.read_text())["/**/ft_driver"]["ros__parameters"]
    assert content == {parameter.name: parameter.default for parameter in FT_DRIVER_PARAMETERS}


@pytest.mark.parametrize("namespace", ["/", "/arm/left"])
def test_the_parameter_file_is_taken_in_whatever_the_namespace(
    start_node: Callable[..., NodeProcess], namespace: str
) -> None:
    file = ["--ros-args", "--params-file", str(CONFIG), "-r", f"__ns:={namespace}", "--"]
    driver = start_node("ft_driver", {"device": "jr3"}, arguments=file)
    assert driver.wait() == 2
    assert "parameter device is 'jr3'" in driver.output  # all the others were fine


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_driver_ends_clean_and_silences_its_sensor(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor, number: signal.Signals
) -> None:
    driver = start_node("ft_driver", rdt_parameters(rdt))
    graph.wait_for(lambda: rdt.is_streaming, what="the stream")
    assert driver.stop(number) == 0
    assert "Traceback" not in driver.output
    graph.wait_for(lambda: not rdt.is_streaming, what="the sensor's rest")


def test_a_killed_driver_leaves_its_sensor_to_the_next(
    graph: Graph, start_node: Callable[..., NodeProcess], rdt: FakeRdtSensor
) -> None:
    driver = start_node("ft_driver", rdt_parameters(rdt))
    graph.wait_for(lambda: rdt.is_streaming, what="the stream")
    driver.send(signal.SIGKILL)
    driver.wait()
    wrenches = graph.collect("wrench", WrenchStamped)
    start_node("ft_driver", rdt_parameters(rdt))
    graph.wait_for(lambda: wrenches, what="wrenches from the next driver")
