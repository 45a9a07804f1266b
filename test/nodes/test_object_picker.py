"""pick_object with world_model and a fake FR3: a can is picked and weighed, or is not there and becomes lost."""

import pytest
from action_caller import Caller
from assembly_calls import LATCHED
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import JointState

from poise.assembly import Assembly, Box, Cylinder, RigidObject
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message, pose_message
from poise.nodes.world_message import GRASP_EVENTS
from poise_msgs.action import PickObject
from poise_msgs.msg import GraspEvent, WorldObject, WorldState
from poise_msgs.srv import SetAssembly

pytestmark = pytest.mark.ros
FRAME, FINGERS = "table", "finger_joint"
FLOOR = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose.from_vector([0, 0, -0.05, 0, 0, 0, 1]), fixed=True)
CAN = RigidObject("can", Cylinder(0.03, 0.1), Pose.from_vector([-0.1, -0.42, 0.05, 0, 0, 0, 1]), mass=0.3)
PICKER = {"base": [-0.5, 0.0, 0.0, 0.0], "gripper_joint": FINGERS, "ready_timeout": 20.0, "stop_unattended": 60.0}
ROBOT = {"mode": "arm", "robot": "fr3", "rate": 3.0, "joint_rate": 60.0, "joint_noise": 0.0, "gripper_joint": FINGERS}
ROBOT |= {"sensor": "low", "sensor_rate": 50.0}


@pytest.fixture
def caller(graph):
    caller = Caller(graph, PickObject, "pick_object")
    yield caller
    caller.close()


def test_a_can_is_picked_weighed_and_held_until_it_is_not_there(start_node, graph, caller):
    start_node("world_model")
    start_node("fake_robot", ROBOT)
    start_node("object_picker", PICKER)
    caller.ready()
    events = graph.collect("grasp_events", GraspEvent, GRASP_EVENTS)
    worlds = graph.collect("world", WorldState, LATCHED)
    states = graph.collect("joint_states", JointState)
    client = graph.node.create_client(SetParameters, "fake_robot/set_parameters")
    weights = {GraspEvent.GRASPED: 0.31, GraspEvent.RELEASED: 0.0, GraspEvent.LOST: 0.0}

    def weigh(mass):
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=mass)
        client.call_async(SetParameters.Request(parameters=[Parameter(name="payload.mass", value=value)]))

    graph.node.create_subscription(GraspEvent, "grasp_events", lambda event: weigh(weights[event.event]), GRASP_EVENTS)
    scene = assembly_message(Assembly((FLOOR, CAN)), FRAME)
    assert graph.call(SetAssembly, "set_assembly", SetAssembly.Request(assembly=scene)).error.code == ErrorCode.OK
    graph.wait_for(lambda: states, what="the robot")

    def world(name, condition):
        def found():
            return next((each for each in worlds[-1].objects if each.object.id == name), None) if worlds else None

        graph.wait_for(lambda: found() is not None and condition(found()), what=f"{name} in the world")
        return found()

    unknown = caller.result(caller.send(id="cup")).result
    assert unknown.error.code == ErrorCode.OBJECT_UNKNOWN
    planned = caller.result(caller.send(id="can", seed=1, plan_only=True)).result
    assert (planned.error.message, planned.stages) == ("", ["reach", "approach", "lift", "hold"])
    assert not events

    done = caller.result(caller.send(id="can", seed=1)).result
    assert (done.error.message, done.holding, done.attempts) == ("", True, 1)
    assert done.mass == pytest.approx(0.31, abs=3 * done.mass_std)
    assert done.mass_std < 0.02
    held = world("can", lambda can: can.state == WorldObject.HELD)
    assert (held.frame_id, held.source, held.object.inertia.m) == ("tcp", WorldObject.GIVEN, 0.3)  # which fits
    busy = caller.result(caller.send(id="can")).result
    assert busy.error.code in (ErrorCode.BUSY, ErrorCode.OBJECT_UNKNOWN)

    weights[GraspEvent.GRASPED] = 0.0
    event = GraspEvent(event=GraspEvent.RELEASED, id="can", pose=pose_message(CAN.pose))
    event.header.frame_id, event.header.stamp = FRAME, graph.node.get_clock().now().to_msg()
    graph.node.create_publisher(GraspEvent, "grasp_events", GRASP_EVENTS).publish(event)
    world("can", lambda can: can.state == WorldObject.STANDING)
    caller.feedback.clear()
    empty = caller.result(caller.send(id="can", seed=1), 120.0).result
    assert (empty.error.code, empty.holding, empty.attempts) == (ErrorCode.NOT_HELD, False, 2)
    assert "nothing was lifted" in empty.error.message
    assert world("can", lambda can: can.state == WorldObject.LOST)
    assert {"planning", "picking", "verifying", "returning"} <= {said.stage for said in caller.feedback}
