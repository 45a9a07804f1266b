"""Stamps from numbers and arrivals: right on average, free of jitter, never in the future."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from poise.force_torque.clock import SampleClock, lower_support

PERIOD = 142_857.0 * (1 + 80e-6)
"""ns; a 7 kHz device whose crystal is off by 80 ppm."""
EPOCH = 1_790_000_000_000_000_000


def arrivals(rng: np.random.Generator, seconds: float, every: int = 7) -> tuple[np.ndarray, np.ndarray]:
    """Positions read, and when: after delays that are short mostly, long sometimes, and never negative."""
    position = np.arange(every - 1, int(seconds * 1e9 / PERIOD), every)
    delay = rng.exponential(300e3, len(position)) + np.where(rng.random(len(position)) < 0.01, 5e6, 0)
    arrival = np.maximum.accumulate(EPOCH + position * PERIOD + delay)
    return position, arrival.astype(np.int64)


def run(clock: SampleClock, position: np.ndarray, arrival: np.ndarray) -> np.ndarray:
    stamps = []
    for place, time in zip(position.tolist(), arrival.tolist(), strict=True):
        clock.observe(place, time)
        stamps.append(clock.stamps(np.array([place]))[0])
    return np.array(stamps)


def test_stamps_have_a_hundredth_of_the_jitter_of_the_arrivals() -> None:
    position, arrival = arrivals(np.random.default_rng(1), 20.0)
    stamps = run(SampleClock(1e9 / 7000), position, arrival)
    truth = EPOCH + position * PERIOD
    late = position * PERIOD > 5e9
    error = (stamps - truth)[late]
    assert np.std(error) < 0.01 * np.std((arrival - truth)[late])
    assert np.abs(error).max() < 20e3


def test_no_stamp_lies_after_the_arrival_and_none_before_the_last() -> None:
    position, arrival = arrivals(np.random.default_rng(2), 5.0)
    stamps = run(SampleClock(1e9 / 7000), position, arrival)
    assert np.all(stamps <= arrival)
    assert np.all(np.diff(stamps) > 0)


def test_a_read_that_comes_early_does_not_turn_the_stamps_back() -> None:
    clock = SampleClock(142_857.0)
    clock.observe(0, EPOCH)
    first = clock.stamps(np.array([0]))
    clock.observe(7, EPOCH + 1000)  # so sample 0 was late by almost a millisecond
    stamps = np.concatenate([first, clock.stamps(np.arange(1, 8))])
    assert np.all(np.diff(stamps) > 0)
    assert stamps[-1] <= EPOCH + 1000


def test_the_period_of_the_device_is_found_to_a_millionth() -> None:
    clock = SampleClock(1e9 / 7000)
    run(clock, *arrivals(np.random.default_rng(3), 12.0))
    assert clock.period == pytest.approx(PERIOD, rel=2e-6)


def test_a_wrong_nominal_rate_is_mended_within_a_second() -> None:
    position, arrival = arrivals(np.random.default_rng(4), 3.0)
    stamps = run(SampleClock(1e9 / 1000), position, arrival)
    late = position * PERIOD > 1.5e9
    assert np.abs(stamps - EPOCH - position * PERIOD)[late].max() < 1e6


@pytest.mark.parametrize("step", [-3_600_000_000_000, 3_600_000_000_000])
def test_a_host_clock_that_is_set_is_followed(step: int) -> None:
    position, arrival = arrivals(np.random.default_rng(5), 8.0)
    after = position * PERIOD > 3e9
    stamps = run(SampleClock(1e9 / 7000), position, arrival + np.where(after, step, 0))
    settled = position * PERIOD > 4e9
    assert np.abs(stamps - EPOCH - position * PERIOD - step)[settled].max() < 1e6


def test_a_reader_that_was_held_up_does_not_move_the_stamps() -> None:
    position, arrival = arrivals(np.random.default_rng(6), 8.0)
    held = (position * PERIOD > 5e9) & (position * PERIOD < 5.3e9)
    arrival[held] = arrival[held].max()
    stamps = run(SampleClock(1e9 / 7000), position, arrival)
    assert np.abs(stamps - EPOCH - position * PERIOD)[held].max() < 50e3


def test_a_device_that_counts_anew_is_stamped_at_once() -> None:
    clock = SampleClock(1e9 / 7000)
    position, arrival = arrivals(np.random.default_rng(7), 3.0)
    run(clock, position, arrival)
    clock.restart()
    later = int(arrival[-1]) + 10_000_000_000
    clock.observe(int(position[-1]) + 1, later)
    assert clock.stamps(np.array([position[-1] + 1])).tolist() == [later]


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 1000), st.integers(-1000, 1000)), min_size=2, max_size=40).map(
        lambda points: sorted(points)
    )
)
def test_the_supporting_line_is_the_optimum_of_the_linear_programme(points: list[tuple[int, int]]) -> None:
    x, y = np.array(points, dtype=float).T
    (x0, y0), (x1, y1) = lower_support(points)
    slope = (y1 - y0) / (x1 - x0) if x1 > x0 else 0.0
    below = y - (y0 + slope * (x - x0))
    assert below.min() >= -1e-6
    # Moon et al.: minimise sum(y - (a + b x)) over a, b, with a + b x <= y everywhere.
    optimum = linprog([-len(x), -x.sum()], np.column_stack([np.ones_like(x), x]), y, bounds=(None, None))
    if x.max() > x.min():
        assert below.sum() == pytest.approx(y.sum() + optimum.fun, abs=1e-4)
