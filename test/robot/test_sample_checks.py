"""Samples that are no measurements of their own, and odometry that is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.geometry import rotation_of_quaternion
from poise.recording import JointStream, PoseStream
from poise.robot import blanks, interpolated, lapsed, stands_alone, usable_odometry
from poise.types import Array

TIMES = np.arange(2000) * 0.008


def smooth(times: Array) -> Array:
    return np.stack([np.sin(times), 0.7 * np.cos(1.3 * times), np.sin(0.6 * times + 1.0)], axis=1)


def stream(times: Array, values: Array) -> JointStream:
    empty = np.full_like(values, np.nan)
    return JointStream(np.rint(times * 1e9).astype(np.int64), ("a", "b", "c"), values, empty, empty)


@pytest.mark.parametrize("digits", [None, 7])
def test_samples_on_lines_between_others_are_found(digits: int | None) -> None:
    rng = np.random.default_rng(5)
    own = smooth(TIMES) + 1e-4 * rng.standard_normal((len(TIMES), 3))
    times = np.unique(np.concatenate([TIMES, rng.uniform(0.0, TIMES[-1], 1500)]))
    values = np.stack([np.interp(times, TIMES, column) for column in own.T], axis=1)
    if digits:
        values = np.array([[float(f"{cell:.{digits}g}") for cell in row] for row in values])
    found = interpolated(stream(times, values), values)
    assert (found == ~np.isin(times, TIMES)).mean() > 0.99


@pytest.mark.parametrize(
    "values",
    [
        smooth(TIMES),  # of a simulator, without noise
        np.round(smooth(TIMES) / 1e-3) * 1e-3,
        np.round(smooth(0.02 * TIMES) / 1e-4) * 1e-4,  # slow, coarse
        np.outer(TIMES, [0.1, 0.2, -0.1]),  # at constant speed
        np.zeros((len(TIMES), 3)),
        np.random.default_rng(1).standard_normal((len(TIMES), 3)),
    ],
)
def test_measurements_are_not_taken_for_interpolated(values: Array) -> None:
    assert not interpolated(stream(TIMES, values), values).any()


def test_a_sample_stands_alone_but_for_whole_turns() -> None:
    values = smooth(TIMES)
    values[[50, 900]] = -999.0
    assert np.flatnonzero(stands_alone(values, np.zeros(3, dtype=bool))).tolist() == [50, 900]
    values = smooth(TIMES)
    values[50, 0] += 2.0 * np.pi
    assert not stands_alone(values, np.array([True, False, False])).any()


def test_zeros_between_other_samples_are_blanks() -> None:
    values = smooth(TIMES)
    values[10::3] = 0.0
    values[11::9] = 0.0
    assert np.array_equal(blanks(values), (values == 0.0).all(axis=1))
    values = smooth(TIMES)
    values[:500] = values[900:990] = 0.0  # at home
    assert not blanks(values).any()
    tared = np.round(np.random.default_rng(2).standard_normal((2000, 3)))
    assert (tared == 0.0).all(axis=1).any()
    assert not blanks(tared).any()


def test_joints_that_jump_to_zero_for_a_while_lapse_and_those_that_move_there_do_not() -> None:
    values = smooth(TIMES)
    values[700:712] = values[900:990] = 0.0
    assert np.array_equal(lapsed(values), (values == 0.0).all(axis=1))
    home = smooth(TIMES) * np.clip(np.abs(TIMES - 8.0) - 0.5, 0.0, 1.0)[:, None]
    assert (home == 0.0).all(axis=1).sum() > 100
    assert not lapsed(home).any()
    begun = smooth(TIMES)
    begun[:500] = 0.0
    assert not lapsed(begun).any()


def odometry(yaw: Array, place: Array, order: tuple[int, ...] = (0, 1, 2, 3)) -> PoseStream:
    still = np.zeros(len(yaw))
    quaternion = np.stack([still, still, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)[:, order]
    stamps = np.rint(TIMES[: len(yaw)] * 1e9).astype(np.int64)
    return PoseStream(stamps, rotation_of_quaternion(quaternion), place, "odom", "base_link")


def test_poses_that_are_none_are_left_out_with_a_note() -> None:
    place = smooth(TIMES)
    place[100] = np.nan
    place[[300, 301, 700]] = [[-999.0] * 3] * 2 + [[0.0] * 3]  # two in a row are no single jump
    pose = odometry(0.3 * TIMES, place)
    turned = np.array(pose.rotation_parent_child)
    turned[200] = np.nan
    pose = PoseStream(pose.stamps, turned, place, "odom", "base_link")
    found, notes = usable_odometry(pose)
    assert len(found) == len(TIMES) - 3
    assert ["no valid pose" in note or "single outliers" in note for note in notes] == [True, True]
    assert notes[0].startswith("2 ")
    assert notes[1].startswith("1 ")


def test_quaternions_in_the_order_w_x_y_z_are_refused() -> None:
    usable_odometry(odometry(0.3 * TIMES, smooth(TIMES)))
    with pytest.raises(InputError, match="order w x y z") as caught:
        usable_odometry(odometry(0.3 * TIMES, smooth(TIMES), (3, 0, 1, 2)))
    assert caught.value.code is ErrorCode.BAD_INPUT


def test_a_twist_that_no_message_has_is_none() -> None:
    pose = odometry(0.3 * TIMES, smooth(TIMES))
    twist = np.full((len(TIMES), 6), np.nan)
    found, notes = usable_odometry(replace(pose, twist_in_child=twist))
    assert (len(found), found.twist_in_child, notes) == (len(TIMES), None, [])
    twist[1:] = 0.0
    assert len(usable_odometry(replace(pose, twist_in_child=twist))[0]) == len(TIMES) - 1


def test_odometry_without_valid_poses_is_refused() -> None:
    with pytest.raises(InputError, match="0 of 2000 poses") as caught:
        usable_odometry(odometry(0.0 * TIMES, np.full((len(TIMES), 3), np.nan)))
    assert caught.value.code is ErrorCode.TOO_FEW_SAMPLES
