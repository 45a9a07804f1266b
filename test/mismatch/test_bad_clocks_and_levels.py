"""Inputs of the diagnosis: stamps with large jitter, the noise level beside knocks and steps, and its confidence."""

from dataclasses import replace

import numpy as np
import pytest
from cases import make_case
from test_effort_recordings import PHI, ROBOT

from poise.mismatch.answer import BeliefBasis, diagnose
from poise.mismatch.answer.belief import rival_odds
from poise.mismatch.answer.signal_diagnosis import _misfit
from poise.mismatch.inference import HeldOutProof
from poise.mismatch.reading.joint_motion import recorded_from_streams
from poise.mismatch.reading.joint_samples import apart, compared_efforts
from poise.mismatch.recorded import white_level
from poise.robot import regular_clock
from poise.simulation import FourierTrajectory, IdealRobot, WrenchNoise, record
from poise.types import Array


@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_a_clock_is_found_through_jitter_of_a_quarter_of_its_period(lost: float) -> None:
    rng = np.random.default_rng(5)
    true = 0.0031 + 0.008 * np.arange(4000) * (1.0 + 2e-5)
    kept = rng.random(len(true)) >= lost
    stamps = true + np.clip(rng.normal(size=len(true)) * 0.002, -0.0036, 0.0036)
    found = regular_clock(stamps[kept])
    assert found is not None
    assert np.abs(found - true[kept]).max() < 3e-4


def arrivals(true: Array, worst: float, rng: np.random.Generator) -> Array:
    """(N,) s, when messages of these times arrive: 1 ms late on average, one in a hundred later, in their order."""
    late = rng.exponential(1e-3, len(true)) + (rng.random(len(true)) < 0.01) * rng.uniform(0.0, worst, len(true))
    return np.maximum.accumulate(true + late) + 1e-9 * np.arange(len(true))


@pytest.mark.parametrize("rate", [125.0, 250.0, 500.0])
def test_a_clock_is_found_through_messages_that_arrive_in_bursts(rate: float) -> None:
    true = 0.0031 + np.arange(int(20 * rate)) / rate * (1.0 + 2e-5)
    found = regular_clock(arrivals(true, 0.03, np.random.default_rng(3)))
    assert found is not None
    off = found - true
    assert (np.abs(off - np.median(off)) > 0.3 / rate).mean() < 2e-3


@pytest.mark.parametrize("rate", [200.0, 500.0])
def test_lost_samples_among_late_ones_are_placed_by_what_was_sampled_or_left_out(rate: float) -> None:
    rng = np.random.default_rng(6)
    true = np.arange(int(20 * rate)) / rate
    kept = np.ones(len(true), dtype=bool)
    for first in rng.integers(20, len(true) - 20, int(0.006 * len(true))):
        kept[first : first + int(rng.integers(1, 7))] = False
    stamps = arrivals(true, 0.03, rng)[kept]
    position = np.column_stack([np.sin(2.0 * true), np.cos(1.3 * true)])[kept] + 1e-5 * rng.normal(size=(kept.sum(), 2))

    def misplaced(found: Array | None) -> int:
        """Jumps of a tick that the samples do not have."""
        assert found is not None
        return int((np.abs(np.diff(found) - np.diff(true[kept])) > 0.3 / rate).sum())

    assert misplaced(regular_clock(stamps)) > 5
    found = regular_clock(stamps, position)
    assert found is not None
    assert np.isfinite(found).mean() > 0.95
    assert misplaced(found) <= 2


@pytest.mark.parametrize("law", ["uniform", "exponential"])
def test_stamps_without_a_clock_behind_them_are_left_as_they_are(law: str) -> None:
    rng = np.random.default_rng(6)
    steps = rng.uniform(0.001, 0.02, 3000) if law == "uniform" else rng.exponential(0.01, 3000)
    assert regular_clock(np.cumsum(steps)) is None


def test_knocks_do_not_raise_the_level_of_the_noise() -> None:
    rng = np.random.default_rng(7)
    values = 0.3 * rng.normal(size=(4000, 1))
    values[40::100] += 200.0
    assert white_level(values)[0] == pytest.approx(0.3, rel=0.15)


