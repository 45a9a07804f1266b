"""examples/set_payload.py: an estimate becomes one request of a robot's driver, or none while it may be wrong."""

import importlib.util
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.srv import SetCameraInfo

from poise.errors import ErrorCode
from poise.exporting import ExportSettings, export
from poise.inertia import InertialEstimate, InertialParameters
from poise.inertia.model import EstimateFinding
from poise.nodes.estimate_message import estimate_message
from poise.nodes.runtime import LATCHED
from poise_msgs.msg import InertialEstimate as InertialEstimateMessage

EXAMPLE = Path(__file__).parents[2] / "examples" / "set_payload.py"
PAYLOAD = InertialParameters(1.6, np.array([0.01, -0.02, 0.19]), np.diag([0.009, 0.006, 0.004]))

pytestmark = pytest.mark.ros


@pytest.fixture(scope="module")
def example():
    """The example as a module."""
    specification = importlib.util.spec_from_file_location("set_payload", EXAMPLE)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def estimate(std: float = 0.005, findings: tuple = (), parameters: InertialParameters = PAYLOAD) -> InertialEstimate:
    return InertialEstimate(
        stamp=5 * 10**9,
        frame_id="ft_sensor",
        parameters=parameters,
        phi=parameters.phi,
        covariance=std**2 * np.eye(10),
        bias=np.zeros(6),
        bias_covariance=np.eye(6),
        delay=np.nan,
        delay_std=np.nan,
        method="poise",
        consistent=True,
        unidentified=(),
        condition_number=1.0,
        n_samples=1000,
        rejected=(),
        residual_force=0.1,
        residual_torque=0.01,
        findings=findings,
        since=10**9,
    )


def test_a_payload_is_sent_once_and_only_when_it_is_known_and_not_doubtful(graph, example, monkeypatch) -> None:
    """By a service of this installation whose request has room for the values: the robots' own are not on PyPI."""

    def as_camera(load: dict) -> dict:
        return {"camera_info": {"d": [load["mass"], *load["center_of_mass"]], "k": load["load_inertia"]}}

    robot = example.Robot("franka", "sensor_msgs/srv/SetCameraInfo", "set_load", as_camera)
    monkeypatch.setitem(example.ROBOTS, "test", robot)
    requests: list[SetCameraInfo.Request] = []

    def serve(request, response):
        requests.append(request)
        response.success = len(requests) > 1  # the first is refused
        return response

    graph.node.create_service(SetCameraInfo, "set_load", serve)
    publisher = graph.node.create_publisher(InertialEstimateMessage, "inertial_estimate", LATCHED)
    overrides = [
        Parameter("robot", value="test"),
        Parameter("flange_pose", value=[0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0]),
        Parameter("gripper", value=[0.4, 0.0, 0.0, 0.05, 1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4]),
    ]
    node = example.PayloadSetter(context=graph.node.context, parameter_overrides=overrides)
    graph.add(node)
    graph.wait_for(node.client.service_is_ready, what="the service")
    wrong = EstimateFinding(ErrorCode.TORQUE_SIGN, "the torque has the wrong sign")
    held = PAYLOAD + InertialParameters(0.4, np.array([0, 0, 0.05]), 1e-4 * np.eye(3))
    good = estimate_message(estimate(parameters=held))
    for doubtful in (estimate(std=0.1, parameters=held), estimate(findings=(wrong,), parameters=held)):
        node.take(estimate_message(doubtful))
    assert node.sent is None
    publisher.publish(good)
    graph.wait_for(lambda: len(requests) == 1 and node.sent is None, what="the refused request")
    publisher.publish(good)
    graph.wait_for(lambda: len(requests) == 2, what="the request")
    node.take(good)
    info = requests[1].camera_info
    np.testing.assert_allclose(info.d, [1.6, 0.01, -0.02, 0.24], atol=1e-9)
    np.testing.assert_allclose(np.reshape(info.k, (3, 3)), PAYLOAD.inertia, atol=1e-9)
    assert len(requests) == 2
    node.destroy_node()


def test_requests_have_the_fields_of_the_drivers_services(example) -> None:
    """The fields of ur_msgs (Jazzy, Rolling) and franka_msgs, from their documentation."""

    def filled(robot: str, **fields):
        request = SimpleNamespace(**fields)
        kind = example.ROBOTS[robot].kind
        load = json.loads(export(estimate(), kind, ExportSettings(transition_time=0.25)))
        content = example.ROBOTS[robot].request(load)
        example.fill(request, content)
        assert set(content) <= set(fields)
        return request

    six = dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 0.0)
    vector = {"x": 0.0, "y": 0.0, "z": 0.0}
    flat = filled(
        "ur",
        mass=0.0,
        center_of_gravity=SimpleNamespace(**vector),
        transition_time=SimpleNamespace(sec=0, nanosec=0),
        **six,
    )
    assert (flat.mass, flat.center_of_gravity.z, flat.iyy) == (1.6, 0.19, 0.006)
    assert flat.transition_time.nanosec == 250_000_000
    inertia = SimpleNamespace(m=0.0, com=SimpleNamespace(**vector), **six)
    nested = filled("ur-rolling", payload=inertia, transition_time=0.0)
    assert (nested.payload.m, nested.payload.com.y, nested.payload.izz) == (1.6, -0.02, 0.004)
    assert nested.transition_time == 0.25
    load = filled("franka", mass=0.0, center_of_mass=np.zeros(3), load_inertia=np.zeros(9))
    assert (load.mass, load.center_of_mass[2], load.load_inertia[4]) == (1.6, 0.19, 0.006)


def test_the_services_of_the_drivers_where_they_are_installed(example) -> None:
    service = pytest.importorskip("ur_msgs.srv").SetPayload
    request = service.Request()
    load = json.loads(export(estimate(), "ur-driver"))
    example.fill(request, example.ROBOTS["ur" if hasattr(request, "mass") else "ur-rolling"].request(load))
