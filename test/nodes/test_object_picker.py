"""pick_object and place_object with world_model and a fake FR3: picked, weighed, put on a cube, then lost."""

import numpy as np
import pytest
from action_caller import Caller
from assembly_calls import LATCHED
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import JointState

from poise.assembly import Assembly, Box, Cylinder, RigidObject
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message
from poise.nodes.transforms import pose_of
from poise.nodes.world_message import GRASP_EVENTS
from poise_msgs.action import PickObject, PlaceObject
from poise_msgs.msg import AssemblyObject, GraspEvent, WorldObject, WorldState
from poise_msgs.srv import SetAssembly

pytestmark = [pytest.mark.ros, pytest.mark.alone]
FRAME, FINGERS = "table", "finger_joint"
FLOOR = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose.from_vector([0, 0, -0.05, 0, 0, 0, 1]), fixed=True)
CUBE = RigidObject("cube", Box((0.1, 0.1, 0.1)), Pose.from_vector([0, 0, 0.05, 0, 0, 0, 1]), mass=1.0)
CAN = RigidObject("can", Cylinder(0.03, 0.1), Pose.from_vector([-0.1, -0.42, 0.05, 0, 0, 0, 1]), mass=0.3)
PICKER = {"base": [-0.5, 0.0, 0.0, 0.0], "gripper_joint": FINGERS, "ready_timeout": 20.0, "stop_unattended": 60.0}
PICKER |= {"stop_silence": 5.0, "motion_lead": 2.0}  # 1 s of a busy machine: the robot runs at rate 2
ROBOT = {"mode": "arm", "robot": "fr3", "rate": 2.0, "joint_rate": 60.0, "joint_noise": 0.0, "gripper_joint": FINGERS}
ROBOT |= {"sensor": "low", "sensor_rate": 50.0}


@pytest.fixture
def caller(graph):
    caller = Caller(graph, PickObject, "pick_object")
    yield caller
    caller.close()


@pytest.fixture
def placer(graph):
    caller = Caller(graph, PlaceObject, "place_object")
    yield caller
    caller.close()


def test_a_can_is_picked_weighed_and_held_until_it_is_not_there(start_node, graph, caller, placer):
    start_node("world_model")
    start_node("fake_robot", ROBOT)
    start_node("object_picker", PICKER)
    start_node("placement_planner", PICKER | {"candidates": 1, "support": "objects"})
    caller.ready()
    placer.ready()
    events = graph.collect("grasp_events", GraspEvent, GRASP_EVENTS)
    worlds = graph.collect("world", WorldState, LATCHED)
    states = graph.collect("joint_states", JointState)
    client = graph.node.create_client(SetParameters, "fake_robot/set_parameters")
    weights = {GraspEvent.GRASPED: 0.31, GraspEvent.RELEASED: 0.0, GraspEvent.LOST: 0.0}

    def weigh(mass):
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=mass)
        client.call_async(SetParameters.Request(parameters=[Parameter(name="payload.mass", value=value)]))

    graph.node.create_subscription(GraspEvent, "grasp_events", lambda event: weigh(weights[event.event]), GRASP_EVENTS)
    scene = assembly_message(Assembly((FLOOR, CUBE, CAN)), FRAME)
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
    assert "tf does not connect it with table" in planned.assumptions[0]
    assert not events

    done = caller.result(caller.send(id="can", seed=1)).result
    assert (done.error.message, done.holding, done.attempts) == ("", True, 1)
    assert done.mass == pytest.approx(0.31, abs=3 * done.mass_std)
    assert done.mass_std < 0.02
    held = world("can", lambda can: can.state == WorldObject.HELD)
    assert (held.frame_id, held.source, held.object.inertia.m) == ("tcp", WorldObject.GIVEN, 0.3)  # which fits
    busy = caller.result(caller.send(id="can")).result
    assert busy.error.code in (ErrorCode.BUSY, ErrorCode.OBJECT_UNKNOWN)

    place = placer.result(placer.send(object=AssemblyObject(id="cup"), held=True, execute=True)).result
    assert place.error.code == ErrorCode.NOT_HELD
    placed = placer.result(placer.send(held=True, execute=True, seed=1, deadline=60.0)).result
    assert (placed.error.message, placed.stages) == ("", ["carry", "lower", "retreat", "return"])
    there = world("can", lambda can: can.state == WorldObject.STANDING)
    off = np.array(pose_of(there.object.pose).vector) - pose_of(placed.pose.pose).vector
    assert np.abs(off[:3]).max() < 2e-3  # where the hand left it, which is about where it was planned
    assert placed.pose.pose.position.z == pytest.approx(0.15, abs=1e-6)
    assert placer.result(placer.send(held=True, execute=True)).result.error.code == ErrorCode.NOT_HELD

    weights[GraspEvent.GRASPED] = 0.0
    caller.feedback.clear()
    empty = caller.result(caller.send(id="can", seed=1)).result
    assert (empty.error.code, empty.holding, empty.attempts) == (ErrorCode.NOT_HELD, False, 2)
    assert "nothing was lifted" in empty.error.message
    assert world("can", lambda can: can.state == WorldObject.LOST)
    assert {"planning", "picking", "verifying", "returning"} <= {said.stage for said in caller.feedback}