def test_coarse_readings_are_named_for_what_they_are() -> None:
    case, step = make_case(32), np.repeat([1.0, 0.05], 3)
    recorded = case.recorded()
    found = diagnose(replace(recorded, wrench=np.round(recorded.wrench / step) * step), case.model)
    assert [finding.effect.name for finding in found.findings] == ["quantisation"]
    assert found.findings[0].parameters["force_step"].value == pytest.approx(1.0, rel=1e-3)
    assert found.verdict == "named"


def test_more_evidence_is_surer() -> None:
    chances = [BeliefBasis(size, 0.0, 0, False).probability for size in (1.0, 10.0, 100.0, 1e6)]
    assert chances == sorted(chances)
    assert chances[0] < 0.5 < chances[-1] < 1.0


def test_an_event_is_less_certain_than_a_lasting_effect() -> None:
    """A cause outside the library that acts once is followed by an event of it."""
    assert BeliefBasis(1e6, 0.0, 0, True).probability < 0.985 < BeliefBasis(1e6, 0.0, 0, False).probability


def test_a_rival_that_explains_nearly_as_much_counts_where_the_answer_leaves_an_error() -> None:
    """Hundreds of nats between two models say little where neither is exact."""
    exact, inexact = (rival_odds(1e4, 9.8e3, misfit) for misfit in (0.0, 0.02))
    assert exact < 1e-6
    assert inexact > 0.5
    assert rival_odds(1e4, 2e3, 0.02) < 1e-4
    assert rival_odds(1e4, 1.1e4, 0.0) == 1.0


def test_effects_that_fit_equally_well_share_the_belief() -> None:
    chances = [BeliefBasis(1e4, rivals, 0, False).probability for rivals in (1.0, 2.0, 4.0)]
    assert np.all(np.array(chances) < [0.92, 0.85, 0.75])
    assert chances == sorted(chances, reverse=True)
    assert BeliefBasis(1e4, 0.0, 1, False).probability < 0.5  # equal by rule: nothing prefers the name


def test_an_answer_that_no_sample_could_test_leaves_all_of_the_error() -> None:
    """Without a held-out sample the errors are NaN, and so was the probability of every name."""
    proof = HeldOutProof(1.0, 3.0, 1.0, 3.0, 3.0, np.zeros((3, 6)), np.ones(6))
    assert _misfit(proof, 0.0) == 0.0
    for unknown in (replace(proof, nominal=np.nan, augmented=np.nan), replace(proof, augmented=np.nan)):
        assert _misfit(unknown, 0.0) == 1.0
    assert _misfit(proof, np.nan) == 1.0


def test_a_sample_that_was_sent_with_the_one_before_is_left_out() -> None:
    seconds = np.arange(200) * 0.01
    late = seconds.copy()
    late[100:103] = seconds[103] + 1e-9 * np.arange(-3, 0)  # three messages wait for the fourth
    kept = apart(late)
    assert np.flatnonzero(~kept).tolist() == [101, 102, 103]
    at, efforts = compared_efforts(late, np.ones((200, 2)))
    assert len(at) == len(efforts) == 197
    assert np.diff(at).min() > 5e-4


def test_efforts_have_the_clock_of_the_positions_that_came_with_them() -> None:
    """Stamps that are late by up to 4 ms: the effort of a fast joint would be off by up to 4 ms of its slope."""
    motion = FourierTrajectory.random(ROBOT, np.random.default_rng(2), duration=12.0, speed=0.8)
    made = record(IdealRobot(ROBOT, PHI, [0.0, 0.0, -9.80665]), motion, np.random.default_rng(2), WrenchNoise(100.0))
    late = np.random.default_rng(2).exponential(1.2e6, size=len(made.joints.stamps)).clip(max=4e6).astype(np.int64)
    off = []
    for stamps in (made.joints.stamps, np.maximum.accumulate(made.joints.stamps + late) + np.arange(len(late))):
        joints = replace(made.joints, stamps=stamps)
        recorded, notes = recorded_from_streams(ROBOT, joints, None, None, PHI, 9.80665)
        assert recorded.effort is not None
        off.append(np.sqrt(np.mean((recorded.effort.measured - recorded.effort.prediction) ** 2)))
    assert any("jitter" in note for note in notes)
    assert off[1] < 1.1 * off[0]  # by the stamps, 1.5 times
