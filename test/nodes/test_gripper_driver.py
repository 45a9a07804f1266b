"""The gripper's node in the ROS graph, against the device in software."""

from collections.abc import Callable, Iterator

import pytest
from action_caller import Caller
from action_msgs.msg import GoalStatus
from control_msgs.action import GripperCommand
from control_msgs.msg import GripperCommand as Command
from diagnostic_msgs.msg import DiagnosticArray
from ros_graph import Graph, NodeProcess
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from poise.gripping import FakeGripper

pytestmark = pytest.mark.ros
ACTION = "gripper_controller/gripper_cmd"
JOINT = "robotiq_85_left_knuckle_joint"


@pytest.fixture
def gripper() -> Iterator[FakeGripper]:
    with FakeGripper(active=True) as device:
        yield device


def test_goals_end_at_the_position_at_an_object_or_cancelled(
    graph: Graph, start_node: Callable[..., NodeProcess], gripper: FakeGripper
) -> None:
    states = graph.collect("joint_states", JointState)
    node = start_node("gripper_driver", {"address": gripper.port, "speed": 0.15})
    caller = Caller(graph, GripperCommand, ACTION).ready()
    graph.wait_for(lambda: states, what="joint states")

    def ended(then: Callable[[], None] = lambda: None, **command: float):
        """The end of a goal; one is sent again if the device, in a thread of this process, had no time to answer."""
        for _ in range(10):
            goal = caller.offer(command=Command(**command))
            if not goal.accepted:
                continue
            then()
            done = caller.result(goal)
            if done.status != GoalStatus.STATUS_ABORTED:
                return done
        raise AssertionError("the device had no time to answer in ten goals")

    half = ended(position=0.4)
    assert half.status == GoalStatus.STATUS_SUCCEEDED
    assert half.result.reached_goal
    assert not half.result.stalled
    assert half.result.position == pytest.approx(0.4, abs=0.005)
    assert states[-1].name == [JOINT]

    gripper.object_width = 0.02
    held = ended(position=0.8, max_effort=100.0)
    assert held.status == GoalStatus.STATUS_SUCCEEDED
    assert held.result.stalled
    assert not held.result.reached_goal
    assert held.result.position == pytest.approx(0.8 * (1 - 0.02 / 0.085), abs=0.01)

    gripper.object_width = None
    publisher = graph.node.create_publisher(JointTrajectory, "gripper_trajectory", 10)
    graph.meet()

    def command(position: float) -> None:
        point = JointTrajectoryPoint(positions=[position])
        publisher.publish(JointTrajectory(joint_names=[JOINT], points=[point]))

    again = graph.node.create_timer(1.0, lambda: command(0.0))
    graph.wait_for(lambda: states[-1].position[0] < 0.01, what="open fingers")
    graph.node.destroy_timer(again)

    running = ended(position=0.4, then=lambda: command(9.0))
    assert running.status == GoalStatus.STATUS_SUCCEEDED  # the trajectory is refused

    gripper.silent = True  # the motion cannot end
    handle = caller.send(command=Command(position=0.8))
    caller.cancel(handle)
    assert caller.result(handle).status == GoalStatus.STATUS_CANCELED

    for position, effort in ((2.0, 0.0), (0.4, 5.0), (float("nan"), 0.0)):
        future = caller._client.send_goal_async(
            GripperCommand.Goal(command=Command(position=position, max_effort=effort))
        )
        graph.wait_for(future.done, what="a refusal")
        assert not future.result().accepted
    assert "JOINT_LIMIT" in node.output
    caller.close()
    assert node.stop() == 0


def test_a_gripper_that_lost_its_supply_is_activated_only_by_the_service(
    graph: Graph, start_node: Callable[..., NodeProcess], gripper: FakeGripper
) -> None:
    arrays = graph.collect("/diagnostics", DiagnosticArray)
    start_node("gripper_driver", {"address": gripper.port})

    def condition() -> str:
        found = [status for array in arrays[-1:] for status in array.status]
        return next((pair.value for status in found for pair in status.values if pair.key == "condition"), "")

    graph.wait_for(lambda: condition() == "ready", what="a gripper that is ready")
    gripper._was_active = False
    gripper.power_up()
    graph.wait_for(lambda: condition() == "inactive", what="a gripper that is not active")
    assert gripper.activations == 0
    assert graph.call(Trigger, "activate_gripper", Trigger.Request()).success
    graph.wait_for(lambda: condition() == "ready", what="a gripper that is ready again")
    assert gripper.activations == 1
