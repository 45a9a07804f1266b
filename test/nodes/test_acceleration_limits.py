"""acceleration_limits in a real graph: closed forms, and what it says when assembly, payload or base change."""

import json
import math
import os
import signal
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from assembly_calls import CUBE, FRAME, LATCHED, LID, box, message
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message

from poise.assembly import acceleration_limits
from poise.errors import ErrorCode
from poise.nodes.acceleration_limits import AccelerationLimitsNode
from poise.nodes.acceleration_worker import AccelerationWorker, limits_of
from poise.nodes.assembly_message import assembly_of
from poise_msgs.msg import AccelerationLimits, Assembly, InertialEstimate
from poise_msgs.msg import ErrorCode as ErrorCodeMessage

pytestmark = pytest.mark.ros
G, MU = 9.80665, 0.5


@pytest.fixture
def limits(start_node, graph):
    """Start the node with parameters; return the list of what it publishes, and a publisher of assemblies."""

    def start(parameters=None):
        values = {"azimuths": 8, "rate": 50.0, **(parameters or {})}
        start.pid = start_node("acceleration_limits", values).process.pid
        found = graph.collect("acceleration_limits", AccelerationLimits, LATCHED)
        graph.wait_for(lambda: graph.node.count_publishers("acceleration_limits"), what="the node")
        return found, graph.node.create_publisher(Assembly, "assembly", LATCHED)

    return start


def newest(graph, found, holds, what):
    """The first message, from now on, for which a condition holds."""
    return graph.wait_for(lambda: found and holds(found[-1]) and found[-1], what=what)


def test_the_limits_follow_the_assembly_and_say_when_it_does_not_stand(limits, graph):
    found, assemblies = limits({"longest_contacts": 3.0})
    assemblies.publish(message(CUBE))
    alone = newest(graph, found, lambda said: said.limits, "limits")
    # The cube slides at mu g, before it topples at g.
    np.testing.assert_allclose(alone.limits, MU * G, rtol=1e-3)
    np.testing.assert_allclose(alone.azimuths, np.arange(8) * math.pi / 4)
    np.testing.assert_allclose(alone.tilts, math.atan(MU), rtol=1e-3)
    assert {tuple(movers.ids) for movers in alone.first_to_move} == {("cube",)}
    assert (alone.header.frame_id, alone.error.code) == (FRAME, ErrorCode.OK)
    for normal, offset in zip(alone.normals, alone.offsets, strict=True):
        assert normal.x * MU * G * 0.999 <= offset + 1e-9
    # A tall block topples: width / height g.
    assemblies.publish(message(CUBE, box("post", (0.1, 0.1, 0.4), (0, 0, 1.2))))
    tall = newest(
        graph, found, lambda said: said.limits and "post" in said.first_to_move[0].ids, "the post to move first"
    )
    assert tall.limits[0] == pytest.approx(G * 0.1 / 0.4, rel=1e-3)
    assemblies.publish(message(CUBE, box("ledge", (1, 1, 0.2), (0.7, 0, 1.1))))
    fallen = newest(graph, found, lambda said: said.error.code == ErrorCode.UNSTABLE, "UNSTABLE")
    assert list(fallen.limits) == [0.0] * 8
    assert "ledge" in fallen.error.message
    assemblies.publish(message(box("cube", (1, 1, 1), (0, 0, 0.4))))
    overlap = newest(graph, found, lambda said: said.error.code == ErrorCode.INTERPENETRATION, "INTERPENETRATION")
    assert not overlap.limits
    assemblies.publish(message(CUBE, LID))
    newest(graph, found, lambda said: said.error.code == ErrorCode.OK, "limits again")
    # A computation that hangs: the node answers, says that the limits are late, and stops its process.
    hung = offspring(limits.pid)
    for process in hung:
        os.kill(process, signal.SIGSTOP)
    assemblies.publish(message(CUBE))
    late = newest(graph, found, lambda said: said.error.code == ErrorCode.DEADLINE, "DEADLINE")
    assert "still being computed" in late.error.message
    assert not late.limits
    assert graph.set_parameters("acceleration_limits", turning_speed=0.3, longest_contacts=60.0) == [True, True]
    assert graph.set_parameters("acceleration_limits", turning_speed=1e9, longest=math.nan) == [False, False]
    os.kill(hung[0], signal.SIGCONT)  # the template; the worker stays as it is
    newest(graph, found, lambda said: "before anything was certified" in said.error.message, "the end of the wait")
    assemblies.publish(message(CUBE))
    turned = newest(graph, found, lambda said: said.error.code == ErrorCode.OK, "limits of a new process")
    assert turned.turning_speed == 0.3


