"""Solids from clouds, against volumes that are known in closed form."""

import numpy as np
import pytest
import shape_samples as samples

from poise.errors import ErrorCode, InputError
from poise.shape.carving import carve

COUNT = 2000


def clouds() -> dict[str, tuple[np.ndarray, float]]:
    rng = np.random.default_rng(5)
    hollow = np.concatenate([samples.sphere(rng, 0.05, COUNT), samples.sphere(rng, 0.02, COUNT // 4)])
    return {
        "box": (samples.box(rng, (0.1, 0.06, 0.04), COUNT), 0.1 * 0.06 * 0.04),
        "sphere": (samples.sphere(rng, 0.05, COUNT), 4 / 3 * np.pi * 0.05**3),
        "a hidden hollow counts as filled": (hollow, 4 / 3 * np.pi * 0.05**3),
        "torus": (samples.torus(rng, 0.06, 0.02, COUNT), 2 * np.pi**2 * 0.06 * 0.02**2),
        "cylinder": (samples.cylinder(rng, 0.01, 0.2, COUNT), np.pi * 0.01**2 * 0.2),
        "plate of 3 mm with points 3 mm apart": (samples.box(rng, (0.1, 0.1, 0.003), COUNT), 0.1 * 0.1 * 0.003),
    }


@pytest.mark.parametrize("name", clouds())
def test_the_volume_is_that_of_the_shape(name: str) -> None:
    points, volume = clouds()[name]
    assert carve(points).volume == pytest.approx(volume, rel=0.07)


def test_the_hole_of_a_torus_stays_open() -> None:
    axis_distance = np.linalg.norm(carve(clouds()["torus"][0]).centroids[:, :2], axis=1)
    assert axis_distance.min() > 0.9 * 0.04


@pytest.mark.parametrize("name", clouds())
def test_the_surface_is_closed_and_holds_the_volume(name: str) -> None:
    solid = carve(clouds()[name][0])
    triangles, _ = solid.surface
    ends, turns = np.unique(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=0, return_counts=True)
    back = {(b, a): n for (a, b), n in zip(ends.tolist(), turns.tolist(), strict=True)}
    assert all(back.get((a, b)) == n for (a, b), n in zip(ends.tolist(), turns.tolist(), strict=True))
    corners = solid.vertices[triangles]
    assert np.linalg.det(corners).sum() / 6 == pytest.approx(solid.volume)


def test_size_and_place_change_nothing() -> None:
    points, _ = clouds()["torus"]
    here, there = carve(points), carve(3.0 * points + [0.4, -2.0, 1.0])
    assert there.volume == pytest.approx(27 * here.volume, rel=1e-6)


def test_what_has_no_volume_is_refused() -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.random((100, 2)), np.zeros(100)])
    with pytest.raises(InputError) as refused:
        carve(flat)
    assert refused.value.code is ErrorCode.MESH_INVALID
    with pytest.raises(InputError) as refused:
        carve(rng.random((5, 3)))
    assert refused.value.code is ErrorCode.SCAN_INCOMPLETE
