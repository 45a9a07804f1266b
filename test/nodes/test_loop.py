"""The loop: a scanned object is picked, weighed and placed on the tray of a fake robot, whose base then carries it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_caller import Caller
from assembly_calls import LATCHED, change
from geometry_msgs.msg import PoseStamped, TransformStamped
from ros_graph import Graph, NodeProcess
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from poise.assembly import Assembly, Box, Mesh, RigidObject, write_scene
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message, mesh_message
from poise.nodes.transforms import pose_of
from poise_msgs.action import CarryObject, IdentifyPayload, PickObject, PlaceObject
from poise_msgs.msg import Part, SegmentedObject, WorldObject, WorldState
from poise_msgs.srv import SetAssembly

pytestmark = [pytest.mark.ros, pytest.mark.alone]

Start = Callable[..., NodeProcess]
FRAME, FINGERS, MASS = "base_footprint", "finger_joint", 0.62


def block(name: str, size: tuple[float, float, float], x: float, y: float, top: float, **more: Any) -> RigidObject:
    return RigidObject(name, Box(size), Pose.from_vector([x, y, top - size[2] / 2, 0, 0, 0, 1]), **more)


TABLE = block("table", (0.3, 0.3, 0.02), 0.4, -0.42, 0.4, fixed=True)
TRAY = block("tray", (0.4, 0.4, 0.02), 0.5, 0.05, 0.4, fixed=True)
CRATE = block("crate", (0.14, 0.14, 0.1), 0.5, 0.05, 0.5, mass=1.0)
MIDDLE = np.array([0, 0, 0.04])  # of the box in the frame of its scan, which lies on its foot
BOX = block("box", (0.06, 0.04, 0.08), 0.4, -0.42, 0.48, mass=MASS)
PATIENT = {"stop_unattended": 60.0, "stop_silence": 5.0, "motion_lead": 0.5}
"""On machines that do other things."""
ARM = {"gripper_joint": FINGERS, "ready_timeout": 20.0} | PATIENT
ROBOT = {"mode": "arm", "robot": "fr3", "base": True, "gripper_joint": FINGERS, "riding": ["tray"]}
ROBOT |= {"sensor": "low", "sensor_rate": 50.0, "joint_rate": 60.0, "tf_rate": 10.0, "cmd_vel_timeout": 5.0}
WEIGHER = {"tcp_frame": "tcp", "object_radius": 0.12} | PATIENT
WEIGHER |= {"room": 0.3, "stop_and_go_dwell": 0.5, "publish_rate": 1.0}


def scan(item: RigidObject, stamp: Any) -> tuple[SegmentedObject, TFMessage]:
    """What object_scanner says of an object that it saw without errors."""
    size = np.ptp(item.vertices, axis=0)
    foot = item.pose.translation - [0, 0, size[2] / 2]
    message = SegmentedObject(id=item.id, header=Header(frame_id=item.id, stamp=stamp), volume=float(size.prod()))
    solid = item.shape.polyhedron
    part = Part(volume=message.volume, surface=mesh_message(Mesh(item.vertices - foot, solid.triangles)))
    unit, (x, y, z) = part.unit_inertia, size**2 / 12
    unit.m, unit.com.z, unit.ixx, unit.iyy, unit.izz = 1.0, size[2] / 2, y + z, x + z, x + y
    message.parts = [part]
    there = TransformStamped(child_frame_id=item.id, header=Header(frame_id="world"))
    shift = there.transform.translation
    shift.x, shift.y, shift.z = foot.tolist()
    return message, TFMessage(transforms=[there])


def test_a_scanned_box_is_picked_weighed_placed_and_carried(graph: Graph, start_node: Start, tmp_path: Path) -> None:
    write_scene(Assembly((TABLE, TRAY, CRATE, BOX), friction=0.5), tmp_path / "truth.yaml")
    truths = graph.collect("world_truth", TFMessage)
    worlds = graph.collect("world", WorldState, LATCHED)
    start_node("fake_robot", ROBOT | {"world": str(tmp_path / "truth.yaml")})
    start_node("world_model", {"payload_period": 0.0})
    start_node("object_picker", ARM)
    start_node("placement_planner", ARM | {"candidates": 1, "support": "objects"})
    start_node("inertial_estimator", WEIGHER)
    start_node("acceleration_limits")
    start_node("object_carrier", {"ready_timeout": 10.0, "path_tolerance": 2.0})  # on machines that do other things
    picker, placer = Caller(graph, PickObject, "pick_object"), Caller(graph, PlaceObject, "place_object")
    weigher, carrier = Caller(graph, IdentifyPayload, "identify_payload"), Caller(graph, CarryObject, "carry_object")
    scans = graph.node.create_publisher(SegmentedObject, "segmented_object", LATCHED)
    frames = graph.node.create_publisher(TFMessage, "tf_static", LATCHED)
    for each in (picker, placer, weigher, carrier):
        each.ready()

    def newest(name: str) -> WorldObject:
        return next(each for each in worlds[-1].objects if each.object.id == name)

    def box(state: int, source: int) -> WorldObject:
        def found() -> bool:
            known = worlds[-1].objects if worlds else []
            return any((each.object.id, each.state, each.source) == ("box", state, source) for each in known)

        graph.wait_for(found, what=f"the box in state {state} from {source}")
        return newest("box")

    def centre(known: WorldObject) -> np.ndarray:
        com = known.object.inertia.com
        return np.array([com.x, com.y, com.z])

    def truth(name: str) -> np.ndarray:
        pose = next(each.transform for each in truths[-1].transforms if each.child_frame_id == name)
        return np.array([pose.translation.x, pose.translation.y, pose.translation.z])

    known = assembly_message(Assembly((TABLE, TRAY, CRATE), friction=0.5), FRAME)
    assert graph.call(SetAssembly, "set_assembly", SetAssembly.Request(assembly=known)).error.code == ErrorCode.OK
    scanned, there = scan(BOX, graph.node.get_clock().now().to_msg())
    frames.publish(there)
    scans.publish(scanned)
    box(WorldObject.STANDING, WorldObject.ASSUMED)

    picked = picker.result(picker.send(id="box", seed=1, deadline=60.0)).result
    assert (picked.error.message, picked.holding) == ("", True)
    assert picked.mass == pytest.approx(MASS, abs=3 * picked.mass_std)
    graph.wait_for(lambda: newest("box").object.inertia.m == pytest.approx(MASS, rel=0.05), what="the lifted mass")
    assert newest("box").state == WorldObject.HELD

    weighed = weigher.result(weigher.send(motion=IdentifyPayload.Goal.MOTION_STOP_AND_GO)).result
    assert weighed.error.message == ""
    assert weighed.estimate.inertia.m == pytest.approx(MASS, rel=0.015)
    held = box(WorldObject.HELD, WorldObject.WEIGHED).object.inertia
    assert held.m == pytest.approx(MASS, rel=0.015)
    graph.wait_for(lambda: centre(newest("box")) == pytest.approx(MIDDLE, abs=2e-3), what="its centre of mass")

    placed = placer.result(placer.send(held=True, execute=True, seed=1, deadline=60.0)).result
    assert placed.error.message == ""
    standing = box(WorldObject.STANDING, WorldObject.WEIGHED)
    graph.wait_for(lambda: truth("box")[2] < 0.55, what="it was put down")
    off = pose_of(standing.object.pose).apply(MIDDLE) - truth("box")
    assert np.abs(off).max() < 2e-3
    assert standing.object.inertia.m == pytest.approx(MASS, rel=0.015)

    before = {name: truth(name) for name in ("crate", "box")}
    table = assembly_message(Assembly((TABLE,), friction=0.5), FRAME)
    assert graph.call(SetAssembly, "set_assembly", change(SetAssembly.Request.REMOVE, table)).error.code == 0
    goal = PoseStamped(header=Header(frame_id="odom"))
    goal.pose.position.x, goal.pose.orientation.w = 1.0, 1.0
    carried = carrier.result(carrier.send(path=[goal], speed=0.25)).result
    assert (carried.error.message, carried.distance) == ("", pytest.approx(1.0, abs=0.03))
    drive = np.array([carried.pose.pose.position.x, carried.pose.pose.position.y, 0.0])
    for name, place in before.items():
        assert np.abs(truth(name) - place - drive).max() < 2e-3
