"""Signals at rest have no velocity and no acceleration; slow ones do."""

import numpy as np
import pytest

from poise.robot import differentiate

RATE = 125.0
SECONDS = np.arange(0.0, 6.0, 1.0 / RATE)
STAMPS = np.round(SECONDS * 1e9).astype(np.int64)


def quantised(values, step):
    return np.round(values / step) * step


@pytest.mark.parametrize("noise", [1e-7, 1e-5, 1e-3])
def test_white_noise_at_rest_has_no_acceleration_and_a_small_sigma(noise):
    rng = np.random.default_rng(1)
    position = 0.7 + rng.normal(size=(len(SECONDS), 7)) * noise
    found = differentiate(STAMPS, position)
    assert found.at_rest.mean() > 0.9
    assert np.all(found.velocity[found.at_rest] == 0.0)
    assert np.all(found.acceleration[found.at_rest] == 0.0)
    # A spline with knots every 0.1 s would have a sigma of some 1e3 noise per s2.
    assert np.median(found.acceleration_sigma[found.at_rest]) < 5.0 * noise
    assert np.all(np.abs(found.position - 0.7)[found.at_rest] < 6.0 * found.position_sigma[found.at_rest])


@pytest.mark.parametrize("start", [0.30004, 0.3, 0.299951])
def test_an_encoder_that_flickers_or_stands_is_at_rest(start):
    rng = np.random.default_rng(2)
    position = quantised(start + rng.normal(size=(len(SECONDS), 3)) * 3e-5, 1e-4)
    found = differentiate(STAMPS, position)
    assert found.at_rest.mean() > 0.9
    assert np.all(found.acceleration[found.at_rest] == 0.0)
    assert np.all(found.acceleration_sigma[found.at_rest] > 0.0)


@pytest.mark.parametrize("noise", [1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("sigmas", [12.0, 100.0, 1e4])
def test_a_slow_joint_is_not_at_rest(noise, sigmas):
    rng = np.random.default_rng(3)
    detectable = noise * np.sqrt(12.0 / len(SECONDS)) / SECONDS[-1]
    velocity = sigmas * detectable
    found = differentiate(STAMPS, velocity * SECONDS[:, None] + rng.normal(size=(len(SECONDS), 6)) * noise)
    assert found.at_rest.mean() < 0.05
    if sigmas >= 100.0:
        assert np.abs(found.velocity.mean() / velocity - 1.0) < 0.2


@pytest.mark.parametrize("velocity", [5e-4, 2e-3, 1e-2])
def test_the_staircase_of_a_slow_joint_with_a_coarse_encoder_is_not_at_rest(velocity):
    found = differentiate(STAMPS, quantised(velocity * SECONDS[:, None] + 0.1, 3e-4))
    assert not found.at_rest.any()


def test_stops_between_moves_are_found_and_the_moves_are_not():
    rng = np.random.default_rng(4)
    phase = np.clip((SECONDS % 3.0) - 1.5, 0.0, 1.0)  # moves for a second, rests for two
    step = 10 * phase**3 - 15 * phase**4 + 6 * phase**5
    truth = 0.4 * (np.floor(SECONDS / 3.0) + step)
    moving = (phase > 0.05) & (phase < 0.95)
    found = differentiate(STAMPS, truth[:, None] + rng.normal(size=(len(SECONDS), 1)) * 1e-5)
    assert not found.at_rest[moving].any()
    assert found.at_rest[(phase == 0.0) | (phase == 1.0)].mean() > 0.7


def test_a_turning_point_is_no_rest():
    rng = np.random.default_rng(5)
    position = 0.2 * np.sin(2 * np.pi * 0.2 * SECONDS)[:, None] + rng.normal(size=(len(SECONDS), 1)) * 1e-4
    assert not differentiate(STAMPS, position).at_rest.any()


def test_the_stated_errors_of_joints_cover_the_truth_where_they_rest_too():
    rng = np.random.default_rng(6)
    detectable = 1e-4 * np.sqrt(12.0 / len(SECONDS)) / SECONDS[-1]
    velocity = rng.normal(size=40) * detectable  # as slow as the data cannot show
    found = differentiate(STAMPS, velocity * SECONDS[:, None] + rng.normal(size=(len(SECONDS), 40)) * 1e-4)
    ratio = (found.velocity - velocity) / found.velocity_sigma
    assert np.sqrt(np.mean(ratio**2)) < 1.6


def test_position_and_acceleration_errors_are_correlated_as_stated():
    rng = np.random.default_rng(7)
    truth = 0.5 * np.sin(2 * np.pi * 0.5 * SECONDS)
    found = differentiate(STAMPS, truth[:, None] + rng.normal(size=(len(SECONDS), 60)) * 1e-4, knot_spacing=0.2)
    middle = slice(100, -100)
    error = found.position[middle] - truth[middle, None]
    second = found.acceleration[middle] + (np.pi**2) * truth[middle, None]
    stated = np.mean(found.covariance[middle, :, 0, 2])
    assert stated < 0.0
    assert 0.7 < np.mean(error * second) / stated < 1.4


def test_samples_faster_than_the_fit_needs_are_averaged_without_a_bias():
    seconds = np.arange(0.0, 3.0, 1e-3)
    rate = 2 * np.pi * 2.0
    truth = 0.3 * np.sin(rate * seconds)[:, None]
    found = differentiate(np.round(seconds * 1e9).astype(np.int64), truth)
    inner = slice(100, -100)
    np.testing.assert_allclose(found.position[inner], truth[inner], atol=1e-8)
    np.testing.assert_allclose(found.acceleration[inner], -(rate**2) * truth[inner], atol=5e-4 * 0.3 * rate**2)


@pytest.mark.parametrize("seed", range(5))
def test_a_motion_that_begins_is_not_at_rest_before_it_shows_in_the_noise(seed):
    since = np.clip(SECONDS - 2.0, 0.0, None)
    noise = 1e-5
    truth, acceleration = 5.0 * since**4, 60.0 * since**2
    slow = since < 0.3
    rng = np.random.default_rng(seed)
    found = differentiate(STAMPS[slow], (truth[slow] + rng.normal(size=slow.sum()) * noise)[:, None])
    still = found.at_rest[:, 0]
    assert still.mean() > 0.6
    assert np.abs(acceleration[slow][still]).max() == 0.0
