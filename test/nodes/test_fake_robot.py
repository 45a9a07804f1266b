"""fake_robot through the real ROS graph: bags come out as they went in, arms obey, bad input ends with one line."""

import signal
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_graph import Graph, NodeProcess
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Empty, String
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from poise.fake_robots.parameters import PARAMETERS, PAYLOAD, make_source
from poise.nodes.parameters import declare_parameters
from poise.recording import open_recording

pytestmark = pytest.mark.ros

Start = Callable[..., NodeProcess]
BAGS = Path(__file__).parents[2] / "bags"
REST, FREE = str(BAGS / "kuka_at_rest.mcap"), str(BAGS / "kuka_free_motion.mcap")
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TYPES = {"wrench": WrenchStamped, "imu": Imu, "tf": TFMessage}


def collect_raw(graph: Graph, topic: str, kind: type) -> list[tuple[float, bytes]]:
    """Subscribe to the bytes; the list grows with (time of arrival, bytes)."""
    heard: list[tuple[float, bytes]] = []
    graph.node.create_subscription(
        kind, topic, lambda data: heard.append((time.monotonic(), bytes(data))), 10_000, raw=True
    )
    return heard


def recorded(bag: str, topic: str) -> list[bytes]:
    return [message.data for message in open_recording(bag).messages([topic])]


def play(graph: Graph, start_node: Start, topics: Iterable[str], params: dict[str, Any]) -> NodeProcess:
    """Start a replay when publishers and subscribers of the topics know each other, so that no message is lost."""
    node = start_node("fake_robot", {**params, "playing": False})
    for topic in topics:
        graph.wait_for(lambda topic=topic: graph.node.count_publishers(topic), what=f"a publisher of {topic}")
    assert graph.call(SetBool, "play", SetBool.Request(data=True)).message == "playing"
    return node


def wait_for_end(graph: Graph, node: NodeProcess) -> int:
    graph.wait_for(lambda: node.process.poll() is not None, what="the end of the node")
    return node.wait()


def test_every_message_of_a_bag_arrives_in_order_and_byte_for_byte(graph: Graph, start_node: Start) -> None:
    heard = {topic: collect_raw(graph, topic, kind) for topic, kind in TYPES.items()}
    done = graph.collect("replay_done", Empty, LATCHED)
    node = play(graph, start_node, TYPES, {"bag": FREE, "rate": 6.0})
    assert wait_for_end(graph, node) == 0
    for topic in TYPES:
        sent = recorded(FREE, topic)
        graph.wait_for(lambda topic=topic, sent=sent: len(heard[topic]) >= len(sent), what=f"all of {topic}")
        assert [data for _, data in heard[topic]] == sent
    graph.wait_for(lambda: done, what="replay_done")


def test_messages_take_as_long_as_they_took(graph: Graph, start_node: Start) -> None:
    heard = collect_raw(graph, "wrench", WrenchStamped)
    begun = time.monotonic()
    node = start_node("fake_robot", {"bag": REST, "wait_for_subscribers": ["wrench"]})
    assert wait_for_end(graph, node) == 0
    assert heard
    due = [message.log_time * 1e-9 for message in open_recording(REST).messages(["wrench"])]
    assert time.monotonic() - begun > due[-1] - due[0]


def test_topics_take_a_namespace_and_remappings(graph: Graph, start_node: Start) -> None:
    heard = collect_raw(graph, "left/ft", WrenchStamped)
    start_node("fake_robot", {"bag": REST, "topics": ["wrench"], "loop": True}, {"__ns": "/left", "wrench": "ft"})
    graph.wait_for(lambda: heard, what="messages on the remapped topic")


def test_who_comes_late_still_gets_what_was_latched(graph: Graph, start_node: Start) -> None:
    done = graph.collect("replay_done", Empty, LATCHED)
    start_node("fake_robot", {"bag": REST, "rate": 10.0, "stay": True})
    graph.wait_for(lambda: done, what="replay_done")
    static = collect_raw(graph, "tf_static", TFMessage)
    assert static == []  # a volatile subscriber does not
    latched = graph.collect("tf_static", TFMessage, LATCHED)
    graph.wait_for(lambda: latched, what="tf_static")
    assert latched[0].transforms[0].child_frame_id == "imu"


