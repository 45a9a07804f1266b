"""Objects that touch side by side: no force between neighbours counts that Coulomb contact does not produce."""

from dataclasses import dataclass, field, replace
from math import erf

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G, box, fixed_box

from benchmarks.touching import (
    ABOVE,
    KINDS,
    Tally,
    compare,
    followed,
    holds_in_mujoco,
    random_scene,
    single_limits,
    single_pushes,
)
from poise.assembly import (
    Analysis,
    Assembly,
    Push,
    acceleration_limits,
    assess,
    motion_probability,
    robustness_map,
    sensitivity,
)
from poise.assembly.robustness.uncertainty import _moves
from poise.assembly.statics import NO_DEADLINE, Deadline


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


ALONG = np.array([[1.0, 0, 0], [-1, 0, 0]])


def row(inside, size=(0.2, 0.1, 0.1), count=3, gap=0.0):
    """Bricks of 1 kg side by side on a post; the centres of the outer ones are this far inside its edges, m."""
    pitch = size[0] + gap
    places = (np.arange(count) - (count - 1) / 2) * pitch
    post = fixed_box("post", (2 * (places[-1] + inside), 0.5, 0.1), (0, 0, -0.05))
    bricks = [box(f"b{i}", size, (x, 0, size[2] / 2)) for i, x in enumerate(places)]
    return Assembly((post, *bricks), scenes.GRAVITY, 0.5)


@pytest.mark.parametrize("inside", [0.003, 0.01])
def test_an_outer_brick_topples_over_the_edge_as_if_it_were_alone(inside):
    """g times (distance of its centre from the edge) / (its height above it); limit analysis allows 5 times as much."""
    found = acceleration_limits(row(inside), ALONG, turning=False)
    assert found.limits == pytest.approx([G * inside / 0.05] * 2, rel=0.02)
    assert not found.doubtful.any()


def test_tall_boxes_that_touch_hold_as_much_as_with_a_gap():
    found = acceleration_limits(row(0.1, (0.06, 0.1, 0.3), 5), ALONG, turning=False)
    assert found.limits == pytest.approx([G * 0.03 / 0.15] * 2, rel=0.02)


@pytest.mark.parametrize("inside", [0.01, 0.001, 1e-5])
def test_the_margin_of_a_row_is_that_of_its_outer_brick_alone(inside):
    alone = Analysis.of(row(inside, gap=0.002)).stability().margin
    assert Analysis.of(row(inside)).stability().margin == pytest.approx(alone, rel=1e-4)


@pytest.mark.parametrize("inside", [0.0, -1e-7, -1e-5, -1e-3])
def test_a_centre_over_the_edge_or_beyond_is_not_stable(inside):
    found = Analysis.of(row(inside)).stability()
    assert not found.stable
    assert found.falling == ("b0", "b2")


def test_a_wall_whose_top_bricks_overhang_by_half_is_not_stable():
    assert not Analysis.of(scenes.wall(3, 3)).stability().stable
    assert Analysis.of(scenes.wall(4, 3)).stability().stable


def test_a_map_does_not_count_on_neighbours_either():
    found = robustness_map(row(0.003), 100, tolerance=0.05)
    outer = (found.surface.place == 1) & (found.surface.directions[:, 2] < -0.5) & (found.surface.points[:, 0] < -0.25)
    # Pressed down at an arm beyond the edge, the weight at its arm inside holds it.
    arm = -found.surface.points[outer, 0] - 0.203
    assert np.all(found.lower[outer] <= 1.05 * G * 0.003 / arm)


@pytest.mark.parametrize("kind", KINDS)
def test_limits_and_maps_of_random_scenes_are_below_single_pushes(kind):
    tally, rng = Tally(), np.random.default_rng(1)
    compare(random_scene(kind, rng), rng, tally, points=40, asked=4)
    assert max(tally.limits + tally.bounds + tally.doubtful, default=0.0) <= ABOVE
    assert all(tally.held)


def test_a_single_push_finds_the_states_that_small_steps_find():
    """Here friction allows several states: looked for at given loads, the block seemed to fall 9 % earlier."""
    rng = np.random.default_rng([1, 174])
    analysis = Analysis.of(random_scene("row", rng))
    point, direction, place = np.array([-0.0360411, -0.0425265, 0.0380848]), np.array([0.0, 1.0, 0.0]), 2
    single = float(single_pushes(analysis, point[None], direction[None], np.array([place]))[0])
    assert single == pytest.approx(14.95, rel=0.01)
    assert followed(analysis, point, direction, place, 0.99 * single) == pytest.approx(0.99 * single)
    assert followed(analysis, point, direction, place, 1.4 * single) == pytest.approx(single, rel=0.01)


