"""Answers to pushes: bad questions, several forces, deadlines, mechanisms."""

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G, box

from poise.assembly import Analysis, Push, assess, motion_probability, robustness_map, sensitivity
from poise.assembly.robustness.registry import ROBUSTNESS_MODELS
from poise.assembly.scene import ROLLING
from poise.errors import ErrorCode, InputError

GOOD = ("cube", (-0.5, 0, 0.2), (1, 0, 0))

BAD = {
    "unknown id": (("ghost", *GOOD[1:]), ErrorCode.OBJECT_UNKNOWN, "ghost"),
    "off the surface": (("cube", (-0.6, 0, 0.2), GOOD[2]), ErrorCode.POINT_OFF_SURFACE, "100.0 mm off"),
    "inside": (("cube", (0, 0, 0.5), GOOD[2]), ErrorCode.POINT_OFF_SURFACE, "500.0 mm off"),
    "no direction": (("cube", GOOD[1], (0, 0, 0)), ErrorCode.BAD_INPUT, "length of direction"),
    "point not finite": (("cube", (np.nan, 0, 0), GOOD[2]), ErrorCode.NOT_FINITE, "point"),
    "direction not finite": (("cube", GOOD[1], (np.inf, 0, 0)), ErrorCode.NOT_FINITE, "direction"),
    "two numbers": (("cube", (0, 0), GOOD[2]), ErrorCode.BAD_INPUT, "3 numbers"),
    "words": (("cube", "abc", GOOD[2]), ErrorCode.BAD_INPUT, "3 numbers"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_push_is_a_numbered_error(case):
    entry, code, words = BAD[case]
    with pytest.raises(InputError) as caught:
        assess(scenes.cube(), [Push(*GOOD), Push(*entry)])
    assert caught.value.code is code
    assert words in caught.value.message


def test_an_unknown_model_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="coulomb, default, limit, lp4, lp8, patch"):
        assess(scenes.cube(), [], "magic")


@pytest.mark.parametrize("model", [model for model in ROBUSTNESS_MODELS.names() if model != "pybullet"])
def test_every_model_knows_that_a_fixed_body_never_moves(model):
    found = assess(scenes.cube(), [Push("floor", (3, 3, 0), (1, 0, 0))], model).results[0]
    assert found.robustness == np.inf
    assert found.mode == "none"


def test_pushes_that_grow_together_add_up():
    """Two equal pushes on one face slide a cube at half of mu W each; opposite ones never move it."""
    pair = [Push("cube", (-0.5, y, 0.1), (1, 0, 0)) for y in (-0.2, 0.2)]
    squeeze = [Push("cube", (side * 0.5, 0, 0.1), (-side, 0, 0)) for side in (-1, 1)]
    ratio = [Push("cube", (-0.5, 0, 0.1), (2, 0, 0)), Push("cube", (-0.5, 0, 0.1), (1, 0, 0))]
    found = assess(scenes.cube(), [pair, squeeze, ratio], "limit").results
    assert found[0].robustness == pytest.approx(0.25 * G)
    assert found[1].robustness == np.inf
    assert found[2].robustness == pytest.approx(0.5 * G / 1.5)


def test_a_push_steadied_by_a_hand_on_top_takes_more():
    """A hand that presses down half as hard as the push: (1 - mu / 2) F = mu W."""
    both = [Push("cube", (-0.5, 0, 0.1), (2, 0, 0)), Push("cube", (0, 0, 1), (0, 0, -1))]
    found = assess(scenes.cube(), [both]).results[0]
    assert found.robustness == pytest.approx(0.5 * G / 0.75, rel=1e-6)


def test_bounds_hold_the_answer_and_lie_close():
    rng = np.random.default_rng(0)
    pushes = [Push("slab", (-1, y, 1.1), (1, *rng.normal(0, 0.3, 2))) for y in rng.uniform(-0.5, 0.5, 20)]
    for found in assess(scenes.table(), pushes, "limit").results:
        assert found.lower <= found.robustness <= found.upper
        assert found.lower == pytest.approx(found.upper, rel=1e-6)


def test_the_pushed_point_of_a_mechanism_moves_at_one_metre_per_second():
    point = np.array([1.0, 0.3, 1.15])
    push = Push("slab", point, (-1, 0.2, 0))
    found = assess(scenes.table(), [push], "limit").results[0]
    linear, angular = np.split(found.mechanism[found.moves.index("slab")], 2)
    velocity = linear + np.cross(angular, point - [0, 0, 1.1])
    direction = np.array([-1, 0.2, 0]) / np.linalg.norm([-1, 0.2, 0])
    assert velocity @ direction == pytest.approx(1)


def test_no_time_gives_bounds_that_hold_and_says_so():
    push = [Push("slab", (1, 0, 1.1), (-1, 0, 0))]
    found = assess(scenes.table(), push, deadline=0.0)
    assert not found.complete
    truth = assess(scenes.table(), push, "limit").results[0].robustness
    assert found.results[0].lower <= truth <= found.results[0].upper


def test_two_hundred_objects_and_a_short_deadline_give_partial_answers_not_errors():
    wall = Analysis.of(scenes.wall(20, 10))
    assert len(wall.assembly.objects) == 191
    pushes = [Push(f"b19_{i}", ((i - 4) * 0.2, 0, 2.0), (0, 0, -1)) for i in range(9)]
    found = assess(wall, pushes, deadline=1.0)
    assert len(found.results) == 9
    for result in found.results:
        assert 0 <= result.lower <= result.upper
    assert isinstance(found.complete, bool)


def test_a_cylinder_on_its_side_rolls_away_at_next_to_no_force_but_resists_along_its_axis():
    can = scenes.cylinder("can", 0.1, 0.5, (0, 0, 0.1), quaternion=scenes.turned((0, 1, 0), 90))
    assembly = scenes.on_floor(can)
    found = assess(assembly, [Push("can", (0, -0.1, 0.1), (0, 1, 0)), Push("can", (-0.25, 0, 0.1), (1, 0, 0))])
    assert found.results[0].robustness == pytest.approx(ROLLING * G, rel=1e-6)
    assert found.results[0].mode == "roll"
    assert found.results[1].robustness == pytest.approx(0.5 * G, rel=1e-6)


def test_friction_of_zero_slides_at_nothing_and_still_topples_by_lifting():
    found = assess(scenes.cube(0.0), [Push("cube", (-0.5, 0, 0.1), (1, 0, 0)), Push("cube", (0, 0, 1), (0, 0, 1))])
    assert found.results[0].robustness == pytest.approx(0, abs=1e-6)
    assert found.results[1].robustness == pytest.approx(G, rel=1e-6)


def test_all_questions_refuse_what_floats():
    floating = scenes.on_floor(box("up", (1, 1, 1), (0, 0, 3)))
    push = Push("up", (0, 0, 3.5), (0, 0, 1))
    rng = np.random.default_rng(0)
    for ask in (
        lambda: assess(floating, [push]),
        lambda: robustness_map(floating, 10),
        lambda: sensitivity(floating, push),
        lambda: motion_probability(floating, push, 1.0, rng),
    ):
        with pytest.raises(InputError) as caught:
            ask()
        assert caught.value.code is ErrorCode.FLOATING


def test_many_pushes_on_single_bodies_hold_the_weaker_of_limit_analysis_and_patches():
    """`default` asks limit analysis only where it may hold less, many loads at once; both models answer one by one."""
    places = np.random.default_rng(5).uniform((-0.2, 0.8), (0.2, 0.99), (60, 2)).tolist()
    pushes, analysis = [Push("cube", (-0.5, y, z), (1, 0, 0)) for y, z in places], Analysis.of(scenes.cube())
    found, limit, patch = (assess(analysis, pushes, model).results for model in ("default", "limit", "patch"))
    weaker = [min(one.robustness, other.robustness) for one, other in zip(limit, patch, strict=True)]
    assert [each.robustness for each in found] == pytest.approx(weaker, rel=1e-6)
    assert [each.lower for each in found] == pytest.approx(weaker, rel=1e-6)
    by_limit = [one.robustness < 0.999 * other.robustness for one, other in zip(limit, patch, strict=True)]
    assert 0 < sum(by_limit) < len(pushes), "both models decide"
    assert all(each.moves for each in found if np.isfinite(each.robustness))