def test_play_starts_pauses_and_begins_again(graph: Graph, start_node: Start) -> None:
    heard = collect_raw(graph, "wrench", WrenchStamped)
    done = graph.collect("replay_done", Empty)
    play(graph, start_node, ["wrench"], {"bag": REST, "stay": True, "rate": 0.4})  # time for a pause at any load
    graph.wait_for(lambda: len(heard) > 20, what="the first messages")
    assert graph.call(SetBool, "play", SetBool.Request(data=False)).message == "paused"
    sent = recorded(REST, "wrench")
    assert len(heard) < len(sent)
    assert not done
    graph.call(SetBool, "play", SetBool.Request(data=True))
    graph.wait_for(lambda: done, what="the end")
    graph.wait_for(lambda: len(heard) >= len(sent), what="all messages")
    assert [data for _, data in heard] == sent
    graph.call(SetBool, "play", SetBool.Request(data=True))
    graph.wait_for(lambda: len(heard) >= 2 * len(sent), what="all messages again")
    assert [data for _, data in heard[: 2 * len(sent)]] == sent * 2


def test_a_loop_goes_on(graph: Graph, start_node: Start) -> None:
    heard = collect_raw(graph, "wrench", WrenchStamped)
    play(graph, start_node, ["wrench"], {"bag": REST, "rate": 4.0, "loop": True})
    sent = recorded(REST, "wrench")
    graph.wait_for(lambda: len(heard) > 2 * len(sent), what="a third turn")
    assert [data for _, data in heard[: 2 * len(sent)]] == sent * 2


def test_the_clock_runs_with_the_recording(graph: Graph, start_node: Start) -> None:
    clock = graph.collect("/clock", Clock)
    node = play(graph, start_node, ["/clock"], {"bag": REST, "rate": 2.0, "publish_clock": True})
    assert wait_for_end(graph, node) == 0
    times = np.array([message.clock.sec * 10**9 + message.clock.nanosec for message in clock])
    log = [message.log_time for message in open_recording(REST).messages()]
    # 100 Hz at twice the speed. Its publisher keeps ten messages: a busy reader misses some.
    assert np.median(np.diff(times)) == 20_000_000
    assert ((times - log[0]) % 20_000_000 == 0).all()
    assert (np.diff(times) > 0).all()
    assert log[0] <= times[0] < times[-1] <= log[-1]


def test_faults_strike_what_they_name(graph: Graph, start_node: Start) -> None:
    heard = {topic: graph.collect(topic, TYPES[topic], 10_000) for topic in ("wrench", "imu")}
    faults = ["drop: {topic: imu, share: 0.5}", "nan: {topic: wrench, start: 0.5}"]
    node = play(graph, start_node, heard, {"bag": REST, "rate": 5.0, "faults": faults})
    assert wait_for_end(graph, node) == 0
    forces = np.array([message.wrench.force.x for message in heard["wrench"]])
    assert len(forces) == len(recorded(REST, "wrench"))
    assert 0.4 < np.isnan(forces).mean() < 0.6
    assert 0.35 < len(heard["imu"]) / len(recorded(REST, "imu")) < 0.65


@pytest.mark.parametrize(
    ("params", "why"),
    [
        ({"bag": "/nowhere/a.mcap"}, "/nowhere/a.mcap"),
        ({"bag": REST, "wait_for_subscribers": ["wrench"], "wait_timeout": 0.2}, "wait_timeout"),
    ],
)
def test_bad_input_ends_with_one_line_and_status_2(start_node: Start, params: dict[str, Any], why: str) -> None:
    node = start_node("fake_robot", params)
    assert node.wait() == 2
    lines = [line for line in node.output.strip().splitlines() if not line.endswith("ready")]
    assert len(lines) == 1
    assert why in lines[0]


