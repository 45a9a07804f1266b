"""inertial_estimator in a real graph: the recording's answer, a simulated arm's payload, and messages gone wrong."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped, WrenchStamped
from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from poise.errors import ErrorCode
from poise.fake_robots.bag_replay import BagSource, message_class
from poise.inertia import OnlineEstimator, identify, identify_wrenches
from poise.nodes.estimate_message import estimate_message
from poise.nodes.payload_causes import CauseSearch
from poise.recording import open_recording
from poise.robot import find_kinematics
from poise.robot.model import find_urdf
from poise_msgs.msg import InertialEstimate

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

ROOT = Path(__file__).resolve().parents[2]
STATIC = ROOT / "bags" / "kuka_static_poses.mcap"
FREE = ROOT / "bags" / "kuka_free_motion.mcap"
QUIET = 3.0
"""s: a machine that does other things holds up messages, and the estimator must not take that for their end."""

pytestmark = pytest.mark.ros


def replay(start_node, graph, bag: Path, **parameters) -> InertialEstimate:
    """Hand the messages of a bag to an estimator, as fast as it takes them, and return its last estimate."""
    estimates = graph.collect("inertial_estimate", InertialEstimate, LATCHED)
    settings = {"gravity": 9.82085, "publish_rate": 20.0, "motion_source": "tf", "flush_after": QUIET}
    start_node("inertial_estimator", settings | parameters)
    source, outlets = BagSource(bag, ["wrench", "tf", "tf_static"]), {}
    for topic, info in source.topics.items():
        qos = LATCHED if info.latched else QoSProfile(depth=5000)
        outlets[topic] = graph.node.create_publisher(message_class(info.type), topic, qos)
        graph.wait_for(outlets[topic].get_subscription_count, what=f"a subscriber of {topic}")
    graph.meet()
    client = graph.node.create_client(GetParameters, "inertial_estimator/get_parameters")
    graph.wait_for(client.service_is_ready, what="the estimator's parameters")
    since = 0
    for number, message in enumerate(source.messages()):
        outlets[message.topic].publish(message.data)
        # A burst overflows the socket, and what is sent again comes after its motion is forgotten.
        if number % 100 == 0 or message.time - since >= 10**9:
            graph.answer(client, GetParameters.Request())
            since = message.time
    expected = identify(open_recording(bag), method=parameters.get("method", "poise")).estimate.n_samples
    graph.wait_for(lambda: estimates and estimates[-1].n_samples >= expected, what=f"{expected} samples used")
    return estimates[-1]


def agrees(message: InertialEstimate, bag: Path, **options) -> None:
    """The message says what `identify` says of the same bag, to 1e-9."""
    estimate = identify(open_recording(bag), **options).estimate
    inertia, parameters = message.inertia, estimate.parameters
    for name, live, offline in (
        ("mass", [inertia.m], [parameters.mass]),
        ("com", [inertia.com.x, inertia.com.y, inertia.com.z], parameters.com),
        (
            "inertia",
            [inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz],
            parameters.inertia_vector,
        ),
        ("force bias", [message.bias.force.x, message.bias.force.y, message.bias.force.z], estimate.bias[:3]),
        ("torque bias", [message.bias.torque.x, message.bias.torque.y, message.bias.torque.z], estimate.bias[3:]),
        ("covariance", message.covariance, estimate.covariance.ravel()),
        ("bias covariance", message.bias_covariance, estimate.bias_covariance.ravel()),
        (
            "residual",
            [message.residual_force, message.residual_torque],
            [estimate.residual_force, estimate.residual_torque],
        ),
    ):
        np.testing.assert_allclose(live, offline, rtol=1e-9, atol=1e-9, err_msg=name)
    assert message.n_samples == estimate.n_samples
    assert tuple(message.unidentified) == estimate.unidentified
    assert message.method == estimate.method
    assert message.consistent == estimate.consistent
    assert message.header.frame_id == estimate.frame_id
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == estimate.stamp
    assert message.error.code == ErrorCode.OK


def test_the_static_poses_through_the_graph_are_the_offline_answer_to_1e_9(start_node, graph):
    message = replay(start_node, graph, STATIC, method="auto")
    agrees(message, STATIC, method="auto")
    assert message.inertia.m == pytest.approx(0.9323, abs=0.005)
    assert message.inertia.com.z == pytest.approx(0.0439, abs=0.001)
    assert np.isnan(message.inertia.ixx)
    assert not message.rejected


def test_by_default_the_node_gives_the_answer_of_poise_identify_to_1e_9(start_node, graph):
    message = replay(start_node, graph, STATIC)
    assert message.method == "poise"
    agrees(message, STATIC)


def test_a_motion_through_the_graph_is_the_offline_answer_to_1e_9(start_node, graph):
    agrees(replay(start_node, graph, FREE, method="ols"), FREE, method="ols")


def test_a_wrench_that_no_payload_explains_is_published_as_an_error_without_numbers():
    """The message says what is wrong; no reader can take the numbers for a payload."""
    recording = open_recording(STATIC)
    wrench = recording.wrench("wrench")
    turned = replace(wrench, wrench_in_sensor=wrench.wrench_in_sensor[:, [1, 2, 0, 4, 5, 3]])
    kinematics = find_kinematics(recording, wrench.frame_id)
    answer = identify_wrenches(turned, kinematics, OnlineEstimator(kinematics.source, frame_id=wrench.frame_id))
    message = estimate_message(answer.estimate)
    assert message.error.code == ErrorCode.POOR_FIT
    assert ErrorCode.POOR_FIT in [finding.code for finding in message.findings]
    assert np.isnan([message.inertia.m, *message.covariance]).all()


def test_an_identification_on_request_names_the_cause_and_withholds_the_number():
    """A sensor that is turned by 90 degrees about z, in the answer of identify_payload."""
    recording = open_recording(STATIC)
    wrench = recording.wrench("wrench")
    rows = wrench.wrench_in_sensor[:, [1, 0, 2, 4, 3, 5]] * [1, -1, 1, 1, -1, 1]
    kinematics = find_kinematics(recording, wrench.frame_id)
    estimator = OnlineEstimator(kinematics.source, frame_id=wrench.frame_id)
    answer = identify_wrenches(replace(wrench, wrench_in_sensor=rows), kinematics, estimator)
    search = CauseSearch()
    while not search.done(answer.estimate):
        pass
    message = search.take().message
    assert message.error.code == ErrorCode.SENSOR_ROTATED
    assert message.findings[0].code == ErrorCode.SENSOR_ROTATED
    assert np.isnan(message.inertia.m)


def test_the_payload_of_a_simulated_arm_is_weighed_from_its_joint_states(start_node, graph):
    estimates = graph.collect("inertial_estimate", InertialEstimate, LATCHED)
    diagnostics = graph.collect("/diagnostics", DiagnosticArray)
    start_node("inertial_estimator", {"method": "ols"})
    graph.wait_for(lambda: graph.node.count_publishers("inertial_estimate"), what="the estimator")
    com, inertia = [0.02, -0.01, 0.12], [0.004, 0.0, 0.0, 0.005, 0.0, 0.003]
    payload = {"payload.mass": 1.5, "payload.com": com, "payload.inertia": inertia}
    # The motion is long and in real time: what waits during a pause of a busy machine does not fill the queues.
    arm = {"mode": "arm", "trajectory": "fourier", "duration": 60.0, "speed": 0.6, **payload}
    start_node("fake_robot", {**arm, "wait_for_subscribers": ["wrench", "joint_states"]})
    graph.wait_for(
        lambda: estimates and not estimates[-1].unidentified and estimates[-1].n_samples > 700, what="all parameters"
    )
    found = estimates[-1].inertia
    assert found.m == pytest.approx(1.5, rel=0.01)
    np.testing.assert_allclose([found.com.x, found.com.y, found.com.z], com, atol=0.001)
    np.testing.assert_allclose([found.ixx, found.iyy, found.izz], [0.004, 0.005, 0.003], rtol=0.1)
    assert estimates[-1].consistent
    healthy = graph.wait_for(  # on a busy machine some messages arrive late, and a status says so
        lambda: [found for message in diagnostics if (found := status([message]))["level"] == 0],
        what="healthy diagnostics",
    )
    assert healthy[-1]["motion"].startswith("joint_states")


# -- messages gone wrong -----------------------------------------------------------------------------------------


def status(diagnostics) -> dict:
    """What the diagnostics said last."""
    for message in reversed(diagnostics):
        for entry in message.status:
            if entry.name == "inertial_estimator":
                values = {value.key: value.value for value in entry.values}
                return {"level": entry.level[0], "message": entry.message, **values}
    return {"level": -1, "message": ""}


def seconds(estimate: InertialEstimate) -> float:
    """Stamp of the newest sample used."""
    return estimate.header.stamp.sec + estimate.header.stamp.nanosec * 1e-9


class Feeder:
    """Publishes made-up messages of a sensor that is turned about at 100 Hz, faster than real time."""

    def __init__(self, graph) -> None:
        self.graph, node = graph, graph.node
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.wrench = node.create_publisher(WrenchStamped, "wrench", 2000)
        self.tf = node.create_publisher(TFMessage, "tf", 2000)
        self.joints = node.create_publisher(JointState, "joint_states", 2000)
        self.description = node.create_publisher(String, "robot_description", latched)
        for publisher in (self.wrench, self.tf, self.joints, self.description):
            graph.wait_for(publisher.get_subscription_count, what="the estimator's subscriptions")
        graph.meet()
        self.rng = np.random.default_rng(0)

    def hold(
        self, poses: range, seconds: float = 0.5, start: int = 1000, wrench=None, frame: str = "ft_sensor"
    ) -> None:
        """Hold still in one attitude after another, about x and y in turns, under a weight of 1 kg."""
        for number in poses:
            angle = 0.7 * number
            axis = number % 2
            turn = [np.sin(angle / 2) * (axis == 0), np.sin(angle / 2) * (axis == 1), 0.0, np.cos(angle / 2)]
            x, y, _, w = turn
            down = np.array([2 * w * y, -2 * w * x, -(1 - 2 * (x * x + y * y))]) * 9.80665
            for k in range(round(seconds * 100)):
                stamp = start * 10**9 + round((number * seconds + 0.01 * k) * 1e9)
                self._transform(stamp, turn)
                force = down + self.rng.normal(0.0, 0.05, 3)
                values = np.concatenate([force, np.cross([0, 0, 0.05], force)]) if wrench is None else wrench
                self._wrench(stamp + 5_000_000, values, frame)
            self.graph.meet()  # the node has taken all of it: no topic runs ahead of the other by more

    def _transform(self, stamp: int, quaternion) -> None:
        message = TransformStamped(child_frame_id="ft_sensor")
        message.header.frame_id = "base"
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        rotation, translation = message.transform.rotation, message.transform.translation
        rotation.x, rotation.y, rotation.z, rotation.w = (float(value) for value in quaternion)
        translation.x = 0.5
        self.tf.publish(TFMessage(transforms=[message]))

    def _wrench(self, stamp: int, values, frame: str) -> None:
        message = WrenchStamped()
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = (float(value) for value in values)
        self.wrench.publish(message)


@pytest.fixture
def watched(start_node, graph):
    """A static estimator that reads tf, a feeder for it, its estimates and its diagnostics."""
    estimates = graph.collect("inertial_estimate", InertialEstimate, LATCHED)
    diagnostics = graph.collect("/diagnostics", DiagnosticArray)
    parameters = {"method": "static", "motion_source": "tf", "max_force": 200.0, "flush_after": QUIET}
    start_node("inertial_estimator", parameters)
    return Feeder(graph), estimates, diagnostics


def test_wrenches_that_are_no_numbers_saturated_or_of_another_sensor_never_reach_the_estimate(watched, graph):
    feeder, estimates, diagnostics = watched
    feeder.hold(range(6))
    graph.wait_for(lambda: estimates and not np.isnan(estimates[-1].inertia.m), what="an estimate")
    feeder.hold(range(6, 8), wrench=[np.nan] * 6)
    feeder.hold(range(8, 10), wrench=[0.0, 0.0, 250.0, 0.0, 0.0, 0.0])
    feeder.hold(range(10, 12), wrench=[100.0] * 6, frame="other_sensor")
    feeder.hold(range(12, 15))
    graph.wait_for(lambda: status(diagnostics).get("wrenches_of_other_frames") == "100", what="all counted")
    graph.wait_for(lambda: seconds(estimates[-1]) > 1007.3, what="the last samples")
    last = estimates[-1]
    assert last.inertia.m == pytest.approx(1.0, abs=0.01)
    assert last.inertia.com.z == pytest.approx(0.05, abs=0.001)
    # On a busy machine joint states may come too late for some wrenches: these are stale.
    reasons = {span.reason: span.samples for span in last.rejected if span.reason not in ("moving", "stale")}
    assert reasons == {"not_finite": 100, "saturated": 100}


def test_when_the_clock_is_set_back_the_estimate_goes_on_and_the_jump_is_told(watched, graph):
    feeder, estimates, diagnostics = watched
    feeder.hold(range(6))
    graph.wait_for(lambda: estimates and seconds(estimates[-1]) > 1002.8, what="an estimate")
    before = estimates[-1].n_samples
    feeder.hold(range(6), start=500)
    graph.wait_for(lambda: 502.8 < seconds(estimates[-1]) < 600, what="samples of the new time")
    assert estimates[-1].n_samples > before + 150
    assert estimates[-1].inertia.m == pytest.approx(1.0, abs=0.01)
    graph.wait_for(lambda: int(status(diagnostics).get("clock_jumps", 0)) >= 1, what="the jump")


def test_a_reset_forgets_the_payload(watched, graph):
    feeder, estimates, _ = watched
    feeder.hold(range(6))
    graph.wait_for(lambda: estimates and seconds(estimates[-1]) > 1002.8, what="an estimate")
    before = estimates[-1].n_samples
    response = graph.call(Trigger, "reset_estimate", Trigger.Request())
    assert response.success
    assert "samples" in response.message
    feeder.hold(range(20, 26))
    graph.wait_for(lambda: seconds(estimates[-1]) > 1012.8, what="the second payload")
    assert estimates[-1].n_samples < 1.3 * before


def test_before_there_is_an_answer_the_message_says_why_and_holds_no_number(watched, graph):
    feeder, estimates, _ = watched
    feeder.hold(range(1), seconds=1.0)
    graph.wait_for(lambda: estimates, what="a message")
    assert estimates[-1].error.code == ErrorCode.NOT_IDENTIFIABLE
    assert "attitudes" in estimates[-1].error.message
    assert np.isnan(estimates[-1].inertia.m)
    assert np.isnan(estimates[-1].covariance).all()


def test_joint_states_of_another_robot_are_not_read_as_this_ones(start_node, graph):
    diagnostics = graph.collect("/diagnostics", DiagnosticArray)
    estimates = graph.collect("inertial_estimate", InertialEstimate, LATCHED)
    start_node("inertial_estimator", {"motion_source": "joint_states"})
    feeder = Feeder(graph)
    feeder.description.publish(String(data=find_urdf("fr3").read_text()))
    for k in range(50):
        message = JointState(name=["left_wheel", "right_wheel"], position=[0.1, 0.2])
        message.header.stamp.sec = 1000
        message.header.stamp.nanosec = k * 10_000_000
        feeder.joints.publish(message)
    feeder.hold(range(1))
    graph.wait_for(lambda: "fr3_joint1" in status(diagnostics)["message"], what="the missing joints by name")
    assert status(diagnostics)["level"] == 2
    assert not estimates


@pytest.mark.parametrize(
    ("description", "named"),
    [("<robot", "XML"), (find_urdf("fr3").read_text().replace("ft_sensor", "wrist"), "ft_sensor")],
)
def test_a_robot_description_that_cannot_be_used_is_told(start_node, graph, description, named):
    diagnostics = graph.collect("/diagnostics", DiagnosticArray)
    node = start_node("inertial_estimator", {"motion_source": "joint_states"})
    feeder = Feeder(graph)
    feeder.description.publish(String(data=description))
    feeder.hold(range(1))
    graph.wait_for(lambda: named in status(diagnostics)["message"], what=f"{named} in the diagnostics")
    assert node.process.poll() is None


def test_without_wrench_and_without_kinematics_the_diagnostics_say_what_is_missing(start_node, graph):
    diagnostics = graph.collect("/diagnostics", DiagnosticArray)
    start_node("inertial_estimator")
    graph.wait_for(lambda: "no wrench yet" in status(diagnostics)["message"], what="no wrench")
    publisher = graph.node.create_publisher(WrenchStamped, "wrench", 10)
    graph.wait_for(publisher.get_subscription_count, what="the estimator")
    graph.meet()
    message = WrenchStamped()
    message.header.frame_id = "ft_sensor"
    publisher.publish(message)
    graph.wait_for(lambda: "nothing says how ft_sensor moves" in status(diagnostics)["message"], what="no kinematics")


@pytest.mark.parametrize(
    ("parameters", "named"),
    [
        ({"method": "magic"}, "magic"),
        ({"publish_rate": "fast"}, "publish_rate"),
    ],
)
def test_senseless_parameters_end_the_node_with_one_line_and_status_2(start_node, parameters, named):
    node = start_node("inertial_estimator", parameters)
    assert node.wait() == 2
    lines = [line for line in node.output.splitlines() if "BAD_INPUT" in line]
    assert len(lines) == 1
    assert named in lines[0]
    assert "Traceback" not in node.output


def test_the_parameter_file_holds_every_parameter_with_its_default(start_node, graph):
    file = ROOT / "config" / "inertial_estimator.yaml"
    (written,) = yaml.safe_load(file.read_text()).values()
    values = written["inertial_estimator"]["ros__parameters"]
    start_node("inertial_estimator")
    request = GetParameters.Request(names=list(values))
    response = graph.call(GetParameters, "inertial_estimator/get_parameters", request)
    defaults = [rclpy.parameter.parameter_value_to_python(value) for value in response.values]
    assert dict(zip(values, defaults, strict=True)) == values


def test_the_parameter_file_is_taken(start_node, graph, tmp_path):
    changed = (ROOT / "config" / "inertial_estimator.yaml").read_text().replace("gravity: 9.80665", "gravity: 9.5")
    file = tmp_path / "changed.yaml"
    file.write_text(changed)
    start_node("inertial_estimator", arguments=["--ros-args", "--params-file", str(file)])
    request = GetParameters.Request(names=["gravity"])
    response = graph.call(GetParameters, "inertial_estimator/get_parameters", request)
    assert response.values[0].double_value == 9.5
