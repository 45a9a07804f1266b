"""Thinning a series keeps its picture: every extremum, every gap, nothing invented."""

import itertools

import numpy as np
import pytest

from poise.viewing.decimation import break_at_gaps, envelope


@pytest.mark.parametrize("seed", range(20))
def test_thinning_keeps_every_extremum_and_invents_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, bins = int(rng.integers(2_000, 20_000)), int(rng.integers(10, 300))
    x, y = np.cumsum(rng.random(n)), rng.normal(size=n)
    y[rng.choice(n, 5, replace=False)] = 100 * rng.choice([-1, 1], 5)
    thin_x, thin_y = envelope(x, y, bins)
    assert len(thin_y) <= 5 * bins
    assert np.all(np.diff(thin_x) > 0)
    samples = dict(zip(x, y, strict=True))
    assert all(samples[at] == value for at, value in zip(thin_x, thin_y, strict=True))
    # Seen through columns of pixels as wide as the stretches, the two curves are the same.
    edges = np.linspace(0, n, bins + 1).astype(int)
    for first, end in itertools.pairwise(edges):
        inside = (thin_x >= x[first]) & (thin_x <= x[end - 1])
        assert thin_y[inside].min() == y[first:end].min()
        assert thin_y[inside].max() == y[first:end].max()


def test_a_single_spike_among_a_million_samples_stays_visible() -> None:
    y = np.zeros(1_000_000)
    y[654_321] = 1.0
    assert envelope(np.arange(1e6), y, 240)[1].max() == 1.0


def test_a_short_series_is_left_as_it_is() -> None:
    x, y = np.arange(50.0), np.arange(50.0) ** 2
    assert envelope(x, y, 10)[1] is y


def test_a_broken_line_stays_broken_and_an_unknown_series_stays_unknown() -> None:
    x, y = np.arange(1000.0), np.ones(1000)
    y[500] = np.nan
    assert np.isnan(envelope(x, y, 20)[1]).sum() == 1
    assert np.isnan(envelope(x, np.full(1000, np.nan), 20)[1]).all()


def test_no_line_is_drawn_across_a_pause() -> None:
    x = np.concatenate([np.arange(0, 1, 0.01), np.arange(5, 6, 0.01)])
    broken_x, broken_y = break_at_gaps(x, np.ones_like(x))
    gap = np.flatnonzero(np.isnan(broken_y))
    assert len(gap) == 1
    assert 0.99 < broken_x[gap[0]] < 5
    assert np.sum(np.isfinite(broken_y)) == len(x)


def test_an_even_series_has_no_gaps() -> None:
    assert np.isfinite(break_at_gaps(np.arange(100.0), np.ones(100))[1]).all()
