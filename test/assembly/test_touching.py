"""Objects that touch side by side: no force between neighbours counts that Coulomb contact does not produce."""

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G, box, fixed_box

from benchmarks.touching import ABOVE, KINDS, Tally, compare, holds_in_mujoco, random_scene
from poise.assembly import Analysis, Assembly, Push, acceleration_limits, assess, robustness_map
from poise.assembly.statics import Deadline

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


def test_models_that_elastic_contacts_do_not_check_say_so():
    analysis, push = Analysis.of(row(0.003)), [Push("b0", (-0.3, 0, 0.05), (1, 0, 0))]
    assert assess(analysis, push, "limit").results[0].doubtful
    assert not assess(analysis, push).results[0].doubtful
    assert (
        not assess(Analysis.of(scenes.cube()), [Push("cube", (0.5, 0, 0.5), (-1, 0, 0))], "limit").results[0].doubtful
    )


def test_stability_that_is_not_known_in_time_is_no_error_but_doubtful():
    found = Analysis.of(row(0.003)).require_stable(Deadline.after(-1.0))
    assert found.doubtful
    assert not found.stable
    assert found.margin == 0