def offspring(process):
    """Process ids of the children of a process, and of theirs."""
    found = []
    for task in Path(f"/proc/{process}/task").iterdir():
        for child in map(int, (task / "children").read_text().split()):
            found += [child, *offspring(child)]
    return found


def test_limits_pass_from_the_worker_as_they_are():
    worker = AccelerationWorker([], "lid", [0.0] * 6 + [1.0])
    asked = {"do": "solve", "gravity": [0.0, 0.0, -9.81], "azimuths": 8, "longest": 10.0, "axis": [-1.0, 0.0]}
    assert worker(asked, [])[0]["error"][0] == ErrorCode.INTERNAL  # nothing is held
    held, _ = worker({"do": "hold"}, [serialize_message(message(CUBE, LID))])
    assert (held["frame"], held["payload"]) == (FRAME, True)
    answer, _ = worker({**asked, "gravity": held["gravity"]}, [])
    found = limits_of(json.loads(json.dumps(answer["limits"])))
    expected = acceleration_limits(assembly_of(message(CUBE, LID)), 8, axis=[-1.0, 0.0])
    for name in (
        "directions",
        "limits",
        "normals",
        "offsets",
        "first_to_move",
        "angular_speed",
        "angular_acceleration",
        "complete",
        "doubtful",
    ):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for serialized, code in ((b"cut", ErrorCode.BAD_INPUT), (serialize_message(Assembly()), ErrorCode.BAD_INPUT)):
        assert worker({"do": "hold"}, [serialized])[0]["error"][0] == code
    assert worker(asked, [])[0]["error"][0] == ErrorCode.INTERNAL  # nor the one before


def test_a_weighed_payload_moves_the_limits(limits, graph):
    found, assemblies = limits({"payload": "lid", "payload_pose": [0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]})
    assemblies.publish(
        message(box("cube", (0.4, 1, 1), (0, 0, 0.5)), box("lid", (0.4, 1, 0.2), (0, 0, 1.1)), friction=2.0)
    )
    before = newest(graph, found, lambda said: said.limits, "limits")
    # Together 1.2 high, the centre of mass at 0.6: topples at g w / h; a lid of 3 kg lifts it to (0.5 + 3 * 1.15) / 4.
    assert before.limits[0] == pytest.approx(G * 0.2 / 0.8, rel=1e-3)
    estimates = graph.node.create_publisher(InertialEstimate, "inertial_estimate", LATCHED)
    weighed = estimate(graph, covariance=np.full(100, math.nan))
    weighed.inertia.m, weighed.inertia.com.z = 3.0, 0.35
    weighed.inertia.ixx = math.nan
    estimates.publish(weighed)
    after = newest(graph, found, lambda said: said.limits and said.limits[0] != before.limits[0], "the payload")
    assert after.limits[0] == pytest.approx(G * 0.2 / ((0.5 + 3 * 1.15) / 4), rel=1e-3)


def estimate(graph, mass=3.0, **values):
    """Of a payload, weighed now."""
    found = InertialEstimate(consistent=True, **values)
    found.inertia.m = mass
    found.header.stamp = graph.node.get_clock().now().to_msg()
    return found


def test_the_weight_at_the_grasp_is_kept_and_no_estimate_of_an_empty_hand_replaces_it(limits, graph):
    found, assemblies = limits({"payload": "lid"})
    assemblies.publish(message(box("cube", (0.4, 1, 1), (0, 0, 0.5)), box("lid", (0.4, 1, 0.2), (0, 0, 1.1))))
    before = newest(graph, found, lambda said: said.limits, "limits")
    qos = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    estimates = graph.node.create_publisher(InertialEstimate, "inertial_estimate", qos)
    graph.wait_for(estimates.get_subscription_count, what="the node")
    graph.meet()
    old = estimate(graph, 9.0)
    old.header.stamp.sec -= 60
    for unusable in (
        estimate(graph, 9.0, unidentified=["m"]),
        estimate(graph, 9.0, findings=[ErrorCodeMessage(code=ErrorCode.NOT_IDENTIFIABLE)]),
        estimate(graph, -9.0),
        estimate(graph, 9.0, error=ErrorCodeMessage(code=ErrorCode.SENSOR_STALE)),
        old,
    ):
        estimates.publish(unusable)
    inconsistent = estimate(graph, 9.0)
    inconsistent.consistent = False
    estimates.publish(inconsistent)
    held = estimate(graph, unidentified=["cx", "cy", "cz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"])
    held.inertia.com.x = 5.0
    held.since.sec = 100
    estimates.publish(held)
    # Of the grasped lid the mass alone is known: cube and lid topple together, about their common centre of mass.
    grasped = newest(graph, found, lambda said: said.limits and said.limits[0] != before.limits[0], "the payload")
    lid, cube = 3.0 * 1.1, 1.0 * 0.5
    assert grasped.limits[0] == pytest.approx(min(MU * G, G * 0.2 / ((lid + cube) / 4)), rel=1e-3)
    released = estimate(graph, 2e-5)
    released.since.sec = 200
    estimates.publish(released)
    assemblies.publish(message(box("cube", (0.4, 1, 1), (0, 0, 0.5)), box("lid", (0.4, 1, 0.2), (0, 0, 1.1))))
    count = len(found)
    again = newest(graph, found, lambda said: len(found) > count and said.limits, "limits of the next assembly")
    np.testing.assert_allclose(again.limits, grasped.limits, rtol=1e-9)


