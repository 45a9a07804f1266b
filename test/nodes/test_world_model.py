"""world_model in a real graph: set, scanned, grasped, weighed, placed, restarted; robustness_server follows it."""

import threading
import time
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from assembly_calls import CUBE, FLOOR, FRAME, LATCHED, LID, LOW_PUSH, assess, box, change, message, replace_by
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from rclpy.logging import get_logger
from rclpy.serialization import serialize_message
from shape_msgs.msg import Mesh as MeshMessage
from tf2_msgs.msg import TFMessage

from poise.assembly import Assembly, Mesh, write_scene
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message, mesh_message, pose_message
from poise.nodes.jobs import Job
from poise.nodes.robustness_calls import Call
from poise.nodes.world_message import GRASP_EVENTS
from poise.nodes.world_model import WorldModel
from poise.world import World
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import AssemblyObject, GraspEvent, InertialEstimate, Part, SegmentedObject, WorldObject, WorldState
from poise_msgs.srv import AssessRobustness, SetAssembly

pytestmark = pytest.mark.ros
HAND = "tcp"
IN_HAND = Pose.from_vector([0, 0, 0.05, 0, 0, 0, 1])


class Friend:
    """What the test says to the node, and what it hears."""

    def __init__(self, graph):
        self.graph = graph
        self.assemblies = graph.collect("assembly", AssemblyMessage, LATCHED)
        self.states = graph.collect("world", WorldState, LATCHED)
        make = graph.node.create_publisher
        self.events = make(GraspEvent, "grasp_events", GRASP_EVENTS)
        self.estimates = make(InertialEstimate, "inertial_estimate", LATCHED)
        self.scans = make(SegmentedObject, "segmented_object", LATCHED)
        self.tf = make(TFMessage, "tf_static", LATCHED)

    def stamp(self):
        return self.graph.node.get_clock().now().to_msg()

    def set(self, request):
        return self.graph.call(SetAssembly, "set_assembly", request)

    def wait(self, condition, what):
        self.graph.wait_for(lambda: self.states and condition(self.states[-1]), what=what)
        return self.states[-1]

    def happened(self, event, name, frame, pose, **more):
        self.event = GraspEvent(event=event, id=name, pose=pose_message(pose), **more)
        self.event.header.stamp, self.event.header.frame_id = self.stamp(), frame
        self.events.publish(self.event)

    def mounted(self, *frames):
        transforms = [TransformStamped(child_frame_id=child) for _, child, *_ in frames]
        for transform, (parent, _, along, up) in zip(transforms, frames, strict=True):
            shift = transform.transform.translation
            transform.header.frame_id, shift.x, shift.z = parent, along, up
        self.tf.publish(TFMessage(transforms=transforms))


@pytest.fixture
def friend(graph):
    return Friend(graph)


def state_of(state, name):
    return next((each for each in state.objects if each.object.id == name), None)


def scanned_box(name, stamp):
    """A block of 6 x 4 x 8 cm as object_scanner publishes it, in two parts, rough at its foot."""
    scan = SegmentedObject(id=name, volume=1.92e-4)
    scan.header.frame_id, scan.header.stamp = name, stamp
    for low, high in ((-0.0006, 0.03), (0.03, 0.08)):
        solid = box("part", (0.06, 0.04, high - low), (0, 0, 0)).shape.polyhedron
        surface: MeshMessage = mesh_message(Mesh(solid.vertices + np.array([0, 0, (low + high) / 2]), solid.triangles))
        scan.parts.append(Part(surface=surface))
    return scan


