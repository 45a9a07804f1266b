"""place_object with execute, in a real graph: a fake FR3 puts a can on a cube, or is cancelled, hindered, refused."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from action_caller import Caller
from action_msgs.msg import GoalStatus
from assembly_calls import LATCHED
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory

from poise.assembly import Analysis, Assembly, Cylinder, RigidObject, load_scene
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.manipulation import Arm, Limits, Reach, plan_transfer
from poise.manipulation.bodies import se3_of
from poise.manipulation.gripper import Gripper
from poise.nodes.assembly_message import assembly_message
from poise.placement import Options, plan_placement
from poise.robot import RobotModel
from poise.robot.model import find_urdf
from poise.robot.urdf import read_urdf
from poise.simulation import home
from poise_msgs.action import PlaceObject

pytestmark = pytest.mark.ros
FRAME, SEED, FINGERS = "table", 1, "finger_joint"
SCENE = load_scene(Path(__file__).resolve().parents[2] / "docs" / "scenes" / "placement" / "cube.yaml")
CAN = RigidObject("can", Cylinder(0.03, 0.1), Pose.from_vector([-0.1, -0.42, 0.05, 0, 0, 0, 1]), mass=0.3)
BASE = Pose.from_vector([-0.5, 0, 0, 0, 0, 0, 1])
PLANNER = {"candidates": 1, "support": "objects", "base": [-0.5, 0.0, 0.0, 0.0], "gripper_joint": FINGERS}
PLANNER |= {"ready_timeout": 0.2, "stop_unattended": 60.0}
PLANNER |= {"stop_silence": 5.0, "motion_lead": 3.0}  # 1 s of a busy machine: the robot runs at rate 3
ROBOT = {"mode": "arm", "robot": "fr3", "joint_rate": 60.0, "joint_noise": 0.0, "gripper_joint": FINGERS}
ROBOT |= {"sensor": "none", "sensor_rate": 10.0}
ENDLESS = {"candidates": 10_000, "attempts": 1_000_000}
STAGES = ["planning", "picking", "carrying", "placing"]


@pytest.fixture
def caller(graph):
    caller = Caller(graph, PlaceObject, "place_object")
    yield caller
    caller.close()


def goal(item=CAN, **more):
    """The can, where it lies, and the scene without it."""
    there = assembly_message(Assembly((SCENE.objects[0], item)), FRAME).objects[1]
    return {"assembly": [assembly_message(SCENE, FRAME)], "object": there, "seed": SEED, "execute": True, **more}


def start_both(start_node, graph, caller, planner=PLANNER, remaps=None, rate=3.0):
    """Both nodes, found by each other; the joint states from here on."""
    start_node("placement_planner", planner | {"ready_timeout": 20.0})
    caller.ready()
    robot = start_node("fake_robot", ROBOT | {"rate": rate}, remaps)
    states = graph.collect("joint_states", JointState, 10_000)
    graph.wait_for(lambda: states, what="the robot")
    refused = {ErrorCode.ROBOT_DESCRIPTION_MISSING, ErrorCode.TOPIC_MISSING}
    ask = goal(deadline=1e-6)
    graph.wait_for(lambda: caller.result(caller.send(**ask)).result.error.code not in refused, what="each other")
    caller.feedback.clear()
    return robot, states


def arrays(states):
    """(N, 7) positions of the arm, (N,) of the fingers."""
    rows = np.array([state.position for state in states])
    return rows[:, :7], rows[:, 7]


def wait_for_stage(graph, caller, stage, handle):
    ended = handle.get_result_async()
    graph.wait_for(lambda: ended.done() or any(one.stage == stage for one in caller.feedback), what=stage)
    assert not ended.done(), ended.result().result.error


def comes_to_rest(graph, states):
    """It does, and stays there."""
    states.clear()
    graph.wait_for(lambda: len(states) > 200, what="joint states")
    assert np.ptp(arrays(states[-100:])[0], axis=0).max() < 1e-6


@pytest.mark.alone
def test_a_can_is_picked_up_and_put_on_a_cube(start_node, graph, caller):
    transform = TransformStamped(child_frame_id="base_link")
    transform.header.frame_id, transform.transform.translation.x = FRAME, -0.5
    graph.node.create_publisher(TFMessage, "tf_static", LATCHED).publish(TFMessage(transforms=[transform]))
    _, states = start_both(start_node, graph, caller, PLANNER | {"base": [5.0, 5.0, 0.0, 0.0]})  # tf knows better
    planned = caller.result(caller.send(**goal(deadline=60.0, execute=False))).result
    caller.feedback.clear()
    done = caller.result(caller.send(**goal(deadline=60.0)))
    for result in (planned, done.result):
        assert not any("tf" in each for each in result.assumptions)
        assert result.stages == ["reach", "approach", "lift", "carry", "lower", "retreat", "return"]
        ends = [[way.points[k].positions for way in result.trajectories] for k in (0, -1)]
        np.testing.assert_allclose(ends[0][1:], ends[1][:-1], atol=1e-6)  # each begins where the one before ends
        assert result.grasp.header.frame_id == FRAME
        assert result.grasp.pose.position.z > 0.0
    assert (done.result.error.message, done.status) == ("", GoalStatus.STATUS_SUCCEEDED)
    graph.wait_for(lambda: caller.feedback[-1].stage == "placing", what="the last stage")
    assert list(dict.fromkeys(one.stage for one in caller.feedback)) == STAGES
    place = done.result.pose.pose
    at = place.position
    assert (done.result.pose.header.frame_id, at.z) == (FRAME, pytest.approx(0.15, abs=1e-6))

    # What the core plans from the same place is what the arm did.
    arm, start = Arm.load("fr3", BASE), home(RobotModel.from_file("fr3"))
    reach = Reach(arm, Analysis.of(SCENE), CAN, start=start, seed=SEED)
    found = plan_placement(reach.before, CAN, Options(candidates=1, on="objects", tests=reach.tests), SEED)
    grasp = plan_transfer(reach, found.analysis, found.item, Limits(speed=0.5), 60.0, SEED).grasp
    np.testing.assert_allclose(found.pose.vector[:3], [at.x, at.y, at.z], atol=1e-9)
    joints, fingers = arrays(states)
    tools = [arm.tool(q) for q in joints]
    gripper = Gripper()
    wide = gripper.position(arm.hand.opening(grasp.width), False)
    gripped = gripper.position(grasp.width, True)
    for item, before, after in ((CAN, wide, gripped), (found.item, gripped, wide)):
        wanted = se3_of(item.pose) * grasp.object_tcp
        off = np.array([np.linalg.norm(tool.translation - wanted.translation) for tool in tools])
        assert off.min() < 1e-3
        assert np.abs(tools[off.argmin()].rotation - wanted.rotation).max() < 1e-3
        (here,) = np.nonzero(off < 1e-3)
        assert fingers[[here[0], here[-1]]] == pytest.approx([before, after], abs=1e-6)
        assert np.all(np.diff(here) == 1)  # it comes once, and the fingers move while it is there
    np.testing.assert_allclose(joints[-1], start, atol=1e-3)
    comes_to_rest(graph, states)


@pytest.mark.parametrize("stage", ["planning", "carrying"])
def test_cancelled_it_is_answered_and_the_arm_rests(start_node, graph, caller, stage):
    planner = PLANNER | (ENDLESS if stage == "planning" else {})
    # Not faster than reality: on a busy machine, the can would be there before the request to stop.
    _, states = start_both(start_node, graph, caller, planner, rate=1.0)
    handle = caller.send(**goal(deadline=600.0 if stage == "planning" else 60.0))
    wait_for_stage(graph, caller, stage, handle)
    second = caller.result(caller.send(**goal()))
    assert second.result.error.code == ErrorCode.BUSY
    caller.cancel(handle)
    done = caller.result(handle)
    assert (done.status, done.result.error.code) == (GoalStatus.STATUS_CANCELED, ErrorCode.CANCELLED)
    holds = "the arm stopped while carrying can; it still holds it"
    assert done.result.error.message == (
        holds if stage == "carrying" else "placing can was cancelled; nothing was changed"
    )
    comes_to_rest(graph, states)
    if stage == "carrying":
        away = np.abs(arrays(states)[0][-1] - home(RobotModel.from_file("fr3"))).max()
        assert away > 0.01


def test_what_is_missing_or_in_the_way_is_said(start_node, graph, caller):
    start_node("placement_planner", PLANNER)
    caller.ready()

    def refused(code, word, **fields):
        error = caller.result(caller.send(**goal(**fields))).result.error
        assert error.code in (code, ErrorCode.ROBOT_DESCRIPTION_MISSING, ErrorCode.TOPIC_MISSING), error.message
        return error.code == code and word in error.message

    assert refused(ErrorCode.ROBOT_DESCRIPTION_MISSING, "robot_description")
    describe = graph.node.create_publisher(String, "robot_description", LATCHED)
    describe.publish(String(data=read_urdf(find_urdf("fr3"))))
    for topic in ("joint_trajectory", "gripper_trajectory"):
        graph.wait_for(lambda topic=topic: refused(ErrorCode.TOPIC_MISSING, topic), what=f"no {topic}")
        graph.collect(topic, JointTrajectory)
    describe.publish(String(data="<robot"))  # does not replace what is valid, and known by now
    graph.wait_for(lambda: refused(ErrorCode.TOPIC_MISSING, "joint_states"), what="no joint states")

    start = home(RobotModel.from_file("fr3"))
    says = graph.node.create_publisher(JointState, "joint_states", 10)
    names = [f"fr3_joint{number}" for number in range(1, 8)]

    def say():
        message = JointState(name=names, position=start.tolist())
        message.header.stamp = graph.node.get_clock().now().to_msg()
        says.publish(message)

    graph.node.create_timer(0.01, say)
    at_hand = Pose(np.eye(3), Arm.load("fr3", BASE).tool(start).translation)
    in_hand = RigidObject("can", CAN.shape, at_hand, mass=0.3)
    graph.wait_for(lambda: refused(ErrorCode.INTERPENETRATION, "touches object can", item=in_hand), what="a touch")
    in_cube = RigidObject("can", CAN.shape, Pose.from_vector([0, 0, 0.05, 0, 0, 0, 1]), mass=0.3)
    assert refused(ErrorCode.INTERPENETRATION, "cube", item=in_cube)
    far = RigidObject("can", CAN.shape, Pose.from_vector([3, 0, 0.05, 0, 0, 0, 1]), mass=0.3)
    assert refused(ErrorCode.UNREACHABLE, "cannot be picked up", item=far, deadline=60.0)


def test_joints_that_do_not_follow_are_commanded_to_stay_where_they_are(start_node, graph, caller):
    commands = graph.collect("joint_trajectory", JointTrajectory)
    _, states = start_both(start_node, graph, caller, remaps={"joint_trajectory": "elsewhere"})
    done = caller.result(caller.send(**goal(deadline=60.0)))
    assert (done.status, done.result.error.code) == (GoalStatus.STATUS_ABORTED, ErrorCode.NOT_FOLLOWING)
    assert "its hand is empty" in done.result.error.message
    graph.wait_for(lambda: len(commands) >= 2, what="the stop")
    for point in commands[-1].points:
        np.testing.assert_allclose(point.positions, arrays(states)[0][-1], atol=1e-9)


def test_a_robot_that_falls_silent_is_stopped(start_node, graph, caller):
    slow = PLANNER | {"speed": 0.15}  # a busy machine has to see it carry
    robot, _ = start_both(start_node, graph, caller, slow)
    commands = graph.collect("joint_trajectory", JointTrajectory)
    handle = caller.send(**goal(deadline=60.0))
    wait_for_stage(graph, caller, "carrying", handle)
    with contextlib.suppress(ProcessLookupError):
        robot.process.kill()
    done = caller.result(handle)
    assert done.result.error.code == ErrorCode.SENSOR_STALE
    assert "it still holds it" in done.result.error.message
    graph.wait_for(lambda: not any(commands[-1].points[-1].velocities), what="the stop")
