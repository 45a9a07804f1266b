"""The world's transitions: each does what it says, or refuses, and never leaves two truths."""

from dataclasses import replace

import numpy as np
import pytest

from poise.assembly import Assembly, Box, Cylinder, FrictionPair, Mesh, RigidObject
from poise.assembly.statics import same_object
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.world import WeightSource, Whereabouts, World, assumed_weight, load_world, save_world, settled

FLOOR = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose.from_vector([0, 0, -0.05, 0, 0, 0, 1]), fixed=True)
CUBE = RigidObject("cube", Box((0.1, 0.1, 0.1)), Pose.from_vector([0, 0, 0.05, 0, 0, 0, 1]), mass=1.0)
CAN = RigidObject("can", Cylinder(0.03, 0.1), Pose.from_vector([0.3, 0, 0.05, 0, 0, 0, 1]), mass=0.3)
SCENE = Assembly((FLOOR, CUBE, CAN), friction_pairs=(FrictionPair(("cube", "can"), 0.3),))
IN_HAND = Pose.from_vector([0, 0, 0.02, 0, 0, 0, 1])
S = 10**9
START = World("table").with_assembly(SCENE, "table", S)
HELD = START.grasped("can", IN_HAND, "tcp", 2 * S, lifted=(0.3, 0.002))


def refused(code, transition, *arguments, **named):
    with pytest.raises(InputError) as caught:
        transition(*arguments, **named)
    assert caught.value.code == code
    return caught.value.message


def test_what_is_grasped_leaves_the_assembly_and_comes_back_where_it_was_released():
    assert [item.id for item in HELD.assembly.objects] == ["floor", "cube"]
    assert (HELD.held.item.id, HELD.held.frame, HELD.version) == ("can", "tcp", START.version + 1)
    assert HELD.held.item.pose == IN_HAND
    assert not HELD.assembly.friction_pairs
    there = Pose.from_vector([0, 0, 0.15, 0, 0, 0, 1])
    placed = HELD.released("can", there, 3 * S)
    assert placed.held is None
    assert placed.assembly.objects[placed.assembly.place_of("can")].pose == there
    assert placed.assembly.friction_between("cube", "can") == 0.3
    assert placed.version == HELD.version + 1


def test_a_grasp_that_its_lift_verifies_is_still_held_since_it_was_grasped():
    grasped = START.grasped("can", IN_HAND, "tcp", 2 * S)
    verified = grasped.grasped("can", IN_HAND, "tcp", 9 * S, lifted=(0.31, 0.01))
    assert (verified.held.changed, verified.held.lifted) == (2 * S, (0.31, 0.01))
    assert verified.weighed(replace(CAN, mass=0.3), 3 * S).held.source is WeightSource.WEIGHED


def test_an_event_that_is_not_newer_changes_nothing():
    for stamp in (S, 2 * S):
        assert HELD.grasped("cube", IN_HAND, "tcp", stamp) is HELD
        assert HELD.released("can", CAN.pose, stamp) is HELD
        assert HELD.lost("can", stamp, "") is HELD


def test_a_grasp_that_comes_after_the_release_that_ended_it_is_history():
    empty = World("table").with_assembly(Assembly((FLOOR,)), "table", S)
    refused(ErrorCode.OBJECT_UNKNOWN, empty.released, "can", CAN.pose, 5 * S)
    assert empty.passed(5 * S).grasped("can", IN_HAND, "tcp", 2 * S, item=CAN).held is None


def test_the_hand_holds_one_object_and_what_it_held_before_is_lost():
    after = HELD.grasped("cube", IN_HAND, "tcp", 3 * S)
    assert after.held.item.id == "cube"
    assert after.objects["can"].where is Whereabouts.LOST
    assert [item.id for item in after.assembly.objects] == ["floor"]


def test_what_is_lost_stands_nowhere_until_it_is_scanned():
    lost = HELD.lost("can", 3 * S, "it slipped")
    assert lost.held is None
    assert "can" not in lost.assembly.index
    found = lost.scanned(assumed_weight(CAN), 4 * S)
    assert found.objects["can"].where is Whereabouts.STANDING
    assert "can" in found.assembly.index


