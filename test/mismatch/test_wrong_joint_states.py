"""Joint states of wrong drivers: left out or corrected with a finding; never a false effect."""

import re
from dataclasses import replace

import numpy as np
import pytest
from field_robots import ARM, Recorded, read, urdf

from poise.errors import InputError
from poise.geometry import STANDARD_GRAVITY
from poise.mismatch.reading import InputFinding, ReadRecording, parse_model
from poise.mismatch.recorded import at_times
from poise.recording import JointStream
from poise.robot import RobotModel, resample, without_turns
from poise.simulation import IdealRobot, JointMotion
from poise.types import Array

SLOW = Recorded(damping=2.0, coulomb=1.0)


def only(reading: ReadRecording, kind: str) -> InputFinding:
    (finding,) = reading.findings
    assert finding.kind == kind
    assert finding.sentence in reading.notes
    return finding


def with_effort(joints: JointStream, effort: Array) -> JointStream:
    return replace(joints, effort=effort)


@pytest.mark.parametrize(
    ("order", "said"),
    [
        ([1, 0, 2], "shoulder and elbow were exchanged"),
        ([2, 0, 1], "in the order wrist shoulder elbow"),
    ],
)
def test_efforts_of_joints_in_another_order_are_left_out(order: list[int], said: str) -> None:
    joints = SLOW.joints()
    reading = read(with_effort(joints, joints.effort[:, order]))
    assert said in only(reading, "effort_order").sentence
    assert reading.recorded.effort is None


SKEWED = urdf(("first", "revolute", "0 1 0"), ("second", "revolute", "0.6 0 0.8"), ("third", "revolute", "0 1 0"))


