"""Closed forms of statics: limit analysis equals them to 1e-6, the default where friction does not turn patches too."""

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G

from poise.assembly import Assembly, FrictionPair, Push, assess

EXACT = 1e-6
MODELS = ("limit", "default")


def robustness(assembly, name, point, direction, model):
    return assess(assembly, [Push(name, point, direction)], model).results[0]


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("friction", [0.2, 0.5, 0.9])
def test_a_low_push_slides_a_cube_at_mu_w(model, friction):
    found = robustness(scenes.cube(friction), "cube", (-0.5, 0, 0.1), (1, 0, 0), model)
    assert found.robustness == pytest.approx(friction * G, rel=EXACT)
    assert found.mode == "slip"
    assert found.moves == ("cube",)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("height", [0.6, 0.8, 1.0])
def test_a_high_push_topples_a_cube_at_w_half_width_over_height(model, height):
    found = robustness(scenes.cube(0.95), "cube", (-0.5, 0.0, height), (1, 0, 0), model)
    assert found.robustness == pytest.approx(G * 0.5 / height, rel=EXACT)
    assert found.mode == "topple"


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("degrees", [0, 10, 25, 50])
def test_a_push_below_the_horizontal_presses_as_it_slides(model, degrees):
    angle, mu = np.radians(degrees), 0.5
    # Aimed at the middle of the base, so that the cube does not topple.
    point = (-0.5, 0.0, min(0.5 * np.tan(angle), 1.0)) if degrees < 60 else (0, 0, 1)
    found = robustness(scenes.cube(mu), "cube", point, (np.cos(angle), 0, -np.sin(angle)), model)
    assert found.robustness == pytest.approx(mu * G / (np.cos(angle) - mu * np.sin(angle)), rel=EXACT)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("sideways", [0.0, 0.2, 0.4])
def test_a_steep_push_that_hits_the_base_is_sustained_for_ever(model, sideways):
    angle = np.arctan(1 / 0.5) + 0.01
    point = np.array([-0.3, sideways, 1.0])
    found = robustness(scenes.cube(0.5), "cube", point, (np.cos(angle), 0, -np.sin(angle)), model)
    assert found.robustness == np.inf
    assert found.moves == ()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("offset", [0.0, 0.1, 0.4])
def test_lifting_off_centre_topples_about_the_far_edge(model, offset):
    found = robustness(scenes.cube(), "cube", (offset, 0, 1), (0, 0, 1), model)
    assert found.robustness == pytest.approx(G / (1 + 2 * offset), rel=EXACT)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("reach", [0.6, 1.0, 1.5])
def test_a_plank_over_an_edge_tips_at_w_a_over_x_minus_a(model, reach):
    half = 0.5  # the support ends here
    support = scenes.fixed_box("block", (2 * half, 1, 1), (0, 0, 0.5))
    plank = scenes.box("plank", (4, 1, 0.1), (0, 0, 1.05))
    assembly = Assembly((support, plank), scenes.GRAVITY, 0.5)
    found = robustness(assembly, "plank", (reach, 0.2, 1.1), (0, 0, -1), model)
    assert found.robustness == pytest.approx(G * half / (reach - half), rel=EXACT)
    assert robustness(assembly, "plank", (half - 0.01, 0.2, 1.1), (0, 0, -1), model).robustness == np.inf


@pytest.mark.parametrize("model", MODELS)
def test_a_stack_gives_way_at_its_weakest_interface(model):
    masses = [1.0, 2.0, 0.5]
    pairs = [FrictionPair(("floor", "c0"), 0.2), FrictionPair(("c0", "c1"), 0.9), FrictionPair(("c1", "c2"), 0.4)]
    stack = scenes.stack(3, masses=masses)
    assembly = Assembly(stack.objects, stack.gravity, 0.5, tuple(pairs))
    for place, height in ((2, 2.05), (1, 1.05), (0, 0.05)):
        slips = [mu * sum(masses[i:]) * G for i, mu in enumerate((0.2, 0.9, 0.4)) if i <= place]
        topples = [sum(masses[i:]) * G * 0.5 / (height - i) for i in range(place + 1)]
        weakest = int(np.argmin([min(slip, topple) for slip, topple in zip(slips, topples, strict=True)]))
        found = robustness(assembly, f"c{place}", (-0.5, 0, height), (1, 0, 0), model)
        assert found.robustness == pytest.approx(min(*slips, *topples), rel=EXACT)
        assert found.moves == tuple(f"c{i}" for i in range(weakest, 3))


@pytest.mark.parametrize("model", MODELS)
def test_a_tripod_topples_over_an_edge_or_over_a_foot(model):
    radius, height = 0.5, 0.4
    assembly = scenes.tripod(radius, friction=5.0)
    half = 1.5 * radius
    over_foot = robustness(assembly, "tripod", (-half, 0, height), (1, 0, 0), model)
    over_edge = robustness(assembly, "tripod", (half, 0, height), (-1, 0, 0), model)
    assert over_foot.robustness == pytest.approx(G * radius / height, rel=EXACT)
    assert over_edge.robustness == pytest.approx(G * radius / 2 / height, rel=EXACT)


def v_groove(slope, friction):
    """A cylinder in a groove along y whose sides rise at `slope` degrees."""
    angle, radius = np.radians(slope), 0.2
    sides = []
    for sign in (1, -1):
        normal = np.array([sign * np.sin(angle), 0, np.cos(angle)])
        sides.append(scenes.fixed_box(f"side{sign}", (4, 4, 0.2), -0.1 * normal, scenes.turned((0, sign, 0), slope)))
    body = scenes.cylinder("bar", radius, 1.0, (0, 0, radius / np.cos(angle)), quaternion=scenes.turned((1, 0, 0), 90))
    return Assembly((*sides, body), scenes.GRAVITY, friction)