def test_mujoco_moves_above_the_limit_and_holds_below():
    scene = row(0.01)
    assert holds_in_mujoco(scene, 0.9 * G * 0.01 / 0.05 * ALONG[0])
    assert not holds_in_mujoco(scene, 1.15 * G * 0.01 / 0.05 * ALONG[0])


def test_what_is_not_checked_in_time_is_doubtful_and_its_bound_holds():
    analysis = Analysis.of(row(0.003))
    late = acceleration_limits(analysis, ALONG, deadline=0.0, turning=False)
    assert late.doubtful.all()
    assert not late.complete
    assert np.all(late.limits == 0)
    pushes = assess(Analysis.of(row(0.003)), [Push("b0", (-0.3, 0, 0.05), (1, 0, 0))], deadline=0.0)
    assert pushes.doubtful
    assert not pushes.stable
    assert pushes.results[0].doubtful
    assert pushes.results[0].lower == 0
    mapped = robustness_map(Analysis.of(row(0.003)), 50, deadline=0.0)
    assert mapped.doubtful.all()
    assert np.all(mapped.lower == 0)


OUTWARD = Push("b0", (-0.2, 0, 0.1), (-1, 0, 0))
"""Beside the top edge between the first two bricks: the second cannot pull the first back."""


def test_a_sensitivity_that_counts_on_neighbours_is_doubtful_and_the_smaller_value_is_given():
    found = sensitivity(row(0.003), OUTWARD)
    assert found.doubtful
    assert found.robustness == pytest.approx(G * 0.003 / 0.1, rel=0.02)
    assert found.robustness < 0.5 * found.limit
    late = sensitivity(row(0.003), OUTWARD, deadline=0.0)
    assert late.doubtful
    assert late.robustness == 0


@pytest.mark.parametrize("shift", [-0.5, 0.0, 0.5])
def test_the_probability_of_motion_does_not_count_on_neighbours(shift):
    """The mass of the outer brick is known to 10 %; it topples alone, as the normal distribution says."""
    scene = row(0.003)
    brick = replace(scene.objects[1], covariance=np.diag([0.01, *[0.0] * 9]))
    force = (1 + 0.1 * shift) * G * 0.003 / 0.1
    found = motion_probability(scene.with_object(brick), OUTWARD, force, np.random.default_rng(0), 400)
    assert found.probability == pytest.approx((1 + erf(shift / np.sqrt(2))) / 2, abs=0.07)
    assert found.moves == {"b0": found.probability}


def test_samples_that_are_not_checked_in_time_do_not_count_as_standing():
    """Limit analysis holds all of these, elastic contacts none."""
    scene, clock = row(0.003), _Questions(NO_DEADLINE.at, [10])
    brick = replace(scene.objects[1], covariance=np.diag([1e-4, *[0.0] * 9]))
    analysis = Analysis.of(scene.with_object(brick))
    movers, _ = _moves(analysis, OUTWARD, 1.5 * G * 0.003 / 0.1, np.random.default_rng(0), 50, clock)
    assert len(movers) < 50
    assert all(movers)


def test_models_that_elastic_contacts_do_not_check_say_so():
    analysis, push = Analysis.of(row(0.003)), [Push("b0", (-0.3, 0, 0.05), (1, 0, 0))]
    assert assess(analysis, push, "limit").results[0].doubtful
    assert not assess(analysis, push).results[0].doubtful
    assert (
        not assess(Analysis.of(scenes.cube()), [Push("cube", (0.5, 0, 0.5), (-1, 0, 0))], "limit").results[0].doubtful
    )


def test_stability_that_is_not_known_in_time_is_no_error_but_doubtful():
    found = Analysis.of(row(0.003)).require_stable(Deadline.after(0.0))
    assert found.doubtful
    assert not found.stable
    assert found.margin == 0


def test_a_row_that_falls_before_a_load_at_which_it_stands_has_the_smaller_limit():
    scene = random_scene("row", np.random.default_rng([1, 171]))
    analysis, direction = Analysis.of(scene), np.array([[-0.12804472, -0.95888856, -0.25325339]])
    limits = acceleration_limits(analysis, direction, turning=False)
    assert limits.limits[0] <= 1.01 * single_limits(analysis, limits.directions)[0]


def test_a_map_of_few_points_of_each_face_is_near_what_single_pushes_hold():
    scene = random_scene("row", np.random.default_rng([1, 0]))
    analysis, rng = Analysis.of(scene), np.random.default_rng(0)
    found = robustness_map(analysis, 60, 0.05)
    rows = rng.choice(np.flatnonzero(np.isfinite(found.upper)), 8, replace=False)
    surface = found.surface
    single = single_pushes(analysis, surface.points[rows], surface.directions[rows], surface.place[rows])
    assert np.all(found.lower[rows] <= 1.05 * single)
    assert np.median(found.lower[rows] / single) > 0.85