def test_what_is_scanned_is_grasped_weighed_placed_and_survives_a_restart(start_node, graph, friend, tmp_path):
    parameters = {"state_file": str(tmp_path / "world"), "payload_period": 0.0}
    node = start_node("world_model", parameters)
    start_node("robustness_server", {"follow": True})
    refused = friend.set(change(SetAssembly.Request.REMOVE, message(CUBE)))
    assert refused.error.code == ErrorCode.EMPTY
    assert friend.set(replace_by(message(CUBE))).version == 1

    friend.mounted((FRAME, "cup", 2.0, 0.004), ("hand_sensor", HAND, 0.0, 0.1))
    friend.scans.publish(scanned_box("cup", friend.stamp()))
    friend.scans.publish(scanned_box("cup", friend.stamp()))
    state = friend.wait(lambda state: state_of(state, "cup"), "the scanned object")
    cup = state_of(state, "cup")
    assert (cup.state, cup.source) == (WorldObject.STANDING, WorldObject.ASSUMED)
    assert cup.object.pose.position.z == pytest.approx(0.0, abs=1e-9)
    assert len(cup.object.covariance) == 100
    graph.wait_for(lambda: len(friend.assemblies[-1].objects) == 3, what="the assembly")

    # One truth: the follower answers about the same version.
    def followed():
        answer = graph.call(AssessRobustness, "assess_robustness", assess(LOW_PUSH))
        return answer.version == friend.assemblies[-1].version and answer

    assert graph.wait_for(followed).error.code == ErrorCode.OK

    friend.happened(GraspEvent.GRASPED, "cup", HAND, IN_HAND, mass=0.5, mass_std=0.01)
    state = friend.wait(lambda state: state_of(state, "cup").state == WorldObject.HELD, "the grasp")
    assert state_of(state, "cup").object.inertia.m == 0.5
    graph.wait_for(lambda: len(friend.assemblies[-1].objects) == 2, what="the assembly without it")
    frames = graph.collect("tf", TFMessage)
    graph.wait_for(lambda: frames and frames[-1].transforms, what="tf")
    held = next(each for each in frames[-1].transforms if each.child_frame_id == "cup")
    assert (held.header.frame_id, held.transform.translation.z) == (HAND, 0.05)
    again = friend.set(change(SetAssembly.Request.ADD_OR_MOVE, message(box("cup", (1, 1, 1), (5, 0, 0.5)))))
    assert again.error.code == ErrorCode.BAD_INPUT
    assert "in the hand" in again.error.message

    estimate = InertialEstimate(consistent=True, covariance=(1e-8 * np.eye(10)).ravel())
    estimate.header.frame_id, estimate.header.stamp, estimate.since = "hand_sensor", friend.stamp(), friend.stamp()
    found = estimate.inertia
    found.m, found.com.z, found.ixx, found.iyy, found.izz = 1.4, 0.17, 4e-4, 4e-4, 2e-4
    friend.estimates.publish(estimate)
    friend.wait(lambda state: state.error.code == ErrorCode.NOT_CONSISTENT, "an estimate with the gripper in it")
    found.m = 0.51
    friend.estimates.publish(estimate)
    state = friend.wait(lambda state: state_of(state, "cup").source == WorldObject.WEIGHED, "the estimate")
    item = state_of(state, "cup").object
    assert (item.inertia.m, item.com_given) == (0.51, True)
    assert item.inertia.com.z == pytest.approx(0.17 - 0.1 - 0.05)

    node.stop()
    friend.states.clear()
    node = start_node("world_model", parameters)
    state = friend.wait(lambda state: state_of(state, "cup"), "the world after the restart")
    cup = state_of(state, "cup")
    assert (cup.state, cup.object.inertia.m, cup.frame_id) == (WorldObject.HELD, 0.51, HAND)
    assert "not verified" in cup.notes[-1]

    friend.happened(GraspEvent.RELEASED, "cup", FRAME, Pose.from_vector([3, 0, 0, 0, 0, 0, 1]))
    state = friend.wait(lambda state: state_of(state, "cup").state == WorldObject.STANDING, "the release")
    cup = state_of(state, "cup")
    assert (cup.object.pose.position.x, cup.object.inertia.m, cup.frame_id) == (3.0, 0.51, FRAME)
    graph.wait_for(lambda: len(friend.assemblies[-1].objects) == 3, what="the assembly with it")
    friend.happened(GraspEvent.GRASPED, "cup", HAND, IN_HAND)
    friend.happened(GraspEvent.LOST, "cup", "", Pose.identity())
    friend.wait(lambda state: state_of(state, "cup").state == WorldObject.LOST, "the loss")
    assert graph.wait_for(followed).error.code == ErrorCode.OK


def test_what_makes_no_sense_is_said_and_changes_nothing(start_node, graph, friend):
    start_node("world_model", {"settle": 0.005})
    version = friend.set(replace_by(message(CUBE))).version
    stale = change(SetAssembly.Request.ADD_OR_MOVE, message(box("lid", (1, 1, 0.2), (0, 0, 1.1))))
    stale.expected_version = version + 7
    assert friend.set(stale).error.code == ErrorCode.BAD_INPUT
    graph.meet()
    friend.happened(GraspEvent.GRASPED, "mug", HAND, IN_HAND)
    friend.wait(lambda state: state.error.code == ErrorCode.OBJECT_UNKNOWN, "an unknown object")
    friend.mounted((FRAME, "cup", 2.0, 0.5))
    friend.scans.publish(scanned_box("cup", friend.stamp()))
    friend.wait(lambda state: state.error.code == ErrorCode.FLOATING, "a scan above everything")
    friend.mounted((FRAME, "cup", 0.0, 0.0))
    friend.scans.publish(scanned_box("cup", friend.stamp()))
    friend.wait(lambda state: state.error.code == ErrorCode.INTERPENETRATION, "a scan inside the cube")
    friend.happened(
        GraspEvent.GRASPED, "bad", HAND, Pose.from_vector([np.nan, 0, 0, 0, 0, 0, 1]), object=[AssemblyObject(id="bad")]
    )
    friend.wait(lambda state: state.error.code == ErrorCode.NOT_FINITE, "a pose that is not finite")
    friend.happened(GraspEvent.GRASPED, "bad", HAND, IN_HAND, object=message(LID).objects[1:])
    friend.wait(lambda state: "of another id" in state.error.message, "an object of another id")
    friend.happened(7, "cube", HAND, IN_HAND)
    friend.wait(lambda state: "no event 7" in state.error.message, "an event that does not exist")
    friend.event.event, friend.event.header.stamp.sec = GraspEvent.GRASPED, friend.event.header.stamp.sec + 3600
    friend.events.publish(friend.event)
    friend.wait(lambda state: "ahead" in state.error.message, "an event in an hour")
    state = friend.states[-1]
    assert [each.object.id for each in state.objects] == ["cube"]
    assert state.version == version


