"""A payload is weighed from the part of a recording that is free of contact, however long the contact is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from composites import composite, measured, without_shape
from kuka_recordings import kuka
from scipy.spatial.transform import Rotation, Slerp

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia import identify
from poise.inertia.bayes.consistent_part import away_from_contact
from poise.inertia.bayes.estimator import PoiseEstimator, poise
from poise.inertia.model.problem import NoiseLevels
from poise.inertia.model.wrench_regressor import regressor
from poise.inertia.pipeline.identification import _motion_of
from poise.inertia.pipeline.online import OnlineEstimator
from poise.recording import ImuStream, PoseStream, Recording, WrenchStream, open_recording, write_recording
from poise.types import Array

ROOT = Path(__file__).resolve().parents[2]
WEIGHED = 0.9343
"""kg, of the KUKA's payload: between the held poses (0.9323) and the free motion (0.9365)."""
TIP = np.array([0.02, -0.01, 0.12])


def spans(seconds: Array, share: float, pieces: int) -> Array:
    """(N,) 1 during a contact and 0 elsewhere, with edges of 50 ms; `pieces` contacts take up a share of the time."""
    period, length = seconds[-1] / pieces, share * seconds[-1] / pieces
    phase = seconds % period - 0.3 * (period - length)
    return np.clip(np.minimum(phase, length - phase) / 0.05, 0, 1)


def contact_force(kind: str, seconds: Array, tip: Array, rng: np.random.Generator) -> Array:
    """(N, 3) N in the base, at the tip (N, 3) m."""
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    if kind == "constant":
        return np.tile(12 * normal, (len(tip), 1))
    along = (tip - tip.mean(axis=0)) @ normal
    if kind == "spring":
        return 12 * np.clip(1 + 0.6 * along / along.std(), 0.1, None)[:, None] * normal
    velocity = np.gradient(tip, seconds, axis=0)
    sliding = velocity - (velocity @ normal)[:, None] * normal
    return 12 * (normal - 0.4 * sliding / (np.linalg.norm(sliding, axis=1, keepdims=True) + 0.01))


def in_contact(name: str, kind: str, share: float, pieces: int, path: Path, seed: int = 1) -> Recording:
    """A KUKA bag whose arm rests against something for a share of the time."""
    recording = open_recording(ROOT / "bags" / f"kuka_{name}.mcap")
    wrench, poses = recording.wrench(), recording.poses("ft_sensor")
    seconds = (wrench.stamps - wrench.stamps[0]) * 1e-9
    at = (poses.stamps - poses.stamps[0]) * 1e-9
    turns = Slerp(at, Rotation.from_matrix(poses.rotation_parent_child))
    attitude = turns(np.clip((wrench.stamps - poses.stamps[0]) * 1e-9, 0, at[-1]))
    force = contact_force(kind, seconds, attitude.apply(TIP), np.random.default_rng([seed, 77]))
    force = attitude.inv().apply(force) * spans(seconds, share, pieces)[:, None]
    touched = wrench.wrench_in_sensor + np.hstack([force, np.cross(TIP, force)])
    imu: ImuStream = recording.imu()
    mounting = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    streams = {
        "wrench": WrenchStream(wrench.stamps, touched, wrench.frame_id),
        "imu": imu,
        "tf": poses,
        "tf_static": PoseStream(poses.stamps[:1], mounting[None], np.zeros((1, 3)), "ft_sensor", "imu"),
    }
    write_recording(path / "touched.mcap", streams, metadata={"poise": {"gravity": "9.82085"}})
    return open_recording(path / "touched.mcap")


def codes(findings) -> set[ErrorCode]:
    return {finding.code for finding in findings}


@pytest.mark.parametrize(
    ("name", "kind", "share", "pieces"),
    [
        ("free_motion", "constant", 0.5, 1),
        ("free_motion", "friction", 0.7, 3),
        ("vibration", "spring", 0.5, 3),
    ],
)
def test_a_real_arm_that_rests_against_something_for_most_of_the_time(name, kind, share, pieces, tmp_path):
    estimate = identify(in_contact(name, kind, share, pieces, tmp_path)).estimate
    assert estimate.parameters.mass == pytest.approx(WEIGHED, rel=0.03)
    (finding,) = [each for each in estimate.findings if each.code is ErrorCode.IN_CONTACT]
    assert finding.evidence["share"] == pytest.approx(share, abs=0.15)
    assert finding.evidence["spans"] >= 1


