"""`identify` with Poise's own estimator and the thesis' methods: the real recordings, clocks, IMUs, shapes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from kuka_recordings import kuka
from simulated_motion import BIAS, GRAVITY, LOAD, record, swing

from poise.cli import run
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia import InertialParameters
from poise.inertia.model.parts import Parts, box_moments
from poise.inertia.pipeline.identification import identify
from poise.recording import ImuStream, PoseStream, Recording, WrenchStream, open_recording, write_recording
from poise.robot import frame_poses, sensor_motion
from poise.robot.model import find_urdf

ROOT = Path(__file__).resolve().parents[2]
URDF = find_urdf("fr3").read_text()
WEIGHED = 0.9323
"""kg, of the KUKA's payload by least squares on 24 held poses."""


@pytest.fixture
def save(tmp_path):
    """Write streams to a bag and open it again."""

    def write(streams, **known) -> Recording:
        write_recording(tmp_path / "scene.mcap", streams, **known)
        return open_recording(tmp_path / "scene.mcap")

    return write


@pytest.fixture(scope="module")
def swinging():
    return record(swing, 3.0, rng=np.random.default_rng(1), wrench_rate=200.0)


def with_wrench(stream: WrenchStream, values) -> WrenchStream:
    return WrenchStream(stream.stamps, values, stream.frame_id)


def in_sigma(estimate) -> np.ndarray:
    return np.abs(estimate.phi - LOAD.phi) / np.sqrt(np.diag(estimate.covariance))


# -- the real recordings -----------------------------------------------------------------------------------------


def test_held_poses_of_a_real_arm():
    estimate = kuka("static_poses").estimate
    assert estimate.parameters.mass == pytest.approx(WEIGHED, abs=0.005)
    assert estimate.parameters.com[2] == pytest.approx(0.0439, abs=0.001)
    np.testing.assert_allclose(estimate.bias[:3], [9.08, -1.02, 9.98], atol=0.01)
    assert np.isnan(estimate.delay)
    assert {"ixx", "iyy", "izz"} <= set(estimate.unidentified)


@pytest.mark.parametrize(("name", "within"), [("free_motion", 0.01), ("vibration", 0.02)])
def test_motion_of_the_same_arm_gives_the_same_mass_with_its_imu(name, within):
    """Wrench and IMU shake together from 4 to 65 Hz, the IMU 5.5 to 8 ms later: the phase of their spectra."""
    answer = kuka(name)
    assert answer.estimate.parameters.mass == pytest.approx(WEIGHED, rel=within)
    assert answer.estimate.parameters.com[2] == pytest.approx(0.0439, abs=0.001)
    assert -0.009 < answer.estimate.delay < -0.005
    assert answer.estimate.delay_std < 0.002
    assert "imu" in answer.source
    assert answer.estimate.consistent


# -- a simulated arm ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_clocks_that_differ_are_set_right(swinging, save, late):
    wrench = replace(swinging.wrench, stamps=swinging.wrench.stamps + round(late * 1e9))
    estimate = identify(save({"wrench": wrench, "joint_states": swinging.joints}, robot_description=URDF)).estimate
    assert estimate.delay == pytest.approx(late, abs=0.003)
    assert np.all(in_sigma(estimate) < 5)
    assert estimate.unidentified == ()
    np.testing.assert_allclose(estimate.bias, BIAS, atol=0.1)


def imu_of(scene, place, rng) -> ImuStream:
    """An IMU at a place in the sensor frame, turned about z by a right angle."""
    stamps = scene.joints.stamps
    motion = sensor_motion(scene.model, stamps, *swing((stamps - stamps[0]) * 1e-9))
    omega, alpha = motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor
    felt = motion.linear_acceleration_in_sensor - motion.gravity_in_sensor([0, 0, -GRAVITY])
    felt = felt + np.cross(alpha, place) + np.cross(omega, np.cross(omega, place))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    noise = rng.normal(0.0, 0.01, felt.shape)
    return ImuStream(stamps, (omega + 1e-3 * noise) @ turn, (felt + noise) @ turn, "imu")


