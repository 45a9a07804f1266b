"""Commanded motion: joint commands and trajectories, as they were to be executed."""

import numpy as np
from other_formats import JAZZY
from test_bag_bad_input import refused

from poise.errors import ErrorCode
from poise.recording import RecordingWriter, joint_commands, open_recording


def trajectory(start, seconds, positions, names=("a", "b")):
    make = JAZZY.types
    duration = make["builtin_interfaces/msg/Duration"]
    point = make["trajectory_msgs/msg/JointTrajectoryPoint"]
    nothing = np.array([])
    points = [
        point(np.array(row, dtype=float), nothing, nothing, nothing, duration(sec=0, nanosec=int(1e9 * second)))
        for second, row in zip(seconds, positions, strict=True)
    ]
    stamp = make["builtin_interfaces/msg/Time"](sec=start, nanosec=0)
    header = make["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    message = make["trajectory_msgs/msg/JointTrajectory"](header, list(names), points)
    return bytes(JAZZY.serialize_cdr(message, "trajectory_msgs/msg/JointTrajectory"))


def write_trajectories(path, messages):
    with RecordingWriter(path) as writer:
        writer.add_topic("arm/joint_trajectory", "trajectory_msgs/msg/JointTrajectory")
        for log_time, data in messages:
            writer.write("arm/joint_trajectory", log_time, data)
    return open_recording(path)


def test_trajectories_are_read_as_commands(tmp_path):
    messages = [
        (2 * 10**9, trajectory(2, (0.1, 0.5, 0.9), ((1, 2), (3, 4), (5, 6)))),
        (3 * 10**9, trajectory(0, (0.0, 0.25), ((8, 7), (10, 9)), names=("b", "a"))),
    ]
    commands = joint_commands(write_trajectories(tmp_path / "run.mcap", messages))
    assert commands.names == ("a", "b")
    assert commands.stamps.tolist() == [2_100_000_000, 2_500_000_000, 2_900_000_000, 3_000_000_000, 3_250_000_000]
    assert commands.position.tolist() == [[1, 2], [3, 4], [5, 6], [7, 8], [9, 10]]
    assert np.isnan(commands.velocity).all()


def test_a_later_trajectory_replaces_the_rest_of_an_earlier_one(tmp_path):
    messages = [
        (10**9, trajectory(1, (0.0, 0.5, 0.9), ((1, 1), (2, 2), (3, 3)))),
        (10**9 + 1, trajectory(1, (0.4, 0.6), ((7, 7), (8, 8)))),
    ]
    commands = joint_commands(write_trajectories(tmp_path / "run.mcap", messages))
    assert commands.position[:, 0].tolist() == [1, 7, 8]


def test_commands_that_are_not_there_are_refused(bag, tmp_path):
    refused(lambda: joint_commands(open_recording(bag)), ErrorCode.TOPIC_MISSING, "joint_commands", "name the topic")
    refused(lambda: joint_commands(open_recording(bag), "imu"), ErrorCode.TYPE_MISMATCH, "sensor_msgs/msg/Imu")
    wrong = write_trajectories(tmp_path / "run.mcap", [(1, trajectory(1, (0.0,), ((1, 2, 3),)))])
    refused(lambda: joint_commands(wrong), ErrorCode.TYPE_MISMATCH, "3 positions for 2 joints")
