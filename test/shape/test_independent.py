"""Parts that a sensor at rest distinguishes: their centroids span space, or there are fewer of them."""

import numpy as np
import pytest
import shape_samples as samples

from poise.shape.independent import independent_parts, spread
from poise.shape.segmentation import segment


def test_coplanar_centroids_have_no_spread_and_a_tetrahedron_has() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert spread(square, np.ones(4)) == pytest.approx(0, abs=1e-12)
    assert spread(square[:2], np.ones(2)) > 0.5
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert spread(corner, np.ones(4)) > 0.2
    assert spread(np.concatenate([corner, [[1.0, 1, 1]]]), np.ones(5)) == 0


@pytest.mark.parametrize("gap", [0.0, 0.03])
def test_arms_of_a_cross_are_parts_only_as_far_as_their_masses_show(gap: float) -> None:
    rng = np.random.default_rng(8)
    middles = [[0, 0, 0], [0.06, 0, 0], [-0.06, 0, 0], [0, 0.06, 0], [0, -0.06, gap]]
    arms = [samples.box(rng, (0.06, 0.06, 0.06), 500, np.array(middle)) for middle in middles]
    colours = np.repeat([[1.0, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]], 500, axis=0)
    found = segment(np.concatenate(arms), colours)
    parts = independent_parts(found)
    volumes = np.bincount(parts, found.solid.volumes)
    first = found.solid.volumes[:, None] * found.solid.centroids
    centroids = np.stack([np.bincount(parts, column) for column in first.T], axis=1) / volumes[:, None]
    assert 2 <= len(volumes) <= 4
    assert spread(centroids, volumes) > 0.03
    if gap:  # the fourth arm is lifted out of the plane of the others
        assert len(volumes) == 4
