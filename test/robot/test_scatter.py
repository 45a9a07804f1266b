"""The white noise of a stream."""

import numpy as np
import pytest

from poise.robot import scatter


@pytest.mark.parametrize(("count", "columns"), [(50, 3), (200, 3), (2000, 3), (2000, 1), (200, 6)])
def test_the_noise_of_a_smooth_signal_is_found_without_an_error_on_average(count: int, columns: int) -> None:
    """The quiet blocks that count have less noise than the others by chance."""
    rng = np.random.default_rng(3)
    smooth = np.sin(np.arange(count) / 40.0)[:, None]
    found = [scatter(smooth + 0.2 * rng.normal(size=(count, columns))) for _ in range(300)]
    assert abs(np.mean(found) / 0.2 - 1) < 0.01 + 3 * np.std(found) / 0.2 / np.sqrt(300)


def test_shaking_in_half_of_the_samples_is_no_noise_and_few_samples_show_none() -> None:
    rng = np.random.default_rng(4)
    values = 0.2 * rng.normal(size=(4000, 3))
    values[2000:] += 5.0 * rng.normal(size=(2000, 3))
    assert 0.18 < scatter(values) < 0.22
    assert np.isnan(scatter(values[:20]))
