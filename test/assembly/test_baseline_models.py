"""The models to compare with: each against closed forms, with the error that its own paper's assumptions make."""

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G

from poise.assembly import Analysis, Assembly, FrictionPair, Push, assess
from poise.baselines.models.approx import qr_forces
from poise.baselines.models.thesis import ThesisAnalysis
from poise.baselines.robustness.sampled import sampled_contacts
from poise.baselines.robustness.slipping import point_improvement, point_robustness
from poise.baselines.robustness.toppling import cuts, is_form_closed
from poise.errors import ErrorCode, InputError

SAMPLED = ("thesis", "approx", "lp4", "lp8")


def asked(assembly, name, point, direction, model):
    return assess(assembly, [Push(name, point, direction)], model).results[0]


def contact_condition(s, force, push, friction):
    """Thesis eq. 4.19."""
    return friction * (force[0] + s * push[0]) - np.linalg.norm(force[1:] + s * push[1:])


def test_the_force_that_a_point_bears_is_the_first_root_of_its_contact_condition():
    rng = np.random.default_rng(1)
    normals = rng.uniform(0.5, 2, 300)
    friction = rng.uniform(0.2, 1.2, 300)
    turn, share = rng.uniform(0, 2 * np.pi, 300), rng.uniform(0, 0.95, 300)
    tangents = (share * friction * normals)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    forces = np.column_stack([normals, tangents])
    pushes = rng.normal(size=(300, 3))
    pushes /= np.linalg.norm(pushes, axis=1)[:, None]
    found = point_robustness(forces, pushes, friction)
    for force, push, mu, s in zip(forces, pushes, friction, found, strict=True):
        upto = np.linspace(0, min(s, 50.0) * (1 - 1e-9), 40)
        assert min(contact_condition(at, force, push, mu) for at in upto) >= -1e-9
        if np.isfinite(s):
            assert contact_condition(s, force, push, mu) == pytest.approx(0, abs=1e-7 * (1 + s))
            assert contact_condition(s * 1.001 + 1e-6, force, push, mu) < 0
        else:
            assert contact_condition(1e6, force, push, mu) > 0


def test_a_push_along_the_edge_of_the_cone_has_a_linear_condition():
    """Thesis eq. 4.24 with the sign of e_n that its norms lose: away from the surface a point slips, into it never."""
    mu, force = 0.5, np.array([[2.0, 0.3, 0.0]])
    normal = 1 / np.sqrt(1 + mu**2)
    along = mu * normal
    away = np.array([[-normal, along, 0.0]])
    root = point_robustness(force, away, np.array([mu]))[0]
    assert contact_condition(root, force[0], away[0], mu) == pytest.approx(0, abs=1e-12)
    assert point_robustness(force, np.array([[normal, -along, 0.0]]), np.array([mu]))[0] == np.inf


def test_the_improvement_of_a_contact_condition_is_its_derivative():
    force, mu = np.array([[2.0, 0.4, -0.2]]), 0.6
    push = np.array([[0.3, 0.5, 0.8]]) / np.linalg.norm([0.3, 0.5, 0.8])
    step = 1e-6
    for s in (0.0, 0.7):
        rise = contact_condition(s + step, force[0], push[0], mu) - contact_condition(s - step, force[0], push[0], mu)
        assert point_improvement(force, push, np.array([mu]), s)[0] == pytest.approx(rise / (2 * step), rel=1e-6)


@pytest.mark.parametrize("model", SAMPLED)
def test_a_low_push_through_the_middle_slides_a_cube_at_mu_w(model):
    """Along a corner of their polygons the linear programs are exact; LPs lose a little where points turn the patch."""
    found = asked(scenes.cube(0.4), "cube", (-0.5, 0, 0.0), (1, 0, 0), model)
    loss = {"lp4": 1 - np.cos(np.pi / 4), "lp8": 0.08}.get(model, 0.0)
    assert (1 - loss) * 0.4 * G * (1 - 1e-6) <= found.robustness <= 0.4 * G * (1 + 1e-6)
    assert found.moves == ("cube",)


@pytest.mark.parametrize(("model", "sides"), [("lp4", 4), ("lp8", 8)])
def test_linear_programs_lose_what_their_polygon_leaves_of_the_circle(model, sides):
    """Against the middle of a side of the inscribed polygon friction is cos(pi / N) of what it is."""
    found = asked(scenes.cube(0.4), "cube", (0, 0, 0), (np.cos(np.pi / sides), np.sin(np.pi / sides), 0), model)
    exact = asked(scenes.cube(0.4), "cube", (0, 0, 0), (1, 0, 0), "limit").robustness
    across = asked(scenes.cube(0.4), "cube", (0, 0, 0), (1, 0, 0), model).robustness
    assert sorted([found.robustness, across]) == pytest.approx([exact * np.cos(np.pi / sides), exact], rel=1e-6)