@pytest.mark.parametrize("slope", [20, 35, 45])
def test_a_bar_in_a_v_groove_slides_along_it_at_mu_w_over_cosine(slope):
    """Pressed by its weight alone; limit analysis may wedge it by friction across the groove, up to its own optimum."""
    mu, angle = 0.4, np.radians(slope)
    assembly = v_groove(slope, mu)
    end = (0, -0.5, 0.2 / np.cos(angle))
    plain = mu * G / np.cos(angle)
    wedged = plain / np.sqrt(1 - (mu * np.tan(angle)) ** 2)
    assert robustness(assembly, "bar", end, (0, 1, 0), "limit").robustness == pytest.approx(wedged, rel=EXACT)
    assert robustness(assembly, "bar", end, (0, 1, 0), "coulomb").robustness == pytest.approx(plain, rel=0.005)


@pytest.mark.parametrize("model", MODELS)
def test_a_leaning_ladder_holds_a_climber_up_to_kappa(model):
    floor, wall = 0.4, 0.3
    assembly, at = scenes.ladder(60, floor, wall)
    kappa = floor * (np.tan(np.radians(60)) + wall) / (1 + floor * wall)
    for share in (0.3, 0.6, kappa - 1e-3):
        assert robustness(assembly, "ladder", at(share), (0, 0, -1), model).robustness == np.inf
    for share in (kappa + 0.01, 0.8, 0.95):
        found = robustness(assembly, "ladder", at(share), (0, 0, -1), model)
        assert found.robustness == pytest.approx(G * (kappa - 0.5) / (share - kappa), rel=EXACT)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("height", [0.0, 0.2])
def test_a_sled_on_unequal_feet_slides_as_its_weight_shifts(model, height):
    """Two ridges 1 m apart with different friction; a pull at a height loads the front one more."""
    rear, front, apart = 0.2, 0.6, 1.0
    ridges = [
        scenes.fixed_box(name, (0.2, 2, 0.2), (x, 0, -0.1 * np.sqrt(2)), scenes.turned((0, 1, 0), 45))
        for name, x in (("rear", -apart / 2), ("front", apart / 2))
    ]
    sled = scenes.box("sled", (1.6, 0.6, 0.4), (0, 0, 0.2), com=np.array([0.1, 0, 0]))
    pairs = (FrictionPair(("sled", "rear"), rear), FrictionPair(("sled", "front"), front))
    assembly = Assembly((*ridges, sled), scenes.GRAVITY, 0.5, pairs)
    # Balance of moments about the rear ridge: N_front = (W (apart / 2 + 0.1) + F h) / apart.
    on_front = G * (apart / 2 + 0.1) / apart
    expected = (rear * (G - on_front) + front * on_front) / (1 - (front - rear) * height / apart)
    found = robustness(assembly, "sled", (-0.8, 0, height), (1, 0, 0), model)
    assert found.robustness == pytest.approx(expected, rel=EXACT)


@pytest.mark.parametrize(("share", "stands"), [(0.98, True), (1.02, False)])
def test_the_harmonic_overhang_of_four_bricks_is_the_last_that_stands(share, stands):
    bricks, x = [], 0.0
    for level in range(4):  # from the bottom: the k-th from the top hangs over by 1 / (2 k)
        x += share / (2 * (4 - level))
        bricks.append(scenes.box(f"brick{level}", (1, 0.5, 0.2), (x - 0.5, 0, 0.1 + 0.2 * level)))
    table = scenes.fixed_box("table", (1, 1, 1), (-0.5, 0, -0.5))
    assert assess(Assembly((table, *bricks), scenes.GRAVITY, 0.5), []).stable is stands


@pytest.mark.parametrize(("thickness", "stands"), [(0.105, False), (0.1075, True)])
def test_a_semicircular_arch_stands_from_milankovitchs_thickness_on(thickness, stands):
    found = assess(scenes.arch(thickness), [])
    assert found.stable is stands
    assert (found.margin >= 0) is stands


def test_a_cube_held_only_between_two_walls_does_not_stand():
    found = assess(scenes.between_walls(with_floor=False), [Push("cube", (0, 0, 3.5), (0, 0, 1))])
    assert not found.stable
    assert found.falling == ("cube",)
    assert found.margin < 0
    assert found.results[0].robustness == 0


def test_lifting_a_cube_from_between_two_walls_takes_its_weight_though_limit_analysis_would_wedge_it():
    assembly = scenes.between_walls(with_floor=True)
    push = Push("cube", (0, 0, 1), (0, 0, 1))
    assert assess(assembly, [push], "limit").results[0].robustness == np.inf
    found = assess(assembly, [push]).results[0]
    assert found.checked
    assert found.robustness == pytest.approx(G, rel=0.01)
    assert found.upper == np.inf


def test_a_centre_of_mass_exactly_over_an_edge_is_margin_zero():
    table = scenes.fixed_box("table", (1, 1, 1), (0, 0, 0.5))
    over = Assembly((table, scenes.box("cube", (1, 1, 1), (0.5, 0, 1.5))), scenes.GRAVITY, 0.5)
    found = assess(over, [Push("cube", (1, 0, 2), (0, 0, -1)), Push("cube", (0.2, 0, 2), (0, 0, -1))])
    assert not found.stable  # any disturbance topples it
    assert found.margin == 0
    assert found.falling == ("cube",)
    assert [result.robustness for result in found.results] == [0, 0]
