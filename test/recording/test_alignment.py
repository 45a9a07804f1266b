"""Alignment in time against closed forms: straight lines, constant turning, gaps, edges, clocks."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.recording import (
    JointStream,
    PoseStream,
    Reason,
    WrenchStream,
    interpolate,
    interpolate_rotations,
    nearest,
    resample,
)

MS = 1_000_000
EPOCH = 1_700_000_000_000_000_000  # where float64 seconds would lose tenths of microseconds


def irregular(rng, count=200):
    return EPOCH + np.cumsum(rng.integers(1, 10 * MS, count))


def test_interpolation_of_a_straight_line_is_exact():
    rng = np.random.default_rng(0)
    stamps = irregular(rng)
    slope, start = rng.normal(size=6), rng.normal(size=6)

    def line(at):
        return start + slope * ((at - EPOCH) * 1e-9)[:, None]

    wanted = rng.integers(stamps[0], stamps[-1], 500)
    result = interpolate(stamps, line(stamps), wanted, max_gap=0.01)
    assert result.found.all()
    np.testing.assert_allclose(result.values, line(wanted), rtol=0, atol=1e-12)


def test_interpolation_of_a_constant_turn_is_exact_and_gives_rotations():
    rng = np.random.default_rng(1)
    stamps = irregular(rng)
    start, velocity = Rotation.random(rng=rng), np.array([7.0, -3.0, 5.0])

    def turn(at):
        return (start * Rotation.from_rotvec(velocity * ((at - EPOCH) * 1e-9)[:, None])).as_matrix()

    wanted = rng.integers(stamps[0], stamps[-1], 500)
    result = interpolate_rotations(stamps, turn(stamps), wanted, max_gap=0.01)
    np.testing.assert_allclose(result.values, turn(wanted), rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        result.values @ result.values.transpose(0, 2, 1), np.tile(np.eye(3), (500, 1, 1)), atol=1e-12
    )


def test_rotations_go_the_shorter_way():
    around = Rotation.from_rotvec(np.deg2rad([[0, 0, 170], [0, 0, -170]])).as_matrix()
    middle = interpolate_rotations(np.array([0, 2]), around, np.array([1]), max_gap=1.0).values[0]
    np.testing.assert_allclose(middle, np.diag([-1.0, -1.0, 1.0]), atol=1e-12)


def test_nothing_is_interpolated_across_a_gap_or_beyond_the_ends_and_the_reason_is_given():
    stamps = np.array([10, 20, 60, 70]) * MS
    wanted = np.array([9, 10, 15, 20, 21, 40, 59, 60, 70, 71]) * MS
    result = interpolate(stamps, stamps / MS, wanted, max_gap=0.010)
    R = Reason
    expected = [R.BEFORE, R.FOUND, R.FOUND, R.FOUND, R.GAP, R.GAP, R.GAP, R.FOUND, R.FOUND, R.AFTER]
    np.testing.assert_array_equal(result.reason, expected)
    np.testing.assert_allclose(result.values[result.found], [10, 15, 20, 60, 70], rtol=1e-15)
    assert np.isnan(result.values[~result.found]).all()


def test_a_sample_that_is_not_finite_spoils_its_neighbourhood_only():
    stamps = np.arange(5) * MS
    values = np.array([0.0, 1.0, np.nan, 3.0, np.inf])
    wanted = (np.array([0.5, 1.0, 1.5, 2.0, 3.0, 3.5]) * MS).astype(np.int64)
    result = interpolate(stamps, values, wanted, max_gap=1)
    bad = Reason.NOT_FINITE
    np.testing.assert_array_equal(result.reason, [0, 0, bad, bad, 0, bad])
    np.testing.assert_array_equal(result.values, [0.5, 1.0, np.nan, np.nan, 3.0, np.nan])


def test_nearest_agrees_with_a_search_through_all_pairs():
    rng = np.random.default_rng(2)
    stamps = np.sort(rng.integers(0, 1000, 60))
    wanted = rng.integers(-100, 1100, 400)
    pairing = nearest(stamps, wanted, max_gap=12e-9)
    distances = np.abs(stamps[None] - wanted[:, None])
    best = distances.min(axis=1)
    np.testing.assert_array_equal(pairing.found, best <= 12)
    np.testing.assert_array_equal(np.abs(stamps[pairing.index] - wanted)[pairing.found], best[pairing.found])
    np.testing.assert_allclose(np.abs(pairing.distance), best * 1e-9)
    assert (pairing.index[~pairing.found] == -1).all()
    outside = (wanted < stamps[0]) | (wanted > stamps[-1])
    assert (pairing.reason[~pairing.found & ~outside] == Reason.GAP).all()


def test_of_two_equally_near_samples_the_earlier_is_taken():
    assert nearest(np.array([0, 10]), np.array([5]), max_gap=1.0).index.tolist() == [0]


@pytest.mark.parametrize("offset", [0.0125, -3.0])
def test_a_clock_offset_shifts_the_stream(offset):
    stamps = EPOCH + np.arange(100) * MS
    values = np.sin(np.arange(100.0))
    wanted = stamps[10:20] + round(offset * 1e9)
    result = interpolate(stamps, values, wanted, max_gap=0.01, clock_offset=offset)
    np.testing.assert_array_equal(result.values, values[10:20])
    assert nearest(stamps, wanted, max_gap=0.01, clock_offset=offset).index.tolist() == list(range(10, 20))


def test_of_samples_with_one_stamp_the_last_counts():
    stamps = np.array([0, 10, 10, 20])
    result = interpolate(stamps, np.array([0.0, 1.0, 2.0, 4.0]), np.array([10, 15]), max_gap=1.0)
    np.testing.assert_array_equal(result.values, [2.0, 3.0])


def test_an_empty_stream_gives_nothing_and_one_sample_gives_itself():
    none = np.zeros(0, dtype=np.int64)
    assert not interpolate(none, np.zeros((0, 3)), np.array([1, 2]), max_gap=1.0).found.any()
    assert not nearest(none, np.array([1]), max_gap=1.0).found.any()
    assert len(interpolate(np.array([5]), np.ones(1), none, max_gap=1.0).values) == 0
    one = interpolate(np.array([5]), np.array([7.0]), np.array([4, 5, 6]), max_gap=1.0)
    np.testing.assert_array_equal(one.reason, [Reason.BEFORE, Reason.FOUND, Reason.AFTER])
    assert one.values[1] == 7.0


def test_rotations_that_are_all_out_of_reach_and_nothing_wanted_are_no_error():
    stamps, rotations = np.array([0, 100]), np.tile(np.eye(3), (2, 1, 1))
    beyond = interpolate_rotations(stamps, rotations, np.array([500, 600]), max_gap=1.0)
    assert list(beyond.reason) == [Reason.AFTER, Reason.AFTER]
    assert np.isnan(beyond.values).all()
    assert interpolate_rotations(stamps, rotations, np.zeros(0, dtype=np.int64), max_gap=1.0).values.shape == (0, 3, 3)


def test_resampling_a_stream_at_its_own_stamps_changes_nothing():
    rng = np.random.default_rng(3)
    stamps = irregular(rng, 20)
    pose = PoseStream(stamps, Rotation.random(20, rng=rng).as_matrix(), rng.normal(size=(20, 3)), "base", "tool")
    again, reason = resample(pose, stamps, max_gap=1.0)
    assert (reason == Reason.FOUND).all()
    np.testing.assert_array_equal(again.translation_parent_child, pose.translation_parent_child)
    np.testing.assert_allclose(again.rotation_parent_child, pose.rotation_parent_child, atol=1e-14)
    assert (again.parent, again.child) == ("base", "tool")


def test_columns_that_were_never_measured_do_not_spoil_a_resampled_stream():
    stamps = np.arange(3) * MS
    nothing = np.full((3, 2), np.nan)
    joints = JointStream(stamps, ("a", "b"), np.arange(6.0).reshape(3, 2), nothing, nothing)
    middle, reason = resample(joints, stamps[:2] + MS // 2, max_gap=1.0)
    np.testing.assert_array_equal(middle.position, [[1, 2], [3, 4]])
    assert (reason == Reason.FOUND).all()
    spoiled = WrenchStream(stamps, np.array([[0.0] * 6, [np.nan] + [0.0] * 5, [0.0] * 6]), "ft")
    assert resample(spoiled, stamps[:2] + MS // 2, max_gap=1.0)[1].tolist() == [Reason.NOT_FINITE] * 2


@pytest.mark.parametrize(
    ("code", "arguments"),
    [
        (ErrorCode.TIME_BACKWARDS, {"stamps": np.array([2, 1])}),
        (ErrorCode.TYPE_MISMATCH, {"stamps": np.array([0.5, 1.0])}),
        (ErrorCode.TYPE_MISMATCH, {"wanted": np.array([[1]])}),
        (ErrorCode.SHAPE_MISMATCH, {"values": np.zeros(3)}),
        (ErrorCode.BAD_INPUT, {"max_gap": -1.0}),
        (ErrorCode.BAD_INPUT, {"max_gap": np.nan}),
        (ErrorCode.BAD_INPUT, {"clock_offset": np.inf}),
    ],
)
def test_senseless_arguments_are_refused_by_name(code, arguments):
    good = {"stamps": np.array([1, 2]), "values": np.zeros(2), "wanted": np.array([1]), "max_gap": 1.0}
    with pytest.raises(InputError) as caught:
        interpolate(**(good | arguments))
    assert caught.value.code == code


def test_a_matrix_that_is_no_rotation_is_refused():
    mirror = np.tile(np.diag([1.0, 1.0, -1.0]), (2, 1, 1))
    with pytest.raises(InputError, match="not a rotation"):
        interpolate_rotations(np.array([0, 2]), mirror, np.array([1]), max_gap=1.0)