@pytest.mark.parametrize("name", ["free_motion", "vibration", "static_poses"])
def test_recordings_without_contact_have_no_such_finding_and_every_estimate_on_the_way_holds(name):
    answer = kuka(name)
    assert ErrorCode.IN_CONTACT not in codes(answer.estimate.findings)
    assert len(answer.history) >= 10
    for past in answer.history:
        assert abs(past.parameters.mass - WEIGHED) < 3 * past.mass_std
    assert answer.estimate.mass_std < 0.015  # the scale of the accelerometer is uncertain by one percent


def test_errors_of_an_accelerometer_within_a_block_do_not_make_the_payload_lighter():
    """A slow turn by 20 degrees, while the acceleration is measured with an error of 1 m/s2."""
    rng = np.random.default_rng(4)
    seconds = np.arange(1500) * 1e-3
    turn = Rotation.from_rotvec(np.outer(seconds * 0.35 / 1.5, [1.0, 0.0, 0.0]))
    gravity = turn.apply([0.0, 0.0, -9.81], inverse=True)
    still = np.zeros_like(gravity)
    rate = np.tile([0.35 / 1.5, 0.0, 0.0], (len(seconds), 1))
    phi = np.concatenate([[1.0], [0.0, 0.0, 0.05], [4e-3, 0, 0, 4e-3, 0, 2e-3]])
    noise = NoiseLevels(0.05, 0.002, 0.3, 0.05, np.inf, np.inf)
    wrench = regressor(gravity, rate, still) @ phi + noise.wrench * rng.normal(size=(len(seconds), 6))
    wrong = rng.normal(size=gravity.shape)
    masses = {}
    for averaged in (False, True):
        estimator = PoiseEstimator(noise=noise, averaged=averaged, longest_delay=0.0)
        estimator.add((seconds * 1e9).astype(np.int64), gravity, wrong, rate, still, wrench)
        solution = estimator.solve()
        masses[averaged] = solution.phi[0]
    assert masses[False] < 0.8
    assert abs(masses[True] - 1.0) < 3 * np.sqrt(solution.covariance[0, 0]) < 0.3


def test_errors_that_last_widen_the_covariance_and_white_noise_does_not():
    rng = np.random.default_rng(5)
    phi = composite(rng).phi
    problem = without_shape(measured(rng, 0.8 * phi / phi[0], samples=800))
    slow = 0.15 * np.array([np.interp(problem.seconds, np.arange(0, 9, 0.5), rng.normal(size=18)) for _ in range(3)]).T
    lasting = replace(problem, wrench=problem.wrench + np.hstack([slow, np.zeros_like(slow)]))
    plain, widened = poise(problem), poise(lasting)
    assert np.sqrt(widened.covariance[0, 0] / plain.covariance[0, 0]) > 2.5
    assert abs(widened.phi[0] - 0.8) < 3 * np.sqrt(widened.covariance[0, 0])


def touched_problem(seed: int, share: float, kind: str = "constant"):
    """Six seconds of motion, the middle of which is in contact."""
    rng = np.random.default_rng([8, seed])
    phi = composite(rng).phi
    phi = 0.8 * phi / phi[0]
    problem = without_shape(measured(rng, phi, samples=600, noise=NoiseLevels(force_bias=np.inf, torque_bias=np.inf)))
    force = rng.normal(size=3)
    force *= 8 / np.linalg.norm(force)
    up = -problem.gravity_in_sensor / 9.80665
    pushed = np.tile(force, (600, 1)) if kind == "constant" else 4 * np.sin(problem.seconds)[:, None] * up + force
    pushed = pushed * spans(problem.seconds, share, 1)[:, None]
    return phi, replace(problem, wrench=problem.wrench + np.hstack([pushed, np.cross([0, 0, 0.1], pushed)]))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.65])
