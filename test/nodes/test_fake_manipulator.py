"""fake_robot as a mobile manipulator: its gripper grasps, its base drives, its camera sees, tf joins the frames."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from action_caller import Caller
from action_msgs.msg import GoalStatus
from control_msgs.action import GripperCommand
from control_msgs.msg import GripperCommand as Command
from geometry_msgs.msg import TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from ros_graph import Graph, NodeProcess
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from poise.assembly import Assembly, Box, RigidObject, write_scene
from poise.fake_robots.drive import mounted_on_base
from poise.fake_robots.gripper import SimulatedGripper
from poise.fake_robots.gripper_action import GripperAction
from poise.fake_robots.link_frames import LinkFrames
from poise.geometry import Pose
from poise.nodes.runtime import TF_STATIC
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import home

pytestmark = pytest.mark.ros

Start = Callable[..., NodeProcess]


def scene(path: Path) -> str:
    """A block between the open fingers of an FR3 at home, on a table."""
    description = mounted_on_base(read_urdf(find_urdf("fr3")), 0.4)
    model = RobotModel.from_urdf(description)
    tool = LinkFrames(description, model).poses(("tcp",), home(model))[0]
    block = RigidObject("block", Box((0.04, 0.04, 0.04)), tool, mass=0.5)
    under = np.array([*tool.translation[:2], block.vertices[:, 2].min() - 0.02])
    table = RigidObject("table", Box((0.08, 0.08, 0.04)), Pose(np.eye(3), under), fixed=True)
    write_scene(Assembly((table, block)), path)
    return str(path)


def test_a_cancelled_goal_does_not_drop_what_the_fingers_hold() -> None:
    gripper = SimulatedGripper("finger_joint", speed=1.0)
    gripper.go(0.8, 0.0, 60.0)
    gripper.stop_at(0.04)
    action, goal = GripperAction.__new__(GripperAction), object()
    action._arm = SimpleNamespace(now=1.0, grip=lambda names, position: gripper.go(position, 1.0))  # type: ignore[assignment]
    action._gripper, action._goal = gripper, goal  # type: ignore[assignment]
    action._on_cancel(goal)  # type: ignore[arg-type]
    assert gripper.force(1.0) == 60.0


def test_it_grasps_drives_and_sees(graph: Graph, start_node: Start, tmp_path: Path) -> None:
    wrenches = graph.collect("wrench", WrenchStamped)
    odometry = graph.collect("odom", Odometry)
    frames = graph.collect("tf_static", TFMessage, TF_STATIC)
    params = {
        "mode": "arm",
        "robot": "fr3",
        "sensor": "none",
        "sensor_rate": 50.0,
        "joint_rate": 50.0,
        "base": True,
        "cmd_vel_stamped": True,
        "gripper_joint": "finger_joint",
        "world": scene(tmp_path / "scene.yaml"),
        "camera": True,
        "camera_width": 64,
    }
    start_node("fake_robot", params)
    gripper = Caller(graph, GripperCommand, "gripper_controller/gripper_cmd").ready()

    closed = gripper.result(gripper.send(command=Command(position=0.8, max_effort=60.0)))
    assert closed.status == GoalStatus.STATUS_SUCCEEDED
    assert closed.result.stalled
    assert not closed.result.reached_goal
    assert closed.result.position == pytest.approx(0.8 * (1 - 0.04 / 0.085), abs=1e-3)
    assert closed.result.effort == 60.0
    refused = gripper.result(gripper.send(command=Command(position=5.0)))
    assert refused.status == GoalStatus.STATUS_ABORTED

    driving = graph.node.create_publisher(TwistStamped, "cmd_vel", 10)
    graph.wait_for(driving.get_subscription_count, what="cmd_vel")
    graph.meet()
    command = TwistStamped()
    command.twist.linear.x = 0.3
    driving.publish(command)
    graph.wait_for(lambda: odometry[-1].pose.pose.position.x > 0.03, what="a motion")
    graph.wait_for(lambda: odometry[-1].twist.twist.linear.x == 0.0, what="the stop without cmd_vel")
    # The hand has taken the block off its table, along with the base: the wrench holds it.
    force = wrenches[-1].wrench.force
    assert np.linalg.norm([force.x, force.y, force.z]) == pytest.approx(0.5 * 9.80665, rel=0.02)  # it may still brake

    opened = gripper.result(gripper.send(command=Command(position=0.0)))
    assert opened.result.reached_goal
    depth = graph.collect("camera/aligned_depth_to_color/image_raw", Image)
    info = graph.collect("camera/aligned_depth_to_color/camera_info", CameraInfo)
    graph.wait_for(lambda: depth and info, what="an image")
    assert (depth[0].width, depth[0].encoding) == (64, "16UC1")
    assert depth[0].header.frame_id == info[0].header.frame_id
    joined = {each.child_frame_id: each.header.frame_id for each in frames[0].transforms}
    assert joined["odom"] == "world"
    assert joined[depth[0].header.frame_id] == "ft_sensor"
