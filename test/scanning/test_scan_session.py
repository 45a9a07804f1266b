"""Messages of a scan in any order, and what is said of those that are missing."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_cloud_frames import cloud_of

from poise.errors import ErrorCode, InputError
from poise.fake_robots.sweep_bag import image_bytes
from poise.recording import IMAGE, open_recording, typestore
from poise.recording.images import image_of, messages_of
from poise.recording.streams import stamp_of
from poise.scanning import SweepOptions, frame_of_cloud, read_sweep, scan_sweep
from poise.scanning.imaging import frame_of
from poise.scanning.reading import camera_of, fixed_transforms
from poise.scanning.session import RobotLog, ScanSession, SessionOptions

BAG = Path(__file__).parents[2] / "bags" / "hammer_sweep.mcap"
DEPTH, INFO = "camera/aligned_depth_to_color/image_raw", "camera/aligned_depth_to_color/camera_info"


@pytest.fixture(scope="module")
def bag():
    return open_recording(BAG)


def heard(bag, without=()):
    """A robot with the joint states of the bag."""
    robot = RobotLog()
    robot.description = "" if "description" in without else bag.robot_description()
    for transform in () if "tf" in without else fixed_transforms(bag):
        robot.fixed[transform.child] = transform
    if "joints" not in without:
        for message in messages_of(bag, "joint_states"):
            robot.add_joint_state(stamp_of(message), message.name, message.position.tolist())
    return robot


def taken(bag, count, camera=True, colours_first=False):
    session = ScanSession(SessionOptions(count, 0.2, 60.0, 5.0), 0.0)
    if camera:
        session.set_camera(camera_of(next(messages_of(bag, INFO))))
    depths = [image_of(message, DEPTH) for message in messages_of(bag, DEPTH)][: 2 * count]
    colours = [image_of(message, "colour") for message in messages_of(bag, "camera/color/image_raw")][: 2 * count]
    for depth, colour in zip(depths, colours, strict=True):
        if colours_first:
            session.add_colour(colour)
        session.add_depth(depth, 1.0)
        if not colours_first:
            session.add_colour(colour)
    return session


@pytest.mark.parametrize("colours_first", [True, False])
def test_a_session_gives_the_views_that_the_bag_gives(bag, colours_first):
    session = taken(bag, 6, colours_first=colours_first)
    assert session.count == 6
    found = session.sweep(heard(bag), SweepOptions())
    expected = {view.frame.stamp: view for view in read_sweep(bag, SweepOptions()).views}
    for view in found.views:
        other = expected[view.frame.stamp]
        np.testing.assert_allclose(view.translation_world_camera, other.translation_world_camera, atol=1e-12)
        np.testing.assert_array_equal(view.frame.depth, other.frame.depth)
        np.testing.assert_array_equal(view.frame.colours, other.frame.colours)


def test_frames_that_come_too_soon_are_left_out(bag):
    session = ScanSession(SessionOptions(100, 0.5, 60.0, 5.0), 0.0)
    for message in list(messages_of(bag, DEPTH))[:9]:  # 0.24 s apart
        session.add_depth(image_of(message, DEPTH), 1.0)
    assert session.count == 3


def test_it_is_enough_when_all_is_there_or_nothing_more_comes():
    session = ScanSession(SessionOptions(10, 0.2, 60.0, 5.0), 100.0)
    assert not session.enough(104.9)
    assert session.enough(105.1)
    patient = ScanSession(SessionOptions(10, 0.2, 3.0, 500.0), 100.0)
    assert patient.enough(103.1)


def test_a_camera_that_paused_is_reported(bag):
    assert not any("no frame" in note for note in taken(bag, 6).sweep(heard(bag), SweepOptions()).notes)
    session = ScanSession(SessionOptions(10, 0.2, 60.0, 5.0), 100.0)
    session.set_camera(camera_of(next(messages_of(bag, INFO))))
    depths = [image_of(message, DEPTH) for message in messages_of(bag, DEPTH)]
    for depth in [*depths[:3], *depths[20:23]]:
        session.add_depth(depth, 103.0)
    assert session.silent(104.5) == 1.5
    gap = (depths[20].stamp - depths[2].stamp) * 1e-9
    assert session.longest_gap == pytest.approx(gap, abs=1e-9)
    assert f"no frame for {gap:.1f} s" in session.sweep(heard(bag), SweepOptions()).notes[-1]


@pytest.mark.parametrize(
    ("count", "camera", "without", "code"),
    [
        (0, True, (), ErrorCode.TOPIC_MISSING),
        (2, False, (), ErrorCode.TOPIC_MISSING),
        (2, True, ("description",), ErrorCode.ROBOT_DESCRIPTION_MISSING),
        (2, True, ("joints",), ErrorCode.TOPIC_MISSING),
        (2, True, ("tf",), ErrorCode.FRAME_UNKNOWN),
    ],
)
def test_what_did_not_come_is_named(bag, count, camera, without, code):
    with pytest.raises(InputError) as caught:
        taken(bag, count, camera).sweep(heard(bag, without), SweepOptions())
    assert caught.value.code == code


def test_joint_states_without_positions_or_of_other_joints_do_not_count():
    robot = RobotLog()
    robot.add_joint_state(1, ["a", "b"], [])
    assert robot.newest == 0
    robot.add_joint_state(5, ["a"], [0.1])
    with pytest.raises(InputError) as caught:
        robot.joints(("a", "b"))
    assert caught.value.code == ErrorCode.JOINT_MISSING
    robot.add_joint_state(7, ["b", "a"], [0.3, 0.2])
    np.testing.assert_allclose(robot.joints(("a", "b")).position, [[0.2, 0.3]])
    robot.add_joint_state(7 - 2 * 10**9, ["a", "b"], [0.0, 0.0])  # the clock was set back
    assert len(robot.joints(("a", "b"))) == 1


def in_metres(session, depth, camera):
    """A depth image as a message of 32FC1."""
    pixels = np.where(depth.pixels > 0, depth.pixels * np.float32(1e-3), np.float32(np.nan)).astype(np.float32)
    message = typestore().deserialize_cdr(image_bytes(depth.stamp, depth.frame_id, pixels, "32FC1"), IMAGE)
    session.add_depth(image_of(message, DEPTH), 1.0)


def in_steps(session, depth, camera):
    """The driver's own message of 16UC1."""
    session.add_depth(depth, 1.0)


def in_points(session, depth, camera):
    """The same as a PointCloud2."""
    frame = frame_of(depth, camera)
    cloud = cloud_of(replace(frame, colours=np.zeros((*frame.depth.shape, 3), np.uint8)))
    cloud.fields = cloud.fields[:3]
    seconds, rest = divmod(depth.stamp, 10**9)
    cloud.header = SimpleNamespace(frame_id=depth.frame_id, stamp=SimpleNamespace(sec=seconds, nanosec=rest))
    session.add_cloud(frame_of_cloud(cloud), 1.0)


@pytest.mark.parametrize("send", [in_steps, in_metres, in_points])
def test_depth_alone_floats_and_clouds_give_the_object(bag, send):
    session = ScanSession(SessionOptions(100, 0.2, 60.0, 5.0), 0.0)
    camera = camera_of(next(messages_of(bag, INFO)))
    session.set_camera(camera)
    for message in list(messages_of(bag, DEPTH))[::2]:
        send(session, image_of(message, DEPTH), camera)
    sweep = session.sweep(heard(bag), SweepOptions())
    assert len(sweep.views) == session.count >= 20
    found = scan_sweep(sweep)
    assert found.colours is None
    assert found.segmented().volumes.sum() == pytest.approx(2.08e-4, rel=0.3)
