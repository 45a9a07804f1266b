"""An arm on a base that drives is weighed with the base's odometry, live as in a recording."""

import numpy as np
import pytest
from simulated_motion import GRAVITY, LOAD, fr3, swing

from poise.errors import InputError
from poise.inertia import identify
from poise.inertia.model import regressor
from poise.inertia.pipeline import FLUSH_AFTER, LiveEstimator, LiveOptions, status_of
from poise.recording import JointStream, PoseStream, WrenchStream, open_recording, write_recording
from poise.robot import BaseMotion, RobotModel, find_urdf, sensor_motion

URDF = find_urdf("fr3").read_text()
START = 1_700_000_000_000_000_000


def drive(seconds):
    """x, y, yaw of a base that accelerates by up to 0.9 m/s2, with its rates."""
    rate, zero = 1.5, np.zeros_like(seconds)
    pose = np.stack([0.4 * (1 - np.cos(rate * seconds)), zero, 0.2 * np.sin(rate * seconds)], axis=1)
    velocity = np.stack([0.4 * rate * np.sin(rate * seconds), zero, 0.2 * rate * np.cos(rate * seconds)], axis=1)
    second = rate**2 * np.stack([0.4 * np.cos(rate * seconds), zero, -0.2 * np.sin(rate * seconds)], axis=1)
    return pose, velocity, second


@pytest.fixture(scope="module")
def streams():
    rng, names = np.random.default_rng(4), fr3().joint_names
    at = np.arange(0.0, 8.0, 0.01)
    stamps = START + np.round(at * 1e9).astype(np.int64)
    position = swing(at)[0] + rng.normal(0.0, 2e-6, (len(at), 7))
    unknown = np.full(position.shape, np.nan)
    base = BaseMotion.planar(*drive(at))
    floating = RobotModel.from_urdf(URDF, fr3().sensor_frame, base="floating")
    motion = sensor_motion(floating, stamps, *swing(at), base)
    specific = motion.gravity_in_sensor([0, 0, -GRAVITY]) - motion.linear_acceleration_in_sensor
    wrench = regressor(specific, motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor) @ LOAD.phi
    wrench = wrench + rng.normal(size=wrench.shape) * np.repeat((0.05, 0.002), 3)
    where = base.translation_world_base + rng.normal(0.0, 1e-4, (len(at), 3)) * [1, 1, 0]
    return {
        "joint_states": JointStream(stamps, names, position, unknown, unknown),
        "odom": PoseStream(stamps, base.rotation_world_base, where, "odom", "base_link"),
        "wrench": WrenchStream(stamps, wrench, fr3().sensor_frame),
    }


def live(streams, odometry=True):
    estimator = LiveEstimator(LiveOptions())
    estimator.set_robot_description(URDF, 0.0)
    joints, odom, wrench = (streams[topic] for topic in ("joint_states", "odom", "wrench"))
    for k, stamp in enumerate(wrench.stamps.tolist()):
        now = k * 0.01
        estimator.add_joint_state(stamp, joints.names, joints.position[k], [], now)
        if odometry:
            pose = odom.rotation_parent_child[k], odom.translation_parent_child[k]
            estimator.add_odometry(stamp, *pose, now)
        estimator.add_wrench(stamp, wrench.frame_id, wrench.wrench_in_sensor[k], now)
        if k % 5 == 4:
            estimator.update(now)
    estimator.update(now + 2 * FLUSH_AFTER)
    return estimator.estimate()


def test_odometry_is_used_live_as_in_a_recording(streams, tmp_path):
    write_recording(tmp_path / "drive.mcap", streams, robot_description=URDF)
    recording = open_recording(tmp_path / "drive.mcap")
    from_file = identify(recording).estimate
    on_robot = live(streams | {"odom": recording.odometry()})  # quaternions round the rotations
    np.testing.assert_allclose(on_robot.phi, from_file.phi, atol=1e-9, rtol=0)
    assert on_robot.findings == from_file.findings
    assert abs(on_robot.phi[0] - LOAD.phi[0]) < 5 * np.sqrt(on_robot.covariance[0, 0]) < 0.05


def test_without_odometry_the_drive_is_not_seen(streams):
    error = abs(live(streams, odometry=False).phi[0] - LOAD.phi[0])
    assert error > 5 * abs(live(streams).phi[0] - LOAD.phi[0])


def test_odometry_that_is_no_pose_does_not_move_the_base_and_a_base_whose_odometry_stops_is_reported(streams):
    estimator = LiveEstimator(LiveOptions())
    estimator.set_robot_description(URDF, 0.0)
    joints, wrench = streams["joint_states"], streams["wrench"]
    pose = np.eye(3), np.zeros(3)

    def hear(count):
        for k in range(count):
            stamp, now = int(joints.stamps[k]), k * 0.01
            estimator.add_joint_state(stamp, joints.names, joints.position[k], [], now)
            estimator.add_wrench(stamp, wrench.frame_id, wrench.wrench_in_sensor[k], now)

    for turn, shift in (
        pose,
        (np.eye(3), [np.nan, 0, 0]),
        (np.full((3, 3), np.nan), pose[1]),
        (2 * np.eye(3), pose[1]),
    ):
        estimator.add_odometry(START, turn, shift, 0.0)
    assert (estimator.base_moves, estimator.invalid_odometry) == (False, 3)
    hear(20)
    assert "joint_states" in estimator.estimator.motion_words
    estimator.add_odometry(START, np.eye(3), [0.1, 0, 0], 0.0)
    hear(300)
    assert status_of(estimator, 3.0).message.startswith("no odometry for 3.0 s, and the base has moved")
    estimator.reset()
    hear(300)
    estimator.update(3.0 + 2 * FLUSH_AFTER)
    assert estimator.n_samples > 100


def test_an_invalid_robot_description_does_not_replace_a_valid_one(streams):
    estimator = LiveEstimator(LiveOptions())
    wrench = streams["wrench"]
    estimator.add_wrench(START, wrench.frame_id, wrench.wrench_in_sensor[0], 0.0)
    estimator.set_robot_description(URDF, 0.0)
    known = estimator.joints
    with pytest.raises(InputError):
        estimator.set_robot_description("<robot", 0.1)
    assert estimator.joints is known
    assert estimator.problem is None


@pytest.mark.parametrize("invalid", ["<robot", URDF.replace("ft_sensor", "wrist")])
@pytest.mark.parametrize("wrench_first", [True, False])
def test_nor_one_that_waits_for_the_sensor_frame_or_did_not_work(streams, wrench_first, invalid):
    estimator = LiveEstimator(LiveOptions(sensor_frame="ft_sensor" if "wrist" in invalid else ""))
    wrench = streams["wrench"]

    def feel() -> None:
        estimator.add_wrench(START, "ft_sensor", wrench.wrench_in_sensor[0], 0.0)

    if wrench_first:
        feel()
    with pytest.raises(InputError) as caught:
        estimator.set_robot_description(invalid, 0.0)
    assert estimator.problem is caught.value  # there is none yet
    estimator.set_robot_description(URDF, 0.1)
    assert estimator.problem is None
    with pytest.raises(InputError):
        estimator.set_robot_description(invalid, 0.2)
    feel()
    assert estimator.joints is not None
    assert estimator.problem is None
