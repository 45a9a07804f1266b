"""The stereo world of benchmarks/: its renderer and its volumes are exact, and its depth errs as a stereo camera's."""

import numpy as np
import pytest

pytest.importorskip("pybullet")
pytest.importorskip("pybullet_data")
pytest.importorskip("cv2")

from benchmarks.stereo_camera import shoot
from benchmarks.stereo_sweeps import way
from benchmarks.stereo_world import CAMERA, Paint, Shape, World, rays_of_camera, shape

PLAIN = Paint(np.array([0.6, 0.6]), 0.0, np.array([1.0, 0.0, 0.0]), np.full((2, 3), 0.5))


def test_the_volume_of_a_box_is_exact_and_a_hidden_hollow_is_seen() -> None:
    box = shape("domino/domino.obj", 0.08)
    size, middle = np.ptp(box.vertices, axis=0), box.vertices.min(axis=0) + np.ptp(box.vertices, axis=0) / 2
    assert box.columns[1] == pytest.approx(np.prod(size), rel=0.01)
    assert box.columns[2] == pytest.approx(middle, abs=3e-4)
    assert box.hidden == pytest.approx(0.0, abs=1e-3)
    both = np.concatenate([box.vertices, middle + 0.5 * (box.vertices - middle)])
    inner = box.triangles[:, ::-1] + len(box.vertices)
    hollow = Shape("hollow", both, np.concatenate([box.triangles, inner]))
    assert hollow.columns[1] == pytest.approx(7 / 8 * np.prod(size), rel=0.03)
    assert hollow.hidden == pytest.approx(1 / 7, abs=0.03)


def test_a_view_is_exact_and_its_stereo_depth_is_not() -> None:
    rng = np.random.default_rng(0)
    world = World(shape("toys/prism.obj", 0.1), PLAIN, rng)
    try:
        assert world.vertices[:, 2].min() == 0.0
        rotation, translation = (poses[0] for poses in way(6, 0.1, rng))
        depth, object_ = world.depth(rotation, translation)
        shot = shoot(world, rotation, translation, rng)
    finally:
        world.close()
    at = (depth[..., None] * rays_of_camera()) @ rotation.T + translation
    assert object_.sum() > 5000
    assert at[object_][:, 2].min() > -1e-3
    assert at[object_][:, 2].max() < world.vertices[:, 2].max() + 1e-3
    known = (shot.depth > 0) & (depth > 0) & (depth < 0.6)
    off = (shot.depth - depth)[known & object_]
    assert known[object_].mean() > 0.7
    assert abs(np.median(off)) < 1e-3
    assert 3e-4 < 1.4826 * np.median(np.abs(off - np.median(off))) < 3e-3
    assert 0.001 < np.mean(np.abs(off) > 0.01) < 0.15  # at edges, it is that of something else
    assert shot.depth.shape == (CAMERA.height, CAMERA.width)
