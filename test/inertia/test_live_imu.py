"""An IMU on the running robot: the real arm of which only attitudes were recorded, and a base that drives."""

from pathlib import Path

import numpy as np
import pytest
from simulated_motion import BIAS, GRAVITY, LOAD, record, swing

from poise.errors import InputError
from poise.inertia.model.problem import NoiseLevels
from poise.inertia.model.wrench_regressor import regressor
from poise.inertia.pipeline.live import LiveEstimator
from poise.inertia.pipeline.live_options import LiveOptions
from poise.recording import Recording, open_recording
from poise.robot import sensor_motion
from poise.robot.model import find_urdf

BAGS = Path(__file__).parents[2] / "bags"
LOCAL_GRAVITY = 9.82085  # where the arm stands, see bags/README.md
WEIGHED = 0.9323  # kg, in its static poses


def replay(live: LiveEstimator, recording: Recording, seconds: float) -> None:
    """Every message in the order of time, with an update every 50 ms."""
    wrench, poses, imu = recording.wrench(), recording.poses("ft_sensor"), recording.imu("imu")
    mounting = recording.poses("imu")
    turn, shift = mounting.rotation_parent_child[0], mounting.translation_parent_child[0]
    live.add_transform(int(mounting.stamps[0]), mounting.parent, "imu", turn, shift, True, 0.0)
    begin = int(wrench.stamps[0])
    messages = [
        (int(stamp), kind, k)
        for kind, stream in enumerate((wrench, poses, imu))
        for k, stamp in enumerate(stream.stamps)
        if stamp < begin + seconds * 1e9
    ]
    updated = 0.0
    for stamp, kind, k in sorted(messages):
        now = (stamp - begin) * 1e-9
        if kind == 0:
            live.add_wrench(stamp, "ft_sensor", wrench.wrench_in_sensor[k], now)
        elif kind == 1:
            rotation, translation = poses.rotation_parent_child[k], poses.translation_parent_child[k]
            live.add_transform(stamp, poses.parent, "ft_sensor", rotation, translation, False, now)
        else:
            live.add_imu(stamp, "imu", imu.linear_acceleration[k])
        if now - updated > 0.05:
            live.update(now)
            updated = now


@pytest.mark.parametrize(("name", "within"), [("free_motion", 0.01), ("vibration", 0.02)])
def test_an_arm_of_unknown_places_is_weighed_as_it_moves(name, within):
    noise = NoiseLevels(force=0.1, torque=0.005, force_bias=20.0, torque_bias=1.0)  # never zeroed
    live = LiveEstimator(LiveOptions(method="poise", gravity=LOCAL_GRAVITY, noise=noise, continuous=True))
    replay(live, open_recording(BAGS / f"kuka_{name}.mcap"), 30.0)
    answer = live.estimate()
    assert answer.parameters.mass == pytest.approx(WEIGHED, rel=within)
    assert answer.parameters.com[2] == pytest.approx(0.0439, abs=0.001)
    assert -0.012 < answer.delay < -0.004  # of wrenches against the IMU, see test_weighing_recordings
    assert live.changes == []
    assert "imu" in live.estimator.motion_words


def driven(imu: str) -> LiveEstimator:
    """An arm that swings on a base that drives to and fro, which its joint states do not know."""
    rng = np.random.default_rng(6)
    scene = record(swing, 8.0, rng=rng)
    stamps = scene.wrench.stamps
    seconds = (stamps - scene.joints.stamps[0]) * 1e-9
    motion = sensor_motion(scene.model, stamps, *swing(seconds))
    omega, alpha = motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor
    of_base = np.outer(np.sin(2.5 * seconds), [1.5, 0.8, 0.0])
    of_base = np.einsum("nji,nj->ni", motion.rotation_world_sensor, of_base)  # in sensor axes
    wrench = scene.wrench.wrench_in_sensor + regressor(-of_base, 0 * omega, 0 * omega) @ LOAD.phi
    place, turn = np.array([0.03, -0.02, 0.05]), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    felt = motion.linear_acceleration_in_sensor + of_base - motion.gravity_in_sensor([0, 0, -GRAVITY])
    felt += np.cross(alpha, place) + np.cross(omega, np.cross(omega, place)) + rng.normal(0.0, 0.02, felt.shape)
    live = LiveEstimator(LiveOptions(method="poise", imu=imu, noise=NoiseLevels(force_bias=20.0, torque_bias=1.0)))
    live.set_robot_description(find_urdf("fr3").read_text(), 0.0)
    live.add_transform(int(stamps[0]), "ft_sensor", "imu", turn, place, True, 0.0)
    for k, now in enumerate(seconds.tolist()):
        live.add_wrench(int(stamps[k]), "ft_sensor", wrench[k], now)
        live.add_imu(int(stamps[k]), "imu", felt[k] @ turn)
        if k % 5 == 0:
            joints, at = scene.joints, k // 5
            live.add_joint_state(int(joints.stamps[at]), joints.names, joints.position[at], [], now)
            live.update(now)
    return live


def test_on_a_base_that_drives_the_imu_knows_what_the_joints_do_not():
    known, unknown = (driven(imu).estimate() for imu in ("always", "never"))
    assert known.parameters.mass == pytest.approx(LOAD.mass, rel=0.005)
    np.testing.assert_allclose(known.parameters.com, LOAD.com, atol=1e-3)
    np.testing.assert_allclose(known.parameters.inertia, LOAD.inertia, atol=5e-4)
    np.testing.assert_allclose(known.bias, BIAS, atol=0.1)
    assert abs(unknown.parameters.mass / LOAD.mass - 1) > 0.01


def test_an_imu_that_is_not_wanted_is_not_taken_and_not_kept():
    live = LiveEstimator(LiveOptions(imu="never"))
    live.add_imu(0, "imu", np.array([0.0, 0.0, 9.8]))
    assert live.imu.newest is None
    with pytest.raises(InputError, match="imu 'sometimes'"):
        LiveEstimator(LiveOptions(imu="sometimes"))
