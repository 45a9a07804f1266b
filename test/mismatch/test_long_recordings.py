"""Long and fast recordings are averaged to what can be compared in a sensible time and memory."""

from dataclasses import replace

import numpy as np
import pytest
from cases import make_case

from poise.mismatch.effects.base_motion import MAX_SPLINES, UnreportedBaseMotion
from poise.mismatch.inference.unknown import states
from poise.mismatch.reading.wrench_samples import MAX_WRENCH_RATE, MAX_WRENCH_SAMPLES, MIN_WRENCH_RATE, usable
from poise.mismatch.recorded import BaseTrack
from poise.recording import WrenchStream


def stream(seconds: float, rate: float) -> WrenchStream:
    """A slow sine in every channel."""
    at = np.arange(round(seconds * rate)) / rate
    values = np.sin(0.3 * at)[:, None] * np.arange(1.0, 7.0)
    return WrenchStream(np.round(at * 1e9).astype(np.int64), values, "ft_sensor")


@pytest.mark.parametrize(("seconds", "rate"), [(20.0, 100.0), (30.0, 1000.0), (120.0, 1000.0), (900.0, 100.0)])
def test_few_enough_samples_are_left_and_they_are_averages(seconds: float, rate: float) -> None:
    kept, notes = usable(stream(seconds, rate))
    at = kept.stamps * 1e-9
    assert len(kept) <= MAX_WRENCH_SAMPLES
    assert MIN_WRENCH_RATE * 0.95 <= 1 / np.median(np.diff(at)) <= MAX_WRENCH_RATE * 1.06
    assert kept.wrench_in_sensor[:, 5] == pytest.approx(6.0 * np.sin(0.3 * at), abs=1e-3)
    assert any("longer than" in note for note in notes) == (seconds > MAX_WRENCH_SAMPLES / MIN_WRENCH_RATE)
    assert (len(kept) < round(seconds * rate)) == (seconds * rate > MAX_WRENCH_SAMPLES or rate > MAX_WRENCH_RATE)


def test_a_clock_that_jumps_is_told_from_a_long_recording() -> None:
    given = stream(20.0, 100.0)
    late = given.stamps + np.where(np.arange(len(given)) < 1500, 0, 3600 * 10**9)
    kept, notes = usable(WrenchStream(late, given.wrench_in_sensor, given.frame_id))
    assert len(kept) == 1500
    assert any("jump by 3600 s at 15.0 s" in note for note in notes)


def test_a_base_motion_between_two_samples_does_nothing() -> None:
    recorded = make_case(3, duration=6.0).recorded()
    between = float(recorded.seconds[50:52].mean())
    columns = UnreportedBaseMotion().columns(recorded, {"start": between, "length": 1e-6, "splines": 10.0})
    assert columns.shape == (len(recorded), 6, 2 * MAX_SPLINES)
    assert not columns.any()


def test_a_displacement_that_the_noise_of_odometry_hides_is_no_base_motion() -> None:
    """A spline through noisy positions rounds a jump of the acceleration: the wrench shows it as a small motion."""
    recorded, effect = make_case(3, duration=6.0).recorded(), UnreportedBaseMotion()
    values = {p.name: 0.0 for p in effect.parameters(recorded)} | {"start": 2.0, "length": 1.0, "splines": 10.0}
    values |= {"speed_x_3": 0.04, "speed_x_6": -0.04}
    size = effect.derived(recorded, values)["displacement"][0]
    still = np.zeros((len(recorded), 3))
    jump = np.where(recorded.seconds > 2.5, 2.0, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    driven = BaseTrack(np.tile(np.eye(3), (len(still), 1, 1)), still, still, jump, still, still)
    for base, sigmas in ((None, 3.0), (driven, 10.0)):
        hidden, seen = (replace(recorded, base=base, place_noise=k * size / sigmas) for k in (1.1, 0.9))
        assert "hides" in effect.implausible(hidden, values)
        assert not effect.implausible(seen, values)
    assert not effect.implausible(recorded, values)


def test_a_curve_in_time_has_a_bounded_number_of_columns() -> None:
    """The cost of a fit grows with the square of its columns: their number must not grow with the duration."""
    recorded = make_case(3, duration=12.0).recorded()
    level = np.repeat([0.1, 0.005], 3)
    for name in ("time", "time:pushes", "time:load", "time:turning"):
        counts = [
            states(replace(recorded, seconds=recorded.seconds * longer), level)[name]().columns.shape[2]
            for longer in (50.0, 500.0)
        ]
        assert counts[0] == counts[1] <= 400
