"""Trajectories: their derivatives are derivatives, they meet their waypoints, and files say what is wrong with them."""

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.robot import RobotModel
from poise.simulation import (
    FourierTrajectory,
    SplineTrajectory,
    WaypointTrajectory,
    check_limits,
    home,
    read_trajectory,
)

FR3 = RobotModel.from_file("fr3")
RNG = np.random.default_rng(0)
TIMES = np.array([0.0, 0.8, 2.0, 2.7])
MOTIONS = {
    "fourier": FourierTrajectory.random(FR3, np.random.default_rng(1), duration=6.0),
    "waypoints": WaypointTrajectory(TIMES, *RNG.normal(size=(3, 4, 3))),
    "stop and go": WaypointTrajectory.stop_and_go(RNG.normal(size=(3, 2)), 1.0, 0.5),
    "spline": SplineTrajectory(np.linspace(0, 3, 40), np.sin(np.outer(np.linspace(0, 3, 40), [1.0, 2.0]))),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_velocity_and_acceleration_are_the_derivatives(name):
    trajectory = MOTIONS[name]
    t = np.linspace(0.011, trajectory.duration - 0.011, 500)
    h = 1e-5
    before, here, after = (trajectory.at(t + s * h) for s in (-1, 0, 1))
    apart = np.abs(t[:, None] - TIMES).min(axis=1) > 2 * h  # accelerations may have a corner at a waypoint
    velocity, acceleration = ((after[i] - before[i]) / (2 * h) for i in (0, 1))
    scale = np.abs(here.acceleration).max()
    np.testing.assert_allclose(here.velocity, velocity, atol=1e-6 * scale)
    np.testing.assert_allclose(here.acceleration[apart], acceleration[apart], atol=1e-3 * scale)


@pytest.mark.parametrize("name", ["fourier", "stop and go", "spline"])
def test_the_robot_is_at_rest_before_and_after(name):
    trajectory = MOTIONS[name]
    around = trajectory.at(np.array([-1.0, 0.0, trajectory.duration, trajectory.duration + 1.0]))
    np.testing.assert_allclose(around.velocity, 0.0, atol=1e-9)
    np.testing.assert_allclose(around.acceleration, 0.0, atol=1e-7)
    np.testing.assert_allclose(around.position[0], around.position[1], atol=1e-12)


def test_waypoints_are_met_with_their_velocity_and_acceleration():
    trajectory = MOTIONS["waypoints"]
    met = trajectory.at(TIMES)
    for value, given in zip(met, (trajectory.position, trajectory.velocity, trajectory.acceleration), strict=True):
        np.testing.assert_allclose(value, given, atol=1e-9)


def test_a_random_fourier_motion_keeps_to_the_limits_and_repeats_with_its_seed():
    for seed in range(5):
        check_limits(FR3, FourierTrajectory.random(FR3, np.random.default_rng(seed), speed=1.0, amplitude=10.0))
    again = FourierTrajectory.random(FR3, np.random.default_rng(1), duration=6.0)
    np.testing.assert_array_equal(again.sine, MOTIONS["fourier"].sine)


def test_a_motion_beyond_the_limits_is_refused_by_joint_and_time():
    there = np.tile(home(FR3), (2, 1))
    there[1, 3] = 0.5
    with pytest.raises(InputError, match="fr3_joint4 leaves its range") as caught:
        check_limits(FR3, WaypointTrajectory(np.array([0.0, 2.0]), there))
    assert caught.value.code is ErrorCode.JOINT_LIMIT
    there[1] = there[0]
    there[1, 0] += 1.0
    with pytest.raises(InputError, match="fr3_joint1 exceeds its speed"):
        check_limits(FR3, WaypointTrajectory(np.array([0.0, 0.3]), there))


GOOD = {
    "stops.yaml": "joints: [fr3_joint1, fr3_joint4]\n"
    "stop_and_go: {move: 1.0, dwell: 0.5, positions: [[0, -1.5], [0.5, -2]]}",
    "way.yaml": "joints: [fr3_joint1]\nwaypoints:\n- {time: 0, position: [0]}\n"
    "- {time: 1, position: [0.3], velocity: [0.1]}",
    "wave.yaml": "fourier: {seed: 3, duration: 4, harmonics: 2}",
    "dense.csv": "time, fr3_joint2, fr3_joint1\n0, 0, 0\n1, 0.1, 0.2\n2, 0.2, 0.3\n",
}


@pytest.mark.parametrize("name", GOOD)
def test_files_are_read_and_joints_not_named_stay_home(name, tmp_path):
    (tmp_path / name).write_text(GOOD[name])
    trajectory = read_trajectory(tmp_path / name, FR3)
    check_limits(FR3, trajectory)
    motion = trajectory.at(np.array([0.0, 1.0]))
    if name != "wave.yaml":
        np.testing.assert_allclose(motion.position[:, 4:], np.tile(home(FR3)[4:], (2, 1)), atol=1e-12)
        np.testing.assert_allclose(motion.velocity[:, 4:], 0.0, atol=1e-12)
    if name == "dense.csv":
        np.testing.assert_allclose(motion.position[1, :2], [0.2, 0.1], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("a.yaml", "", "expected waypoints"),
        ("a.yaml", "{", "not YAML"),
        ("a.yaml", "!!python/object/apply:os.system [ls]", "not YAML"),
        ("a.yaml", "waypoints: 3", "list"),
        ("a.yaml", "waypoints: [{time: 0}]", "position"),
        ("a.yaml", "waypoints: [{time: soon, position: [0,0,0,0,0,0,0]}]", "time must be a number"),
        ("a.yaml", "joints: [elbow]\nwaypoints: [{time: 0, position: [0]}]", "no joint elbow"),
        ("a.yaml", "joints: [fr3_joint1]\nwaypoints: [{time: 0, position: [0, 1]}]", "1 joints"),
        ("a.yaml", "joints: [fr3_joint1]\nwaypoints: [{time: 1, position: [0]}, {time: 0, position: [0]}]", "ascend"),
        ("a.yaml", "fourier: {amplitud: 3}", "amplitud"),
        ("a.yaml", "fourier: {duration: -3}", "positive"),
        ("a.csv", "time, fr3_joint1\n0, 0\n1, x\n", "numbers"),
        ("a.csv", "0, 0\n1, 1\n", "header"),
    ],
)
def test_what_is_wrong_in_a_file_is_said_with_its_name(name, text, why, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=why) as caught:
        read_trajectory(tmp_path / name, FR3)
    assert str(tmp_path / name) in caught.value.message


def test_a_missing_trajectory_file_is_said(tmp_path):
    with pytest.raises(InputError) as caught:
        read_trajectory(tmp_path / "none.yaml", FR3)
    assert caught.value.code is ErrorCode.FILE_UNREADABLE
