"""The tree of frames: chains, common ancestors, interpolation, fixed mountings, conflicts."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.robot import FrameTree, Mounting


def random_pose(rng) -> Pose:
    return Pose(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))


def added(tree, parent, child, pose, stamp=0, fixed=False):
    return tree.add([stamp], parent, child, pose.rotation[None], pose.translation[None], fixed=fixed)


def close(a: Pose, b: Pose) -> bool:
    return np.allclose(a.rotation, b.rotation, atol=1e-12) and np.allclose(a.translation, b.translation, atol=1e-12)


def test_frames_are_joined_through_their_nearest_common_ancestor():
    rng = np.random.default_rng(1)
    steps = {name: random_pose(rng) for name in ("arm", "hand", "camera", "tray", "cup")}
    tree = FrameTree()
    for parent, child in (("base", "arm"), ("arm", "hand"), ("hand", "camera"), ("arm", "tray"), ("tray", "cup")):
        added(tree, parent, child, steps[child])
    in_arm = (steps["hand"] @ steps["camera"]).inverse @ steps["tray"] @ steps["cup"]
    assert close(tree.pose("cup", "camera"), in_arm)
    assert close(tree.pose("camera", "cup"), in_arm.inverse)
    assert close(tree.pose("cup", "base"), steps["arm"] @ steps["tray"] @ steps["cup"])
    assert tree.pose("cup", "elsewhere") is None
    assert tree.path("camera", "arm") == ["hand", "camera"]
    assert tree.top("cup") == "base"


def test_moving_transforms_are_interpolated_and_fixed_ones_hold():
    rng = np.random.default_rng(2)
    mounted = random_pose(rng)
    axis = np.array([0.0, 0.0, 1.0])
    stamps = np.arange(0, 1_000_000_001, 100_000_000)
    turns = Rotation.from_rotvec(np.outer(stamps * 1e-9, axis)).as_matrix()
    tree = FrameTree()
    tree.add(stamps, "world", "base", turns, np.outer(stamps * 1e-9, [1.0, 2.0, 3.0]))
    added(tree, "base", "sensor", mounted, fixed=True)
    wanted = np.array([50_000_000, 720_000_000, 2_000_000_000])
    pose, known = tree.poses("sensor", "world", wanted)
    np.testing.assert_array_equal(known, [True, True, False])
    for k in range(2):
        t = wanted[k] * 1e-9
        expected = Pose(Rotation.from_rotvec(t * axis).as_matrix(), t * np.array([1.0, 2.0, 3.0])) @ mounted
        assert close(Pose(pose.rotation[k], pose.translation[k]), expected)


def test_only_frames_that_do_not_move_against_each_other_are_mounted():
    rng = np.random.default_rng(3)
    imu, sensor, arm = (random_pose(rng) for _ in range(3))
    tree = FrameTree(keep=False)
    added(tree, "base", "flange", arm)
    added(tree, "flange", "imu", imu, fixed=True)
    added(tree, "flange", "sensor", sensor, fixed=True)
    assert close(tree.pose("imu", "sensor", fixed_only=True), sensor.inverse @ imu)
    assert tree.pose("imu", "base", fixed_only=True) is None
    added(tree, "flange", "imu", imu)  # a publisher of tf, not tf_static
    assert tree.pose("imu", "sensor", fixed_only=True) is None


def test_a_second_parent_is_refused_or_taken_over_as_wanted():
    rng = np.random.default_rng(4)
    strict, free = FrameTree(), FrameTree(one_parent=False)
    for tree in (strict, free):
        added(tree, "tray", "cup", random_pose(rng))
    with pytest.raises(InputError, match="tray") as caught:
        added(strict, "gripper", "cup", random_pose(rng))
    assert caught.value.code is ErrorCode.FRAME_UNKNOWN
    held = random_pose(rng)
    added(free, "gripper", "cup", held, stamp=1)
    assert free.pose("cup", "tray") is None
    assert close(free.pose("cup", "gripper"), held)


def test_a_circle_ends_and_invalid_transforms_are_counted():
    tree = FrameTree()
    assert added(tree, "a", "b", Pose.identity())
    assert added(tree, "b", "a", Pose.identity())
    assert tree.pose("a", "b") is not None
    assert not added(tree, "a", "c", Pose(2.0 * np.eye(3), np.zeros(3)))
    assert not added(tree, "a", "c", Pose(np.eye(3), np.full(3, np.nan)))
    assert tree.not_finite == 2
    assert "c" not in tree.frames


def test_a_clock_that_is_set_back_starts_the_samples_over():
    tree = FrameTree()
    added(tree, "base", "sensor", Pose.identity(), stamp=10_000_000_000)
    added(tree, "base", "sensor", Pose.identity(), stamp=1_000_000_000)
    assert tree.jumps == 1
    np.testing.assert_array_equal(tree.stamps(["sensor"], 0, 2**62), [1_000_000_000])


def test_a_mounting_needs_a_unit_quaternion():
    assert Mounting.of_vector("link", "camera", [1, 2, 3, 0, 0, 0, 1]).parent == "link"
    for wrong in ([1, 2, 3, 0, 0, 0, 2], [1, 2, 3], [np.nan, 0, 0, 0, 0, 0, 1]):
        with pytest.raises(InputError, match="not a pose"):
            Mounting.of_vector("link", "camera", wrong)