@pytest.mark.parametrize("with_tf", [True, False])
def test_an_imu_stands_in_for_positions_and_even_for_attitudes(swinging, save, with_tf):
    place = np.array([0.03, -0.02, 0.05])
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    stamps = swinging.joints.stamps
    mount = PoseStream(stamps[:1], turn[None], place[None], "ft_sensor", "imu")
    streams = {"wrench": swinging.wrench, "imu": imu_of(swinging, place, np.random.default_rng(3)), "tf_static": mount}
    if with_tf:
        rotation, _ = frame_poses(swinging.model, swinging.joints.position)
        streams["tf"] = PoseStream(stamps, rotation, np.zeros((len(stamps), 3)), "base_link", "ft_sensor")
    answer = identify(save(streams))
    assert "imu" in answer.source
    assert answer.estimate.parameters.mass == pytest.approx(LOAD.mass, rel=0.005)
    np.testing.assert_allclose(answer.estimate.parameters.com, LOAD.com, atol=1e-3)
    np.testing.assert_allclose(answer.estimate.parameters.inertia, LOAD.inertia, atol=4e-4)


# -- a shape, and other methods ----------------------------------------------------------------------------------


def two_boxes() -> tuple[Parts, InertialParameters]:
    """A steel head on a wooden handle, and what it weighs."""
    centres, sides = np.array([[0.0, 0.0, 0.05], [0.03, 0.0, 0.16]]), np.array([[0.03, 0.03, 0.2], [0.1, 0.03, 0.03]])
    cube = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    corners = np.concatenate([centre + cube * side for centre, side in zip(centres, sides, strict=True)])
    parts = Parts.from_moments(box_moments(centres, sides), [0, 1], corners)
    return parts, InertialParameters.from_phi(parts.unit_phi @ (parts.volumes * [700.0, 7800.0]))


@pytest.fixture(scope="module")
def hammering():
    _, load = two_boxes()
    return record(swing, 2.0, rng=np.random.default_rng(4), load=load, wrench_rate=200.0)


def unbiased(scene) -> WrenchStream:
    return with_wrench(scene.wrench, scene.wrench.wrench_in_sensor - BIAS)


@pytest.mark.parametrize(
    ("name", "within"),
    [("poise", 0.005), ("geo", 0.25), ("pmd", 0.02), ("rtls", 0.02), ("ols", 0.005), ("auto", 0.005)],
)
def test_every_method_weighs_a_hammer(hammering, save, name, within):
    """GEO with the thesis' weight leans on its prior of a single density, which this hammer is far from."""
    parts, load = two_boxes()
    recording = save({"wrench": unbiased(hammering), "joint_states": hammering.joints}, robot_description=URDF)
    answer = identify(recording, method=name, parts=parts)
    assert answer.estimate.method == name.replace("auto", "ols")
    assert answer.estimate.parameters.mass == pytest.approx(load.mass, rel=within)
    assert not answer.estimate.findings
    assert answer.history[-1] is answer.estimate


def test_hps_wants_a_sensor_that_stands_still(hammering, save):
    recording = save({"wrench": hammering.wrench, "joint_states": hammering.joints}, robot_description=URDF)
    with pytest.raises(NoAnswerError, match="stop and go"):
        identify(recording, method="hps", parts=two_boxes()[0])


def test_a_method_that_knows_no_bias_says_so(hammering, save):
    parts, _ = two_boxes()
    recording = save({"wrench": hammering.wrench, "joint_states": hammering.joints}, robot_description=URDF)
    findings = identify(recording, method="pmd", parts=parts).estimate.findings
    assert [finding.code for finding in findings] == [ErrorCode.UNSUPPORTED]


@pytest.mark.parametrize("name", ["geo", "pmd", "hps"])
def test_a_method_that_wants_a_shape_says_so(hammering, save, name):
    recording = save({"wrench": hammering.wrench, "joint_states": hammering.joints}, robot_description=URDF)
    with pytest.raises(InputError) as caught:
        identify(recording, method=name)
    assert caught.value.code is ErrorCode.UNSUPPORTED


def test_total_least_squares_do_not_guess_what_a_motion_does_not_show():
    with pytest.raises(NoAnswerError, match="ixx") as caught:
        identify(open_recording(ROOT / "bags" / "kuka_free_motion.mcap"), method="rtls")
    assert caught.value.code is ErrorCode.NOT_IDENTIFIABLE


# -- bad input ---------------------------------------------------------------------------------------------------


def shape_problems(scene, save, **known):
    recording = save({"wrench": scene.wrench, "joint_states": scene.joints}, robot_description=URDF)
    return {finding.code for finding in identify(recording, **known).estimate.findings}


