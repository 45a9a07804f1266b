"""Simulated recordings: the noise is the stated noise, the seed is the recording, the payload comes back out."""

import numpy as np
import pytest
from scipy.stats import kurtosis

from poise.errors import InputError
from poise.inertia.model import regressor
from poise.robot import RobotModel, motion_from_joints
from poise.simulation import (
    WRENCH_NOISE,
    FourierTrajectory,
    IdealRobot,
    JointNoise,
    NoisyWrench,
    WrenchNoise,
    record,
    wrench_noise,
)

PAYLOAD = np.array([1.2, 0.02, -0.01, 0.09, 0.012, 0.001, 0.0, 0.011, 0.0, 0.004])
XARM = RobotModel.from_file("xarm7")


def test_white_noise_bias_and_drift_are_as_stated():
    noise = WrenchNoise(
        rate=100.0, force=0.2, torque=0.01, bias=(1, 2, 3, 0.1, 0.2, 0.3), drift_force=0.05, drift_torque=0.002
    )
    runs = [NoisyWrench(noise, np.random.default_rng(seed)).report(np.zeros((400, 6))) for seed in range(300)]
    said = np.array(runs)
    steps = np.diff(said, axis=1)  # white noise twice, one step of the walk
    expected = np.sqrt(2 * np.array([0.2, 0.01]) ** 2 + np.array([0.05, 0.002]) ** 2 / 100)
    np.testing.assert_allclose(steps.std(axis=(0, 1)), np.repeat(expected, 3), rtol=0.02)
    np.testing.assert_allclose(said.mean(axis=(0, 1)), noise.bias, atol=0.02)
    late = said[:, -100:].mean(axis=1).std(axis=0)  # after 3.5 s the walk has spread by sqrt(3.5)
    np.testing.assert_allclose(late[:3], 0.05 * np.sqrt(3.5), rtol=0.2)
    assert abs(float(kurtosis(steps.ravel() / np.tile(np.repeat(expected, 3), 300 * 399)))) < 0.05


def test_samples_do_not_depend_on_how_they_are_cut_into_blocks():
    noise = wrench_noise("ft300", drift_force=0.01, stamp_jitter=1e-3)
    wrench = np.random.default_rng(1).normal(size=(100, 6))
    taken = np.arange(100) * 10**7
    whole, pieces = (NoisyWrench(noise, np.random.default_rng(2)) for _ in range(2))
    cuts = [slice(0, 7), slice(7, 50), slice(50, 100)]
    np.testing.assert_array_equal(whole.report(wrench), np.vstack([pieces.report(wrench[cut]) for cut in cuts]))
    np.testing.assert_array_equal(whole.stamps(taken), np.concatenate([pieces.stamps(taken[cut]) for cut in cuts]))


def test_numbers_lie_on_the_grid_of_the_sensors_resolution():
    said = NoisyWrench(wrench_noise("ft300"), np.random.default_rng(3)).report(np.zeros((50, 6)))
    np.testing.assert_allclose(said[:, :3] * 100, np.round(said[:, :3] * 100), atol=1e-9)
    np.testing.assert_allclose(said[:, 3:] * 1000, np.round(said[:, 3:] * 1000), atol=1e-9)


def test_stamps_are_late_by_the_latency_and_never_out_of_order():
    sensor = NoisyWrench(wrench_noise("ft300", latency=0.02, stamp_jitter=0.05), np.random.default_rng(4))
    taken = np.arange(5000) * 10**7
    stamps = sensor.stamps(taken)
    assert (np.diff(stamps) > 0).all()
    assert np.mean(stamps - taken) * 1e-9 == pytest.approx(0.02, abs=1e-3)


def test_one_seed_is_one_recording():
    ideal, motion = IdealRobot(XARM, PAYLOAD), FourierTrajectory.random(XARM, np.random.default_rng(5), duration=3.0)
    noise = (wrench_noise("ft300"), JointNoise(position=1e-5, velocity=1e-3, effort=0.1))
    first, second, other = (record(ideal, motion, np.random.default_rng(seed), *noise) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.wrench.wrench_in_sensor, second.wrench.wrench_in_sensor)
    np.testing.assert_array_equal(first.joints.effort, second.joints.effort)
    assert (first.wrench.wrench_in_sensor != other.wrench.wrench_in_sensor).any()


def test_the_payload_comes_back_out_of_what_was_recorded():
    """Joint states -> splines -> motion -> least squares, from noisy samples on two clocks."""
    ideal = IdealRobot(XARM, PAYLOAD)
    motion = FourierTrajectory.random(XARM, np.random.default_rng(6), duration=15.0, speed=0.4)
    noise = wrench_noise("ft300", bias=(1.0, -2.0, 0.5, 0.1, 0.0, -0.1))
    recorded = record(ideal, motion, np.random.default_rng(7), noise, JointNoise(rate=100.0, position=2e-5))
    moved = motion_from_joints(XARM, recorded.joints.stamps, recorded.joints.names, recorded.joints.position).motion
    at = np.searchsorted(moved.stamps, recorded.wrench.stamps)
    assert (moved.stamps[at] == recorded.wrench.stamps).all()
    matrix = regressor(
        moved.gravity_in_sensor() - moved.linear_acceleration_in_sensor,
        moved.angular_velocity_in_sensor,
        moved.angular_acceleration_in_sensor,
    )
    rows = np.concatenate([matrix, np.tile(np.eye(6), (len(matrix), 1, 1))], axis=2)
    weight = np.repeat([1 / 0.1, 1 / 0.005], 3)[:, None]
    left, right = (rows * weight).reshape(-1, 16), (recorded.wrench.wrench_in_sensor * weight[:, 0]).ravel()
    estimate, residual = np.linalg.lstsq(left, right)[:2]
    sigma = np.sqrt(np.diag(np.linalg.inv(left.T @ left)))
    truth = np.concatenate([PAYLOAD, noise.bias])
    assert np.abs((estimate - truth) / sigma).max() < 4.0
    assert float(residual[0]) / len(right) == pytest.approx(1.0, abs=0.1)  # nothing but the stated noise is left


def test_every_named_sensor_says_where_its_numbers_are_from():
    for name, noise in WRENCH_NOISE.items():
        assert name == "none" or len(noise.source) > 20


@pytest.mark.parametrize(("name", "changes"), [("best", {}), ("ft300", {"force": -1.0}), ("ft300", {"rate": 0.0})])
def test_a_sensor_that_cannot_be_is_refused(name, changes):
    with pytest.raises(InputError, match=name):
        wrench_noise(name, **changes)