def test_a_damaged_state_file_is_refused_in_one_line(start_node, tmp_path):
    (tmp_path / "world").write_text("poise world 1\nabc\n{}\n")
    node = start_node("world_model", {"state_file": str(tmp_path / "world")})
    assert node.wait() == 2
    assert node.output.count("\n") == 1
    assert "FILE_CORRUPT" in node.output
    assert "checksum" in node.output


def test_a_state_file_that_cannot_be_written_ends_nothing(start_node, graph, friend, tmp_path):
    write_scene(Assembly((FLOOR, CUBE), friction=0.5), tmp_path / "scene.yaml")
    node = start_node(
        "world_model", {"scene": str(tmp_path / "scene.yaml"), "state_file": str(tmp_path / "scene.yaml" / "w")}
    )
    graph.wait_for(lambda: friend.assemblies and len(friend.assemblies[-1].objects) == 2, what="the scene")
    graph.wait_for(lambda: "not kept over a restart" in node.output, what="why it is not kept")
    assert friend.set(replace_by(message())).error.code == ErrorCode.FILE_UNWRITABLE  # and holds until a restart
    graph.wait_for(lambda: len(friend.assemblies[-1].objects) == 1, what="the change")


def test_an_assembly_that_is_set_while_the_held_object_is_weighed_takes_nothing_away():
    can, cup = box("can", (0.1, 0.1, 0.1), (0, 0, 0.05), 0.3), box("cup", (0.1, 0.1, 0.1), (0.3, 0, 0.05), 0.3)
    begun = World(FRAME).with_assembly(Assembly((FLOOR, can)), FRAME, 1).grasped("can", IN_HAND, HAND, 2)
    node = SimpleNamespace(_world=begun, _lock=threading.Lock(), _folders=(), _now=lambda: 4, _known=None)

    class Waiting(Job):
        """A call while which the held object is weighed."""

        def claim(self):
            node._world = node._world.weighed(replace(can, mass=0.31), 3)
            return super().claim()

    def make(transition):
        node._world = transition(node._world)
        return node._world

    node._change = make
    request = change(SetAssembly.Request.ADD_OR_MOVE, assembly_message(Assembly((FLOOR, cup)), FRAME))
    call = Call("set", serialize_message(request), FRAME, True)
    response = WorldModel._set(node, call, Waiting(SetAssembly, time.monotonic() + 10.0))
    assert response.version == begun.version + 1
    assert node._world.held.item.mass == 0.31
    assert "cup" in node._world.objects


def test_every_refusal_is_published_whatever_was_refused_before():
    """rclpy raises when one line of code logs with two severities."""
    said = []
    node = SimpleNamespace(
        get_logger=lambda: get_logger("world"),
        _lock=threading.Lock(),
        _publish=lambda _, error: said.append(error.code),
    )
    for topic in ("grasp_events", "inertial_estimate", "segmented_object"):
        WorldModel._refused(node, topic, InputError(ErrorCode.BAD_INPUT, "no"))
    assert said == [ErrorCode.BAD_INPUT] * 3


def test_of_scans_that_come_together_none_overtakes_one_that_waits_for_its_frame():
    begun, frames = [], {"cup_2"}

    def begin(message, heard):
        if message.id in frames:
            begun.append(message.id)
        return message.id in frames

    model = SimpleNamespace(_scans={}, _begin_scan=begin)
    model._begin_scans = partial(WorldModel._begin_scans, model)
    for name, second in (("cup_2", 2), ("cup", 1)):
        model._scans[name] = scanned_box(name, Time(sec=second)), 0.0
    model._begin_scans()
    assert (begun, set(model._scans)) == ([], {"cup", "cup_2"})
    frames.add("cup")
    model._begin_scans()
    assert (begun, model._scans) == (["cup", "cup_2"], {})