def test_unknown_and_fixed_objects_are_not_held():
    refused(ErrorCode.OBJECT_UNKNOWN, START.grasped, "cup", IN_HAND, "tcp", 2 * S)
    refused(ErrorCode.BAD_INPUT, START.grasped, "floor", IN_HAND, "tcp", 2 * S)
    refused(ErrorCode.OBJECT_UNKNOWN, START.released, "cup", IN_HAND, 2 * S)
    refused(ErrorCode.OBJECT_UNKNOWN, START.lost, "floor", 2 * S, "")
    brought = START.grasped("cup", IN_HAND, "tcp", 2 * S, item=replace(CAN, id="cup"))
    assert brought.held.item.id == "cup"


def test_an_assembly_with_the_held_object_is_refused_and_one_without_it_keeps_it():
    assert "in the hand" in refused(ErrorCode.BAD_INPUT, HELD.with_assembly, SCENE, "table", 3 * S)
    after = HELD.with_assembly(Assembly((FLOOR,)), "table", 3 * S)
    assert after.held.item.id == "can"
    assert after.version == HELD.version + 1
    back = after.released("can", CAN.pose, 4 * S)
    assert [item.id for item in back.assembly.objects] == ["floor", "can"]


def test_the_same_poses_in_another_frame_are_in_that_frame():
    moved = START.with_assembly(SCENE, "tray", 2 * S)
    assert {known.frame for known in moved.objects.values()} == {"tray"}


def test_a_scan_of_what_is_held_or_fixed_or_without_an_assembly_is_refused():
    refused(ErrorCode.BAD_INPUT, HELD.scanned, assumed_weight(CAN), 3 * S)
    refused(ErrorCode.BAD_INPUT, START.scanned, assumed_weight(replace(CAN, id="floor")), 3 * S)
    refused(ErrorCode.EMPTY, World("table").scanned, assumed_weight(CAN), 3 * S)


def test_an_old_scan_does_not_bring_back_what_was_moved_since():
    placed = HELD.released("can", Pose.from_vector([0, 0, 0.15, 0, 0, 0, 1]), 5 * S)
    assert placed.scanned(assumed_weight(CAN), 4 * S) is placed
    scanned = placed.scanned(assumed_weight(replace(CAN, id="cup")), 6 * S)
    gone = scanned.with_assembly(SCENE, "table", 7 * S)
    assert gone.scanned(assumed_weight(replace(CAN, id="cup")), 6 * S) is gone


def test_a_second_scan_replaces_the_first_and_keeps_the_mass_but_not_the_centre_of_mass():
    weighed = replace(CAN, com=np.array([0.0, 0.0, 0.02]), covariance=1e-6 * np.eye(10))
    start = World("table").with_assembly(Assembly((FLOOR, weighed)), "table", S)
    again = start.scanned(assumed_weight(replace(CAN, pose=Pose.from_vector([0.4, 0, 0.05, 0, 0, 0, 1]))), 2 * S)
    item = again.objects["can"].item
    assert len(again.objects) == 2
    assert (item.mass, item.com) == (0.3, None)
    assert np.sqrt(item.covariance[3, 3]) > 0.3 * 0.005  # metres times mass: it may be anywhere within the can
    assert again.scanned(assumed_weight(CAN), 3 * S).objects["can"].item.mass == 0.3  # also at the third scan
    other = start.scanned(assumed_weight(replace(CAN, shape=Cylinder(0.03, 0.2))), 2 * S).objects["can"]
    assert other.item.mass != 0.3
    assert "another object" in other.notes[0]


def test_an_estimate_is_of_the_held_object_since_it_is_held():
    estimate = replace(CAN, mass=0.302, com=np.array([0.0, 0.0, 0.01]), covariance=1e-6 * np.eye(10))
    weighed = HELD.weighed(estimate, 2 * S)
    assert weighed.held.source is WeightSource.WEIGHED
    assert weighed.held.item.mass == 0.302
    assert weighed.version == HELD.version
    standing = weighed.released("can", CAN.pose, 3 * S)
    assert standing.objects["can"].item.mass == 0.302
    assert standing.objects["can"].item.covariance is not None
    refused(ErrorCode.OBJECT_UNKNOWN, standing.weighed, estimate, 4 * S)
    refused(ErrorCode.OBJECT_UNKNOWN, HELD.weighed, replace(estimate, id="cube"), 2 * S)
    assert "before can was grasped" in refused(ErrorCode.SENSOR_STALE, HELD.weighed, estimate, S)


