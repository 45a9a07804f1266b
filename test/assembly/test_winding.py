"""Inside or outside of closed surfaces, against solid angles, where rays hit edges and corners, too."""

import numpy as np
import pytest

from benchmarks.placement.scenes import bowl, glued
from poise.assembly import RigidObject
from poise.assembly.contact.penetration import winding_number
from poise.types import Array


def solid_angles(points: Array, corners: Array) -> Array:
    """(N,) sums over triangles (T, 3, 3), in whole spheres (van Oosterom, Strackee 1983)."""
    numbers = []
    for point in points:
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        base = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
        numbers.append(np.arctan2(volume, base).sum() / (2 * np.pi))
    return np.array(numbers)


@pytest.mark.parametrize("item", [bowl(500), *map(glued, "adgj")], ids=lambda item: item.id)
def test_a_ray_counts_what_solid_angles_say(item: RigidObject) -> None:
    """Anywhere; and under and over corners and middles of edges, where those a hair's breadth around agree."""
    rng = np.random.default_rng(3)
    vertices, polyhedron = item.vertices, item.shape.polyhedron
    corners = vertices[polyhedron.triangles]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    anywhere = rng.uniform(low, high, (100, 3))
    aligned = np.concatenate([vertices[rng.integers(len(vertices), size=50)], vertices[polyhedron.edges].mean(axis=1)])
    aligned = aligned[rng.permutation(len(aligned))[:100]]
    aligned[:, 2] = rng.uniform(low[2], high[2], len(aligned))
    points = np.concatenate([anywhere, aligned])
    around = np.round([solid_angles(points + 1e-7 * rng.normal(size=3), corners) for _ in range(8)])
    sure = np.all(around == around[0], axis=0)
    found = winding_number(points, corners, np.stack([corners.min(axis=1), corners.max(axis=1)]))
    assert sure[:100].all()
    assert np.array_equal(found[sure], around[0, sure])
    assert np.all((found == around).any(axis=0))
    assert 0 < np.mean(found > 0) < 1
