"""The compiled kernels of solids and parts against their forms in Python, and with bad input."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from poise.errors import InputError
from poise.kernels import (
    Drawn,
    clustered_points,
    matched_places,
    merged_clusters,
    nearest_of,
    normals_of_planes,
    opened_pockets,
    side_averages,
    tetrahedra_of,
    ways_in,
)
from poise.shape import carving, clustering, hierarchy, matching, nearest, pockets, segmentation, surface_fit
from poise.shape.metrics import undersegmentation_error
from poise.shape.segmentation import Segmentation, segment
from poise.shape.solid import tetrahedron_volumes
from poise.types import Array, Indices

RNG = np.random.default_rng(8)
MODULES = (carving, clustering, hierarchy, matching, nearest, pockets, surface_fit)


def hammer(count: int, noise: float) -> tuple[Array, Array, Indices]:
    """Points (N, 3) m of a bent ring and a ball, with a gap that is narrow against the spacing; colours, and truth."""
    around, across = RNG.uniform(0, 1.8 * np.pi, count), RNG.uniform(0, 2 * np.pi, count)
    ring = np.stack([np.cos(around), np.sin(around), np.zeros(count)], axis=1)
    tube = np.cos(across)[:, None] * ring + np.sin(across)[:, None] * [0.0, 0.0, 1.0]
    ball = RNG.normal(size=(count // 2, 3))
    ball = 0.025 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + [0.06, 0.0, 0.0]
    points = np.concatenate([0.03 * ring + 0.008 * tube, ball])
    truth = np.repeat([0, 1], [count, count // 2])
    colours = np.where(truth[:, None] == 0, [0.8, 0.2, 0.1], [0.3, 0.3, 0.4]) + RNG.normal(
        scale=0.03, size=points.shape
    )
    return points + RNG.normal(scale=noise, size=points.shape), np.clip(colours, 0, 1), truth


HAMMER, COLOURS, TRUTH = hammer(900, 1e-4)


@pytest.fixture
def in_python(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    def switch() -> None:
        for module in MODULES:
            monkeypatch.setattr(module, "COMPILED", False)

    return switch


@pytest.fixture
def both(in_python: Callable[[], None]) -> Callable[[Callable[[], Any]], tuple[Any, Any]]:
    def run(what: Callable[[], Any]) -> tuple[Any, Any]:
        compiled = what()
        in_python()
        return compiled, what()

    return run


@pytest.mark.parametrize("coloured", [True, False])
@pytest.mark.parametrize("noise", [1e-4, 1.5e-3])
def test_parts_are_those_of_python(noise: float, coloured: bool, in_python: Callable[[], None]) -> None:
    points, colours, truth = hammer(700, noise)
    given = points, colours if coloured else None
    found = segment(*given)
    in_python()
    expected = segment(*given)
    np.testing.assert_array_equal(found.labels, expected.labels)
    np.testing.assert_array_equal(found.tetrahedron_labels, expected.tetrahedron_labels)
    np.testing.assert_allclose(found.solid.vertices, expected.solid.vertices, atol=1e-12)
    for of in (lambda one: one.noise, lambda one: one.solid.volume_std, lambda one: one.volumes):
        np.testing.assert_allclose(of(found), of(expected), rtol=1e-9)
    assert [merge.parent for merge in found.hierarchy.merges] == [merge.parent for merge in expected.hierarchy.merges]
    if coloured:
        assert undersegmentation_error(found.labels, truth) < 0.05


def test_tetrahedra_are_those_of_qhull(both: Callable[[Callable[[], Any]], tuple[Any, Any]]) -> None:
    for one, other in zip(*both(lambda: carving._delaunay(HAMMER)), strict=True):
        np.testing.assert_array_equal(one, other)


def degenerate(name: str) -> Array:
    grid = np.stack(np.meshgrid(*[np.arange(6.0)] * 3), axis=-1).reshape(-1, 3)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    line = np.linspace(0, 1, 60)[:, None]
    return {
        "grid": grid,
        "turned grid": grid @ turn,
        "points twice": np.concatenate([grid, grid[::3]]),
        "sphere": (lambda at: at / np.linalg.norm(at, axis=1, keepdims=True))(RNG.normal(size=(300, 3))),
        "two lines": np.concatenate([line * [1, 0, 0], line * [0, 1, 0] + [0, 0, 1]]),
    }[name]


@pytest.mark.parametrize("name", ["grid", "turned grid", "points twice", "sphere", "two lines"])
def test_degenerate_points_have_tetrahedra_that_fill_their_hull(name: str) -> None:
    points = degenerate(name)
    tetrahedra, beside = tetrahedra_of(points)
    assert len(np.unique(np.sort(tetrahedra, axis=1), axis=0)) == len(tetrahedra)
    volume = tetrahedron_volumes(points[tetrahedra]).sum()
    expected = np.abs(tetrahedron_volumes(points[carving.Delaunay(points).simplices])).sum()
    assert volume == pytest.approx(expected, rel=1e-6)
    owner, face = np.nonzero(beside >= 0)
    behind = beside[owner, face]
    assert np.all((beside[behind] == owner[:, None]).any(axis=1))
    for own, corner, other in zip(owner[:200], face[:200], behind[:200], strict=True):
        assert set(np.delete(tetrahedra[own], corner)) <= set(tetrahedra[other])
    outer = carving.Solid(points, tetrahedra, beside).surface[0]
    across = np.cross(points[outer[:, 1]] - points[outer[:, 0]], points[outer[:, 2]] - points[outer[:, 0]])
    facing = np.einsum("ij,ij->i", across, points[outer[:, 0]] - points.mean(axis=0))
    assert facing.min() > -1e-9 * facing.max()  # also of flat tetrahedra
    if name == "two lines":
        assert len(tetrahedra) == 59 * 59  # more than there was room for


def test_points_in_a_plane_have_none() -> None:
    flat = np.column_stack([RNG.random((40, 2)), np.zeros(40)])
    for bad in (flat, flat[:3], np.zeros((30, 3))):
        with pytest.raises(np.linalg.LinAlgError):
            tetrahedra_of(bad)
    turned = flat @ np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    with pytest.raises(InputError, match="plane"):
        carving.carve(turned)


def test_ways_in_are_those_of_python(both: Callable[[Callable[[], Any]], tuple[Any, Any]]) -> None:
    coarse = np.random.default_rng(0).uniform(1.0, 3.0, len(HAMMER))
    tetrahedra, beside = tetrahedra_of(HAMMER)
    (reach, order, parent), (radii, _, parents) = both(lambda: carving._reach(HAMMER, coarse, tetrahedra, beside))
    np.testing.assert_allclose(reach, radii, rtol=1e-12)
    np.testing.assert_array_equal(parent[:-1], parents[:-1])
    place = np.empty(len(order) + 1, np.int64)
    place[order] = np.arange(len(order))
    place[-1] = -1
    assert np.all(place[parent[order]] < place[order])


def test_sides_and_pockets_are_those_of_python(both: Callable[[Callable[[], Any]], tuple[Any, Any]]) -> None:
    solid = carving.carve(HAMMER)

    def run() -> list[Array]:
        normals = pockets.oriented_normals(HAMMER, solid.surface[0])
        return [surface_fit.side_normals(solid, 0.005), normals, carving.Stone(HAMMER).carve(0.0003).volumes]

    for one, other in zip(*both(run), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("count", [1, 7, 24])
def test_nearest_points_are_those_of_a_tree(count: int) -> None:
    places = np.concatenate([HAMMER[:300], RNG.uniform(-0.2, 0.2, (100, 3))])
    for cube in (1e-4, 5e-3, 1.0):
        distances, numbers = nearest_of(HAMMER, places, count, cube)
        expected = cKDTree(HAMMER).query(places, k=np.arange(1, count + 1))
        np.testing.assert_allclose(distances, expected[0], rtol=1e-12)
        np.testing.assert_array_equal(numbers, expected[1])


def test_bad_input_is_refused() -> None:
    three, one = np.zeros((2, 3), np.int64), np.zeros(1, np.int64)
    tetrahedra, beside = tetrahedra_of(HAMMER)
    known = {name: np.zeros(3) for name in ("volume", "area", "weight")}
    known |= {"shade": np.zeros((3, 3)), "moment": np.zeros((3, 10))}
    borders = np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0)
    drawn = Drawn(one, np.zeros((1, 3)), np.zeros((1, 3)))
    ways = ways_in(HAMMER, np.ones(len(HAMMER)), tetrahedra, beside)
    bad: list[Callable[[], object]] = [
        lambda: tetrahedra_of(np.full((30, 3), np.nan)),
        lambda: tetrahedra_of(HAMMER[:, :2]),
        lambda: ways_in(HAMMER[:10], np.ones(10), tetrahedra, beside),
        lambda: ways_in(HAMMER, np.ones(3), tetrahedra, beside),
        lambda: ways_in(HAMMER, np.ones(len(HAMMER)), tetrahedra, beside + len(beside)),
        lambda: nearest_of(HAMMER, HAMMER, 65, 0.01),
        lambda: nearest_of(HAMMER[:3], HAMMER, 4, 0.01),
        lambda: nearest_of(HAMMER, np.full((1, 3), np.inf), 1, 0.01),
        lambda: side_averages(HAMMER, HAMMER[:5], 0.01, 2),
        lambda: normals_of_planes(HAMMER, np.full((len(HAMMER), 4), len(HAMMER)), np.zeros(len(HAMMER), bool), HAMMER),
        lambda: opened_pockets(HAMMER, tetrahedra + 9999, ways, ways[0] > 0, TRUTH > 0, HAMMER, {}),
        lambda: clustered_points((HAMMER, HAMMER, HAMMER), np.array([[0, len(HAMMER)]]), 1, 1, {}),
        lambda: merged_clusters(np.array([[0, 2]]), borders, known, {}),
        lambda: matched_places(HAMMER, three + len(HAMMER), three[:, :2], drawn, HAMMER, {}),
        lambda: matched_places(HAMMER, three, three[:, :2], Drawn(one + 2, drawn.within, drawn.errors), HAMMER, {}),
    ]
    for call in bad:
        with pytest.raises(InputError):
            call()


def test_many_pieces_are_left_to_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hierarchy, "_MOST_COMPILED", 10)
    found: Segmentation = segmentation.segment(HAMMER, COLOURS)
    monkeypatch.setattr(hierarchy, "_MOST_COMPILED", 1000)
    np.testing.assert_array_equal(found.labels, segment(HAMMER, COLOURS).labels)