@pytest.mark.parametrize(
    ("params", "number"),
    [({"bag": FREE}, signal.SIGINT), ({"mode": "arm", "trajectory": "fourier"}, signal.SIGTERM)],
    ids=["bag", "arm"],
)
def test_a_signal_ends_it_cleanly(
    graph: Graph, start_node: Start, params: dict[str, Any], number: signal.Signals
) -> None:
    heard = graph.collect("wrench", WrenchStamped)
    node = start_node("fake_robot", params)
    graph.wait_for(lambda: heard, what="wrenches")
    assert node.stop(number) == 0
    assert "ready" in node.output
    assert "Traceback" not in node.output


ARM = {"mode": "arm", "robot": "xarm7", "sensor": "none", "joint_noise": 0.0, "payload.mass": 2.0}


def length(message: WrenchStamped) -> float:
    force = message.wrench.force
    return float(np.linalg.norm([force.x, force.y, force.z]))


def test_an_arm_at_rest_weighs_its_payload_and_describes_itself(graph: Graph, start_node: Start) -> None:
    heard = graph.collect("wrench", WrenchStamped)
    described = graph.collect("robot_description", String, LATCHED)
    start_node("fake_robot", ARM)
    graph.wait_for(lambda: heard and described, what="wrench and description")
    assert length(heard[0]) == pytest.approx(2.0 * 9.80665)
    assert heard[0].header.frame_id == "ft_sensor"
    assert '<robot name="xarm7">' in described[0].data


def test_an_arm_goes_where_it_is_commanded_and_refuses_what_it_cannot(graph: Graph, start_node: Start) -> None:
    states = graph.collect("joint_states", JointState)
    node = start_node("fake_robot", ARM)
    commands = graph.node.create_publisher(JointTrajectory, "joint_trajectory", 10)
    graph.wait_for(lambda: states and commands.get_subscription_count(), what="the arm")
    graph.meet()

    def go(name: str, position: float) -> None:
        point = JointTrajectoryPoint(positions=[position], time_from_start=Duration(sec=1))
        commands.publish(JointTrajectory(joint_names=[name], points=[point]))

    go("joint1", 0.4)
    at = list(states[-1].name).index("joint1")
    graph.wait_for(lambda: abs(states[-1].position[at] - 0.4) < 1e-9, what="the commanded position")
    go("elbow", 0.4)
    graph.wait_for(lambda: "no joint elbow" in node.output, what="the refusal")
    go("joint1", -0.4)
    graph.wait_for(lambda: abs(states[-1].position[at] + 0.4) < 1e-9, what="the next position")


def test_a_payload_is_grasped_while_the_arm_runs(graph: Graph, start_node: Start) -> None:
    heard = graph.collect("wrench", WrenchStamped)
    start_node("fake_robot", ARM)

    def put(mass: float) -> Any:
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=mass)
        request = SetParameters.Request(parameters=[Parameter(name="payload.mass", value=value)])
        return graph.call(SetParameters, "fake_robot/set_parameters", request).results[0]

    assert put(5.0).successful
    graph.wait_for(lambda: heard and length(heard[-1]) == pytest.approx(5.0 * 9.80665), what="five kilograms")
    assert not put(-1.0).successful


def test_a_driving_arm_says_byte_for_byte_what_its_seed_makes_and_ends(graph: Graph, start_node: Start) -> None:
    params = {
        "mode": "arm",
        "robot": "ridgeback_ur10",
        "trajectory": "fourier",
        "duration": 2.0,
        "start_time": 100.0,
        "rate": 5.0,
        "seed": 7,
    }
    kinds = {"wrench": WrenchStamped, "joint_states": JointState, "odom": Odometry}
    heard = {topic: collect_raw(graph, topic, kind) for topic, kind in kinds.items()}
    node = play(graph, start_node, kinds, params)
    assert wait_for_end(graph, node) == 0
    overrides = [rclpy.Parameter(name, value=value) for name, value in params.items()]
    same = Node("same", context=graph.node.context, parameter_overrides=overrides, start_parameter_services=False)
    expected = list(make_source(declare_parameters(same, PARAMETERS, PAYLOAD)).messages())
    same.destroy_node()
    for topic in kinds:
        made = [message.data for message in expected if message.topic == topic]
        graph.wait_for(lambda topic=topic, made=made: len(heard[topic]) >= len(made), what=f"all of {topic}")
        assert [data for _, data in heard[topic]] == made
