"""Gradients of the robustness against finite differences, and probabilities against brute force."""

from dataclasses import replace
from math import erf

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G, box, on_floor

from poise.assembly import Assembly, FrictionPair, Push, assess, motion_probability, sensitivity
from poise.errors import ErrorCode, InputError, NoAnswerError

STEP = 1e-5


def limit(assembly, push):
    return assess(assembly, [push], "limit").results[0].robustness


def uneven_table():
    legs = [
        box("left", (0.2, 1, 1), (-0.9, 0, 0.5), mass=1.3),
        box("right", (0.3, 0.8, 1), (0.85, 0.05, 0.5), mass=0.8),
    ]
    slab = box("slab", (2, 1, 0.2), (0, 0, 1.1), mass=2.1, com=np.array([0.13, 0.05, 0.0]))
    return on_floor(*legs, slab, friction=0.37)


PUSHES = [
    Push("slab", (1, 0.3, 1.15), (-1, 0.1, 0.2)),
    Push("left", (-1, 0.2, 0.4), (1, 0.3, -0.1)),
    Push("slab", (0.3, 0.5, 1.1), (0.1, -1, 0.15)),
]


def difference(change):
    return (change(STEP) - change(-STEP)) / (2 * STEP)


@pytest.mark.parametrize("push", PUSHES, ids=lambda push: push.object)
def test_gradients_are_those_of_finite_differences(push):
    assembly = uneven_table()
    found = sensitivity(assembly, push)
    assert found.limit == pytest.approx(limit(assembly, push))
    held = assess(assembly, [push]).results[0]
    assert found.robustness == pytest.approx(held.lower, rel=1e-6)
    assert found.doubtful == (held.lower < 0.98 * found.limit)
    for name, value in found.mass.items():
        item = assembly.objects[assembly.index[name]]
        slope = difference(lambda h, i=item: limit(assembly.with_object(replace(i, mass=i.mass + h)), push))
        assert value == pytest.approx(slope, abs=2e-3)
        centre = item.shape.centroid if item.com is None else item.com
        for axis, unit in enumerate(np.eye(3)):
            slope = difference(
                lambda h, i=item, c=centre, u=unit: limit(assembly.with_object(replace(i, com=c + h * u)), push)
            )
            assert found.com[name][axis] == pytest.approx(slope, abs=5e-3)
    for pair, value in found.friction.items():
        slope = difference(
            lambda h, p=pair: limit(replace(assembly, friction_pairs=(FrictionPair(p, 0.37 + h),)), push)
        )
        assert value == pytest.approx(slope, abs=5e-3)


@pytest.mark.parametrize("push", PUSHES, ids=lambda push: push.object)
def test_masses_times_their_gradients_add_up_to_the_limit_load(push):
    assembly = uneven_table()
    found = sensitivity(assembly, push)
    total = sum(found.mass[item.id] * item.mass for item in assembly.objects if item.id in found.mass)
    assert total == pytest.approx(found.limit, rel=1e-6)


def test_moving_the_push_changes_the_robustness_as_the_gradient_says():
    assembly, push = uneven_table(), PUSHES[0]
    found = sensitivity(assembly, push)
    for axis in (1, 2):  # within the face
        move = np.eye(3)[axis]
        slope = difference(
            lambda h, m=move: limit(assembly, Push("slab", np.array(push.point) + h * m, push.direction))
        )
        assert found.point[axis] == pytest.approx(slope, abs=5e-3)


def test_a_weight_put_down_improves_the_robustness_as_predicted():
    """Thesis eq. 4.30 and 4.43, exactly: a small mass at a point changes R by its weight times the improvement."""
    assembly = uneven_table()
    for push in PUSHES:
        found = sensitivity(assembly, push)
        for x in (-0.7, 0.0, 0.6):
            extra = Push("slab", (x, 0.1, 1.2), (0, 0, -1))
            weight = 1e-3
            with_weight = assembly.with_object(box("w", (0.01, 0.01, 0.01), (x, 0.1, 1.205), mass=weight / G))
            change = (limit(with_weight, push) - found.limit) / weight
            assert found.improvement(extra) == pytest.approx(change, abs=5e-3)


def test_what_is_never_moved_has_no_gradient():
    found = sensitivity(scenes.cube(), Push("cube", (0.1, 0, 1), (0, 0, -1)))
    assert found.robustness == np.inf
    assert found.mass == {}
    assert found.improvement(Push("cube", (0, 0, 1), (0, 0, -1))) == 0


def twisted():
    """A push beside the middle of a cube, which turns it where it stands."""
    return Push("cube", (-0.5, 0.45, 0.01), (1, 0, 0))


