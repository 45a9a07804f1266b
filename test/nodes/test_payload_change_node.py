"""inertial_estimator in a real graph, on ordinary work: a grasp on the fake robot, and the shape of what is held."""

import pytest
from geometry_msgs.msg import Inertia, Point, Vector3
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from shape_msgs.msg import Mesh

from poise.errors import ErrorCode
from poise_msgs.msg import InertialEstimate, Part, PayloadChange, SegmentedObject

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ARM = {
    "mode": "arm",
    "trajectory": "fourier",
    "duration": 60.0,
    "speed": 0.3,
    "sensor": "moderate",
    "sensor_rate": 200.0,
    "wait_for_subscribers": ["wrench", "joint_states"],
}

pytestmark = pytest.mark.ros


def ns(stamp) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


def box(label: int, centre: float, frame_sides=(0.06, 0.06, 0.04)) -> Part:
    """A box along z of the object frame."""
    x, y, z = frame_sides
    inertia = Inertia(m=1.0, com=Vector3(z=centre))
    inertia.ixx, inertia.iyy, inertia.izz = (y * y + z * z) / 12, (x * x + z * z) / 12, (x * x + y * y) / 12
    corners = [
        Point(x=sx * x, y=sy * y, z=centre + sz * z) for sx in (-0.5, 0.5) for sy in (-0.5, 0.5) for sz in (-0.5, 0.5)
    ]
    return Part(label=label, volume=x * y * z, unit_inertia=inertia, surface=Mesh(vertices=corners))


def test_a_grasp_during_ordinary_work_is_told_and_weighed_anew(start_node, graph):
    estimates = graph.collect("inertial_estimate", InertialEstimate, LATCHED)
    changes = graph.collect("payload_change", PayloadChange, LATCHED)
    start_node("inertial_estimator")
    graph.wait_for(lambda: graph.node.count_publishers("payload_change"), what="the estimator")
    start_node("fake_robot", ARM)
    graph.wait_for(lambda: estimates and estimates[-1].n_samples > 400, what="an empty hand")
    assert not changes
    before = estimates[-1]
    assert before.inertia.m < 0.05
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=0.8)
    com = ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=[0.0, 0.01, 0.1])
    request = SetParameters.Request(
        parameters=[ParameterMessage(name="payload.com", value=com), ParameterMessage(name="payload.mass", value=value)]
    )
    graph.call(SetParameters, "fake_robot/set_parameters", request)
    graph.wait_for(lambda: changes, what="the grasp")
    assert changes[0].mass_before == pytest.approx(0.0, abs=0.05)
    assert changes[0].mass_after == pytest.approx(0.8, abs=0.1)
    # By the stamps: how long ago the new payload began when it was certain. Transport comes on top.
    assert ns(changes[0].header.stamp) - ns(changes[0].since) < 0.4e9
    graph.wait_for(
        lambda: ns(estimates[-1].since) == ns(changes[0].since) and estimates[-1].n_samples > 300, 60.0, "the new one"
    )
    assert estimates[-1].inertia.m == pytest.approx(0.8, abs=0.02)
    assert len(changes) == 1


def test_the_shape_of_what_is_held_makes_up_for_what_the_motion_does_not_show(start_node, graph):
    estimates = graph.collect("inertial_estimate", InertialEstimate, LATCHED)
    shapes = graph.node.create_publisher(SegmentedObject, "segmented_object", LATCHED)
    start_node("inertial_estimator", {"continuous": False})
    graph.wait_for(shapes.get_subscription_count, what="the estimator")
    payload = {
        "payload.mass": 0.6,
        "payload.com": [0.0, 0.0, 0.1],
        "payload.inertia": [5e-4, 0.0, 0.0, 5e-4, 0.0, 4e-4],
    }
    start_node("fake_robot", {**ARM, **payload})
    graph.wait_for(lambda: estimates and estimates[-1].n_samples > 100, what="an estimate")
    assert estimates[-1].com_in_hull == InertialEstimate.COM_UNKNOWN
    held = SegmentedObject(id="two boxes", parts=[box(0, 0.08), box(1, 0.12)])
    held.header.frame_id = "ft_sensor"
    shapes.publish(held)
    graph.wait_for(
        lambda: estimates[-1].com_in_hull == InertialEstimate.COM_INSIDE and estimates[-1].n_samples > 100, 60.0, "it"
    )
    assert estimates[-1].inertia.m == pytest.approx(0.6, abs=0.02)
    assert estimates[-1].inertia.ixx == pytest.approx(5e-4, rel=0.35)
    assert estimates[-1].error.code == ErrorCode.OK


def test_a_shape_whose_place_in_the_hand_is_unknown_is_refused_by_name(start_node, graph):
    shapes = graph.node.create_publisher(SegmentedObject, "segmented_object", LATCHED)
    node = start_node("inertial_estimator", {"sensor_frame": "ft_sensor"})
    graph.wait_for(shapes.get_subscription_count, what="the estimator")
    lost = SegmentedObject(id="mug", parts=[box(0, 0.1)])
    lost.header.frame_id = "mug"
    shapes.publish(lost)
    graph.wait_for(lambda: "FRAME_UNKNOWN" in node.output and "mug" in node.output, what="the refusal")
    wrong = SegmentedObject(id="mug", parts=[box(7, 0.1)])
    wrong.header.frame_id = "ft_sensor"
    wrong.parts[0].volume = -1.0

    def reported() -> bool:
        shapes.publish(wrong)  # again and again: the log reports errors once a second at the most
        return "OBJECT_INVALID" in node.output and "part 7" in node.output

    graph.wait_for(reported, what="the part by name")


@pytest.mark.parametrize(
    ("parameters", "named"),
    [({"object": "nowhere.stl"}, "nowhere.stl"), ({"object": "x.stl", "object_pose": [0.0, 0.0]}, "object_pose")],
)
def test_an_object_that_cannot_be_used_ends_the_node_with_one_line(start_node, parameters, named):
    node = start_node("inertial_estimator", parameters)
    assert node.wait() == 2
    assert named in node.output
    assert "Traceback" not in node.output
