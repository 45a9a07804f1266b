"""mismatch_diagnoser in a real graph: a robot with a fault, one without, bags, and what goes wrong."""

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from poise.cli import run
from poise.errors import ErrorCode
from poise_msgs.msg import MismatchReport

pytestmark = pytest.mark.ros
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FEW = ["sensor_bias", "clock_offset", "flywheel"]
PATIENCE = 120.0
"""s: an examination takes its time on a machine that does other things."""
ARM = {"mode": "arm", "robot": "ridgeback_ur10", "trajectory": "fourier", "duration": 400.0, "rate": 2.0, "seed": 5}
PAYLOAD = {"payload.mass": 2.0, "payload.com": [0.0, 0.0, 0.1], "payload.inertia": [0.01, 0.0, 0.0, 0.01, 0.0, 0.01]}


@pytest.fixture
def model(tmp_path):
    """The nominal model of that payload."""
    path = tmp_path / "model.yaml"
    payload = {"mass": 2.0, "com": [0, 0, 0.1], "inertia": [0.01, 0, 0, 0.01, 0, 0.01]}
    path.write_text(yaml.safe_dump({"sensor_frame": "ft_sensor", "payload": payload}))
    return path


def diagnoser(start_node, model, **params):
    own = {"model": str(model), "window": 12.0, "period": 0.5, "share": 1.0, "effects": FEW}
    return start_node("mismatch_diagnoser", own | params)


@pytest.mark.parametrize("bias", [[0.0] * 6, [0.0, 4.0, 0.0, 0.0, 0.0, 0.2]])
def test_a_running_robot_is_examined(graph, start_node, model, bias):
    """A bias is named with its size; without one there is nothing to name in the wrench."""
    reports = graph.collect("mismatch_report", MismatchReport, LATCHED)
    states = graph.collect("/diagnostics", DiagnosticArray)
    diagnoser(start_node, model)
    start_node("fake_robot", ARM | PAYLOAD | {"sensor_bias": bias})
    graph.wait_for(lambda: reports, PATIENCE, "a report")
    report = reports[0]
    assert report.error.code == ErrorCode.OK, report.error.message
    assert report.header.frame_id == "ft_sensor"
    assert report.header.stamp.sec > 0
    named = {effect.name: effect for effect in report.effects}
    if any(bias):
        effect = named["sensor_bias"]
        size = dict(zip(effect.parameter_names, effect.parameter_values, strict=True))
        assert size["force_y"] == pytest.approx(4.0, abs=0.3)
        assert size["torque_z"] == pytest.approx(0.2, abs=0.05)
        assert effect.probability > 0.9
        assert report.holdout_augmented < 1.5
    else:
        assert not named
        assert report.verdict == MismatchReport.VERDICT_NONE
    graph.wait_for(lambda: any("window_seconds" in str(each) for each in states), what="diagnostics")


def test_without_a_sensor_the_joint_efforts_are_examined(graph, start_node, model):
    """No wrench has a publisher: the window is that of the joint states."""
    reports = graph.collect("mismatch_report", MismatchReport, LATCHED)
    diagnoser(start_node, model, effects=["viscous_friction"])
    start_node("fake_robot", ARM | PAYLOAD, remaps={"wrench": "another_wrench"})
    graph.wait_for(lambda: reports, PATIENCE, "a report")
    assert reports[0].error.code == ErrorCode.OK, reports[0].error.message
    assert reports[0].header.frame_id == "ft_sensor"
    assert not reports[0].effects


def test_bags_are_diagnosed_once_and_the_report_stays_for_who_joins_later(graph, start_node, model, tmp_path):
    augmented, excite, bag, saved = (tmp_path / name for name in ("a.yaml", "e.yaml", "run.mcap", "saved.yaml"))
    content = yaml.safe_load(model.read_text())
    bias = {"force_x": -3.0} | dict.fromkeys(("force_y", "force_z", "torque_x", "torque_y", "torque_z"), 0.0)
    content["effects"] = [{"name": "sensor_bias", "parameters": bias}]
    augmented.write_text(yaml.safe_dump(content))
    excite.write_text("{fourier: {seed: 3, duration: 14, speed: 0.3}}")
    options = ["--motion", str(excite), "--urdf", "ridgeback_ur10", "--noise", "--out", str(bag)]
    assert run(["simulate", str(augmented), *options]) == 0
    diagnoser(start_node, model, bags=[str(bag)], save=str(saved))
    graph.wait_for(saved.exists, PATIENCE, "the augmented model")
    reports = graph.collect("mismatch_report", MismatchReport, LATCHED)
    graph.wait_for(lambda: reports, PATIENCE, "the report")
    assert [effect.name for effect in reports[0].effects] == ["sensor_bias"]
    assert reports[0].verdict == MismatchReport.VERDICT_NAMED
    found = {entry["name"]: entry["parameters"] for entry in yaml.safe_load(saved.read_text())["effects"]}
    assert found["sensor_bias"]["force_x"] == pytest.approx(-3.0, abs=0.3)


def test_a_robot_description_without_the_sensor_is_a_report_with_a_code(graph, start_node, model):
    """And the node goes on, and ends at the first Ctrl-C (the fixture sees to that)."""
    reports = graph.collect("mismatch_report", MismatchReport, LATCHED)
    diagnoser(start_node, model)
    publisher = graph.node.create_publisher(String, "robot_description", LATCHED)
    publisher.publish(String(data="<robot name='r'><link name='base'/></robot>"))
    start_node("fake_robot", ARM | PAYLOAD, remaps={"robot_description": "another_description"})
    graph.wait_for(lambda: reports, PATIENCE, "a report")
    assert reports[0].error.code == ErrorCode.FRAME_UNKNOWN
    assert "ft_sensor" in reports[0].error.message
    assert np.isnan(reports[0].holdout_nominal)


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ({"effects": ["gremlins"]}, "gremlins"),
        ({"model": "/nowhere/model.yaml"}, "/nowhere"),
        ({"window": 1.0}, "window"),
        ({"wrench": "perhaps"}, "perhaps"),
    ],
)
def test_what_makes_no_sense_ends_the_node_with_one_line(graph, start_node, params, words):
    node = start_node("mismatch_diagnoser", params)
    graph.wait_for(lambda: node.process.poll() is not None, what="the end of the node")
    assert node.wait() == 2
    assert words in node.output
    assert "Traceback" not in node.output


def test_a_node_in_the_midst_of_an_examination_ends_at_once(graph, start_node, model):
    node = diagnoser(start_node, model, effects=[*FEW, "slosh", "grasp_compliance", "loose_part"])
    states = graph.collect("/diagnostics", DiagnosticArray)
    start_node("fake_robot", ARM | PAYLOAD)
    graph.wait_for(
        lambda: any(each.status[0].message == "examining" for each in states if "mismatch" in each.status[0].name),
        PATIENCE,
        "an examination",
    )
    assert node.stop() == 0
