"""Solids from clouds, against volumes that are known in closed form."""

import numpy as np
import pytest
import shape_samples as samples

from poise.errors import ErrorCode, InputError
from poise.shape.carving import _least_to_root as least_to_root
from poise.shape.carving import carve
from poise.shape.pockets import _to_triangles as to_triangles
from poise.shape.pockets import _under_sheets as under_sheets
from poise.shape.pockets import depths_below, depths_inside
from poise.shape.spacing import spacing_of

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


@pytest.mark.parametrize("sides", [(0.3, 0.03, 0.004), (0.2, 0.05, 0.03)])
def test_a_ball_does_not_pass_where_points_are_sparse(sides: tuple[float, float, float]) -> None:
    """At one end there are 16 times as many points per area as at the other, as of what is seen from that end."""
    rng = np.random.default_rng(3)
    many = samples.box(rng, sides, 20 * COUNT)
    weights = 16 ** -(many[:, 0] / sides[0])
    points = many[rng.choice(len(many), COUNT, replace=False, p=weights / weights.sum())]
    assert spacing_of(points).coarseness.max() > 1.5
    assert carve(points).volume == pytest.approx(np.prod(sides), rel=0.1)


def test_even_points_are_not_sparse() -> None:
    for points, _ in clouds().values():
        assert np.mean(spacing_of(points).coarseness > 1.0) < 0.05


def test_what_has_no_volume_is_refused() -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.random((100, 2)), np.zeros(100)])
    with pytest.raises(InputError) as refused:
        carve(flat)
    assert refused.value.code is ErrorCode.MESH_INVALID
    with pytest.raises(InputError) as refused:
        carve(rng.random((5, 3)))
    assert refused.value.code is ErrorCode.SCAN_INCOMPLETE


def test_depth_below_a_surface_is_to_its_triangles() -> None:
    """Two points of a box are inside: one in the middle, and one that a flat tetrahedron just covers."""
    rng = np.random.default_rng(2)
    side = np.array([0.1, 0.06, 0.04])
    middle, covered = np.zeros(3), np.array([0.011, 0.007, side[2] / 2 - 1e-4])
    outside = samples.box(rng, tuple(side.tolist()), COUNT)
    outside -= (outside.min(axis=0) + outside.max(axis=0)) / 2
    outside = outside[np.linalg.norm(outside - covered, axis=1) > 3e-3]
    points = np.concatenate([outside, [middle, covered]])
    solid = carve(points)
    depths = depths_below(points, solid.tetrahedra, solid.surface[0])
    assert depths[-2] == pytest.approx(side[2] / 2, rel=0.02)
    assert depths[-1] == pytest.approx(1e-4, rel=0.2)
    nearest = depths_inside(points, solid.tetrahedra, solid.surface[0])
    assert nearest[-1] > 2.9e-3


def test_the_distance_to_a_triangle_is_that_to_its_nearest_point() -> None:
    rng = np.random.default_rng(3)
    corners, points = rng.normal(size=(40, 1, 3, 3)), rng.normal(size=(40, 3))
    drawn = rng.dirichlet(np.full(3, 0.6), 50_000)
    nearest = [np.linalg.norm(drawn @ corners[i, 0] - points[i], axis=1).min() for i in range(len(points))]
    np.testing.assert_allclose(to_triangles(points, corners)[:, 0], nearest, atol=1e-3)


@pytest.mark.parametrize("longest", [1, 40])
def test_the_least_on_the_way_to_the_root(longest: int) -> None:
    """Trees whose nodes hang on one of a few before them, and chains."""
    rng = np.random.default_rng(longest)
    count = 300
    parents = np.maximum(np.arange(count) - rng.integers(1, longest + 1, count), 0)
    values = rng.uniform(size=count)
    wanted = values.copy()
    for node in range(1, count):
        wanted[node] = min(wanted[node], wanted[parents[node]])
    np.testing.assert_array_equal(least_to_root(values, parents), wanted)


def test_points_close_below_the_surface_are_on_the_inner_face_of_a_sheet() -> None:
    """A plate of 1 mm, with points on the inner face of its upper wall, and one point below a wide gap."""
    step = np.arange(0, 0.05, 0.004)
    grid = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    outer, middle = (np.column_stack([grid, np.full(len(grid), z)]) for z in (0.0, -0.001))
    points = np.concatenate([outer, middle, [[0.02, 0.02, -0.03]]])
    facets = np.array([[0, 1, 13], [1, 14, 13]]) + np.arange(11)[:, None, None]
    facets = (facets[None] + 13 * np.arange(11)[:, None, None, None]).reshape(-1, 3)
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    rows = under_sheets(points, facets, -points[:, 2], up, 0.004)
    assert rows.min() >= len(outer)
    assert set(len(outer) + np.flatnonzero(np.abs(grid - 0.02).max(axis=1) < 0.015)) <= set(rows.tolist())
    assert len(points) - 1 not in rows
