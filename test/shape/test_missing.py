"""Clouds that do not show the whole surface are refused, or have a wide volume; whole clouds do not."""

import numpy as np
import pytest
import shape_samples as samples

from poise.errors import ErrorCode, InputError
from poise.shape.reconstruction import reconstruct
from poise.shape.reflections import principal_axes
from poise.shape.segmentation import segment
from poise.shape.solid import tetrahedron_moments
from poise.types import Array


def _noisy(points: Array, noise: float = 1e-3) -> Array:
    return points + noise * np.random.default_rng(1).normal(size=points.shape)


@pytest.mark.parametrize("noise", [0.0, 5e-5, 3e-4, 1e-3])
@pytest.mark.parametrize("height", [-0.019, 0.0])
def test_one_side_of_a_box_is_refused(height: float, noise: float) -> None:
    """With noise it was a shell of 0.05 to 0.3 of the volume, stated to 5 %."""
    points = samples.box(np.random.default_rng(6), (0.1, 0.06, 0.04), 6000)
    with pytest.raises(InputError, match=r"one layer|nothing behind") as refused:
        segment(_noisy(points[points[:, 2] > height], noise))
    assert refused.value.code == ErrorCode.SCAN_INCOMPLETE


@pytest.mark.parametrize("noise", [0.0, 5e-5, 3e-4, 1e-3])
def test_one_side_of_a_ball_is_refused(noise: float) -> None:
    points = samples.sphere(np.random.default_rng(3), 0.04, 4000)
    with pytest.raises(InputError, match=r"one layer|nothing behind"):
        segment(_noisy(points[points[:, 0] > -0.01], noise))


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_a_rod_without_its_end_may_go_on(noise: float) -> None:
    points = samples.cylinder(np.random.default_rng(4), 0.005, 0.2, 8000)
    found = segment(_noisy(points[points[:, 0] < 0.02], noise))
    whole = np.pi * 0.005**2 * 0.2
    assert abs(found.solid.volume - whole) < 2 * found.solid.volume_std
    assert any("has no points" in note for note in found.notes)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("sides", [(0.1, 0.06, 0.04), (0.12, 0.08, 0.006), (0.2, 0.03, 0.01)])
def test_whole_things_miss_nothing(sides: tuple[float, float, float], noise: float) -> None:
    made = reconstruct(_noisy(samples.box(np.random.default_rng(7), sides, 4000), noise), 2500)
    assert made.missing.share < 0.1
    assert not made.missing.faces
    assert made.solid.volume_std < 0.2 * made.solid.volume


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_mirror_image_below_a_table_is_named(noise: float) -> None:
    rng = np.random.default_rng(8)
    whole = samples.box(rng, (0.1, 0.06, 0.04), 3000, np.array([0.0, 0.0, 0.02]))
    seen = whole[whole[:, 2] > 1e-3]
    image = seen[rng.random(len(seen)) < 0.4] * [1, 1, -1]
    found = segment(_noisy(np.concatenate([seen, image]), noise))
    assert any("mirror image" in note for note in found.notes)
    assert abs(found.solid.volume - 0.1 * 0.06 * 0.04) < 2 * found.solid.volume_std
    doubled = np.concatenate([whole, whole * [1, 1, -1]])
    assert not reconstruct(_noisy(doubled[np.abs(doubled[:, 2]) > 1e-3], noise), 2500).missing.image


def test_axes_of_mirror_images_are_those_of_the_solid() -> None:
    solid = reconstruct(samples.box(np.random.default_rng(9), (0.1, 0.06, 0.04), 1000), 1000).solid
    moments = tetrahedron_moments(solid.vertices[solid.tetrahedra]).sum(axis=0)
    middle, axes = principal_axes(solid)
    assert np.allclose(middle, moments[:3, 3] / moments[3, 3], atol=1e-12)
    turned = axes @ (moments[:3, :3] / moments[3, 3] - np.outer(middle, middle)) @ axes.T
    assert np.allclose(turned, np.diag(np.diag(turned)), atol=1e-12)
