"""fake_robot through FollowJointTrajectory, as a client such as MoveIt uses it: goals, refusals, cancel."""

from collections.abc import Callable
from typing import Any

import pytest
from action_caller import Caller
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from ros_graph import Graph, NodeProcess
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

pytestmark = pytest.mark.ros

Start = Callable[..., NodeProcess]
ACTION = "joint_trajectory_controller/follow_joint_trajectory"
ARM = {"mode": "arm", "robot": "fr3", "sensor": "none", "sensor_rate": 20.0, "joint_rate": 50.0, "joint_noise": 0.0}
NAMES = [f"fr3_joint{i}" for i in range(1, 8)]
HOME = [0.0, 0.0, 0.0, -1.61, 0.0, 2.51, 0.0]
Result = FollowJointTrajectory.Result


def trajectory(*ways: tuple[float, float], names: list[str] = NAMES, **fields: Any) -> JointTrajectory:
    """The first joint goes to positions at times, the others go home."""
    points = [
        JointTrajectoryPoint(
            positions=[position, *HOME[1:]][: len(names)],
            time_from_start=Duration(sec=int(time), nanosec=round(time % 1 * 1e9)),
        )
        for time, position in ways
    ]
    return JointTrajectory(joint_names=names, points=points, **fields)


def tolerance(position: float, name: str = NAMES[0]) -> JointTolerance:
    return JointTolerance(name=name, position=position)


@pytest.fixture
def caller(graph: Graph, start_node: Start) -> Any:
    def start(params: dict[str, Any], namespace: str) -> Caller:
        start_node("fake_robot", ARM | params, {"__ns": namespace})
        return Caller(graph, FollowJointTrajectory, f"{namespace}/{ACTION}").ready()

    return start


def ended(caller: Caller, handle: Any) -> tuple[int, int, str]:
    found = caller.result(handle)
    return found.status, found.result.error_code, found.result.error_string


def test_a_client_moves_the_arm_and_gets_a_code_for_what_cannot_be(graph: Graph, caller: Any) -> None:
    states = graph.collect("/a/joint_states", JointState)
    arm = caller({}, "/a")
    goal = trajectory((0.0, 0.0), (0.3, 0.1), (0.8, 0.3))
    handle = arm.send(trajectory=goal, goal_tolerance=[tolerance(0.001)], path_tolerance=[tolerance(0.001)])
    assert ended(arm, handle) == (GoalStatus.STATUS_SUCCEEDED, Result.SUCCESSFUL, "")
    graph.wait_for(lambda: states[-1].position[0] == pytest.approx(0.3), what="the goal")
    graph.wait_for(lambda: len(arm.feedback) >= 2, what="feedback")
    assert list(arm.feedback[-1].joint_names) == NAMES
    assert arm.feedback[-1].desired.positions == arm.feedback[-1].actual.positions
    refused: list[tuple[JointTrajectory, dict[str, Any], int, str]] = [
        (JointTrajectory(), {}, Result.INVALID_JOINTS, "lacks fr3_joint1"),
        (trajectory(), {}, Result.INVALID_GOAL, "no points"),
        (trajectory((1.0, 0.1), names=NAMES[:6]), {}, Result.INVALID_JOINTS, "lacks fr3_joint7"),
        (trajectory((1.0, 0.1), names=[*NAMES[:6], "elbow"]), {}, Result.INVALID_JOINTS, "elbow"),
        (trajectory((1.0, 0.1), names=[*NAMES[:6], NAMES[0]]), {}, Result.INVALID_JOINTS, "repeated"),
        (trajectory((1.0, 0.1), (1.0, 0.2)), {}, Result.INVALID_GOAL, "must increase"),
        (trajectory((1.0, float("nan"))), {}, Result.INVALID_GOAL, "not finite"),
        (trajectory((0.01, 2.0)), {}, Result.INVALID_GOAL, "exceeds its speed limit"),
        (trajectory((1.0, 9.0)), {}, Result.INVALID_GOAL, "leaves its range"),
        (trajectory((1.0, 0.1)), {"goal_tolerance": [tolerance(-2.0)]}, Result.INVALID_GOAL, "-2.0"),
        (trajectory((1.0, 0.1)), {"path_tolerance": [tolerance(0.1, "elbow")]}, Result.INVALID_JOINTS, "elbow"),
    ]
    old = trajectory((1.0, 0.1))
    old.header.stamp = Time(sec=1)
    refused.append((old, {}, Result.OLD_HEADER_TIMESTAMP, "ago"))
    before = states[-1].position[0]
    for goal, others, code, why in refused:
        status, found, sentence = ended(arm, arm.send(trajectory=goal, **others))
        assert (status, found) == (GoalStatus.STATUS_ABORTED, code), sentence
        assert why in sentence
    assert states[-1].position[0] == before


def test_a_cancel_stops_the_arm_and_a_new_goal_replaces_the_old_one(graph: Graph, caller: Any) -> None:
    states = graph.collect("/a/joint_states", JointState)
    arm = caller({}, "/a")
    first = arm.send(trajectory=trajectory((4.0, 1.0)))
    graph.wait_for(lambda: states and states[-1].position[0] > 0.05, what="a motion")
    second = arm.send(trajectory=trajectory((12.0, 1.2)))
    status, code, sentence = ended(arm, first)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, Result.INVALID_GOAL)
    assert "replaced" in sentence
    graph.wait_for(lambda: states[-1].position[0] > 0.2, what="more of the motion")
    arm.cancel(second)
    assert ended(arm, second)[0] == GoalStatus.STATUS_CANCELED
    at = states[-1].position[0]
    assert at < 1.0
    third = arm.send(trajectory=trajectory((30.0, 0.0)))
    commands = graph.node.create_publisher(JointTrajectory, "/a/joint_trajectory", 10)
    graph.wait_for(commands.get_subscription_count, what="the topic")
    graph.meet()
    commands.publish(JointTrajectory())
    status, code, sentence = ended(arm, third)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, Result.INVALID_GOAL)
    assert "another command" in sentence


def test_an_arm_that_lags_violates_the_tolerances(graph: Graph, caller: Any) -> None:
    states = graph.collect("/b/joint_states", JointState)
    arm = caller({"tracking_delay": 0.4}, "/b")
    handle = arm.send(trajectory=trajectory((1.0, 0.8)), path_tolerance=[tolerance(0.05)])
    status, code, sentence = ended(arm, handle)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, Result.PATH_TOLERANCE_VIOLATED), sentence
    assert "position of fr3_joint1" in sentence
    soon = Duration(nanosec=100_000_000)
    handle = arm.send(trajectory=trajectory((1.0, 0.8)), goal_tolerance=[tolerance(0.001)], goal_time_tolerance=soon)
    assert ended(arm, handle)[1] == Result.GOAL_TOLERANCE_VIOLATED
    handle = arm.send(trajectory=trajectory((1.0, 0.0)), goal_tolerance=[tolerance(0.001)])
    assert ended(arm, handle)[1] == Result.SUCCESSFUL  # it arrives within the default of goal_time_tolerance
    graph.wait_for(lambda: abs(states[-1].position[0]) < 0.001, what="the goal")
