"""Errors of resampled accelerations: they grow where a spline rings, and stay small in smooth motion."""

import numpy as np
import pytest

from poise.robot import resample


@pytest.mark.parametrize("rate", [100.0, 200.0])
def test_the_stated_error_covers_the_ringing_beside_a_jump_of_the_acceleration(rate: float) -> None:
    """A trapezoid of the velocity, with encoders so fine that noise alone explains none of the error."""
    seconds = np.arange(0.0, 12.0, 1.0 / rate)
    corners = np.array([1.0, 1.1, 3.0, 3.1, 5.0, 5.1, 8.0, 8.1])
    jumps = 5.0 * np.array([1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    position = sum(0.5 * jump * np.maximum(seconds - at, 0.0) ** 2 for jump, at in zip(jumps, corners, strict=True))
    truth = sum(jump * (seconds >= at) for jump, at in zip(jumps, corners, strict=True))
    noise = np.random.default_rng(4).normal(scale=1e-6, size=len(seconds))
    found = resample(seconds, (position + noise)[:, None], seconds)
    error, sigma = found.acceleration[:, 0] - truth, found.sigma[2, :, 0]
    apart = np.abs(seconds[:, None] - corners).min(axis=1)
    beside = found.known & (apart > 0.02) & (apart < 0.12) & (sigma > 0.0)
    assert np.sqrt(np.mean((error[beside] / sigma[beside]) ** 2)) < 3.0


def test_smooth_motion_does_not_ring() -> None:
    seconds = np.arange(0.0, 20.0, 0.008)
    position = 0.4 * np.sin(2.0 * np.pi * 0.5 * seconds) + 0.1 * np.sin(2.0 * np.pi * 1.3 * seconds)
    noise = np.random.default_rng(5).normal(scale=1e-5, size=len(seconds))
    found = resample(seconds, (position + noise)[:, None], seconds)
    assert np.nanmax(found.sigma[2]) < 1e-3 * np.nanmax(np.abs(found.acceleration))


@pytest.mark.parametrize(("rate", "noise"), [(100.0, 2e-5), (125.0, 2e-4), (500.0, 3e-5)])
def test_the_stated_error_holds_at_the_corners_of_trapezoids_and_between_them(rate: float, noise: float) -> None:
    """Noise hides how sharp a corner is: without a variance for that, the mean square there was 40 to 59."""
    rng = np.random.default_rng(9)
    seconds, at = np.arange(0.0, 40.0, 1.0 / rate), np.arange(1.0, 39.0, 0.7)
    jumps = np.diff(rng.uniform(-1.5, 1.5, len(at) - 1), prepend=0.0, append=0.0)
    position = sum(0.5 * jump * np.maximum(seconds - t, 0.0) ** 2 for jump, t in zip(jumps, at, strict=True))
    truth = sum(jump * (seconds >= t) for jump, t in zip(jumps, at, strict=True))
    found = resample(seconds, (position + rng.normal(scale=noise, size=len(seconds)))[:, None], seconds)
    moving = found.sigma[2, :, 0] > 0.0
    score = ((found.acceleration[:, 0] - truth)[moving] / found.sigma[2, moving, 0]) ** 2
    corner = np.abs(seconds[moving, None] - at).min(axis=1) < 0.07
    assert np.mean(score[corner]) < 20.0
    assert 0.3 < np.mean(score[~corner]) < 2.0


@pytest.mark.parametrize("steps_per_sample", [21.96, 22.02, 21.5, 21.37])
def test_the_rounding_of_an_encoder_at_constant_speed_is_no_vibration(steps_per_sample: float) -> None:
    """Near a whole number of steps per sample, rounding is a saw tooth of some 20 to 40 Hz, and no white noise."""
    period, step = 1e-3, 2 * np.pi / 2**17
    seconds = np.arange(0, 6, period)
    ramp = 2 * np.sin(np.pi * np.arange(300) / 300) ** 2 / 300 * steps_per_sample * step / period**2
    acceleration = np.zeros_like(seconds)
    for begin, sense in ((0, 1), (1700, -1), (2000, -1), (3700, 1), (4000, 1), (5700, -1)):
        acceleration[begin : begin + 300] += sense * ramp
    position = np.cumsum(np.cumsum(acceleration)) * period**2
    found = resample(seconds, (np.round(position / step) * step)[:, None], seconds[500:-500:4])
    cruising = slice(0, 250)  # 0.5 to 1.5 s
    assert np.std(found.acceleration[cruising, 0]) < 0.02  # it was 0.7 rad/s2
    assert found.sigma[2, cruising].max() < 0.2
