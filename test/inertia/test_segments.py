"""Several payloads in one recording: each is found and weighed, and what is no payload changes nothing."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kuka_recordings import kuka
from ordinary_work import START, Nuisance, Work, work
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode
from poise.inertia import Identification
from poise.inertia.pipeline import OnlineEstimator, identify_wrenches
from poise.inertia.pipeline.block_means import block_means
from poise.inertia.pipeline.payload_changes import find_changes
from poise.robot import JointSource, Kinematics, SensorMotion

ROOT = Path(__file__).resolve().parents[2]


def weighed(measured: Work, bias: float = 3.0) -> Identification:
    """The whole recording at once, of a sensor with a bias, N and N m / 20."""
    wrench = measured.wrench
    shifted = wrench.wrench_in_sensor + np.repeat([bias, bias / 20], 3)
    source = JointSource(measured.model)
    joints = measured.joints
    feed = (joints.stamps, lambda some: source.extend(joints.stamps[some], joints.names, joints.position[some]))
    estimator = OnlineEstimator(source, frame_id=wrench.frame_id, patience=math.inf, max_intervals=None)
    return identify_wrenches(replace(wrench, wrench_in_sensor=shifted), Kinematics(source, [feed]), estimator)


@pytest.mark.parametrize("seed", [0, 2])
def test_every_grasp_and_release_is_found_and_each_payload_is_weighed(seed):
    measured = work(np.random.default_rng([seed, 7]), 17.0, every=2)
    answer = weighed(measured)
    assert len(answer.segments) == len(measured.payloads) >= 3
    for segment, phi in zip(answer.segments, measured.payloads, strict=True):
        estimate = segment.estimate
        assert estimate.parameters.mass == pytest.approx(phi[0], abs=max(4 * estimate.mass_std, 0.002))
    times = [(segment.since - START) * 1e-9 for segment in answer.segments[1:]]
    np.testing.assert_allclose(times, measured.changes, atol=0.15)
    events = ["start", *("grasped" if after else "released" for after in measured.payloads[1:, 0])]
    assert [segment.event for segment in answer.segments] == events
    held = [segment for segment, phi in zip(answer.segments, measured.payloads, strict=True) if phi[0]]
    assert answer.estimate.parameters.mass == held[-1].estimate.parameters.mass
    finding = next(each for each in answer.estimate.findings if each.code is ErrorCode.PAYLOAD_CHANGED)
    assert finding.evidence["changes"] == len(measured.changes)
    assert finding.evidence["time_1"] == pytest.approx(measured.changes[0], abs=0.2)


@pytest.mark.parametrize("seed", [40])
def test_pushes_and_a_drifting_bias_make_no_segments(seed):
    measured = work(np.random.default_rng(seed), 20.0, every=0, nuisance=Nuisance(pushes=12, drift=0.3))
    answer = weighed(measured)
    assert len(answer.segments) == 1
    assert not any(each.code is ErrorCode.PAYLOAD_CHANGED for each in answer.estimate.findings)


@pytest.mark.parametrize("name", ["static_poses", "free_motion", "vibration"])
def test_the_kuka_recordings_have_one_payload(name):
    answer = kuka(name)
    (segment,) = answer.segments
    assert segment.event == "start"
    assert segment.estimate is answer.estimate


def spilling(seconds: tuple[float, float], share: float) -> Work:
    """Something is held, and loses a share of its mass between two instants, s."""
    measured = work(np.random.default_rng([5, 7]), 12.0, every=0, wrench_rate=250.0)
    wrench = measured.wrench
    at = (wrench.stamps - START) * 1e-9
    left = 1 - share * np.clip((at - seconds[0]) / (seconds[1] - seconds[0]), 0, 1)
    noise = np.random.default_rng(6).normal(size=wrench.wrench_in_sensor.shape) * np.repeat([0.1, 0.005], 3)
    return replace(measured, wrench=replace(wrench, wrench_in_sensor=wrench.wrench_in_sensor * left[:, None] + noise))


def test_a_hand_that_lifts_the_load_for_a_while_is_no_payload():
    measured = work(np.random.default_rng([5, 7]), 14.0, every=0, wrench_rate=250.0)
    seconds = (measured.wrench.stamps - START) * 1e-9
    lift = np.where((seconds > 4.0) & (seconds < 9.0), -1.4, 0.0)[:, None] * measured.wrench.wrench_in_sensor
    noise = np.random.default_rng(6).normal(size=lift.shape) * np.repeat([0.05, 0.002], 3)
    touched = measured.wrench.wrench_in_sensor + lift + noise
    answer = weighed(replace(measured, wrench=replace(measured.wrench, wrench_in_sensor=touched)))
    assert len(answer.segments) == 1
    assert abs(answer.estimate.parameters.mass - measured.payloads[0, 0]) < 3 * answer.estimate.mass_std


def test_a_spill_that_takes_a_second_and_a_half_is_one_change_and_its_samples_are_left_out():
    measured = spilling((5.0, 6.5), 0.3)
    answer = weighed(measured)
    mass = measured.payloads[0, 0]
    assert [segment.event for segment in answer.segments] == ["start", "spilled"]
    before, after = (segment.estimate for segment in answer.segments)
    assert abs(before.parameters.mass - mass) < 3 * before.mass_std + 0.001 * mass
    assert abs(after.parameters.mass - 0.7 * mass) < 3 * after.mass_std + 0.001 * mass
    assert answer.estimate.parameters.mass == after.parameters.mass


def test_a_leak_over_the_whole_recording_is_one_segment_whose_answer_is_for_the_end():
    measured = spilling((0.0, 12.0), 0.4)
    answer = weighed(measured)
    (segment,) = answer.segments
    mass = measured.payloads[0, 0]
    assert segment.event == "leaking"
    assert segment.lost == pytest.approx(0.4 * mass, rel=0.05)
    assert abs(answer.estimate.parameters.mass - 0.6 * mass) < 3 * answer.estimate.mass_std
    assert answer.estimate.findings[0].code is ErrorCode.PAYLOAD_CHANGED


def test_many_picks_in_minutes_of_work_are_all_found():
    """Held poses of 1 s for 150 s; every 6 s something is grasped or released."""
    rng = np.random.default_rng(8)
    seconds = np.arange(0.0, 150.0, 0.05)
    turns = Rotation.random(150, random_state=8).as_matrix()[seconds.astype(int)]
    motion = SensorMotion.at_rest(START + np.round(seconds * 1e9).astype(np.int64), turns)
    masses = np.where(np.arange(25) % 2, rng.uniform(0.2, 2.0, 25), 0.0)
    mass = masses[(seconds // 6.0).astype(int)]
    force = mass[:, None] * motion.gravity_in_sensor()
    wrench = np.hstack([force, np.cross([0.01, -0.02, 0.08], force)])
    wrench += 5.0 + 0.0003 * seconds[:, None] + rng.normal(size=wrench.shape) * np.repeat([0.05, 0.002], 3)
    changes = find_changes(block_means(motion, wrench, np.array([0.0, 0.0, -9.80665]), 0.0))
    assert changes is not None
    np.testing.assert_allclose(changes.edges, 60 * np.arange(1, 25), atol=1)
    np.testing.assert_allclose(changes.masses, masses, atol=0.02)


def test_a_sensor_that_is_zeroed_again_is_no_other_payload():
    measured = work(np.random.default_rng([5, 7]), 12.0, every=0, wrench_rate=250.0)
    wrench = measured.wrench
    later = ((wrench.stamps - START) * 1e-9 > 6.0)[:, None]
    shifted = wrench.wrench_in_sensor - later * np.array([2.0, -1.0, 3.0, 0.1, 0.05, -0.02])
    answer = weighed(replace(measured, wrench=replace(wrench, wrench_in_sensor=shifted)))
    codes = {each.code for each in answer.estimate.findings}
    assert ErrorCode.PAYLOAD_CHANGED not in codes
    assert ErrorCode.POOR_FIT in codes
