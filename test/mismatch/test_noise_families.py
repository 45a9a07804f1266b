"""Noise of every family has its level, also behind a filter; the errors of a measured motion are part of it."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt

from poise.inertia import InertialParameters
from poise.mismatch.answer.residual_test import judge_residual
from poise.mismatch.answer.unknown_physics import unknown_physics
from poise.mismatch.inference import Problem, fit
from poise.mismatch.inference.noise import NoiseColour, SignalNoise, fit_noise
from poise.mismatch.reading import NominalModel
from poise.mismatch.reading.motion_variance import wrench_variance
from poise.mismatch.recorded import RecordedMotion, load_wrench, noise_level, white_level
from poise.recording import PoseStream
from poise.robot import base_motion_at, resample
from poise.types import Array

SECONDS = 20.0


def noise(family: str, rate: int, seed: int = 0, filtered: bool = False) -> Array:
    """(N, 6) of unit deviation, made at 1 kHz and sampled at `rate`."""
    rng, count = np.random.default_rng(seed), round(1000 * SECONDS)
    values = rng.normal(size=(count, 6))
    if family == "first order":
        keep = np.exp(-0.001 / 0.06)
        slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=(count, 6)), axis=0)
        values = np.sqrt(0.5) * (values + slow)
    elif family == "band-limited":
        band = sosfilt(butter(2, [6.0, 35.0], "bandpass", fs=1000, output="sos"), values, axis=0)
        values = 0.98 * band / band.std(axis=0) + 0.2 * rng.normal(size=(count, 6))
    elif family == "heavy-tailed":
        values = rng.standard_t(3, size=(count, 6))
    elif family == "quantised":
        values = np.round(values / 0.5) * 0.5
    if filtered:
        values = sosfiltfilt(butter(2, 12.0, fs=1000, output="sos"), values, axis=0)
    return np.asarray((values / values.std(axis=0))[:: 1000 // rate])


def fitted(values: Array, rate: int, least: float = 1e-3) -> SignalNoise:
    seconds = np.arange(len(values)) / rate
    return fit_noise(seconds, np.abs(np.sin(seconds)), values, np.full(values.shape[1], least))


@pytest.mark.parametrize("rate", [100, 500])
@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("family", ["white", "first order", "band-limited", "heavy-tailed", "quantised"])
def test_each_family_has_its_level_and_a_slow_signal_its_chance(family: str, filtered: bool, rate: int) -> None:
    values = noise(family, rate, filtered=filtered)
    model = fitted(values, rate)
    assert np.sqrt(np.mean((values / model.total) ** 2)) == pytest.approx(1.0, abs=0.15)
    white = model.whiten(values[:, :, None])[0]
    squares = []
    for frequency in np.arange(0.3, 5.0, 0.45):
        course = np.sin(2 * np.pi * frequency * model.seconds)
        column = model.whiten(np.repeat(course[:, None], 6, axis=1)[:, :, None])[0]
        squares += ((white * column).sum(axis=1) ** 2 / (column**2).sum(axis=1)).tolist()
    # Chi square with one degree of freedom, 66 times; band-limited noise has little below its band.
    assert np.mean(squares) < 1.6
    assert np.mean(squares) > 0.5 or family == "band-limited"


def test_a_held_out_part_of_a_smoothed_recording_has_the_size_of_its_noise() -> None:
    values = noise("first order", 100, seed=3, filtered=True)
    half = len(values) // 2
    model = fitted(values[:half], 100)
    assert 0.8 < np.sqrt(np.mean((values[half:] / np.median(model.total, axis=0)) ** 2)) < 1.3
    # The differences of neighbouring samples say that it is far smaller.
    assert (model.total.mean(axis=0) > 15.0 * white_level(values)).all()


def test_a_signal_without_noise_has_the_least_level_in_its_own_band() -> None:
    seconds = np.arange(0, SECONDS, 0.008)
    values = np.stack([np.sin((2.0 + k) * seconds) for k in range(6)], axis=1)
    values += 1e-7 * np.random.default_rng(0).normal(size=values.shape)
    level = noise_level(values, 0.008, least=np.full(6, 0.01))
    assert np.sqrt(level.share) * level.sigma == pytest.approx(np.full(6, 0.01), rel=0.05)
    assert (level.share < 0.2).all()


def test_a_slow_recording_has_a_level_too() -> None:
    level = noise_level(np.random.default_rng(1).normal(size=(1000, 3)), 0.1)
    assert level.sigma == pytest.approx(np.ones(3), rel=0.15)
    assert level.block.tolist() == [1, 1, 1]


def test_a_line_in_the_spectrum_is_no_noise() -> None:
    values = noise("white", 200, seed=5)
    seconds = np.arange(len(values)) / 200
    line = 3.0 * np.sin(2 * np.pi * 40.0 * seconds)[:, None]
    assert noise_level(values + line, 0.005).block.tolist() == [1] * 6


def standing(seconds: Array, wrench: Array) -> RecordedMotion:
    """A sensor at rest without a load."""
    zeros, turn = np.zeros((len(wrench), 3)), np.tile(np.eye(3), (len(wrench), 1, 1))
    return RecordedMotion(0, seconds, wrench, np.zeros(10), 0 * wrench, zeros, zeros, zeros, zeros, turn, zeros, zeros)


@pytest.mark.parametrize("size", [0.3, 1.0])
def test_noise_does_not_hide_a_slow_residual(size: float) -> None:
    """The absolute gate: a slow residual beyond what colour may have is structure, whatever filter made the noise."""
    values = noise("white", 100, seed=7, filtered=True)
    seconds = np.arange(len(values)) / 100
    values = values + size * 4.0 * np.sin(2 * np.pi * 0.4 * seconds)[:, None]
    problem = Problem(standing(seconds, values), NominalModel(), fitted(values, 100))
    assert judge_residual(problem, values, problem.whiten(values)).structured == (size == 1.0)


@pytest.mark.parametrize("deviation", [2e-4, 1e-3])
def test_odometry_has_the_errors_that_it_states(deviation: float) -> None:
    rng = np.random.default_rng(11)
    stamps = np.arange(0, 30.0, 0.02)
    moves = (stamps > 8.0) & (stamps < 26.0)
    place, rate = 0.4, 2 * np.pi * 0.3
    course = np.where(moves, place * (1 - np.cos(rate * (stamps - 8.0))) ** 2, 0.0)
    course = np.where(stamps >= 26.0, place * (1 - np.cos(rate * 18.0)) ** 2, course)
    wanted = np.arange(9.0, 24.0, 0.01)
    finer = np.arange(8.0, 25.0, 1e-3)
    true = np.interp(wanted, finer, np.gradient(np.gradient(place * (1 - np.cos(rate * (finer - 8))) ** 2, 1e-3), 1e-3))
    translation = np.zeros((len(stamps), 3))
    translation[:, 0] = course + deviation * rng.normal(size=len(stamps))
    poses = PoseStream((stamps * 1e9).astype(np.int64), np.tile(np.eye(3), (len(stamps), 1, 1)), translation, "o", "b")
    base = base_motion_at(poses, 0, wanted)
    error = base.motion.linear_acceleration_in_base[:, 0] - true
    assert 0.4 < np.sqrt(np.mean(error**2) / np.mean(base.acceleration_sigma[:, 0] ** 2)) < 2.0
    assert 0.8 * deviation < base.place_noise < 2.5 * deviation
    rest = base_motion_at(poses, 0, np.arange(1.0, 6.0, 0.1))
    assert not rest.acceleration_sigma[:, :3].any()


def test_rounded_encoders_have_the_errors_that_they_state() -> None:
    seconds, step = np.arange(0, 20.0, 0.01), 2 * np.pi / 2**15
    position = 0.8 * np.sin(1.3 * seconds) + 0.3 * np.sin(3.1 * seconds)
    found = resample(seconds, (np.round(position / step) * step)[:, None], seconds[50:-50])
    true = -0.8 * 1.3**2 * np.sin(1.3 * seconds) - 0.3 * 3.1**2 * np.sin(3.1 * seconds)
    ratio = np.mean((found.acceleration[:, 0] - true[50:-50]) ** 2) / np.mean(found.sigma[2, :, 0] ** 2)
    assert 0.3 < np.sqrt(ratio) < 2.0


def test_the_variance_of_a_wrench_is_that_of_its_samples() -> None:
    rng = np.random.default_rng(2)
    phi = InertialParameters(2.0, np.array([0.02, -0.01, 0.1]), np.diag([0.02, 0.03, 0.01])).phi
    omega, sigma = rng.normal(size=3), np.array([0.1, 0.2, 0.05, 0.3, 0.1, 0.4])
    errors = sigma * rng.normal(size=(20000, 6))
    still = np.zeros((len(errors), 3))
    spread = load_wrench(phi, still - errors[:, :3], still + omega, errors[:, 3:]).std(axis=0)
    found = wrench_variance(phi, omega[None], np.eye(6)[None], sigma[None])[0]
    assert np.sqrt(found) == pytest.approx(spread, rel=0.03)


def test_no_columns_are_whitened_to_none():
    motion = {"seconds": np.arange(500) * 0.01, "speed": np.ones(500), "share": np.ones(6), "band": np.ones(6)}
    coloured = SignalNoise(np.ones(6), (NoiseColour(0.2, 0.3, 0.1),) * 6, **motion)
    assert coloured.whiten(np.zeros((500, 6, 0))).shape == (0, 6, 500)


@pytest.mark.parametrize("size", [0.0, 1.6])
def test_quiet_channels_do_not_hide_the_residual_of_one(size: float) -> None:
    """A hum of one channel, six sigma, was noise: the motion was less wrong than its variance in the other channels."""
    values = 0.7 * noise("white", 100, seed=7)
    seconds = np.arange(len(values)) / 100
    problem = Problem(standing(seconds, values), NominalModel(), fitted(values / 0.7, 100))
    sigma = problem.noise.sigma[1]
    values[:, 1] += size * sigma * np.sin(2 * np.pi * 6.3 * seconds)
    found = judge_residual(problem, values, problem.whiten(values))
    assert found.excess < 0.0
    assert (found.structured, found.channel) == ((True, "fy") if size else (False, ""))


@pytest.mark.parametrize(
    ("size", "lasts", "found"),
    [
        (40.0, 0.2, (8.1, 17.1)),
        (9.0, 0.03, ()),
        (60.0, 0.03, (8.0, 17.0)),
        (60.0, 0.012, ()),
        (3.5, 0.6, (8.3, 17.3)),  # no reading is beyond ten sigma
        (1.5, 0.8, ()),
    ],
)
def test_brief_events_are_not_the_colour_of_noise(size: float, lasts: float, found: tuple[float, ...]) -> None:
    """A base that drove over thresholds was `none` at 4.6 noises: coloured noise may have this energy."""
    values = noise("white", 200, seed=7)
    seconds = np.arange(len(values)) / 200
    for begin in (8.0, 17.0):
        values[:, 2] += size * values[:, 2].std() * ((seconds > begin) & (seconds < begin + lasts))
    problem = Problem(standing(seconds, values), NominalModel(), fitted(values, 200))
    rest = judge_residual(problem, values, problem.whiten(values))
    assert rest.excess < 0.05
    assert rest.structured == bool(found)
    assert rest.bursts == pytest.approx(found, abs=0.02)
    if found:
        assert f"at {found[0]:.1f} s, {found[1]:.1f} s" in str(unknown_physics(problem, fit(problem, ()), rest))
