"""A clock that is set forward during a recording: the stamps have a hole that the log times lack."""

from pathlib import Path

import numpy as np
import pytest

from poise.recording import RecordingWriter, WrenchStream, open_recording
from poise.recording.encoding import encode_stream
from poise.recording.timeline import clock_steps, on_one_clock
from poise.types import Stamps

PERIOD = 2_000_000
SET = 250_000_000


def written(late: float, seed: int = 0) -> tuple[Stamps, Stamps]:
    """True times of 4,000 messages at 500 Hz, and their log times: a delay of 2 ms with a long tail, ns."""
    rng = np.random.default_rng(seed)
    true = 10**18 + np.arange(4000) * PERIOD + rng.integers(-100_000, 100_000, 4000)
    return true, np.maximum.accumulate(true + (late * rng.lognormal(0.0, 1.0, 4000)).astype(np.int64))


@pytest.mark.parametrize("right_before", [True, False])
def test_the_part_whose_clock_is_near_the_log_stays_and_the_other_is_moved(right_before: bool) -> None:
    true, logged = written(2e6)
    stamps = true.copy()
    if right_before:
        stamps[1500:] += SET
    else:
        stamps[:1500] -= SET
    ((first, jump),) = clock_steps(stamps, logged)
    assert first == 1500
    assert jump == pytest.approx(SET, abs=1_000_000)
    error = on_one_clock(stamps, logged, [(first, jump)]) - true
    assert np.abs(error).max() < 1_000_000
    assert not error[:1500].any() if right_before else not error[1500:].any()


def test_two_steps_are_taken_back() -> None:
    true, logged = written(2e6, 1)
    stamps = true.copy()
    stamps[1000:] += SET
    stamps[3000:] += 2 * SET
    steps = clock_steps(stamps, logged)
    assert [first for first, _ in steps] == [1000, 3000]
    assert np.abs(np.diff(on_one_clock(stamps, logged, steps) - true)).max() < 1_000_000


_CASES = ["lost", "stalled", "bursts", "slow simulation", "fast simulation", "repeated stamps", "log at stamps"]


@pytest.mark.parametrize("case", _CASES)
def test_holes_that_no_clock_made_stay(case: str) -> None:
    stamps, logged = written(2e6, 2)
    if case == "lost":
        stamps, logged = (np.delete(times, slice(1500, 1625)) for times in (stamps, logged))
    elif case == "stalled":  # the network held messages back; the first of them are lost
        logged[1500:1700] = np.maximum(logged[1500:1700], stamps[1700])
        stamps, logged = (np.delete(times, slice(1500, 1600)) for times in (stamps, logged))
    elif case == "bursts":  # the log is written once a second
        stamps = np.delete(stamps, slice(1500, 1625))
        logged = (stamps // 10**9 + 1) * 10**9
    elif case in ("slow simulation", "fast simulation"):
        rate = 0.5 if case.startswith("slow") else 20.0
        logged = (10**18 + (stamps - 10**18) / rate).astype(np.int64)
        stamps, logged = (np.delete(times, slice(1500, 1625)) for times in (stamps, logged))
    else:
        stamps = np.delete(stamps, slice(1500, 1625))
        stamps = np.repeat(stamps, 3) if case == "repeated stamps" else stamps
        logged = stamps
    assert clock_steps(stamps, logged) == []


def test_a_recording_is_read_on_one_clock_and_says_so(tmp_path: Path) -> None:
    true, logged = written(2e6, 3)
    stamps = true.copy()
    stamps[2000:] += SET
    path = tmp_path / "bag.mcap"
    with RecordingWriter(path) as writer:
        writer.add_topic("wrench", "geometry_msgs/msg/WrenchStamped")
        for stamp, at in zip(stamps.tolist(), logged.tolist(), strict=True):
            ((_, data),) = encode_stream("wrench", WrenchStream(np.array([stamp]), np.zeros((1, 6)), "ft_sensor"))
            writer.write("wrench", at, data)
    recording = open_recording(path)
    assert np.abs(recording.wrench().stamps - true).max() < 1_000_000
    (said,) = recording.clocks.values()
    assert "wrench was set forward by 0.25" in said
