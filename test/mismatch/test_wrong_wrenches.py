"""Wrenches of wrong drivers: refused with the cause, corrected with a note, or named; never a false effect."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cases import ROBOT, make_case

from poise.errors import InputError
from poise.geometry import rotation_of_vector
from poise.mismatch.answer import diagnose
from poise.mismatch.reading.joint_input import check_joints
from poise.mismatch.reading.payload import identified
from poise.mismatch.reading.sanity import without_frozen
from poise.mismatch.reading.wrench_input import check_wrench
from poise.mismatch.reading.wrench_samples import usable
from poise.mismatch.recorded import WRENCH_CHANNELS, RecordedMotion, load_wrench
from poise.recording import WrenchStream
from poise.types import Array
from poise.weighing import on_both


def diagonal(*factors: float) -> Array:
    return np.diag(np.array(factors))


WRONG = {
    "force and torque have the opposite sign.* mounted upside down": -np.eye(6),
    "the torque has the opposite sign.* payload.com of the model": diagonal(1, 1, 1, -1, -1, -1),
    "fz alone has the opposite sign.* a joint counts in the opposite direction": diagonal(1, 1, -1, 1, 1, 1),
    "tx alone has the opposite sign": diagonal(1, 1, 1, -1, 1, 1),
    "the y axis is mirrored": diagonal(1, -1, 1, 1, -1, 1),
    "force x and force y are exchanged": on_both(np.eye(3)[[1, 0, 2]], np.eye(3)),
    "the torque comes first": np.roll(np.eye(6), 3, axis=1),
    "force is in kgf": np.eye(6) / 9.80665,
    "torque is in lbf in": diagonal(*[1 / 4.4482216] * 3, *[8.8507457] * 3),
    "torque is in N cm": diagonal(1, 1, 1, 100, 100, 100),
    "fz does not respond to the load": diagonal(1, 1, 0, 1, 1, 1),
}


@pytest.fixture(scope="module")
def healthy() -> RecordedMotion:
    return make_case(32).recorded()


def with_wrench(recorded: RecordedMotion, wrench: Array) -> RecordedMotion:
    """With a noise of 0.01 N and 0.5 mN m more, so that no channel is constant."""
    noise = np.random.default_rng(3).normal(size=wrench.shape) * np.repeat([0.01, 0.0005], 3)
    return replace(recorded, wrench=wrench + noise)


@pytest.mark.parametrize("words", WRONG)
def test_an_error_of_the_driver_is_refused_with_its_name(healthy: RecordedMotion, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_wrench(with_wrench(healthy, healthy.wrench @ WRONG[words].T), "a bag")


@pytest.mark.parametrize("words", ["the y axis is mirrored", "torque is in lbf in", "torque is in N cm"])
def test_without_a_stated_payload_an_error_of_the_driver_is_found_as_a_weighing_finds_it(
    healthy: RecordedMotion, words: str
) -> None:
    # A mirrored axis is half a turn about it and the opposite sign.
    with pytest.raises(InputError, match=f"{words}|179.9 .* and force and torque have the opposite sign"):
        identified(with_wrench(healthy, healthy.wrench @ WRONG[words].T))


def test_an_empty_hand_is_no_error_of_the_driver(healthy: RecordedMotion) -> None:
    assert abs(identified(with_wrench(healthy, 0.0 * healthy.wrench))[0]) < 0.01


def test_axes_of_the_base_are_refused(healthy: RecordedMotion) -> None:
    turn = healthy.rotation_world_sensor
    parts = (np.einsum("nij,nj->ni", turn, healthy.wrench[:, part]) for part in (slice(3), slice(3, 6)))
    with pytest.raises(InputError, match="axes of the base"):
        check_wrench(replace(healthy, wrench=np.hstack(list(parts))), "a bag")


def test_a_force_at_the_end_of_its_range_is_limited_and_not_dead(healthy: RecordedMotion) -> None:
    wrench = healthy.wrench + np.random.default_rng(3).normal(size=healthy.wrench.shape) * 0.01
    limit = np.quantile(np.abs(wrench[:, 2]), 0.02)
    wrench[:, 2] = np.clip(wrench[:, 2], -limit, limit)
    check_wrench(replace(healthy, wrench=wrench), "a bag")


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("degrees", [30.0, -90.0])
def test_a_robot_that_stands_turned_against_its_description_is_refused(
    healthy: RecordedMotion, axis: int, degrees: float
) -> None:
    turn = rotation_of_vector(np.radians(degrees) * np.eye(3)[axis])
    downwards = turn @ [0.0, 0.0, -1.0]
    gravity = np.linalg.norm(healthy.gravity[0]) * np.einsum("nji,j->ni", healthy.rotation_world_sensor, downwards)
    wrench = load_wrench(
        healthy.phi, gravity - healthy.linear_acceleration, healthy.angular_velocity, healthy.angular_acceleration
    )
    with pytest.raises(InputError, match="the base is turned by") as caught:
        check_wrench(with_wrench(healthy, wrench), "a bag")
    said = [float(word) for word in caught.value.message.split("along ")[1].split(" in")[0].split()]
    np.testing.assert_allclose(said, downwards, atol=0.08)  # the load is known to 1 %, and accelerates


@pytest.mark.parametrize("lag", [0.7, -2.0])
def test_a_clock_that_is_seconds_off_is_refused_with_the_lag(healthy: RecordedMotion, lag: float) -> None:
    shift = round(lag / healthy.period)
    rolled = replace(healthy, wrench=np.roll(healthy.wrench, shift, axis=0))
    row = np.arange(len(healthy))
    recorded = rolled.select((row >= shift) & (row < len(healthy) + shift))
    with pytest.raises(InputError, match=f"{abs(lag):.1f}. s {'late' if lag > 0 else 'early'}"):
        check_wrench(recorded, "a bag")


@pytest.mark.parametrize("factor", [0.4, 0.6, 1.8, 3.0])
def test_another_payload_is_no_error_of_the_driver(healthy: RecordedMotion, factor: float) -> None:
    check_wrench(replace(healthy, wrench=factor * healthy.wrench), "a bag")


@pytest.mark.parametrize("degrees", [(0, 0, 30), (0, 180, 0)])
def test_a_sensor_that_is_turned_by_any_angle_is_named(degrees: tuple[float, float, float]) -> None:
    case = make_case(32)
    recorded = case.recorded()
    turn = rotation_of_vector(np.radians(degrees))
    found = diagnose(replace(recorded, wrench=recorded.wrench @ on_both(turn, turn)), case.model)
    assert [finding.effect.name for finding in found.findings] == ["sensor_rotation"]
    values = np.array([found.findings[0].values[f"rotation_{axis}"] for axis in "xyz"])
    assert np.abs(rotation_of_vector(values) - turn).max() < 0.02


def test_a_span_of_one_reading_is_left_out_while_the_load_moves(healthy: RecordedMotion) -> None:
    wrench = healthy.wrench.copy()
    first, last = len(healthy) // 3, len(healthy) // 2
    wrench[first:last] = wrench[first]
    kept, (finding,) = without_frozen(replace(healthy, wrench=wrench))
    assert finding.kind == "wrench_frozen"
    assert finding.values == pytest.approx((healthy.seconds[first], healthy.seconds[last - 1]))
    assert len(kept) == len(healthy) - (last - first)


@pytest.mark.parametrize("channel", [0, 2, 4])
def test_one_channel_that_repeats_one_reading_is_frozen_and_a_channel_at_its_limit_is_not(
    channel: int, healthy: RecordedMotion
) -> None:
    wrench = healthy.wrench.copy()
    wrench[600:1000, channel] = wrench[600, channel]
    kept, (finding,) = without_frozen(replace(healthy, wrench=wrench))
    assert finding.sentence.startswith(WRENCH_CHANNELS[channel])
    assert finding.values == pytest.approx((healthy.seconds[600], healthy.seconds[999]))
    assert len(kept) == len(healthy) - 400
    beside_a_gap = healthy.wrench.copy()
    beside_a_gap[1000:1005, channel] = beside_a_gap[600, channel]
    rows = np.r_[:601, 1000 : len(healthy)]
    assert without_frozen(replace(healthy, wrench=beside_a_gap).select(rows))[1] == []
    limit = float(np.quantile(healthy.wrench[:, channel], 0.8))
    limited = healthy.wrench.copy()
    limited[:, channel] = np.minimum(limited[:, channel], limit)
    assert without_frozen(replace(healthy, wrench=limited))[1] == []


def test_coarse_readings_are_not_frozen(healthy: RecordedMotion) -> None:
    step = np.repeat([2.0, 0.2], 3)
    kept, found = without_frozen(replace(healthy, wrench=np.round(healthy.wrench / step) * step))
    assert (len(kept), found) == (len(healthy), [])


@pytest.mark.parametrize("times", [2, 5])
def test_repetitions_of_a_fast_driver_are_left_out(healthy: RecordedMotion, times: int) -> None:
    stamps = (np.arange(len(healthy) * times) * 1e9 * healthy.period / times).astype(np.int64)
    wrench, notes = usable(WrenchStream(stamps, np.repeat(healthy.wrench, times, axis=0), "ft_sensor"))
    assert len(wrench) == len(healthy)
    assert f"{times} times" in notes[0]


def test_coarse_readings_are_no_repetitions(healthy: RecordedMotion) -> None:
    stamps = (np.arange(len(healthy)) * 1e9 * healthy.period).astype(np.int64)
    step = np.repeat([2.0, 0.2], 3)
    wrench, notes = usable(WrenchStream(stamps, np.round(healthy.wrench / step) * step, "ft_sensor"))
    assert (len(wrench), notes) == (len(healthy), [])


def flipped(position: Array) -> Array:
    return position * np.where(np.array(ROBOT.joint_names) == "wrist_2_joint", -1.0, 1.0)


def rolled(position: Array) -> Array:
    return np.hstack([position[:, :3], np.roll(position[:, 3:], 1, axis=1)])


@pytest.mark.parametrize(("change", "words"), [(flipped, "opposite direction"), (rolled, "in the order")])
def test_joints_of_another_direction_or_order_are_refused_with_their_names(
    change: Callable[[Array], Array], words: str
) -> None:
    case = make_case(32)
    joints = replace(case.joints, position=change(case.joints.position), velocity=change(case.joints.velocity))
    recorded = replace(case, joints=joints).recorded()
    assert case.model.phi is not None
    with pytest.raises(InputError, match=words):
        check_joints(ROBOT, recorded, case.model.phi, "a bag")


def test_the_joints_of_a_healthy_recording_and_of_a_turned_sensor_are_right(healthy: RecordedMotion) -> None:
    phi = make_case(32).model.phi
    assert phi is not None
    turn = rotation_of_vector([0.0, 0.0, np.pi / 2])
    for wrench in (healthy.wrench, healthy.wrench @ on_both(turn, turn)):
        check_joints(ROBOT, replace(healthy, wrench=wrench), phi, "a bag")


@pytest.mark.parametrize("degrees", [45.0, -160.0])
def test_a_flange_that_is_turned_is_refused_with_the_angle(healthy: RecordedMotion, degrees: float) -> None:
    """The load turns with the sensor: its centre of mass is where the model has it."""
    phi, joints = make_case(32).model.phi, healthy.joints
    assert phi is not None
    assert joints is not None
    turn = rotation_of_vector(-np.radians(degrees) * joints.jacobian_in_sensor[0, 3:, -1])
    turned = (healthy.specific @ turn, healthy.angular_velocity @ turn, healthy.angular_acceleration @ turn)
    wrench = load_wrench(phi, *turned) + healthy.wrench - healthy.prediction
    with pytest.raises(InputError, match=rf"zero of wrist_3_joint was {degrees:.0f} degrees off"):
        check_joints(ROBOT, replace(healthy, wrench=wrench), phi, "a bag")
