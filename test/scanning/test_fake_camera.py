"""The software renderer against closed forms, and the stereo noise against what it promises."""

import numpy as np
import pytest
from scenes import EXACT, SMALL, box
from scipy.spatial import ConvexHull

from poise.fake_robots.depth_noise import D435, measured
from poise.fake_robots.rasteriser import TABLE, Body, Rendering, Scene, look_at, render
from poise.fake_robots.sweep_bag import FakeSweep, arm_sweep, laid_down
from poise.robot import RobotModel

EYE = np.array([0.2, -0.15, 0.3])


def ray_directions(rotation):
    """(H, W, 3) in the world, with length 1 along the optical axis."""
    rays = np.moveaxis(SMALL.rays.astype(float), 0, -1)
    return np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1) @ rotation.T


def test_depth_of_a_table_and_a_box_is_that_of_the_slab_method():
    rotation, sides, middle = look_at(EYE, np.zeros(3)), np.array([0.1, 0.06, 0.05]), np.array([0.0, 0.0, 0.025])
    seen = render(Scene((box(tuple(sides), tuple(middle), (1, 0, 0)),)), SMALL, rotation, EYE)
    rays = ray_directions(rotation)
    slabs = np.sort(np.stack([(middle - sides / 2 - EYE) / rays, (middle + sides / 2 - EYE) / rays]), axis=0)
    enters, leaves = slabs[0].max(axis=-1), slabs[1].min(axis=-1)
    table = -EYE[2] / rays[..., 2]
    expected = np.where(enters < leaves, enters, table)
    on_border = np.abs(enters - leaves) < 2e-3
    assert (seen.shown >= 0).sum() > 500
    np.testing.assert_allclose(seen.depth[~on_border], expected[~on_border], atol=1e-9)


def test_a_fine_ball_is_where_the_quadratic_formula_puts_it():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(4000, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    flipped = np.einsum(
        "ti,ti->t", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]
    )
    corners[flipped < 0] = corners[flipped < 0][:, ::-1]
    rotation = look_at(EYE, np.zeros(3))
    seen = render(Scene((Body(corners, np.ones((len(corners), 3))),), table=None), SMALL, rotation, EYE)
    rays = ray_directions(rotation)
    a, b, c = np.sum(rays**2, axis=-1), 2 * rays @ EYE, EYE @ EYE - 0.05**2
    square = b**2 - 4 * a * c
    inner = square > 0.004  # away from the rim
    expected = (-b - np.sqrt(np.where(inner, square, 0))) / (2 * a)
    assert inner.sum() > 500
    np.testing.assert_allclose(seen.depth[inner], expected[inner], atol=3e-4)
    assert not seen.depth[square < -0.001].any()


def test_noise_grows_with_the_square_of_the_distance_as_promised():
    rng = np.random.default_rng(1)
    for depth in (0.3, 0.9):
        wall = Rendering(
            np.full((150, 200), depth),
            np.full((150, 200), TABLE),
            np.ones((150, 200)),
            np.zeros((150, 200, 3), np.uint8),
        )
        values = measured(wall, 190.0, D435, rng) * 1e-3
        known = values > 0
        assert known.mean() == pytest.approx(1 - D435.lost, abs=0.002)
        expected = np.hypot(D435.sigma(depth), 1e-3 / np.sqrt(12))
        assert values[known].std() == pytest.approx(expected, rel=0.1)
        assert values[known].mean() == pytest.approx(depth, abs=1e-4)


def test_what_is_too_near_or_hidden_from_the_second_imager_has_no_depth():
    depth = np.full((20, 200), 0.5)
    depth[:, 100:120] = 0.3
    step = Rendering(depth, np.full(depth.shape, TABLE), np.ones(depth.shape), np.zeros((*depth.shape, 3), np.uint8))
    values = measured(step, 400.0, EXACT, np.random.default_rng(0))
    shadow = 400.0 * EXACT.baseline * (1 / 0.3 - 1 / 0.5)
    lost = (values[10] == 0).nonzero()[0]
    assert len(lost) == pytest.approx(shadow, abs=3)
    assert lost.max() < 101
    near = Rendering(np.full((20, 20), 0.1), step.shown[:, :20], step.facing[:, :20], step.colours[:, :20])
    assert not measured(near, 400.0, EXACT, np.random.default_rng(0)).any()


def test_a_body_is_laid_on_the_face_on_which_it_is_lowest():
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    given = box((0.2, 0.1, 0.03), (0, 0, 0), (1, 1, 1)).triangles.reshape(-1, 3) @ turn.T
    placed = laid_down(given, np.arange(len(given)).reshape(-1, 3), (0.4, 0.1), 0.0)
    low, high = placed.min(axis=0), placed.max(axis=0)
    np.testing.assert_allclose([low[2], high[2]], [0.0, 0.03], atol=1e-9)
    np.testing.assert_allclose((low + high)[:2] / 2, [0.4, 0.1], atol=1e-9)
    before, after = (np.linalg.det(np.diff(points[[0, 1, 2, 30]], axis=0)) for points in (given, placed))
    assert before == pytest.approx(after)  # turned, not mirrored


def test_the_arm_brings_its_camera_around_the_object():
    """The poses from which the benchmarks render a sweep: the object is in the middle of each image."""
    sweep = FakeSweep(Scene((), middle=(0.45, 0.0)), point=(0.45, 0.0, 0.02), frames=3)
    model = RobotModel.from_file("xarm7", "link_eef")
    rotation, translation, states = arm_sweep(sweep, model, 0.0, np.random.default_rng(0))
    towards = np.array(sweep.point) - translation
    cosine = np.einsum("vi,vi->v", rotation[:, :, 2], towards) / np.linalg.norm(towards, axis=1)
    assert (cosine > np.cos(0.16)).all()
    assert len(states) > 3
