"""Offset and scale of an accelerometer: found from the attitudes, taken out of the bias, and uncertain otherwise."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.geometry import cross_matrix
from poise.inertia.estimators import Accelerometer, AccelerometerComparison
from poise.inertia.model.solution import InertialSolution
from poise.inertia.pipeline.identification import identify
from poise.recording import open_recording
from poise.robot import SensorMotion

BAGS = Path(__file__).parents[2] / "bags"
GRAVITY = np.array([0.0, 0.0, -9.81])


def turning(rng: np.random.Generator, seconds: float) -> tuple[SensorMotion, np.ndarray, np.ndarray]:
    """A sensor that turns and moves in a room, as an accelerometer with errors reports it; its scale and offset."""
    stamps = np.arange(0, round(seconds * 1e9), 4_000_000)
    time = (stamps * 1e-9)[:, None]
    frequency, phase = rng.uniform(1.0, 4.0, (2, 3)), rng.uniform(0.0, 6.0, (2, 3))
    angles = rng.uniform(0.4, 0.9, 3) * np.sin(frequency[0] * time + phase[0])
    rotation = Rotation.from_euler("xyz", angles).as_matrix()
    places = 0.15 * rng.uniform(0.5, 1.0, 3)
    in_world = -places * frequency[1] ** 2 * np.sin(frequency[1] * time + phase[1])
    true = np.einsum("nji,nj->ni", rotation, in_world)
    down = np.einsum("nji,j->ni", rotation, GRAVITY)
    scale, offset = rng.normal(0.0, 0.01) + rng.normal(0.0, 0.01, 3), rng.normal(0.0, 0.5, 3)
    reading = (1 + scale) * (down - true) + offset
    still = np.zeros_like(true)
    return SensorMotion(stamps, rotation, still, still, down - reading), scale, offset


def compared(motion: SensorMotion, portions: int = 1) -> AccelerometerComparison:
    comparison = AccelerometerComparison(GRAVITY, Accelerometer.ON_KINEMATICS)
    for which in np.array_split(np.arange(len(motion)), portions):
        comparison.add(motion.select(which))
    return comparison


def test_offsets_and_scales_lie_within_their_uncertainty() -> None:
    scores = []
    for seed in range(40):
        motion, scale, offset = turning(np.random.default_rng(seed), 4.0 + seed % 3 * 4.0)
        found = compared(motion).errors()
        error = np.concatenate([found.scale - scale, found.offset - offset])
        scores.append(error / np.sqrt(np.diag(found.covariance)))
    within = np.abs(scores) < 1.96
    assert 0.90 < within.mean() <= 1.0
    assert np.sqrt(np.diag(found.covariance))[3:].max() < 0.3  # the samples show the offset


def test_portions_do_not_matter_and_windows_stay_few() -> None:
    motion, _, _ = turning(np.random.default_rng(1), 150.0)
    whole, cut = compared(motion).errors(), compared(motion, 17).errors()
    np.testing.assert_array_equal(whole.offset, cut.offset)
    np.testing.assert_array_equal(whole.covariance, cut.covariance)
    assert np.sqrt(np.diag(whole.covariance))[3:].max() < 0.3


def test_a_wrench_of_readings_gives_the_bias_of_the_sensor() -> None:
    """f = m u + b for true specific forces u; least squares on the readings find another mass and bias."""
    motion, _, _ = turning(np.random.default_rng(3), 12.0)
    found = compared(motion).errors()
    true = found.true_motion(motion, GRAVITY)
    down = motion.gravity_in_sensor(GRAVITY)
    specific, reading = (down - each.linear_acceleration_in_sensor for each in (true, motion))
    mass, first, bias = 1.3, np.array([0.02, -0.01, 0.1]), np.array([1.0, -2.0, 0.5])
    force = mass * specific + bias
    design = np.zeros((3 * len(force), 4))
    design[:, 0] = reading.ravel()
    design[:, 1:] = np.tile(np.eye(3), (len(force), 1))
    fitted = np.linalg.lstsq(design, force.ravel(), rcond=None)[0]
    phi = np.concatenate([fitted[:1], first / mass * fitted[0], np.full(6, 0.01)])
    torque = np.cross(first, (specific - fitted[0] / mass * reading).mean(axis=0))
    raw = InertialSolution(
        phi, np.zeros((10, 10)), np.concatenate([fitted[1:], torque]), np.zeros((6, 6)), (), 1.0, 0.0, 0.0, 1, 1.0
    )
    corrected = found.corrected(raw)
    assert corrected.phi[0] == pytest.approx(mass, rel=2e-3)
    np.testing.assert_allclose(corrected.bias[:3], bias, atol=0.03)
    np.testing.assert_allclose(corrected.bias[3:], 0.0, atol=0.005)
    lever = cross_matrix(corrected.phi[1:4]) / corrected.phi[0]
    np.testing.assert_allclose(corrected.bias_covariance[3:, :3], lever @ corrected.bias_covariance[:3, :3], atol=1e-4)


def test_attitudes_by_the_same_imu_show_no_offset_across_gravity() -> None:
    motion, _, _ = turning(np.random.default_rng(4), 8.0)
    alone = AccelerometerComparison(GRAVITY, Accelerometer.ALONE)
    alone.add(motion)
    spread = np.sqrt(np.diag(alone.errors().covariance))[3:]
    assert spread.max() > 1.5 * np.sqrt(np.diag(compared(motion).errors().covariance))[3:].max()


@pytest.mark.parametrize("name", ["free_motion", "vibration"])
def test_a_real_arm_has_the_bias_and_the_mass_of_its_held_poses(name: str) -> None:
    poses, moving = (identify(open_recording(BAGS / f"kuka_{one}.mcap")).estimate for one in ("static_poses", name))
    bias_std = np.sqrt(np.diag(poses.bias_covariance) + np.diag(moving.bias_covariance))
    drift = np.repeat([0.0, 0.005], 3)  # between the recordings, as the poses held in either show
    assert np.all(np.abs(poses.bias - moving.bias) < 3 * np.hypot(bias_std, drift))
    assert bias_std[:3].max() < 0.25
    assert abs(poses.phi[0] - moving.phi[0]) < 2 * np.hypot(poses.mass_std, moving.mass_std)
