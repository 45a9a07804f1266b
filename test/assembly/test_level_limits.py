"""Limits in many level directions of a large block: as if each were followed from rest."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from benchmarks.growth import pallet, wall
from benchmarks.level_limits import LevelTally, around, compare, one_by_one, random_scene
from poise.assembly import Analysis, acceleration_limits
from poise.assembly.robustness.elastic_limits import ElasticLimits, inertial_loads
from poise.assembly.robustness.plane_curve import PlaneCurve
from poise.assembly.statics import NO_DEADLINE, Deadline

COUNT = 72


@dataclass(frozen=True)
class _Questions(Deadline):
    """Passes after it was asked a number of times."""

    left: list[int] = field(default_factory=lambda: [0])

    @property
    def passed(self):
        self.left[0] -= 1
        return self.left[0] < 0

    @property
    def remaining(self):
        return 0.0 if self.passed else None


def curve_of(reach, azimuths):
    curve = PlaneCurve()
    for azimuth in azimuths:
        curve.add(azimuth, reach(azimuth))
    return curve


def square(azimuth):
    return 1 / max(abs(np.cos(azimuth)), abs(np.sin(azimuth)))


def test_chords_of_a_circle_are_its_sagittas_and_tangents_bound_it():
    azimuths = 2 * np.pi * np.arange(8) / 8
    curve = curve_of(lambda _: 2.0, azimuths)
    chord = curve.chord(np.pi / 8)
    assert chord.reach == pytest.approx(2 * np.cos(np.pi / 8))
    assert chord.weights == pytest.approx((0.5, 0.5))
    assert curve.beyond(np.pi / 8) >= 2.0
    assert curve.chord(0.0).reach == pytest.approx(2 * np.cos(np.pi / 4))  # without the point itself


def test_on_a_flat_side_both_bounds_are_the_side_itself():
    curve = curve_of(square, np.radians([-44, -20, 20, 44, 100, 190, 280]) % (2 * np.pi))
    for degrees in (-30, 0, 30):
        azimuth = np.radians(degrees) % (2 * np.pi)
        assert curve.chord(azimuth).reach == pytest.approx(square(azimuth))
        assert curve.beyond(azimuth) == pytest.approx(square(azimuth))


def test_of_points_less_than_half_a_turn_apart_there_is_no_chord_beyond():
    curve = curve_of(square, [0.0, 1.0])
    assert curve.chord(0.5) is not None
    assert curve.chord(3.0) is None
    assert curve.beyond(0.5) == np.inf
    assert curve_of(square, [0.0]).chord(0.1) is None


@pytest.mark.parametrize("scene", [wall(24), pallet(24)], ids=["wall", "pallet"])
def test_limits_that_begin_beside_others_are_those_followed_from_rest(scene):
    block = Analysis.of(scene).blocks[0]
    directions, most = around(COUNT), np.full(COUNT, 1000.0)
    found = ElasticLimits(block, inertial_loads(block), directions, most, NO_DEADLINE, patches=False).solve()
    single = one_by_one(block, directions)
    assert found.known.all()
    assert found.from_rest < 0.6 * COUNT
    # Some directions end early when followed from rest, and then begin better beside others.
    assert np.median(np.abs(found.limits / single - 1)) < 0.005
    assert np.all(found.limits > 0.95 * single)
    for limit, direction in zip(found.limits, directions, strict=True):
        inverse = block.solvers.limit.inverse_factor(inertial_loads(block) @ direction)
        assert limit * inverse.value <= 1 + 1e-3


def test_a_deadline_leaves_limits_all_around():
    block = Analysis.of(wall(24)).blocks[0]
    block.solvers.standing()
    clock = _Questions(NO_DEADLINE.at, [60])
    most = np.full(COUNT, 1000.0)
    found = ElasticLimits(block, inertial_loads(block), around(COUNT), most, clock, patches=False).solve()
    assert 4 <= found.known.sum() < COUNT
    known = np.flatnonzero(found.known)
    assert np.diff([*known, known[0] + COUNT]).max() <= COUNT // 4
    assert np.all(found.limits[known] > 0)


def test_a_direction_asked_twice_has_one_answer():
    twice = np.concatenate([around(COUNT), around(COUNT)[:5]])
    found = acceleration_limits(wall(24), twice, turning=False)
    np.testing.assert_array_equal(found.limits[:5], found.limits[COUNT:])
    assert found.first_to_move[:5] == found.first_to_move[COUNT:]


def test_the_benchmark_compares_a_random_wall_with_mujoco():
    tally, rng = LevelTally(), np.random.default_rng([3, 0, 0])
    compare(random_scene("wall", rng), rng, tally, asked=1)
    assert len(tally.held) == 2  # one of them where the ratio is largest: from rest, that direction had ended early
    assert all(tally.held)
    assert np.median(tally.ratios) == pytest.approx(1, abs=0.01)
    assert min(tally.ratios) > 0.95
