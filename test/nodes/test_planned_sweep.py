"""A sweep that the scanner plans for the table of the assembly: the fake robot's camera sees what stands there."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from action_caller import Caller
from ros_graph import Graph, NodeProcess
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from poise.assembly import Assembly, Box, Cylinder, RigidObject, write_scene
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.manipulation import Arm
from poise.nodes.assembly_message import assembly_message, object_message
from poise.nodes.object_scanner import ObjectScanner
from poise.nodes.placed_arm import assumed_base
from poise.nodes.runtime import LATCHED, SCANS, TF_STATIC
from poise.recording import Image, stamp_of
from poise.scanning import ScanSession, SessionOptions
from poise_msgs.action import ScanObject
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import SegmentedObject, WorldObject, WorldState

pytestmark = pytest.mark.ros
PATIENT = {"stop_silence": 5.0, "motion_lead": 0.5, "stop_unattended": 60.0}
"""On machines that do other things."""
Start = Callable[..., NodeProcess]


def at(x: float, y: float, z: float) -> Pose:
    return Pose(np.eye(3), np.array([x, y, z]))


TABLE = RigidObject("table", Box((0.2, 0.28, 0.02)), at(0.48, 0.0, 0.19), fixed=True)
BOX = RigidObject("box", Box((0.06, 0.05, 0.07)), at(0.46, 0.07, 0.235), mass=0.3)
CAN = RigidObject("can", Cylinder(0.025, 0.06), at(0.5, -0.07, 0.23), mass=0.2)


@pytest.mark.alone
def test_what_stands_on_the_table_is_found_by_a_planned_sweep(graph: Graph, start_node: Start, tmp_path: Path) -> None:
    write_scene(Assembly((TABLE, BOX, CAN), friction=0.5), tmp_path / "truth.yaml")
    known = graph.node.create_publisher(AssemblyMessage, "assembly", LATCHED)
    known.publish(assembly_message(Assembly((TABLE,), friction=0.5), "world"))
    parcel = WorldObject(frame_id="world", object=object_message(replace(BOX, id="parcel")))
    worlds = graph.node.create_publisher(WorldState, "world", LATCHED)
    worlds.publish(WorldState(header=Header(frame_id="world"), objects=[parcel]))
    scans = graph.collect("segmented_object", SegmentedObject, SCANS)
    frames = graph.collect("tf_static", TFMessage, TF_STATIC)
    robot = {"mode": "arm", "robot": "fr3", "sensor": "none", "sensor_rate": 50.0, "joint_rate": 50.0, "camera": True}
    robot |= {"gripper_joint": "finger_joint", "world": str(tmp_path / "truth.yaml"), "camera_width": 240}
    start_node("fake_robot", robot)
    start_node(
        "object_scanner",
        {"sweep": "plan", "all_objects": True, "region_height": 0.1, "ready_timeout": 20.0} | PATIENT,
    )
    scanner = Caller(graph, ScanObject, "scan_object").ready()
    done = scanner.result(scanner.send(id="thing", max_frames=45)).result
    assert (done.error.message, done.error.code) == ("", ErrorCode.OK)
    graph.wait_for(lambda: len(scans) == 2, what="both objects")

    def found() -> dict[str, Any]:
        return {each.child_frame_id: each.transform.translation for message in frames for each in message.transforms}

    graph.wait_for(lambda: {"thing", "parcel"} <= found().keys(), what="their frames")
    there = found()
    assert {each.id for each in scans} == {"thing", "parcel"}  # what the world knows keeps its name
    assert stamp_of(scans[0]) < stamp_of(scans[1])  # else world_model would take the second for an old one
    for scan in scans:
        shift = there[scan.header.frame_id]
        coms = [[part.unit_inertia.com.x, part.unit_inertia.com.y, part.unit_inertia.com.z] for part in scan.parts]
        middle = np.average(coms, axis=0, weights=[part.volume for part in scan.parts])
        centre = np.array([shift.x, shift.y, shift.z]) + middle
        truth = BOX if scan.id == "parcel" else CAN
        assert np.abs(truth.pose.translation - centre).max() < 0.005
        assert scan.volume == pytest.approx(truth.shape.volume, rel=0.15)

    known.publish(assembly_message(Assembly((TABLE, replace(TABLE, id="shelf")), friction=0.5), "world"))
    graph.meet()
    lost = scanner.result(scanner.send(id="thing")).result.error
    assert (lost.code, "shelf" in lost.message) == (ErrorCode.BAD_INPUT, True)


def test_what_a_plan_assumes_and_does_not_see_is_said_with_the_scan() -> None:
    assumed = assumed_base(Arm.load("fr3"), "map", [0.0, 1.0, 0.0, 0.0])
    assert assumed.endswith("tf does not connect it with map; it stands at the parameter base, [0, 1, 0, 0]")
    plan = SimpleNamespace(motion="a motion", notes=("the sweep sees 60% of the faces of its region",))
    task = SimpleNamespace(arm=None, region="a region", plan=lambda start, seconds, cancelled: plan)
    planner = SimpleNamespace(arm=lambda robot: (None, [assumed]), task=lambda *_: task)
    values = {"hand_eye": [np.nan] * 7, "calibration": "", "plan_seconds": 1.0}
    goal = SimpleNamespace(request=ScanObject.Goal(id="thing"))
    scanner = SimpleNamespace(_values=values, _planner=planner, _robot=None, _cancelled=Event())
    _, motion = ObjectScanner._to_plan(scanner, goal)  # type: ignore[arg-type]
    assert motion(np.zeros(7)) == "a motion"
    assert (scanner._region, scanner._plan_notes) == ("a region", (assumed, *plan.notes))


def test_a_camera_that_pauses_does_not_end_a_sweep() -> None:
    session = ScanSession(SessionOptions(frames=10, patience=5.0), 0.0)
    scanner = SimpleNamespace(_sweep=SimpleNamespace(over=False), _over=0.0)

    def enough(now: float) -> bool:
        return ObjectScanner._enough(scanner, session, now)  # type: ignore[arg-type]

    assert enough(5.1)  # no frame at all: the camera's driver is not running
    session.add_depth(Image(10**9, "camera", "16UC1", np.ones((2, 2), np.uint16)), 5.0)
    assert not enough(10.9)
    session.add_depth(Image(6 * 10**9, "camera", "16UC1", np.ones((2, 2), np.uint16)), 11.0)
    scanner._sweep.over, scanner._over = True, 12.0
    assert not enough(12.4)
    session.add_depth(Image(8 * 10**9, "camera", "16UC1", np.ones((2, 2), np.uint16)), 12.5)  # one that came late
    assert not enough(12.9)
    assert enough(13.1)
