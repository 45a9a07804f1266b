"""identify_payload in a real graph: a simulated arm's payload, its speed, and goals that are cancelled or cannot be."""

import contextlib
import time

import numpy as np
import pytest
from action_caller import Caller
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode
from poise.robot import RobotModel, frame_poses
from poise_msgs.action import IdentifyPayload

pytestmark = pytest.mark.ros

MASS, COM, INERTIA = 1.6, [0.0, 0.02, 0.19], [0.009, 0.0, 0.0, 0.006, 0.001, 0.005]
RADIUS = 0.12
ARM = {"mode": "arm", "robot": "fr3", "sensor": "ft300", "payload.mass": MASS, "payload.com": COM}
ARM |= {"payload.inertia": INERTIA}
NODE = {"tcp_frame": "tcp", "object_radius": RADIUS}
NODE |= {"stop_unattended": 60.0, "stop_silence": 5.0, "motion_lead": 0.5}  # on machines that do other things
NODE |= {"noise_linear_acceleration": 0.01, "noise_angular_acceleration": 0.05}
NODE |= {"continuous": False, "publish_rate": 0.5}  # the running estimate is not asked for here
STOP_AND_GO, EXCITATION = IdentifyPayload.Goal.MOTION_STOP_AND_GO, IdentifyPayload.Goal.MOTION_EXCITATION


@pytest.fixture
def caller(graph):
    caller = Caller(graph, IdentifyPayload, "identify_payload")
    yield caller
    caller.close()


def start_both(start_node, graph, caller, arm=ARM, node=NODE):
    robot = start_node("fake_robot", arm)
    start_node("inertial_estimator", node)
    states = graph.collect("joint_states", JointState)
    caller.ready()
    graph.wait_for(lambda: graph.node.count_subscribers("joint_trajectory") and states, what="the arm")
    graph.wait_for(lambda: graph.node.count_publishers("inertial_estimate"), what="the estimator")
    return robot, states


def wait_for_phase(graph, caller, name):
    graph.wait_for(lambda: any(one.phase == name for one in caller.feedback), what=f"phase {name}")


def wait_until_known(graph, caller):
    """Until the node has heard the robot: a goal before that is refused with a code."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        result = caller.result(caller.send(motion=IdentifyPayload.Goal.MOTION_NONE, duration=0.1)).result
        if result.error.code not in (ErrorCode.ROBOT_DESCRIPTION_MISSING, ErrorCode.TOPIC_MISSING):
            return
    pytest.fail(f"the robot stays unknown: {result.error}")


def fastest(states: list[JointState]) -> float:
    """m/s of the tool centre point or the object's surface, from the recorded joint states."""
    model = RobotModel.from_file("fr3")
    position = np.array([state.position for state in states])
    seconds = np.array([state.header.stamp.sec + state.header.stamp.nanosec * 1e-9 for state in states])
    rotation, where = frame_poses(model, position)
    directions = np.random.default_rng(0).normal(size=(100, 3))
    tcp = np.array([0.0, 0.0, 0.163])
    points = np.vstack([tcp, tcp + RADIUS * directions / np.linalg.norm(directions, axis=1)[:, None]])
    places = np.einsum("nij,pj->npi", rotation, points) + where[:, None]
    span = seconds[5:] - seconds[:-5]
    kept = span < 0.06  # no message lost in between
    return float((np.linalg.norm(places[5:] - places[:-5], axis=2).max(axis=1) / span)[kept].max())


def at_rest(states: list[JointState]) -> bool:
    late = np.array([state.position for state in states[-20:]])
    return len(late) == 20 and bool(np.ptp(late, axis=0).max() < 1e-3)


