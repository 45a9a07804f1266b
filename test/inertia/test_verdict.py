"""The verdict on a fit: correct models pass, false assumptions do not, and lasting errors widen the uncertainty."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.inertia import InertialParameters, identify
from poise.inertia.estimators import solve
from poise.inertia.estimators.information import InformationAccumulator
from poise.inertia.model import NoiseLevels, RejectedInterval, regressor
from poise.inertia.verdict import ExtremeReadings, Fit, FitSamples, FitVerdict, SampleBins, judge
from poise.recording import open_recording
from poise.robot import SensorMotion
from poise.types import Array

GRAVITY = np.array([0.0, 0.0, -9.80665])
BODY = InertialParameters(1.6, np.array([0.01, -0.02, 0.07]), np.diag([6e-3, 6e-3, 2e-3]))
NOISE = NoiseLevels(force=0.1, torque=0.005, linear_acceleration=0.01, angular_acceleration=0.01)
RATE, SECONDS = 100, 12


def motion() -> SensorMotion:
    """A wrist that turns about all axes, with the rates that belong to its attitudes."""
    seconds = np.arange(RATE * SECONDS) / RATE
    angles = np.column_stack(
        [1.2 * np.sin(1.1 * seconds), 0.9 * np.sin(0.7 * seconds + 1.0), 0.8 * np.sin(1.7 * seconds)]
    )
    rotation = Rotation.from_euler("xyz", angles)
    omega = (rotation[:-1].inv() * rotation[1:]).as_rotvec() * RATE
    omega = np.vstack([omega, omega[-1:]])
    alpha = np.gradient(omega, 1 / RATE, axis=0)
    stamps = (seconds * 1e9).astype(np.int64)
    return SensorMotion(stamps, rotation.as_matrix(), omega, alpha, np.zeros((len(seconds), 3)))


def wrenches(moved: SensorMotion, seed: int) -> Array:
    """(N, 6) of the body, with white noise."""
    rng = np.random.default_rng(seed)
    clean = (
        regressor(moved.gravity_in_sensor(), moved.angular_velocity_in_sensor, moved.angular_acceleration_in_sensor)
        @ BODY.phi
    )
    return np.asarray(clean + rng.normal(size=clean.shape) * NOISE.wrench + [9.0, -1.0, 10.0, 0.4, -0.7, -0.1])


def verdict(wrench: Array, moved: SensorMotion) -> tuple[FitVerdict, Fit]:
    """Of least squares."""
    sums = InformationAccumulator()
    sums.add(
        regressor(moved.gravity_in_sensor(), moved.angular_velocity_in_sensor, moved.angular_acceleration_in_sensor),
        wrench,
    )
    found = solve(sums)
    bins = SampleBins(GRAVITY)
    bins.add(moved, wrench)
    fit = Fit(found.phi, found.bias, found.covariance, np.nan, 0.0, NOISE)
    return judge(fit, bins.samples), fit


def widening(found: FitVerdict, fit: Fit) -> float:
    """Ratio of the standard deviations of the mass, beyond that no attitude is better known than to 0.3 mrad."""
    assert found.covariance is not None
    return float(np.sqrt(found.covariance[0, 0] / (fit.covariance[0, 0] + (3e-4 * fit.phi[0]) ** 2)))


def test_a_correct_model_passes_and_its_uncertainty_stays() -> None:
    moved = motion()
    answers = [verdict(wrenches(moved, seed), moved) for seed in range(20)]
    assert all(found.passed for found, _ in answers)
    assert sum(widening(*answer) > 1.3 for answer in answers) <= 1


def in_sigmas(found: FitVerdict | Fit, fit: Fit) -> Array:
    """(4,) errors of mass and first moment."""
    assert found.covariance is not None
    return np.asarray((fit.phi - BODY.phi)[:4] / np.sqrt(np.diag(found.covariance)[:4]))


@pytest.mark.parametrize("size", [0.003, 0.02])
def test_a_sensor_that_is_not_quite_calibrated_makes_the_answer_as_uncertain_as_it_is_wrong(size: float) -> None:
    """No payload follows gains and cross-talk, they do not average out, and no residual shows a common gain."""
    moved, claimed, judged = motion(), [], []
    for seed in range(12):
        load = wrenches(moved, seed)
        error = size * np.kron(np.eye(2), np.ones((3, 3))) * np.random.default_rng(seed + 100).normal(size=(6, 6))
        found, fit = verdict(load @ (np.eye(6) + error).T, moved)
        claimed.append(in_sigmas(fit, fit))
        judged.append(in_sigmas(found, fit))
        assert found.passed
    assert np.abs(claimed).max() > 6
    assert np.abs(judged).max() < 3.5
    assert 0.2 < np.mean(np.square(judged)) < 1.5


def test_a_channel_that_shows_another_one_is_named_with_its_share() -> None:
    moved, error = motion(), np.eye(6)
    error[0, 2] = 0.15
    found, fit = verdict(wrenches(moved, 3) @ error.T, moved)
    (test,) = [test for test in found.failed if test.name == "calibration"]
    assert "force x shows 1" in test.sentence
    assert "of force z (cross-talk)" in test.sentence
    assert np.abs(in_sigmas(found, fit)).max() < 3


def test_what_one_attitude_does_not_show_is_not_left_unexplained() -> None:
    """Weight and bias add up to one wrench there: neither of them is known, and both together are."""
    bins, wrench = SampleBins(GRAVITY), wrenches(motion(), 4)
    still = SensorMotion.at_rest(motion().stamps, np.tile(motion().rotation_world_sensor[50], (len(wrench), 1, 1)))
    bins.add(still, wrench[50] + NOISE.wrench * np.random.default_rng(1).normal(size=wrench.shape))
    nothing = np.full((10, 10), np.nan)
    found = judge(Fit(np.full(10, np.nan), np.full(6, np.nan), nothing, np.nan, 0.0, NOISE), bins.samples)
    assert {test.name for test in found.failed}.isdisjoint({"residual_force", "residual_torque"})


def drifting(wrench: Array) -> Array:
    return np.asarray(wrench + np.outer(np.linspace(0, 2.0, len(wrench)), [1, 0, 0, 0, 0, 0]))


def turned(wrench: Array) -> Array:
    rotation = Rotation.from_rotvec([0.0, np.radians(35), 0.0])
    return np.hstack([rotation.apply(wrench[:, :3]), rotation.apply(wrench[:, 3:])])


def clipped(wrench: Array) -> Array:
    return np.clip(wrench, -12.0, 12.0)


def grasped(wrench: Array) -> Array:
    return np.asarray(wrench + np.outer(np.arange(len(wrench)) < len(wrench) // 2, [0, 0, 8.0, 0.3, 0, 0]))


@pytest.mark.parametrize("change", [drifting, turned, clipped, grasped])
def test_a_false_assumption_fails_or_the_answer_is_as_wide_as_it_is_wrong(change) -> None:
    moved = motion()
    found, fit = verdict(change(wrenches(moved, 1)), moved)
    assert not found.passed
    assert found.finding is not None
    assert found.finding.evidence
    assert found.covariance is not None
    assert abs(fit.phi[0] - BODY.mass) < 3 * np.sqrt(found.covariance[0, 0])


def mirrored_torque(wrench: Array) -> Array:
    return np.asarray(wrench * [1, 1, 1, -1, -1, -1])


def on_a_slope(wrench: Array) -> Array:
    """The base leans by 3 degrees; its model does not."""
    rotation = motion().rotation_world_sensor
    sideways = np.einsum("nji,j->ni", rotation, GRAVITY[2] * np.array([np.sin(np.radians(3.0)), 0.0, 0.0]))
    return np.asarray(wrench + np.hstack([BODY.mass * sideways, np.cross(BODY.mass * BODY.com, sideways)]))


@pytest.mark.parametrize(("change", "test"), [(mirrored_torque, "lever"), (on_a_slope, "tilt")])
def test_force_torque_and_gravity_must_agree(change, test: str) -> None:
    moved = motion()
    found, _ = verdict(change(wrenches(moved, 1)), moved)
    assert test in [failed.name for failed in found.failed]


@pytest.mark.parametrize("portion", [3, 500, 1200])
def test_clipped_readings_are_seen_and_coarse_ones_are_not_taken_for_them(portion: int) -> None:
    wrench = wrenches(motion(), 2)
    for change, clips in ((np.clip(wrench, -12, 12), True), (wrench, False), (np.round(wrench), False)):
        extremes = ExtremeReadings()
        for begin in range(0, len(wrench), portion):
            extremes.add(change[begin : begin + portion])
        assert (extremes.clipped is not None) == clips


def test_half_a_newton_of_drift_passes_with_a_wider_answer() -> None:
    moved = motion()
    found, fit = verdict(wrenches(moved, 1) + np.outer(np.linspace(0, 0.5, RATE * SECONDS), [1, 1, 1, 0, 0, 0]), moved)
    assert found.passed
    assert found.covariance is not None
    assert abs(fit.phi[0] - BODY.mass) < 3 * np.sqrt(found.covariance[0, 0])


@pytest.mark.parametrize("portion", [1, 7, 1000])
def test_bins_do_not_depend_on_the_portions(portion: int) -> None:
    moved = motion()
    wrench = wrenches(moved, 0)
    whole, pieces = SampleBins(GRAVITY), SampleBins(GRAVITY)
    whole.add(moved, wrench)
    for begin in range(0, len(wrench), portion):
        which = slice(begin, begin + portion)
        pieces.add(moved.select(np.arange(len(wrench))[which]), wrench[which])
    one, other = whole.samples, pieces.samples
    assert len(one) == len(other) <= 1000
    np.testing.assert_allclose(one.wrench, other.wrench, atol=1e-12)
    np.testing.assert_array_equal(one.stamps, other.stamps)
    assert isinstance(one, FitSamples)
    np.testing.assert_allclose(one.signals[:, :3], one.gravity_in_sensor, atol=1e-9)


def test_recordings_of_a_real_arm_pass_and_agree_within_their_uncertainty() -> None:
    answers = [identify(open_recording(f"bags/kuka_{name}.mcap")).estimate for name in ("static_poses", "free_motion")]
    assert all(answer.fit.passed for answer in answers)
    one, other = answers
    apart = abs(one.parameters.mass - other.parameters.mass)
    assert apart < 3 * np.hypot(one.mass_std, other.mass_std)


def test_averaged_bins_keep_the_sums_a_delay_moves_the_motion_alone_and_spans_are_left_out():
    moved = motion()
    bins = SampleBins(GRAVITY)
    bins.add(moved, wrenches(moved, 5))
    fine = bins.samples
    coarse = fine.averaged(np.floor(fine.seconds / 0.1))
    assert coarse.counts.sum() == len(moved)
    np.testing.assert_allclose(coarse.counts @ coarse.signals, fine.counts @ fine.signals)
    np.testing.assert_allclose(coarse.counts @ coarse.wrench, fine.counts @ fine.wrench)
    later = fine.delayed(0.04)
    assert later.wrench is fine.wrench
    np.testing.assert_allclose(later.signals[5:100], fine.signals[3:98], atol=1e-6)
    assert fine.delayed(np.nan) is fine
    outside = fine.outside([RejectedInterval(fine.stamps[10], fine.stamps[19], 10, "external_contact")])
    np.testing.assert_array_equal(np.flatnonzero(~outside), np.arange(10, 20))