def test_a_tilted_and_turning_base_leaves_less(limits, graph):
    found, assemblies = limits({"from_odom": True, "odom_age": 60.0, "axis": [-1.0, 0.0]})
    assemblies.publish(message(CUBE))
    unknown = newest(graph, found, lambda said: said.error.code == ErrorCode.TOPIC_MISSING, "the lack of odom")
    assert not unknown.limits
    # By best effort, as simulators and drivers of bases publish it.
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    odometry = graph.node.create_publisher(Odometry, "odom", best_effort)
    graph.wait_for(odometry.get_subscription_count, what="the node at odom")
    graph.meet()
    odometry.publish(Odometry())
    still = newest(graph, found, lambda said: said.limits, "limits")
    # One metre from the axis: mu g = omega^2 r; toppling comes later.
    assert still.angular_speed == pytest.approx(math.sqrt(MU * G), rel=0.02)
    turning = Odometry()
    turning.twist.twist.angular.z = 1.0
    odometry.publish(turning)
    reduced = newest(graph, found, lambda said: said.turning_speed == 1.0, "the turning")
    left = 1 - 1 / still.angular_speed**2
    np.testing.assert_allclose(reduced.limits, left * np.array(still.limits), rtol=1e-9)
    np.testing.assert_allclose(reduced.offsets, left * np.array(still.offsets), rtol=1e-9)
    # Nose up by 0.2 rad: less is left forwards than backwards.
    tilted = Odometry()
    tilted.pose.pose.orientation.y, tilted.pose.pose.orientation.w = -math.sin(0.1), math.cos(0.1)
    odometry.publish(tilted)
    uphill = newest(graph, found, lambda said: said.turning_speed == 0.0 and said is not still, "the tilt")
    slope, level = math.tan(0.2), G * math.cos(0.2)
    assert uphill.limits[0] == pytest.approx(level * (MU - slope), rel=2e-3)
    assert uphill.limits[4] == pytest.approx(level * (MU + slope), rel=2e-3)
    tilted.twist.twist.angular.z = 50.0
    odometry.publish(tilted)
    thrown = newest(graph, found, lambda said: said.error.code == ErrorCode.UNSTABLE, "UNSTABLE")
    assert set(thrown.limits) == {0.0}
    assert "more slowly" in thrown.error.message
    assert graph.set_parameters("acceleration_limits", odom_age=0.1) == [True]
    silent = newest(graph, found, lambda said: said.error.code == ErrorCode.SENSOR_STALE, "the end of odom")
    assert not silent.limits


def test_limits_of_an_assembly_that_was_replaced_meanwhile_are_withheld():
    """Their stamp would be later than that of the assembly which they are not of."""
    published = []
    node = SimpleNamespace(
        _solved=lambda *_: "limits",
        _lock=threading.Lock(),
        _assemblies=1,
        _publish=lambda _: published.append(ErrorCode.OK),
        _publisher=SimpleNamespace(publish=lambda error: published.append(error.code)),
        _message=lambda error: error,
    )
    inputs = SimpleNamespace(assembly=1, base=None)
    AccelerationLimitsNode._compute(node, inputs, b"", [])
    node._assemblies = 2
    AccelerationLimitsNode._compute(node, inputs, b"", [])
    assert published == [ErrorCode.OK, ErrorCode.DEADLINE]
    assert node._limits is None