def test_the_free_part_of_a_simulated_motion_is_found(share):
    errors = []
    for seed in range(4):
        phi, problem = touched_problem(seed, share, "turning")
        solution = poise(problem)
        assert ErrorCode.IN_CONTACT in codes(solution.findings)
        errors.append(abs(solution.phi[0] - phi[0]) / np.sqrt(solution.covariance[0, 0]))
        assert solution.phi[0] == pytest.approx(phi[0], rel=0.03)
    assert max(errors) < 3.5


def test_two_payloads_that_explain_one_half_each_are_both_reported():
    rng = np.random.default_rng(12)
    phi = composite(rng).phi
    phi = 0.8 * phi / phi[0]
    problem = without_shape(measured(rng, phi, samples=800, noise=NoiseLevels(force_bias=np.inf, torque_bias=np.inf)))
    late = problem.seconds > problem.seconds[-1] / 2
    wrench = problem.wrench.copy()
    wrench[late] += problem.regressor[late] @ (0.6 * phi)
    solution = poise(replace(problem, wrench=wrench))
    (finding,) = [each for each in solution.findings if each.code is ErrorCode.IN_CONTACT]
    masses = sorted([finding.evidence["mass"], finding.evidence["other_mass"]])
    assert masses == pytest.approx([0.8, 1.28], rel=0.05)
    deviation = np.sqrt(solution.covariance[0, 0])
    assert all(abs(solution.phi[0] - mass) < 1.5 * deviation for mass in (0.8, 1.28))


def test_a_heavy_and_a_light_payload_without_contact_are_not_doubted():
    for mass in (0.03, 5.0):
        rng = np.random.default_rng(3)
        phi = composite(rng).phi
        solution = poise(measured(rng, mass * phi / phi[0], samples=300))
        assert ErrorCode.IN_CONTACT not in codes(solution.findings)


def test_the_neighbours_of_a_contact_are_not_used_as_long_as_enough_is_left():
    free = np.array([1, 1, 1, 0, 0, 1, 1, 1, 1, 1], dtype=bool)
    assert np.flatnonzero(away_from_contact(free)).tolist() == [0, 1, 6, 7, 8, 9]
    short = np.array([1, 1, 0, 1, 1, 0, 1, 1], dtype=bool)
    assert away_from_contact(short).tolist() == short.tolist()


def test_no_estimate_of_a_running_robot_that_rests_against_something_is_too_certain(tmp_path):
    recording = in_contact("free_motion", "friction", 0.5, 1, tmp_path)
    wrench = recording.wrench()
    kinematics, imu = _motion_of(recording, "ft_sensor", None, None, 9.82085)
    online = OnlineEstimator(kinematics.source, frame_id="ft_sensor", gravity=9.82085, continuous=True)
    online.take_imu(imu)
    start, before, surprises = int(wrench.stamps[0]), None, []
    for end in np.arange(0.2, (wrench.stamps[-1] - start) * 1e-9 + 0.2, 0.2):
        until = start + round(end * 1e9)
        kinematics.feed(before, until)
        some = (wrench.stamps >= (before or start)) & (wrench.stamps < until)
        online.add_wrench(wrench.stamps[some], wrench.wrench_in_sensor[some])
        online.update()
        before = until
        try:
            estimate = online.estimate()
        except NoAnswerError:  # too early
            continue
        surprises.append(abs(estimate.parameters.mass - WEIGHED) / estimate.mass_std)
    assert len(surprises) > 20
    assert max(surprises) < 3
    assert len(online.changes) <= 2  # a contact of constant force may pass for a payload


def test_a_bias_that_was_learnt_in_contact_is_not_carried_over():
    phi, problem = touched_problem(1, 0.5, "turning")
    free = replace(problem, wrench=problem.regressor @ phi + NoiseLevels().wrench)
    for each, touched in ((problem, True), (free, False)):
        estimator = PoiseEstimator(None, each.noise)
        estimator.add_problem(each)
        estimator.solve()
        assert estimator.expectation.touched == touched
