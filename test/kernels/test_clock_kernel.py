"""The compiled sums at many lags against their form in Python, and with bad input."""

import numpy as np
import pytest

from poise.errors import InputError
from poise.inertia.bayes import clock_comparison
from poise.inertia.bayes.clock_comparison import ClockComparison
from poise.kernels import clock_sums


def test_sums_and_delay_are_those_of_python(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    seconds = np.cumsum(rng.uniform(0.004, 0.012, 900))
    seconds[500:] += 0.3  # a gap
    rows = np.sin(np.arange(1, 16) * seconds[:, None] + np.arange(15))
    rows[:, 9:] += 0.01 * rng.normal(size=(900, 6))
    stamps = np.round(seconds * 1e9).astype(np.int64) + 10**18
    found = []
    for whether in (True, False):
        monkeypatch.setattr(clock_comparison, "COMPILED", whether)
        comparison = ClockComparison()
        delays = [comparison.delay(stamps[:end], rows[:end]) for end in (300, 900)]
        found.append((comparison._moments, comparison._counts, *(each.mean for each in delays if each)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10 * np.abs(other).max())
    assert found[0][1].sum() > 0


def test_bad_input_is_refused_and_none_gives_nothing() -> None:
    times, lags, none = np.arange(4), np.array([-1, 0, 1]), np.zeros(0, dtype=np.int64)
    for bad in ((times, np.ones((3, 13)), times, np.ones((4, 6))), (times, np.ones((4, 13)), times, np.ones((4, 5)))):
        with pytest.raises(InputError):
            clock_sums(*bad, lags, 10)
    with pytest.raises(InputError):
        clock_sums(times[None], np.ones((1, 13)), times, np.ones((4, 6)), lags, 10)
    assert not clock_sums(none, np.ones((0, 13)), times, np.ones((4, 6)), lags, 10)[1].any()
    assert not clock_sums(times[:1], np.ones((1, 13)), times, np.ones((4, 6)), lags, 10)[1].any()
    assert clock_sums(times, np.full((4, 13), np.nan), none, np.ones((0, 6)), lags, 10)[0].sum() == 0
    assert np.isnan(clock_sums(times, np.full((4, 13), np.nan), times, np.ones((4, 6)), lags, 10)[0][1, 0, 0])
