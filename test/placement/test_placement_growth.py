"""Placements on what has many vertices or many objects, and the cheap looks that come before the dear ones."""

import numpy as np
import pytest

from benchmarks.placement import growth, scenes
from poise.assembly import Analysis, Push, assess
from poise.geometry import Pose, plane_axes, rotation_about
from poise.placement import Options, plan_placement
from poise.placement.balance import SupportCheck, unbalanced_share, unbalanced_weight
from poise.placement.matching import SupportPoint, over_three
from poise.placement.scoring import estimate_score
from poise.placement.supports import find_supports

UP = np.array([0.0, 0.0, 1.0])


def test_a_cube_finds_its_place_in_a_bowl():
    found = plan_placement(
        growth.on_floor(scenes.bowl(500)), scenes.box("dice", (0.04,) * 3, (0, 0, 0)), Options(on="objects"), 3
    )
    assert found.analysis.stability().margin > 0
    assert np.linalg.norm(found.pose.translation[:2]) < 0.075


def test_of_piles_only_the_open_tops_are_places():
    analysis = Analysis.of(growth.piles(10))
    supports = find_supports(analysis, "objects", "uniform", 200, 0.17, np.random.default_rng(0))
    assert supports.points[:, 2] == pytest.approx(0.2)
    assert len(np.unique(supports.places)) == 5


def test_ridges_and_peaks_are_places_and_valleys_are_not():
    for name, height in (("sawteeth", 0.09), ("pyramids", 0.1)):
        supports = find_supports(
            Analysis.of(scenes.scene(name)), "objects", "uniform", 50, 0.17, np.random.default_rng(0)
        )
        assert supports.points[supports.sharp, 2] == pytest.approx(height)
        assert supports.sharp.sum() == (25 if name == "sawteeth" else 3)


def test_places_of_one_draw_are_near_and_all_sharp_or_none():
    supports = find_supports(
        Analysis.of(scenes.scene("pyramids")), "objects", "limit", 50, 0.1, np.random.default_rng(0)
    )
    rng = np.random.default_rng(1)
    for _ in range(100):
        drawn = supports.draw(rng)
        assert len(set(supports.sharp[drawn])) == 1
        assert np.linalg.norm(supports.points[drawn] - supports.points[drawn[0]], axis=1).max() < supports.reach


def test_three_peaks_make_a_plane_that_lies_on_them():
    corners = np.array([[0, 0, 0.1], [0.1, 0, 0.12], [0, 0.1, 0.11]])
    top = over_three(*(SupportPoint(corner, UP) for corner in corners), UP)
    assert (corners - top.point) @ top.normal == pytest.approx(np.zeros(3), abs=1e-12)
    assert top.normal[2] > 0
    assert over_three(*(SupportPoint(np.array([x, 0, 0.1]), UP) for x in (0, 0.1, 0.2)), UP) is None


@pytest.mark.parametrize(("degrees", "stands"), [(20.0, True), (40.0, False)])
def test_presses_on_a_slope_balance_within_the_friction(degrees, stands):
    """The pyramids are around the cones: between 26.6 degrees and 35 the look may be too kind, never too strict."""
    normal = rotation_about(np.array([0.0, 1.0, 0.0]), np.radians(degrees)) @ UP
    feet = np.array([[x, y] for x in (-0.1, 0.1) for y in (-0.1, 0.1)]) @ plane_axes(normal) - 0.01 * normal
    left = unbalanced_share(feet, np.tile(normal, (4, 1)), np.full(4, 0.5), -UP, 0.2)
    assert (left < 1e-9) == stands


def test_what_stands_balances_and_what_hangs_over_does_not():
    for offset, stands in ((0.04, True), (0.06, False)):
        cube = scenes.box("upper", (0.1, 0.1, 0.1), (offset, 0, 0.15))
        analysis = Analysis.of(scenes.scene("cube").with_object(cube))
        assert (unbalanced_weight(analysis, cube) < 1e-9) == stands


def test_a_fit_needs_more_than_a_line_and_nothing_below():
    cube = scenes.cube()
    fit = SupportCheck(cube.vertices, np.zeros(3), True, 0.5, -UP)
    floor = (SupportPoint(np.zeros(3), UP),)
    tilted = rotation_about(np.array([1.0, 0.0, 0.0]), np.pi / 4)
    assert fit.allows(Pose(np.eye(3), np.array([0, 0, 0.05])), floor)
    assert not fit.allows(Pose(np.eye(3), np.array([0, 0, 0.03])), floor)
    assert not fit.allows(Pose(tilted, np.array([0, 0, 0.05 * np.sqrt(2)])), floor)


@pytest.mark.parametrize("name", ["stack", "canyon", "balance", "glued"])
def test_an_estimate_is_never_below_limit_analysis_and_near_it(name):
    scene = growth.on_floor() if name == "glued" else scenes.scene(name)
    item = scenes.glued("h") if name == "glued" else scenes.cube()
    analysis = plan_placement(scene, item, Options(candidates=1), 5).analysis
    corners = [
        Push(body.id, body.pose.apply(corner), -body.pose.rotation @ normal)
        for body in analysis.assembly.objects[1:]
        for facet, normal in enumerate(body.shape.polyhedron.normals)
        for corner in body.shape.polyhedron.vertices[body.shape.polyhedron.facet_vertices[facet]]
    ]
    truth = min(result.robustness for result in assess(analysis, corners, "limit").results)
    assert 0.98 * truth <= estimate_score(analysis).least <= 1.3 * truth
