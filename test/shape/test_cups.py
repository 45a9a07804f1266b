"""Cups of few points: walls inside of what the largest ball leaves show that a gap is an opening, and no hole."""

import numpy as np
import pytest

from benchmarks.closed_shapes import ClosedShape, pieces, turned
from poise.shape import segment
from poise.types import Array


def cloud(shape: ClosedShape, noise: float, count: int) -> Array:
    return shape.cloud(np.random.default_rng([count, round(1e6 * noise)]), count, "white", noise)


@pytest.mark.parametrize("seed", [913, 929, 945, 961, 977])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_cup_of_few_points_is_open(seed: int, noise: float) -> None:
    """The points are 7 to 9 mm apart, and walls 3 to 6 mm thick; filled, it would be 2.5 to 3.6 times its volume."""
    shape = turned(seed)
    solid = segment(cloud(shape, noise, 500)).solid
    assert solid.volume == pytest.approx(shape.volume, rel=0.3)
    assert abs(solid.volume - shape.volume) < 2 * solid.volume_std < shape.volume


@pytest.mark.parametrize("seed", [2, 6, 14])
def test_a_hole_in_the_sampling_of_a_solid_is_none(seed: int) -> None:
    """A ball of three spacings around one point has no other: the ball that carves gets in, and finds no walls."""
    shape = pieces(seed)
    points = cloud(shape, 0.0, 500)
    spacing = np.sqrt(np.median(np.sort(((points[:, None] - points) ** 2).sum(axis=2), axis=1)[:, 3]))
    kept = np.linalg.norm(points - points[0], axis=1) > 3 * spacing
    solid = segment(points[kept]).solid
    assert solid.volume == pytest.approx(shape.volume, rel=0.15)