def agrees(message) -> None:
    """With the simulated payload, within the stated covariance (99.9 %)."""
    com, inertia = np.array(COM), np.array(INERTIA)[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
    about_sensor = inertia + MASS * (com @ com * np.eye(3) - np.outer(com, com))
    truth = np.array([MASS, *(MASS * com), *about_sensor[np.triu_indices(3)]])
    found, c = message.inertia, np.array([message.inertia.com.x, message.inertia.com.y, message.inertia.com.z])
    tensor = np.array(
        [[found.ixx, found.ixy, found.ixz], [found.ixy, found.iyy, found.iyz], [found.ixz, found.iyz, found.izz]]
    )
    tensor = tensor + found.m * (c @ c * np.eye(3) - np.outer(c, c))
    error = np.array([found.m, *(found.m * c), *tensor[np.triu_indices(3)]]) - truth
    covariance = np.array(message.covariance).reshape(10, 10)
    deviation = np.sqrt(np.diag(covariance))
    scaled = error / deviation
    correlation = covariance / np.outer(deviation, deviation)
    assert scaled @ np.linalg.pinv(correlation, rcond=1e-9, hermitian=True) @ scaled < 29.6
    assert found.m == pytest.approx(MASS, rel=0.02)
    np.testing.assert_allclose(c, COM, atol=0.003)


def test_a_simulated_payload_is_weighed_by_moving_slowly(start_node, graph, caller) -> None:
    _, states = start_both(start_node, graph, caller)
    wait_until_known(graph, caller)
    for motion in (EXCITATION, STOP_AND_GO):
        caller.feedback.clear()
        done = caller.result(caller.send(motion=motion))
        assert done.result.error.message == ""
        assert done.status == GoalStatus.STATUS_SUCCEEDED
        agrees(done.result.estimate)
        assert fastest(states) <= 0.25 * (1 + 5e-3)  # encoder noise is in it
        wait_for_phase(graph, caller, "settling")  # what was said last may come after the result
        phases = [one.phase for one in caller.feedback]
        assert list(dict.fromkeys(phases))[-3:] == ["planning", "moving", "settling"]
        shares = [one.progress for one in caller.feedback]
        assert shares == sorted(shares)
        assert shares[-1] >= np.float32(0.9)  # settling begins here


def test_a_cancelled_goal_leaves_the_arm_at_rest_and_a_second_one_is_busy(start_node, graph, caller) -> None:
    _, states = start_both(start_node, graph, caller)
    wait_until_known(graph, caller)
    for phase in ("planning", "moving"):
        caller.feedback.clear()
        handle = caller.send(motion=STOP_AND_GO if phase == "moving" else EXCITATION)
        second = caller.result(caller.send(motion=EXCITATION))
        assert second.status == GoalStatus.STATUS_ABORTED
        assert second.result.error.code == ErrorCode.BUSY
        wait_for_phase(graph, caller, phase)
        caller.cancel(handle)
        done = caller.result(handle)
        assert done.status == GoalStatus.STATUS_CANCELED
        assert done.result.error.code == ErrorCode.CANCELLED
        states.clear()
        graph.wait_for(lambda: at_rest(states), what="rest")
        again = caller.result(caller.send(motion=IdentifyPayload.Goal.MOTION_NONE, duration=0.5))
        assert again.result.error.code != ErrorCode.BUSY  # and the node is free again


def test_goals_that_cannot_be_are_refused_with_codes(start_node, graph, caller) -> None:
    start_node("inertial_estimator", NODE)
    caller.ready()
    done = caller.result(caller.send(motion=EXCITATION))
    assert done.status == GoalStatus.STATUS_ABORTED
    assert done.result.error.code == ErrorCode.TOPIC_MISSING
    start_node("fake_robot", ARM)
    wait_until_known(graph, caller)
    graph.wait_for(lambda: graph.node.count_subscribers("joint_trajectory"), what="the arm")
    for fields in (
        {"motion": 7},
        {"motion": EXCITATION, "method": "guess"},
        {"motion": EXCITATION, "speed_limit": 1.0},
        {"motion": EXCITATION, "duration": float("nan")},
        {"motion": EXCITATION, "duration": 200.0},
        {"motion": EXCITATION, "object_radius": -1.0},
    ):
        assert caller.result(caller.send(**fields)).result.error.code == ErrorCode.BAD_INPUT, fields
    done = caller.result(caller.send(motion=STOP_AND_GO, object_radius=100.0))
    assert done.result.error.code == ErrorCode.UNREACHABLE


def test_a_goal_waits_for_the_robot_and_an_inactive_node_takes_none(start_node, graph, caller) -> None:
    start_node("inertial_estimator", NODE)
    caller.ready()

    def change(number: int) -> None:
        request = ChangeState.Request()
        request.transition.id = number
        assert graph.call(ChangeState, "inertial_estimator/change_state", request).success

    def accepted() -> bool:
        future = caller._client.send_goal_async(IdentifyPayload.Goal())
        graph.wait_for(future.done, what="an answer")
        return future.result().accepted

    handle = caller.send(motion=IdentifyPayload.Goal.MOTION_NONE, duration=100.0)
    wait_for_phase(graph, caller, "waiting")
    start_node("fake_robot", ARM)
    wait_for_phase(graph, caller, "listening")
    change(Transition.TRANSITION_DEACTIVATE)
    done = caller.result(handle)
    assert done.result.error.code == ErrorCode.CANCELLED
    assert "deactivated" in done.result.error.message
    graph.wait_for(lambda: not accepted(), what="a rejection")
    change(Transition.TRANSITION_ACTIVATE)
    graph.wait_for(accepted, what="acceptance")


def test_a_sensor_that_falls_silent_stops_the_arm(start_node, graph, caller) -> None:
    robot, _ = start_both(start_node, graph, caller)
    wait_until_known(graph, caller)
    commands = graph.collect("joint_trajectory", JointTrajectory)
    handle = caller.send(motion=STOP_AND_GO)
    wait_for_phase(graph, caller, "moving")
    with contextlib.suppress(ProcessLookupError):
        robot.process.kill()
    done = caller.result(handle)
    assert done.result.error.code == ErrorCode.SENSOR_STALE
    graph.wait_for(lambda: len(commands) >= 2, what="the stop")
    assert not any(commands[-1].points[-1].velocities)
