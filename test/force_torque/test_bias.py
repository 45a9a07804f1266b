"""A zero is a mean over rest; motion and too little data are refused."""

import numpy as np
import pytest

from poise.errors import ErrorCode, NoAnswerError, SensorError
from poise.force_torque.bias import MAX_DRIFT, BiasJob, estimate_bias
from poise.serial_bus import Backoff

LOAD = np.array([1.0, 2.0, 30.0, 0.1, 0.2, 0.3])
NOISE = np.repeat([0.3, 0.01], 3)


def test_the_mean_and_spread_of_noise_are_found() -> None:
    rng = np.random.default_rng(1)
    bias = estimate_bias(LOAD + NOISE * rng.standard_normal((2000, 6)))
    np.testing.assert_allclose(bias.wrench_in_sensor, LOAD, atol=4 * NOISE.max() / np.sqrt(2000))
    np.testing.assert_allclose(bias.spread, NOISE, rtol=0.1)
    assert bias.count == 2000


def test_noise_larger_than_the_allowed_drift_is_still_rest() -> None:
    rng = np.random.default_rng(2)
    bias = estimate_bias(LOAD + 4 * MAX_DRIFT * rng.standard_normal((5000, 6)))
    assert np.all(bias.drift < MAX_DRIFT)


@pytest.mark.parametrize("axis", range(6))
def test_a_load_that_drifts_is_refused_by_the_name_of_the_axis(axis: int) -> None:
    ramp = np.zeros((1000, 6))
    ramp[:, axis] = np.linspace(0, 2 * MAX_DRIFT[axis], 1000)
    name = ("fx", "fy", "fz", "tx", "ty", "tz")[axis]
    with pytest.raises(NoAnswerError, match=f"the load moves: {name}") as caught:
        estimate_bias(LOAD + ramp)
    assert caught.value.code == ErrorCode.NOT_IDENTIFIABLE


def test_a_swing_that_ends_where_it_began_is_refused() -> None:
    swing = np.zeros((1000, 6))
    swing[:, 2] = np.sin(np.linspace(0, 2 * np.pi, 1000))
    with pytest.raises(NoAnswerError):
        estimate_bias(swing)


def test_too_few_samples_are_no_bias() -> None:
    with pytest.raises(NoAnswerError) as caught:
        estimate_bias(np.zeros((9, 6)))
    assert caught.value.code == ErrorCode.TOO_FEW_SAMPLES


def test_a_job_takes_exactly_as_many_samples_as_it_was_asked_for() -> None:
    job = BiasJob(25)
    for value in range(3):
        job.feed(np.full((10, 6), 0.001 * value), usable=True)
    assert job.future.result(timeout=0).count == 25


def test_a_job_that_meets_a_saturated_sample_fails() -> None:
    job = BiasJob(25)
    job.feed(np.zeros((10, 6)), usable=False)
    with pytest.raises(SensorError) as caught:
        job.future.result(timeout=0)
    assert caught.value.code == ErrorCode.SENSOR_SATURATED


def test_waits_double_up_to_the_cap_with_jitter_and_begin_anew() -> None:
    backoff = Backoff(np.random.default_rng(1), first=0.05, cap=0.8)
    nominal = [0.05, 0.1, 0.2, 0.4, 0.8, 0.8, 0.8]
    waits = [backoff.next() for _ in nominal]
    assert all(0.5 * length <= wait <= length for wait, length in zip(waits, nominal, strict=True))
    backoff.reset()
    assert backoff.next() <= 0.05
    assert [Backoff(np.random.default_rng(2)).next()] != [Backoff(np.random.default_rng(3)).next()]