def test_a_shape_that_is_not_the_objects_is_said_so(hammering, save):
    parts, load = two_boxes()
    assert shape_problems(hammering, save, parts=parts) == set()
    flipped = parts.in_frame(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    beside = parts.in_frame(np.eye(3), [0.08, 0.05, 0.0])
    large = Parts(parts.unit_phi * np.repeat([1.0, 3.0, 9.0], [1, 3, 6])[:, None], parts.volumes * 27, parts.points * 3)
    for wrong in (flipped, beside, large):
        assert ErrorCode.SHAPE_MISMATCH in shape_problems(hammering, save, parts=wrong)
        recording = save({"wrench": hammering.wrench, "joint_states": hammering.joints}, robot_description=URDF)
        assert identify(recording, parts=wrong).estimate.parameters.mass == pytest.approx(load.mass, rel=0.02)


def test_a_wrench_of_the_other_sign_is_refused(swinging, save):
    wrench = with_wrench(swinging.wrench, -swinging.wrench.wrench_in_sensor)
    recording = save({"wrench": wrench, "joint_states": swinging.joints}, robot_description=URDF)
    with pytest.raises(NoAnswerError, match="sign") as caught:
        identify(recording)
    assert caught.value.code is ErrorCode.NOT_CONSISTENT


def test_a_sensor_zeroed_with_the_object_in_hand_is_found_out(swinging, save):
    motion = sensor_motion(swinging.model, swinging.joints.stamps[:1], *swing(np.zeros(1)))
    down = motion.gravity_in_sensor([0, 0, -GRAVITY])[0]
    offset = -LOAD.mass * np.concatenate([down, np.cross(LOAD.com, down)])
    wrench = with_wrench(swinging.wrench, swinging.wrench.wrench_in_sensor - BIAS + offset)
    answer = identify(save({"wrench": wrench, "joint_states": swinging.joints}, robot_description=URDF))
    assert ErrorCode.ZEROED_UNDER_LOAD in {finding.code for finding in answer.estimate.findings}
    assert answer.estimate.parameters.mass == pytest.approx(LOAD.mass, rel=0.005)


def test_samples_that_say_nothing_are_rejected_by_name(swinging, save):
    values = swinging.wrench.wrench_in_sensor.copy()
    values[100:110] = np.nan
    values[200:230, 0] = 400.0
    values[300:330] = values[300]
    wrench = with_wrench(swinging.wrench, values)
    recording = save({"wrench": wrench, "joint_states": swinging.joints}, robot_description=URDF)
    estimate = identify(recording, saturation=(400.0, 40.0)).estimate
    assert {"not_finite", "saturated", "stale", "no_kinematics"} >= {span.reason for span in estimate.rejected}
    counted = {
        reason: sum(span.n_samples for span in estimate.rejected if span.reason == reason)
        for reason in ("not_finite", "saturated")
    }
    assert counted == {"not_finite": 10, "saturated": 30}
    assert any(span.reason == "stale" and span.n_samples == 27 for span in estimate.rejected)
    assert np.all(in_sigma(estimate) < 5)


def test_fewer_samples_than_unknowns_have_no_answer(swinging, save):
    seconds = swinging.wrench.seconds
    few = swinging.wrench.select((seconds > 1.0) & (seconds < 1.006))
    with pytest.raises(NoAnswerError) as caught:
        identify(save({"wrench": few, "joint_states": swinging.joints}, robot_description=URDF))
    assert caught.value.code is ErrorCode.TOO_FEW_SAMPLES


def test_the_command_takes_a_shape_and_its_pose(hammering, save, tmp_path):
    _, load = two_boxes()
    centres, sides = ([0, 0, 0.05], [0.03, 0, 0.16]), ([0.03, 0.03, 0.199], [0.1, 0.03, 0.03])
    boxes = [
        trimesh.creation.box(side, transform=trimesh.transformations.translation_matrix(centre))
        for centre, side in zip(centres, sides, strict=True)
    ]
    mesh = trimesh.util.concatenate(boxes)
    mesh.apply_translation([0, 0, -0.05])
    mesh.apply_scale(1000)
    mesh.export(tmp_path / "hammer.stl")
    save({"wrench": hammering.wrench, "joint_states": hammering.joints}, robot_description=URDF)
    options = ["--object", str(tmp_path / "hammer.stl"), "--object-scale", "0.001", "--object-pose", "0 0 0.05 0 0 0 1"]
    assert run(["identify", str(tmp_path / "scene.mcap"), *options, "--json", str(tmp_path / "out.json")]) == 0
    content = json.loads((tmp_path / "out.json").read_text())
    assert content["mass"] == pytest.approx(load.mass, rel=0.005)
    np.testing.assert_allclose(content["inertia"], load.inertia_vector, atol=0.03 * np.trace(load.inertia) / 3)
    assert content["findings"] == []
    assert content["object"].startswith("2 closed surfaces")
    assert run(["identify", str(tmp_path / "scene.mcap"), *options[:-1], "0 0 1"]) == 2
