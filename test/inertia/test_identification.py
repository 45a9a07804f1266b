"""Identification from recordings: the real one, a simulated arm, and everything that can be wrong with one."""

import functools
from pathlib import Path

import numpy as np
import pytest
from simulated_motion import BIAS, LOAD, fr3, record, steps, swing

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.pipeline import identification
from poise.recording import JointStream, PoseStream, Recording, WrenchStream, open_recording, write_recording
from poise.robot import RobotModel
from poise.robot.model import find_urdf

identify = functools.partial(identification.identify, method="auto")
ROOT = Path(__file__).resolve().parents[2]
URDF = find_urdf("fr3").read_text()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(23)


@pytest.fixture
def save(tmp_path):
    """Write streams to a bag and open it again."""

    def write(streams, **known) -> Recording:
        write_recording(tmp_path / "scene.mcap", streams, **known)
        return open_recording(tmp_path / "scene.mcap")

    return write


@pytest.fixture(scope="module")
def swinging():
    return record(swing, 5.0, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def stopping():
    return record(steps, 12.0, rng=np.random.default_rng(2))


def sigmas(estimate):
    """How many standard deviations phi is from the truth; NaN where it was not identified."""
    return (estimate.phi - LOAD.phi) / np.sqrt(np.diag(estimate.covariance))


def with_wrench(stream: WrenchStream, change) -> WrenchStream:
    values = stream.wrench_in_sensor.copy()
    change(values)
    return WrenchStream(stream.stamps, values, stream.frame_id)


# -- the real recording ------------------------------------------------------------------------------------------


def test_the_kuka_static_poses_give_the_published_figures():
    answer = identify(open_recording(ROOT / "bags" / "kuka_static_poses.mcap"))
    estimate = answer.estimate
    assert estimate.method == "static"
    assert estimate.parameters.mass == pytest.approx(0.9323, abs=1e-4)
    assert estimate.mass_std == pytest.approx(0.0032, abs=1e-4)
    assert estimate.parameters.com[2] == pytest.approx(0.0439, abs=1e-4)
    np.testing.assert_allclose(estimate.bias[:3], [9.08, -1.02, 9.98], atol=0.006)
    assert estimate.residual_force == pytest.approx(0.087, abs=1e-3)
    assert estimate.residual_torque == pytest.approx(0.0030, abs=1e-4)
    assert estimate.n_samples == 24
    assert estimate.rejected == ()
    assert estimate.unidentified == ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    assert np.isnan(estimate.parameters.inertia).all()
    assert estimate.consistent
    assert "tf (base to ft_sensor" in answer.source


def test_the_recordings_own_gravity_is_used_unless_another_is_given():
    recording = open_recording(ROOT / "bags" / "kuka_static_poses.mcap")
    own = identify(recording).estimate.parameters.mass
    assert own == pytest.approx(identify(recording, gravity=9.82085).estimate.parameters.mass)
    assert own * 9.82085 == pytest.approx(identify(recording, gravity=9.80665).estimate.parameters.mass * 9.80665)


def test_a_recording_without_positions_says_what_that_means():
    answer = identify(open_recording(ROOT / "bags" / "kuka_free_motion.mcap"), method="ols")
    assert "linear accelerations are taken as zero" in answer.source


def test_the_history_closes_in_and_ends_with_the_answer():
    answer = identify(open_recording(ROOT / "bags" / "kuka_static_poses.mcap"))
    assert answer.history[-1] is answer.estimate
    counts = [past.n_samples for past in answer.history]
    assert counts == sorted(set(counts))
    assert answer.history[0].mass_std > answer.history[-1].mass_std
    assert len(answer.history) <= 50


# -- a simulated arm ---------------------------------------------------------------------------------------------


def test_motion_gives_all_ten_parameters_and_the_bias(swinging, save):
    recording = save({"wrench": swinging.wrench, "joint_states": swinging.joints}, robot_description=URDF)
    answer = identify(recording)
    estimate = answer.estimate
    assert estimate.method == "ols"
    assert estimate.unidentified == ()
    assert np.all(np.abs(sigmas(estimate)) < 4)
    assert np.all(np.abs(estimate.bias - BIAS) < 5 * np.sqrt(np.diag(estimate.bias_covariance)))
    np.testing.assert_allclose(estimate.parameters.inertia, LOAD.inertia, atol=3e-5)
    assert estimate.consistent
    assert answer.source.startswith("joint_states")


def test_tf_gives_what_joint_states_give(swinging, save):
    joints = save({"wrench": swinging.wrench, "joint_states": swinging.joints}, robot_description=URDF)
    by_joints = identify(joints).estimate
    by_frames = identify(save({"wrench": swinging.wrench, "tf": swinging.poses})).estimate
    deviation = np.sqrt(np.diag(by_joints.covariance))
    assert np.all(np.abs(by_joints.phi - by_frames.phi) < deviation)


def test_a_chain_of_tf_frames_is_composed(swinging, save, rng):
    """The motion in two transforms, one moving and one fixed; the fixed one is recorded twice."""
    turn, shift = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([0.1, 0.2, 0.3])
    poses = swinging.poses
    wrist = PoseStream(
        poses.stamps,
        poses.rotation_parent_child @ turn.T,
        poses.translation_parent_child - poses.rotation_parent_child @ turn.T @ shift,
        "base_link",
        "wrist",
    )
    ends = poses.stamps[[0, -1]]
    mount = PoseStream(ends, np.stack([turn, turn]), np.stack([shift, shift]), "wrist", "ft_sensor")
    whole = identify(save({"wrench": swinging.wrench, "tf": poses})).estimate
    chained = identify(save({"wrench": swinging.wrench, "tf": wrist, "tf_static": mount}))
    np.testing.assert_allclose(chained.estimate.phi, whole.phi, atol=2e-5)
    assert "base_link to ft_sensor" in chained.source


def test_stop_and_go_is_weighed_from_its_held_poses(stopping, save):
    recording = save({"wrench": stopping.wrench, "joint_states": stopping.joints}, robot_description=URDF)
    estimate = identify(recording).estimate
    assert estimate.method == "static"
    assert np.all(np.abs(sigmas(estimate)[:4]) < 4)
    assert {span.reason for span in estimate.rejected} == {"moving", "no_kinematics"}
    in_motion = sum(span.n_samples for span in estimate.rejected if span.reason == "moving")
    # Half a second of travel and the window around it, of every one and a half.
    assert 0.33 < in_motion / len(stopping.wrench) < 0.5


def test_a_robot_model_beats_what_the_recording_says(swinging, save):
    recording = save({"wrench": swinging.wrench, "joint_states": swinging.joints, "tf": swinging.poses})
    assert identify(recording).source.startswith("tf")
    assert identify(recording, robot_model=fr3()).source.startswith("joint_states")


def test_a_robot_description_without_the_sensor_falls_back_to_tf(swinging, save):
    streams = {"wrench": swinging.wrench, "joint_states": swinging.joints, "tf": swinging.poses}
    other = URDF.replace('"ft_sensor"', '"another_sensor"')
    assert identify(save(streams, robot_description=other)).source.startswith("tf")


def test_samples_that_are_no_numbers_or_saturated_are_left_out_and_said_so(swinging, save):
    def spoil(values):
        values[1000:1040, 2] = np.nan
        values[1500:1510, 4] = np.inf
        values[2000:2100, 0] = 400.0

    wrench = with_wrench(swinging.wrench, spoil)
    recording = save({"wrench": wrench, "joint_states": swinging.joints}, robot_description=URDF)
    estimate = identify(recording, saturation=(400.0, 40.0)).estimate
    assert np.all(np.abs(sigmas(estimate)) < 4)
    spans = {(span.start, span.end): span for span in estimate.rejected}
    for begin, end, reason in ((1000, 1039, "not_finite"), (1500, 1509, "not_finite"), (2000, 2099, "saturated")):
        span = spans[int(wrench.stamps[begin]), int(wrench.stamps[end])]
        assert (span.reason, span.n_samples) == (reason, end - begin + 1)


def test_nothing_is_made_up_where_the_kinematics_have_a_hole(swinging, save):
    seconds = swinging.joints.seconds
    holed = swinging.joints.select((seconds < 2.0) | (seconds > 3.0))
    recording = save({"wrench": swinging.wrench, "joint_states": holed}, robot_description=URDF)
    estimate = identify(recording).estimate
    assert np.all(np.abs(sigmas(estimate)) < 4)
    start = int(swinging.wrench.stamps[0])
    holes = [span for span in estimate.rejected if 1.0 < (span.start - start) * 1e-9 < 4.0]
    assert [span.reason for span in holes] == ["no_kinematics"]
    assert (holes[0].start - start) * 1e-9 == pytest.approx(1.9, abs=0.02)  # the hole, and the edges beside it
    assert (holes[0].end - start) * 1e-9 == pytest.approx(3.1, abs=0.02)


def test_joint_states_of_a_gripper_and_of_another_robot_are_not_mixed_in(swinging, save):
    joints = swinging.joints
    n = len(joints)
    rng = np.random.default_rng(0)
    gripper = JointStream(joints.stamps + 1000, ("finger",), *(np.zeros((n, 1)),) * 3)
    names = tuple(f"other_{name}" for name in joints.names)
    other = JointStream(joints.stamps + 2000, names, *(rng.normal(size=(n, 7)) for _ in range(3)))
    alone = save({"wrench": swinging.wrench, "joint_states": joints}, robot_description=URDF)
    expected = identify(alone).estimate.phi
    mixed = save({"wrench": swinging.wrench, "joint_states": [joints, gripper, other]}, robot_description=URDF)
    np.testing.assert_array_equal(identify(mixed).estimate.phi, expected)


# -- what cannot be answered -------------------------------------------------------------------------------------


def test_a_payload_held_in_one_attitude_has_no_answer_and_it_says_what_to_do(stopping, save):
    early = stopping.joints.seconds < 0.9
    joints, wrench = stopping.joints.select(early), stopping.wrench.select(stopping.wrench.seconds < 0.9)
    recording = save({"wrench": wrench, "joint_states": joints}, robot_description=URDF)
    with pytest.raises(NoAnswerError, match="attitudes") as caught:
        identify(recording, method="static")
    assert caught.value.code is ErrorCode.NOT_IDENTIFIABLE


def test_wrench_and_kinematics_of_different_times_have_no_answer_and_the_counts_say_why(swinging, save):
    late = WrenchStream(swinging.wrench.stamps + 3_600 * 10**9, swinging.wrench.wrench_in_sensor, "ft_sensor")
    recording = save({"wrench": late, "joint_states": swinging.joints}, robot_description=URDF)
    with pytest.raises(NoAnswerError, match="no_kinematics") as caught:
        identify(recording)
    assert caught.value.code is ErrorCode.TOO_FEW_SAMPLES


@pytest.mark.parametrize(
    ("topics", "options", "code"),
    [
        (("wrench",), {}, ErrorCode.TOPIC_MISSING),
        (("joint_states",), {}, ErrorCode.TOPIC_MISSING),
        (("wrench", "joint_states"), {}, ErrorCode.ROBOT_DESCRIPTION_MISSING),
        (("wrench", "tf"), {"sensor_frame": "nowhere"}, ErrorCode.FRAME_UNKNOWN),
        (("wrench", "tf"), {"base_frame": "nowhere"}, ErrorCode.FRAME_UNKNOWN),
        (("wrench", "tf"), {"wrench_topic": "elsewhere"}, ErrorCode.TOPIC_MISSING),
        (("wrench", "tf"), {"method": "guess"}, ErrorCode.BAD_INPUT),
        (("wrench", "tf"), {"gravity": -9.81}, ErrorCode.BAD_INPUT),
        (("wrench", "tf"), {"saturation": (0.0, 1.0)}, ErrorCode.BAD_INPUT),
    ],
)
def test_what_is_missing_or_senseless_is_named_with_a_code(swinging, save, topics, options, code):
    streams = {"wrench": swinging.wrench, "joint_states": swinging.joints, "tf": swinging.poses}
    recording = save({topic: streams[topic] for topic in topics})
    with pytest.raises(InputError) as caught:
        identify(recording, **options)
    assert caught.value.code is code


def test_a_description_whose_joints_are_not_in_the_joint_states_is_named(swinging, save):
    joints = JointStream(swinging.joints.stamps, ("a", "b"), *(np.zeros((len(swinging.joints), 2)),) * 3)
    recording = save({"wrench": swinging.wrench, "joint_states": joints}, robot_description=URDF)
    with pytest.raises(InputError, match="fr3_joint1") as caught:
        identify(recording)
    assert caught.value.code is ErrorCode.JOINT_MISSING


@pytest.mark.parametrize("gravity", ["nine", "-9.8", "nan", "inf"])
def test_metadata_with_a_senseless_gravity_is_refused(swinging, save, gravity):
    recording = save({"wrench": swinging.wrench, "tf": swinging.poses}, metadata={"poise": {"gravity": gravity}})
    with pytest.raises(InputError, match="gravity") as caught:
        identify(recording)
    assert caught.value.code is ErrorCode.BAD_INPUT
    assert identify(recording, gravity=9.8, method="ols").estimate.n_samples > 0


def test_wrenches_that_name_no_frame_need_one_to_be_given(swinging, save):
    unnamed = WrenchStream(swinging.wrench.stamps, swinging.wrench.wrench_in_sensor, "")
    recording = save({"wrench": unnamed, "tf": swinging.poses})
    with pytest.raises(InputError, match="sensor frame"):
        identify(recording)
    assert identify(recording, sensor_frame="ft_sensor").estimate.frame_id == "ft_sensor"


def test_a_sensor_that_no_joint_moves_is_refused(swinging, save):
    fixed = RobotModel.from_urdf(URDF, "base_link")
    recording = save({"wrench": swinging.wrench, "joint_states": swinging.joints})
    with pytest.raises(InputError) as caught:
        identify(recording, robot_model=fixed)
    assert caught.value.code is ErrorCode.ROBOT_DESCRIPTION_INVALID