@pytest.mark.parametrize("model", SAMPLED)
def test_sampled_points_topple_up_to_a_tenth_too_early(model):
    """Twenty sampled points lie inside the patch: 4 to 7 % on average over edges, never too strong."""
    errors = []
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        found = asked(scenes.cube(0.95), "cube", (-0.5 * x, -0.5 * y, 1), (x, y, 0), model)
        errors.append(1 - found.robustness / (G / 2))
    assert all(0 < error < 0.16 for error in errors)
    assert 0.02 < np.mean(errors) < 0.09


@pytest.mark.parametrize("model", SAMPLED)
def test_points_near_an_edge_that_no_push_moves_are_called_movable(model):
    """The share of the top that lies outside of the hull of the sampled points."""
    grid = [(x, y) for x in np.linspace(-0.49, 0.49, 9) for y in (-0.48, -0.2, 0.1, 0.48)]
    pushes = [Push("cube", (x, y, 1), (0, 0, -1)) for x, y in grid]
    exact = [result.robustness for result in assess(scenes.cube(), pushes, "limit").results]
    assert np.all(np.isinf(exact))
    movable = np.isfinite([result.robustness for result in assess(scenes.cube(), pushes, model).results])
    assert 0.05 < movable.mean() < 0.8
    assert not movable[np.abs(grid).max(axis=1) < 0.25].any()


def test_the_yaw_of_a_square_is_resisted_by_mu_w_times_the_mean_distance():
    """The erratum of eq. 4.35: with its own term the moments of an interface would cancel. r = 0.3826 sides."""
    found = asked(scenes.cube(0.5), "cube", (0, -0.5, 0.0), (1, 0, 0), "thesis")
    assert found.robustness == pytest.approx(0.5 * G * 0.3826 / 0.5, rel=0.1)
    assert found.mode == "slip"


def test_in_a_stack_the_weakest_interface_slips_by_the_maximum_flow():
    masses, frictions = [1.0, 2.0, 0.5], (0.2, 0.9, 0.4)
    touching = (("floor", "c0"), ("c0", "c1"), ("c1", "c2"))
    pairs = [FrictionPair(names, mu) for names, mu in zip(touching, frictions, strict=True)]
    stack = scenes.stack(3, masses=masses)
    assembly = Assembly(stack.objects, stack.gravity, 0.5, tuple(pairs))
    for place in range(3):
        weights = [mu * sum(masses[i:]) * G for i, mu in enumerate(frictions) if i <= place]
        found = asked(assembly, f"c{place}", (-0.5, 0, 0.01 + place), (1, 0, 0), "thesis")
        assert found.robustness == pytest.approx(min(weights), rel=1e-6)
        assert found.moves == tuple(f"c{i}" for i in range(int(np.argmin(weights)), 3))


def test_interfaces_in_parallel_add_up():
    """Assertion 1 of the thesis: pushed along y, the slab slides on both legs together.

    One per cent early: the least squares of eq. 4.12 let the legs lean on each other, and sliding takes what is left.
    """
    found = asked(scenes.table(0.3), "slab", (0, -0.5, 1.001), (0, 1, 0), "thesis")
    assert 0.98 * 0.3 * G < found.robustness <= 0.3 * G * (1 + 1e-6)
    assert found.moves == ("slab",)


def test_each_object_alone_knows_nothing_of_what_rests_on_it():
    """`approx` on the bottom of a stack: it slides at mu (m g) with m its own mass, not that of the stack."""
    found = asked(scenes.stack(3, 0.3), "c0", (-0.5, 0, 0.01), (1, 0, 0), "approx")
    assert found.robustness < 0.7 * 0.3 * 3 * G
    assert asked(scenes.stack(3, 0.3), "c0", (-0.5, 0, 0.01), (1, 0, 0), "thesis").robustness == pytest.approx(
        0.3 * 3 * G, rel=1e-6
    )


def test_forces_from_a_qr_balance_the_load_with_the_least_squares():
    rng = np.random.default_rng(3)
    points, load = rng.normal(size=(7, 3)), rng.normal(size=6)
    frames = np.array([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in points])
    found = qr_forces(points, frames, load)
    wrenches = np.concatenate([frames, np.cross(points[:, None], frames)], axis=2).reshape(-1, 6)
    assert wrenches.T @ found.ravel() == pytest.approx(load)
    assert found.ravel() == pytest.approx(np.linalg.pinv(wrenches.T) @ load)


