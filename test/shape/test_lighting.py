"""Shading is no border of parts: objects under one distant light and ambient light, whose paints are known."""

import numpy as np
import pytest
import shape_samples as samples

from benchmarks.closed_shapes import turned
from poise.shape.lighting import colour_noise, colour_steps, unlit
from poise.shape.metrics import undersegmentation_error
from poise.shape.segmentation import segment
from poise.types import Array

_SUN = np.array([0.35, -0.25, 0.9]) / np.linalg.norm([0.35, -0.25, 0.9])
_AMBIENT = 0.45


def _light(normals: Array) -> Array:
    """(N, 1) Lambert's law."""
    return np.asarray(_AMBIENT + (1 - _AMBIENT) * np.clip(normals @ _SUN, 0, 1))[:, None]


def _box_normals(points: Array, sides: tuple[float, float, float]) -> Array:
    """(N, 3) of the faces of a box about the origin."""
    reach = np.abs(points) / (np.array(sides) / 2)
    face = reach.argmax(axis=1)
    normals = np.zeros_like(points)
    normals[np.arange(len(points)), face] = np.sign(points[np.arange(len(points)), face])
    return normals


def _mallet_normals(points: Array, labels: Array) -> Array:
    """(N, 3) of `samples.mallet`."""
    head = _box_normals(points - [0.12, 0.0, 0.0], (0.04, 0.12, 0.04))
    round_ = points * [0.0, 1.0, 1.0]
    handle = round_ / np.maximum(np.linalg.norm(round_, axis=1, keepdims=True), 1e-9)
    handle[points[:, 0] < -0.0999] = [-1.0, 0.0, 0.0]
    return np.where((labels == 0)[:, None], head, handle)


def test_one_paint_has_one_colour_without_its_lighting() -> None:
    normals = samples.sphere(np.random.default_rng(0), 1.0, 2000)
    paint = np.array([0.6, 0.4, 0.2])
    found = unlit(paint * _light(normals), normals, np.ones(2000, bool))
    assert found is not None
    lightness = found.mean(axis=1)
    assert np.quantile(np.abs(lightness / np.median(lightness) - 1), 0.95) < 0.12
    assert (paint * _light(normals)).mean(axis=1).std() / 0.4 > 0.15


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_paints_of_one_hue_are_no_lighting(noise: float) -> None:
    rng = np.random.default_rng(1)
    points, _, truth = samples.mallet(rng, 1000)
    colours = np.array([[0.55, 0.55, 0.55], [0.2, 0.2, 0.2]])[truth] + rng.normal(scale=noise, size=points.shape)
    assert unlit(np.clip(colours, 0, 1), _mallet_normals(points, truth), np.ones(len(points), bool)) is None


def test_unseen_colours_do_not_count() -> None:
    rng = np.random.default_rng(2)
    normals = samples.sphere(rng, 1.0, 2000)
    colours = np.array([0.1, 0.2, 0.75]) * _light(normals)
    seen = normals[:, 2] > -0.3
    wrong = np.where(seen[:, None], colours, rng.random((2000, 3)))
    one, other = unlit(colours, normals, seen), unlit(wrong, normals, seen)
    assert one is not None
    assert other is not None
    np.testing.assert_array_equal(one[seen], other[seen])


def test_steps_of_colour_forgive_lightness_alone() -> None:
    one = np.array([[0.5, 0.4, 0.3]])
    assert colour_steps(one, 1.2 * one, 0.25)[0] == pytest.approx(0, abs=1e-12)
    assert colour_steps(one, 1.2 * one, 0.0)[0] == pytest.approx(0.2 * np.linalg.norm(one))
    assert colour_steps(one, one[:, ::-1], 0.25)[0] > 0.2


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_lit_box_of_one_colour_is_one_part(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    sides = (0.1, 0.06, 0.04)
    points = samples.box(rng, sides, 2000)
    colours = np.array([0.8, 0.12, 0.1]) * _light(_box_normals(points, sides))
    assert segment(points, np.clip(colours + rng.normal(scale=noise, size=colours.shape), 0, 1)).n_parts == 1


@pytest.mark.parametrize("encoding", [1, 16])
def test_a_lit_mallet_has_the_parts_of_one_that_is_not(encoding: int) -> None:
    scores = []
    for seed in (2, 3, 4):
        points, colours, truth = samples.mallet(np.random.default_rng(seed), 900)
        lit = colours * _light(_mallet_normals(points, truth))
        lit = np.round(lit * 255 / encoding) * encoding / 255  # as 8 bits, or as coarse as JPEG
        found = segment(points, lit)
        scores.append(undersegmentation_error(found.labels, truth))
        assert 2 <= found.n_parts <= 4
        assert abs(found.n_parts - segment(points, colours).n_parts) <= 1
    assert np.mean(scores) < 0.04


def test_the_noise_of_colours_is_found_and_does_not_hide_the_lighting() -> None:
    """Few points of a noisy paint have one chromaticity; a lit mug had 20 parts, and has as many as one that is not."""
    shape = turned(905)
    corners = shape.vertices[shape.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1)
    plain, counts = np.tile([0.55, 0.5, 0.6], (2500, 1)), []
    for rng in map(np.random.default_rng, range(3, 8)):
        drawn = rng.choice(len(areas), 2500, p=areas / areas.sum())
        points = np.einsum("mk,mki->mi", rng.dirichlet(np.ones(3), 2500), corners[drawn])
        errors = rng.normal(scale=0.03, size=plain.shape)
        lit = plain * _light(across / areas[:, None])[drawn]
        counts.append([segment(points, colours + errors).n_parts for colours in (plain, lit)])
    assert abs(float(np.mean(np.diff(counts)))) < 1.5
    edges = rng.integers(2500, size=(5000, 2))
    assert colour_noise(plain + errors, edges[edges[:, 0] != edges[:, 1]]) == pytest.approx(0.03, rel=0.05)
    assert colour_noise(plain, edges[:0]) == 0
