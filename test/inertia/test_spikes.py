"""Single samples far from their neighbours are spikes; steps, contacts, clipping and heavy noise are not."""

import numpy as np
import pytest

from poise.inertia.model import SpikeFilter

SIDE = 2


def wrench(rate: float, rng: np.random.Generator, seconds: float = 8.0) -> np.ndarray:
    """(N, 6) of a load of 10 N that swings, with noise of 0.05 N and 2.5 mN m."""
    at = np.arange(0, seconds, 1 / rate)
    swing = np.sin(2 * np.pi * 0.7 * at[:, None] + np.arange(6))
    return (10 * swing + 0.05 * rng.normal(size=(len(at), 6))) * np.repeat([1, 0.05], 3)


def judged(rows: np.ndarray, portion: int = 7) -> np.ndarray:
    filtered, found = SpikeFilter(), []
    for begin in range(0, len(rows), portion):
        end = min(begin + portion, len(rows))
        found.append(filtered.judge(rows[begin:end], rows[end : end + SIDE]))
    return np.concatenate(found)


@pytest.mark.parametrize("rate", [100.0, 250.0, 1000.0])
def test_spikes_are_found_and_nothing_else(rate):
    rng = np.random.default_rng(3)
    rows = wrench(rate, rng)
    hit = np.zeros(len(rows), dtype=bool)
    hit[80::41] = True
    channel = rng.integers(6, size=hit.sum())
    rows[hit, channel] += rng.choice([-1, 1], hit.sum()) * np.where(channel < 3, 20.0, 1.0)
    found = judged(rows)
    assert (found & hit).sum() >= 0.98 * hit.sum()
    assert (found & ~hit).sum() <= 0.001 * len(rows)


def test_the_portions_do_not_matter():
    rows = wrench(250.0, np.random.default_rng(4))
    rows[90::37, 2] += 15.0
    whole = judged(rows, len(rows))
    assert whole.any()
    for portion in (2, 33, 500):
        np.testing.assert_array_equal(judged(rows, portion), whole)


def test_steps_presses_clipping_and_quantised_readings_are_no_spikes():
    rng = np.random.default_rng(5)
    rows = wrench(100.0, rng)
    rows[200:230, 0] += 25.0  # a press of 0.3 s
    rows[400:, 1] -= 12.0  # a release
    rows[:, 2] = rows[:, 2].clip(-6.0, 6.0)
    rows[:, 4] = np.round(rows[:, 4] / 0.05) * 0.05
    assert judged(rows).mean() < 0.003


def test_heavy_tailed_noise_hardly_has_spikes():
    rng = np.random.default_rng(6)
    rows = wrench(100.0, rng, 40.0) + 0.05 * rng.standard_t(3, size=(4000, 6)) / np.sqrt(3)
    assert judged(rows).mean() < 0.02


def test_portions_judge_as_one_pass_over_the_whole_recording():
    """Block by block: each sample against the median of five, and the block before for what is usual."""
    rng = np.random.default_rng(7)
    rows = wrench(100.0, rng, 6.0)
    rows[300:340] = rows[300]  # frozen
    rows[rng.integers(80, len(rows), 25), rng.integers(6, size=25)] += 18.0
    expected = np.zeros(len(rows), dtype=bool)
    for i in range(64, len(rows) - SIDE):
        begin = i // 32 * 32 - 32
        bends = np.abs(rows[begin + 1 : begin + 33] - 2 * rows[begin : begin + 32] + rows[begin - 1 : begin + 31]) / 2
        for k in range(6):
            moving = bends[bends[:, k] > 0, k]
            usual = max(10 * np.median(bends[:, k]), 6 * np.median(moving) if len(moving) else np.inf)
            near = np.sort(rows[i - SIDE : i + SIDE + 1, k])
            limit = max(usual, 0.02 if k < 3 else 1e-3) + 3 * (near[3] - near[1])
            expected[i] |= abs(rows[i, k] - near[2]) > limit
    assert expected.sum() > 15
    for portion in (1, 7, 31, 32, 33, 200):
        np.testing.assert_array_equal(judged(rows, portion), expected)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e308])
def test_samples_that_are_no_numbers_neither_warn_nor_hide_spikes(bad):
    rows = wrench(250.0, np.random.default_rng(8))
    rows[600] += 50.0
    for portion in (7, 500):
        given = rows.copy()
        given[570:580] = bad
        given[[100, 101], 2] = bad, -bad
        assert 600 in np.flatnonzero(judged(given, portion))
        given[:] = bad
        assert not judged(given, portion).any()