def test_an_estimate_that_contains_the_gripper_is_refused():
    message = refused(ErrorCode.NOT_CONSISTENT, HELD.weighed, replace(CAN, mass=1.2), 2 * S)
    assert "zero the sensor" in message


def test_what_is_lifted_says_the_mass_where_nothing_better_is_known():
    scanned = START.scanned(assumed_weight(replace(CAN, id="cup")), 2 * S)
    assert scanned.objects["cup"].source is WeightSource.ASSUMED
    held = scanned.grasped("cup", IN_HAND, "tcp", 3 * S, lifted=(0.42, 0.01)).held
    assert (held.item.mass, held.source) == (0.42, WeightSource.ASSUMED)
    assert held.item.covariance[0, 0] == pytest.approx(1e-4)
    assert HELD.held.item is not CAN
    assert (HELD.held.item.mass, HELD.held.item.covariance, HELD.held.source) == (0.3, None, WeightSource.GIVEN)
    other = START.grasped("can", IN_HAND, "tcp", 2 * S, lifted=(0.5, 0.002)).held
    assert (other.item.mass, other.source) == (0.5, WeightSource.ASSUMED)
    assert "were believed" in other.notes[-1]


def test_an_assumed_weight_covers_what_hands_pick_up():
    item = assumed_weight(CAN)
    std = np.sqrt(item.covariance[0, 0])
    for density in (100.0, 2700.0):
        assert abs(density * CAN.shape.volume - item.mass) < 3 * std
    assert np.linalg.eigvalsh(item.covariance).min() > -1e-18


def test_a_scan_is_settled_on_what_is_under_it_or_refused():
    high = replace(CAN, pose=Pose.from_vector([0.3, 0, 0.054, 0, 0, 0, 1]))
    np.testing.assert_allclose(settled(high, START.assembly.without("can"), 0.01).pose.translation, [0.3, 0, 0.05])
    turn = np.sin(np.radians(0.75))
    leaning = replace(CAN, pose=Pose.from_vector([0.0, 0, 0.148, turn, 0, 0, np.sqrt(1 - turn**2)]))
    on_cube = settled(leaning, START.assembly.without("can"), 0.01)
    np.testing.assert_allclose(on_cube.pose.rotation, np.eye(3), atol=1e-12)
    assert on_cube.vertices[:, 2].min() == pytest.approx(0.1, abs=1e-12)
    over = replace(CAN, pose=Pose.from_vector([0.3, 0, 0.2, 0, 0, 0, 1]))
    assert "stands on nothing" in refused(ErrorCode.FLOATING, settled, over, START.assembly, 0.01)


def corners():
    solid = Box((0.05, 0.04, 0.03)).polyhedron
    return Mesh(solid.vertices, solid.triangles)


def test_the_file_gives_the_same_world_back_and_says_that_the_hand_was_not_verified(tmp_path):
    world = HELD.scanned(assumed_weight(RigidObject("cup", corners(), CAN.pose, mass=1.0)), 3 * S, ["seen from above"])
    save_world(world, tmp_path / "world")
    again = load_world(tmp_path / "world")
    assert (again.frame, again.version, again.newest_event, again.newest_scan) == ("table", world.version, 2 * S, 3 * S)
    for name, known in world.objects.items():
        read = again.objects[name]
        assert same_object(known.item, read.item)
        assert (known.where, known.source, known.changed, known.frame) == (
            read.where, read.source, read.changed, read.frame,
        )  # fmt: skip
    assert again.objects["cup"].notes == ("seen from above",)
    assert "not verified" in again.held.notes[-1]
    save_world(replace(again, rolling=0.01, friction_deviation=0.05), tmp_path / "world")
    read = load_world(tmp_path / "world").assembly
    assert (read.rolling, read.friction_deviation) == (0.01, 0.05)
    assert len(load_world(tmp_path / "world").held.notes) == 1
    assert again.released("can", CAN.pose, 4 * S).assembly.friction_between("cube", "can") == 0.3


@pytest.mark.parametrize("damage", ["cut", "changed", "other", "empty"])
def test_a_damaged_file_is_refused(tmp_path, damage):
    path = tmp_path / "world"
    save_world(HELD, path)
    data = path.read_bytes()
    path.write_bytes(
        {"cut": data[:-20], "changed": data.replace(b"0.3", b"0.4"), "other": b"objects: []", "empty": b""}[damage]
    )
    assert "move the file away" in refused(ErrorCode.FILE_CORRUPT, load_world, path)