def test_cuts_of_a_stack_are_its_tops_and_a_cube_between_walls_counts_as_closed():
    stack = Analysis.of(scenes.stack(3)).structure
    assert sorted(sorted(cut) for cut in cuts(stack)) == [[1, 2, 3], [2, 3], [3]]
    walls = sampled_contacts(Analysis.of(scenes.between_walls(with_floor=True)).structure)
    side = np.where(walls.bodies[:, 1] >= 0, 1.0, -1.0)
    assert is_form_closed(walls.points, side[:, None, None] * walls.frames)
    alone = sampled_contacts(Analysis.of(scenes.cube()).structure)
    assert not is_form_closed(alone.points, alone.frames)


def test_leaning_on_a_cube_improves_it_and_lifting_it_does_not():
    """The signs of eq. 4.30 and 4.43; a push down on the middle presses every contact and no axis topples by it."""
    model = ThesisAnalysis(Analysis.of(scenes.stack(2)).structure)
    down, up = np.array([0, 0, -1.0]), np.array([0, 0, 1.0])
    # 20 points on each of the two interfaces, mu for each.
    assert model.slipping.improvement(2, down) == pytest.approx(2 * 20 * 0.5, rel=1e-6)
    assert model.slipping.improvement(1, down) == pytest.approx(20 * 0.5, rel=1e-6)
    assert model.slipping.improvement(2, up) < 0
    assert model.toppling_improvement(2, np.append(down, np.zeros(3))) > 0
    assert model.toppling_improvement(2, np.append(up, np.zeros(3))) < 0


@pytest.mark.parametrize("model", ["thesis", "approx"])
def test_models_of_one_force_refuse_several_at_once(model):
    both = [Push("cube", (-0.5, 0, 0.5), (1, 0, 0)), Push("cube", (0, -0.5, 0.5), (0, 1, 0))]
    with pytest.raises(InputError) as error:
        assess(scenes.cube(), [both], model)
    assert error.value.code == ErrorCode.BAD_INPUT


@pytest.mark.parametrize("model", SAMPLED)
def test_a_deadline_that_has_passed_leaves_answers_open_and_says_so(model):
    found = assess(scenes.stack(2), [Push("c1", (-0.5, 0, 1.5), (1, 0, 0))], model, deadline=0.0)
    assert not found.complete
    assert found.results[0].lower == 0


def test_without_pybullet_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pybullet", None)
    with pytest.raises(InputError, match=r"pip install 'poise\[baselines\]'") as error:
        asked(scenes.cube(), "cube", (-0.5, 0, 0.1), (1, 0, 0), "pybullet")
    assert error.value.code == ErrorCode.UNSUPPORTED


def test_the_search_in_a_physics_engine_is_late_by_its_threshold():
    """One step of 1/240 s from rest must reach sqrt(2 m E): so much more force than friction holds."""
    pytest.importorskip("pybullet")
    found = asked(scenes.cube(0.4), "cube", (-0.5, 0, 0.1), (1, 0, 0), "pybullet")
    assert found.robustness == pytest.approx(0.4 * G + np.sqrt(2 * 1e-4) * 240, rel=0.05)
    assert found.moves == ("cube",)
    assert asked(scenes.cube(), "cube", (0, 0, 1), (0, 0, -1), "pybullet").robustness == np.inf


def test_friction_that_an_engine_cannot_have_is_refused():
    pytest.importorskip("pybullet")
    boxes = [scenes.box(f"b{i}", (1, 1, 1), (i, 0, 0.5)) for i in range(2)]
    pairs = [FrictionPair(("floor", "b0"), 0.5), FrictionPair(("floor", "b1"), 0.5), FrictionPair(("b0", "b1"), 0.1)]
    base = scenes.on_floor(*boxes, pairs=pairs)
    found = assess(base, [Push("b0", (-0.5, 0, 0.1), (1, 0, 0))], "pybullet")
    assert found.results[0].robustness > 0
    third = scenes.box("b2", (1, 1, 1), (0.5, 1, 0.5))
    more = [*pairs, FrictionPair(("b0", "b2"), 0.9), FrictionPair(("b1", "b2"), 0.2)]
    with pytest.raises(InputError, match="does not fit") as error:
        asked(scenes.on_floor(*boxes, third, pairs=more), "b0", (-0.5, 0, 0.1), (1, 0, 0), "pybullet")
    assert error.value.code == ErrorCode.UNSUPPORTED