def test_a_push_that_turns_a_cube_is_doubtful_where_limit_analysis_presses_the_corners():
    found = sensitivity(scenes.cube(), twisted())
    held = assess(scenes.cube(), [twisted()]).results[0].robustness
    assert found.robustness == pytest.approx(held)
    assert held < 0.9 * found.limit
    assert found.doubtful
    assert not sensitivity(scenes.cube(), Push("cube", (-0.5, 0, 0.1), (1, 0, 0))).doubtful


def test_a_push_that_turns_a_cube_moves_it_where_uniform_pressure_does_not_hold_it():
    held, push = sensitivity(scenes.cube(), twisted()).robustness, twisted()
    for factor, moved in ((0.99, 0.0), (1.01, 1.0)):
        found = motion_probability(scenes.cube(), push, factor * held, np.random.default_rng(0), 5)
        assert found.probability == moved


def normal_cdf(value):
    return (1 + erf(value / np.sqrt(2))) / 2


def covariance(mass, com):
    return np.diag([mass**2, *[com**2] * 3, *[0.0] * 6])


def test_an_uncertain_mass_moves_a_cube_as_often_as_the_normal_distribution_says():
    cube = scenes.cube()
    known = replace(cube.objects[1], covariance=covariance(0.1, 0.0))
    force = 0.97 * 0.5 * G
    found = motion_probability(
        cube.with_object(known), Push("cube", (-0.5, 0, 0.1), (1, 0, 0)), force, np.random.default_rng(0), 5000
    )
    assert found.probability == pytest.approx(normal_cdf(-0.3), abs=4 * found.deviation)
    assert found.solves * 60 < found.samples
    assert found.moves == {"cube": found.probability}


def test_uncertain_friction_moves_a_cube_as_often_as_the_normal_distribution_says():
    pair = (FrictionPair(("floor", "cube"), 0.5, 0.05),)
    found = motion_probability(
        replace(scenes.cube(), friction_pairs=pair),
        Push("cube", (-0.5, 0, 0.1), (1, 0, 0)),
        0.48 * G,
        np.random.default_rng(1),
        400,
    )
    assert found.probability == pytest.approx(normal_cdf(-0.4), abs=4 * found.deviation)


def test_uncertain_places_make_an_overhang_fall_sometimes():
    """The upper cube's middle is 2 mm inside the edge, known to 2 mm: a small push down at its end tips it."""
    lower, upper = box("a", (0.1, 0.1, 0.1), (0, 0, 0.05)), box("b", (0.1, 0.1, 0.1), (0.048, 0, 0.15))
    found = motion_probability(
        on_floor(lower, upper),
        Push("b", (0.098, 0, 0.15), (0, 0, -1)),
        1e-3,
        np.random.default_rng(2),
        200,
        pose_deviation=0.002,
    )
    # Both places are uncertain: the difference has a deviation of 2 sqrt 2 mm.
    assert found.probability == pytest.approx(normal_cdf(-1 / np.sqrt(2)), abs=4 * found.deviation + 0.02)


def test_shared_mechanisms_find_what_solving_every_sample_finds():
    assembly = scenes.table()
    objects = tuple(i if i.fixed else replace(i, covariance=covariance(0.08, 0.02)) for i in assembly.objects)
    assembly = Assembly(objects, assembly.gravity, assembly.friction)
    push, force, count = Push("slab", (-1, 0.1, 1.1), (1, 0, 0)), 3.8, 150
    found = motion_probability(assembly, push, force, np.random.default_rng(7), count)
    rng = np.random.default_rng(7)
    drawn = {}
    for item in assembly.objects[1:]:
        mean = np.array([item.mass, 0, 0, 0])
        drawn[item.id] = rng.multivariate_normal(mean, item.covariance[:4, :4], size=count)
    moved = 0
    for row in range(count):
        sample = [assembly.objects[0]]
        for item in assembly.objects[1:]:
            mass, *moment = drawn[item.id][row]
            sample.append(replace(item, mass=mass, com=np.array(moment) / mass))
        moved += limit(Assembly(tuple(sample), assembly.gravity, assembly.friction), push) < force
    assert round(found.probability * count) == moved


def test_without_time_for_a_single_sample_there_is_no_probability():
    with pytest.raises(NoAnswerError) as error:
        motion_probability(
            scenes.cube(), Push("cube", (-0.5, 0, 0.1), (1, 0, 0)), 1.0, np.random.default_rng(0), deadline=0.0
        )
    assert error.value.code is ErrorCode.DEADLINE


def test_negative_numbers_are_refused():
    push = Push("cube", (-0.5, 0, 0.1), (1, 0, 0))
    for bad in ({"force": -1.0}, {"force": np.nan}, {"friction_deviation": -0.1}, {"pose_deviation": np.inf}):
        with pytest.raises(InputError):
            motion_probability(scenes.cube(), push, **{"force": 1.0, "rng": np.random.default_rng(0)} | bad)