@pytest.mark.parametrize(
    ("order", "sign", "said"),
    [
        ([1, 0, 2], [1, 1, 1], "first and second were exchanged"),
        ([1, 2, 0], [1, 1, 1], "in the order"),
        ([0, 1, 2], [-1, 1, 1], "first counted in the opposite direction"),
    ],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_positions_that_the_efforts_contradict_are_refused(
    order: list[int], sign: list[int], said: str, seed: int
) -> None:
    joints = Recorded(SKEWED, damping=1.0, coulomb=0.5, seconds=20.0, seed=seed).joints()
    moved = replace(joints, position=joints.position[:, order] * sign, velocity=joints.velocity[:, order] * sign)
    with pytest.raises(InputError, match=f"do not follow from the joint positions; they would if .*{said}"):
        read(moved, SKEWED)


@pytest.mark.parametrize("seed", range(3))
def test_efforts_with_a_load_that_the_model_lacks_do_not_contradict_the_positions(seed: int) -> None:
    case = Recorded(SKEWED, damping=1.0, seconds=20.0, seed=seed)
    joints = case.joints()
    robot = RobotModel.from_urdf(SKEWED, "link_3")
    load = np.array([3.0, 0.3, 0.0, 0.6, 0.1, 0.0, 0.0, 0.1, 0.0, 0.1])
    moved = resample(joints.seconds, joints.position, joints.seconds)
    parts = (part[moved.known] for part in (moved.position, moved.velocity, moved.acceleration))
    motion = JointMotion(*parts)
    effort = joints.effort.copy()
    effort[moved.known] += IdealRobot(robot, load).effort(motion) - IdealRobot(robot, np.zeros(10)).effort(motion)
    assert read(with_effort(joints, effort), SKEWED).recorded.effort is not None


@pytest.mark.parametrize("samples", [-20, 6, 50])
def test_efforts_that_are_late_are_left_out_with_the_delay(samples: int) -> None:
    joints = replace(Recorded(damping=2.0, coulomb=1.0, seconds=20.0), rate=125.0).joints()
    late = joints.effort[np.clip(np.arange(len(joints)) - samples, 0, len(joints) - 1)]
    reading = read(with_effort(joints, late))
    assert only(reading, "effort_late").values == pytest.approx((samples / 125.0,), abs=0.011)
    assert reading.recorded.effort is None


@pytest.mark.parametrize("late", [-0.012, 0.01, 0.0165])
@pytest.mark.parametrize("seed", [1, 2])
def test_efforts_that_are_a_little_late_are_moved(late: float, seed: int) -> None:
    """A filter of 15 ms was `joint_coupling` (93 %)."""
    joints = Recorded(damping=2.0, coulomb=1.0, seconds=20.0, seed=seed).joints()
    effort = at_times(joints.seconds, joints.effort, joints.seconds - late)
    reading = read(with_effort(joints, effort))
    assert only(reading, "effort_late").values == pytest.approx((late,), abs=0.003)
    track, intended = reading.recorded.effort, read(joints).recorded.effort
    assert track is not None
    assert intended is not None
    there = at_times(intended.seconds, intended.measured, track.seconds)
    inner = (track.seconds > 1.0) & (track.seconds < track.seconds[-1] - 1.0)
    before = at_times(joints.seconds, effort, track.seconds)
    assert np.std((track.measured - there)[inner]) < 0.5 * np.std((before - there)[inner])


@pytest.mark.parametrize("late", [0.0, 0.004])
def test_efforts_within_the_tolerance_of_a_clock_are_not_moved(late: float) -> None:
    joints = Recorded(damping=2.0, coulomb=1.0, seconds=20.0).joints()
    reading = read(with_effort(joints, at_times(joints.seconds, joints.effort, joints.seconds - late)))
    assert not reading.findings
    assert reading.recorded.effort is not None


def test_efforts_from_which_the_weight_of_the_arm_is_subtracted_are_left_out() -> None:
    case = Recorded(damping=2.0, coulomb=1.0, effort_noise=0.02)
    joints, track = case.joints(), read(case.joints()).recorded.effort
    assert track is not None
    assert track.by_gravity is not None
    weight = -STANDARD_GRAVITY * track.by_gravity[..., 2]
    there = np.stack([np.interp(joints.seconds, track.seconds, column) for column in weight.T], axis=1)
    reading = read(with_effort(joints, joints.effort - there))
    assert "without the weight of the arm" in only(reading, "effort_compensated").sentence


def test_efforts_of_an_arm_on_a_wall_say_how_the_base_is_turned() -> None:
    case = Recorded(damping=2.0, coulomb=1.0, effort_noise=0.02)
    joints, track = case.joints(), read(case.joints()).recorded.effort
    assert track is not None
    assert track.by_gravity is not None
    change = track.by_gravity @ (STANDARD_GRAVITY * np.array([0.6, 0.0, 0.2]))  # down along 0.6 0 -0.8
    there = np.stack([np.interp(joints.seconds, track.seconds, column) for column in change.T], axis=1)
    reading = read(with_effort(joints, joints.effort + there))
    said = re.search(r"along (\S+) (\S+) (\S+) in the axes of the base", only(reading, "base_turned").sentence)
    assert said is not None
    assert [float(number) for number in said.groups()] == pytest.approx([0.6, 0.0, -0.8], abs=0.011)
    assert reading.recorded.effort is None
    assert reading.recorded.effort is None


@pytest.mark.parametrize("spans", [[(400, 415)], [(300, 312), (900, 1000)]])
def test_joint_states_that_are_zero_for_a_while_are_left_out(spans: list[tuple[int, int]]) -> None:
    joints = SLOW.joints()
    position = joints.position.copy()
    for first, last in spans:
        position[first:last] = 0.0
    reading = read(replace(joints, position=position))
    assert f"{sum(last - first for first, last in spans)} of" in only(reading, "joints_mixed").sentence
    track, whole = reading.recorded.effort, read(joints).recorded.effort
    assert track is not None
    assert whole is not None
    assert np.abs(track.measured - track.rigid).max() < 1.1 * np.abs(whole.measured - whole.rigid).max()


def test_efforts_that_repeat_one_reading_and_those_at_a_limit_are_left_out() -> None:
    joints = SLOW.joints()
    frozen = joints.effort.copy()
    frozen[400:700] = frozen[400]
    reading = read(with_effort(joints, frozen))
    assert only(reading, "effort_frozen").values == pytest.approx((joints.seconds[400], joints.seconds[699]))
    track = reading.recorded.effort
    assert track is not None
    assert not ((track.seconds > joints.seconds[400]) & (track.seconds < joints.seconds[699])).any()
    limit = float(np.quantile(np.abs(joints.effort[:, 0]), 0.9))
    reading = read(with_effort(joints, np.clip(joints.effort, [-limit, -99, -99], [limit, 99, 99])))
    finding = only(reading, "effort_limited")
    assert (finding.joints, finding.values) == (("shoulder",), pytest.approx((limit,)))
    assert reading.recorded.effort is not None
    assert np.abs(reading.recorded.effort.measured[:, 0]).max() < limit


@pytest.mark.parametrize("seed", range(6))
def test_friction_rotors_and_springs_are_no_error_of_a_driver(seed: int) -> None:
    joints = Recorded(damping=5.0, coulomb=4.0, seed=seed).joints()
    rng = np.random.default_rng(seed)
    acceleration = np.gradient(joints.velocity, joints.seconds, axis=0)
    lag = np.exp(-np.arange(10) / rng.uniform(1.0, 3.0))
    elastic = np.stack([np.convolve(column, lag / lag.sum())[: len(joints)] for column in joints.effort.T], axis=1)
    for effort in (joints.effort + rng.uniform(0.2, 2.0, 3) * acceleration, rng.uniform(0.5, 2.0, 3) * elastic):
        assert read(with_effort(joints, effort)).findings == ()


@pytest.mark.parametrize(
    ("payload", "said"),
    [
        ({"mass": 1.2, "com": [2.0, 20.0, 140.0]}, "payload.com is 141 m"),
        ({"mass": 1.2, "inertia": [4e3, 0, 0, 5e3, 0, 4e3]}, "payload.inertia is that of 1.2 kg spread over 73.6 m"),
        ({"mass": 1200.0}, "payload.mass of the model is 1200 kg, the robot of the description weighs 6 kg"),
    ],
)
def test_a_payload_in_another_unit_is_refused_with_its_number(payload: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read(SLOW.joints(), ARM, parse_model({"payload": payload}))


def of_two_publishers(joints: JointStream, every: int, place: float = 0.0) -> JointStream:
    """Another one sends `place`, or moves about it."""
    rows = np.arange(every, len(joints) - 1, every)
    sent = place * (1.0 + 0.1 * np.sin(0.01 * rows))[:, None] * np.ones(3)
    parts = {name: np.insert(getattr(joints, name), rows, sent, axis=0) for name in ("position", "velocity", "effort")}
    return replace(joints, stamps=np.insert(joints.stamps, rows, joints.stamps[rows] - 3_000_000), **parts)


def test_messages_of_a_second_publisher_are_left_out_with_a_finding() -> None:
    joints = SLOW.joints()
    assert read(joints).recorded.effort is not None
    for every in (9, 1):
        reading = read(of_two_publishers(joints, every))
        assert "messages jump to 0 0 0" in only(reading, "joints_mixed").sentence
        assert reading.joints is not None
        assert len(reading.joints) == len(joints)
    with pytest.raises(InputError, match="two publishers"):
        read(of_two_publishers(joints, 1, place=2.0))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [2, 3, 30])
def test_few_joint_states_are_refused_without_a_warning_of_numpy(count: int) -> None:
    with pytest.raises(InputError, match="record ten seconds or more"):
        read(SLOW.joints().select(slice(count)))


def test_a_position_that_jumps_by_whole_turns_is_read_without_them() -> None:
    joints = SLOW.joints()
    position = joints.position.copy()
    position[:, 1] = np.where(position[:, 1] > np.median(position[:, 1]), position[:, 1] - 2 * np.pi, position[:, 1])
    reading = read(replace(joints, position=position))
    assert "the positions of elbow were read without jumps of whole turns" in reading.notes
    assert reading.joints is not None
    np.testing.assert_allclose(reading.joints.position, joints.position, atol=1e-12)


def test_a_joint_at_half_a_turn_may_be_reported_at_either_end() -> None:
    joints = SLOW.joints()
    position = joints.position.copy()
    position[:, 2] += np.where(np.arange(len(joints)) % 3 == 1, 2 * np.pi, 0.0)
    reading = read(replace(joints, position=position))
    assert reading.findings == ()
    assert reading.joints is not None
    np.testing.assert_allclose(reading.joints.position, joints.position, atol=1e-12)


def test_a_reversed_joint_is_not_hidden_by_a_turn() -> None:
    joints = SLOW.joints()
    with pytest.raises(InputError, match="its range in the description"):
        read(replace(joints, position=joints.position - [0.0, 4.0, 0.0]))


def test_only_jumps_are_turns() -> None:
    seconds = np.array([0.0, 0.01, 0.02, 5.0])
    ways = np.array([[3.1], [-3.1], [-3.0], [1.0]])
    np.testing.assert_allclose(
        without_turns(seconds, ways)[:, 0], [3.1, 2 * np.pi - 3.1, 2 * np.pi - 3.0, 2 * np.pi + 1]
    )
    assert without_turns(seconds, np.array([[0.0], [0.1], [0.2], [4.0]]))[-1, 0] == 4.0


def test_an_encoder_that_freezes_in_motion_is_left_out_and_a_stop_is_not() -> None:
    joints = Recorded(seconds=20.0).joints()
    fastest = 1000 + int(np.argmax(np.abs(joints.velocity[1000:2000, 1])))
    position = np.round(joints.position / 1e-5) * 1e-5
    position[fastest:, 1] = position[fastest, 1]
    reading = read(replace(joints, position=position, velocity=np.full_like(position, np.nan)))
    found = next(each for each in reading.findings if each.kind == "encoder_frozen")
    assert found.joints == ("elbow",)
    assert found.values == pytest.approx((joints.seconds[fastest], joints.seconds[-1]))
    assert reading.recorded.seconds[-1] < joints.seconds[fastest]


def test_the_effort_of_one_joint_that_repeats_while_it_moves_is_left_out() -> None:
    joints = SLOW.joints()
    effort = joints.effort.copy()
    effort[400:700, 1] = effort[400, 1]
    finding = only(read(with_effort(joints, effort)), "effort_frozen")
    assert finding.joints == ("elbow",)
    assert finding.values == pytest.approx((joints.seconds[400], joints.seconds[699]))
    still = Recorded(moving=(1.0, 0.0, 1.0)).joints()
    held = still.effort.copy()
    held[400:700, 1] = held[400, 1]
    assert "effort_frozen" not in {each.kind for each in read(with_effort(still, held)).findings}


def test_joints_that_all_freeze_and_leap_on_are_left_out_and_joints_at_rest_are_not() -> None:
    joints = SLOW.joints()
    position = joints.position.copy()
    position[500:600] = position[500]
    found = [each for each in read(replace(joints, position=position)).findings if each.kind == "encoder_frozen"]
    assert found
    assert all(each.values == pytest.approx((joints.seconds[500], joints.seconds[599])) for each in found)
    paused = joints.position.copy()
    paused[600:] = joints.position[500:-100]
    paused[500:600] = joints.position[500]
    found = read(replace(joints, position=paused)).findings
    assert not [each for each in found if each.kind == "encoder_frozen"]


def test_joints_that_stop_one_after_the_other_are_not_frozen() -> None:
    at = np.arange(2500) / 125.0
    moved = [1e-5 * np.round(1e5 * 0.5 * _stopping(np.clip(at - begin, 0.0, 4.0))) for begin in (0.5, 5.0, 9.0)]
    joints = Recorded(seconds=20.0).joints()
    nothing = np.full_like(joints.position, np.nan)
    still = replace(joints, position=np.stack(moved, axis=1), velocity=nothing)
    assert not [each for each in read(still, ARM).findings if each.kind == "encoder_frozen"]


def _stopping(seconds: Array) -> Array:
    """A trapezoidal motion of 4 s: the velocity rises and falls in 0.1 s."""
    velocity = np.minimum(np.minimum(seconds, 4.0 - seconds) / 0.1, 1.0)
    return np.asarray(np.cumsum(velocity) / 125.0)
