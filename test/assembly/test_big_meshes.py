"""Meshes of many vertices: short ways of reading them and of finding contacts give what long ones give."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
import shapely

from benchmarks.big_meshes import HEIGHT, answered, ball_with_flat, content
from poise.assembly import Box, Mesh, RigidObject
from poise.assembly.contact.placed import placed
from poise.assembly.scene import Polyhedron
from poise.assembly.statics.pushes import surface_distance
from poise.errors import InputError
from poise.geometry import Pose, distinct_numbers, rotation_of_vector, unique_rows
from poise.shape.mesh_formats import read_obj


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj"])
def test_a_ball_with_a_flat_topples_over_the_rim_of_its_flat(suffix: str, tmp_path: Path) -> None:
    points, triangles = ball_with_flat(2_000)
    (tmp_path / f"ball{suffix}").write_bytes(content(points, triangles, suffix))
    rim = np.hypot(*points[points[:, 2] == -HEIGHT, :2].T).max()
    assert answered(tmp_path, suffix) == pytest.approx(9.81 * rim / HEIGHT, rel=2e-3)


@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize("kind", [np.int64, np.float64])
@pytest.mark.parametrize("low", [-3, 0])
def test_distinct_rows_are_those_of_numpy(columns: int, kind: type, low: int) -> None:
    for count in (0, 1, 400):
        rows = np.random.default_rng(count).integers(low, 4, (count, columns)).astype(kind)
        values, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        found, which = unique_rows(rows)
        assert np.array_equal(rows[found], values)
        assert np.array_equal(found, first)
        assert np.array_equal(which, number.reshape(-1))


@pytest.mark.parametrize("shape", [(0,), (1,), (400,), (50, 3)])
def test_distinct_numbers_are_those_of_numpy(shape: tuple[int, ...]) -> None:
    numbers = np.random.default_rng(5).integers(-9, 40, shape)
    assert np.array_equal(distinct_numbers(numbers), np.unique(numbers))


def test_the_distance_of_few_points_from_a_mesh_is_that_of_many() -> None:
    item = RigidObject("ball", Mesh(*ball_with_flat(2_000)), Pose.identity(), mass=1.0)
    points = 0.12 * np.random.default_rng(2).normal(size=(20, 3))
    assert np.array_equal(
        surface_distance(item, points), np.array([surface_distance(item, p[None])[0] for p in points])
    )


def test_edges_push_where_the_direction_is_between_their_normals() -> None:
    turned = Pose(rotation_of_vector(np.array([0.3, 0.2, 0.1])), np.zeros(3))
    body = placed(RigidObject("box", Box((1.0, 2.0, 3.0)), turned, fixed=True))
    edges = np.arange(len(body.edges))
    for direction in np.random.default_rng(3).normal(size=(200, 3)):
        # A direction across one of the edges: at random, nothing is square to an edge.
        along = body.vertices[body.edges[0, 1]] - body.vertices[body.edges[0, 0]]
        across = direction - direction @ along / (along @ along) * along
        across /= np.linalg.norm(across)
        between = body.edge_normals @ across >= -1e-3
        lengths = body.vertices[body.edges[:, 1]] - body.vertices[body.edges[:, 0]]
        square = np.abs(lengths @ across) < 1e-2 * np.linalg.norm(lengths, axis=1)
        assert np.array_equal(body.edges_push(edges, across), between.all(axis=1) & square)


def test_areas_and_centres_of_facets_are_those_of_their_polygons() -> None:
    polyhedron = Mesh(*ball_with_flat(300)).polyhedron
    facet = int(np.argmin(polyhedron.normals[:, 2]))
    flat = polyhedron.polygon(facet, polyhedron.vertices, np.zeros(3), np.eye(3)[:2])
    assert isinstance(flat, shapely.Polygon)
    assert polyhedron.facet_areas[facet] == pytest.approx(flat.area)
    assert polyhedron.facet_centres[facet] == pytest.approx([flat.centroid.x, flat.centroid.y, -HEIGHT])
    heights = np.einsum("ij,ij->i", polyhedron.normals, polyhedron.facet_centres)
    assert polyhedron.facet_areas @ heights / 3 == pytest.approx(Mesh(*ball_with_flat(300)).volume)


@pytest.mark.parametrize(
    ("second", "area", "crosses"),
    [
        (
            [[0, 0], [4, 1], [1, 4]],
            8 + 7.5 - 4.8,
            True,
        ),  # their edges cross
        ([[1, 1], [5, 1], [1, 5]], 8 + 8 - 2, False),  # they overlap, and no error says so
        ([[4, 0], [4, 4], [0, 4]], 8 + 8, False),
    ],
)
def test_a_facet_of_triangles_that_cross_is_their_union(second: list[list[int]], area: float, crosses: bool) -> None:
    corners = np.array([[[0, 0], [4, 0], [0, 4]], second], dtype=np.float64)
    with pytest.raises(shapely.errors.GEOSException) if crosses else contextlib.nullcontext():
        shapely.coverage_union_all(shapely.polygons(corners))
    vertices = np.insert(corners.reshape(-1, 2), 2, 0.3, axis=1)
    none = np.zeros((0, 2), dtype=np.int64)
    triangles, facet = np.arange(6).reshape(2, 3), np.zeros(2, dtype=np.int64)
    bent = Polyhedron(vertices, triangles, facet, np.array([[0.0, 0.0, 1.0]]), none, none, False)
    outline = bent.polygon(0, vertices, np.zeros(3), np.eye(3)[:2])
    assert outline.is_valid
    assert outline.area == pytest.approx(area)


@pytest.mark.parametrize(
    "lines",
    [
        ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "f 1 3 2", "f 1 2 4"],
        [" v 0 0 0", "v 1 0 0", "v\t0 1 0", "v 0 0 1", "f 1 3 2", "\tf 1 2 4"],
        ["v 0 0 0", "v 1 0 0", "v 0 1 0", "f -3 -1 -2", "v 0 0 1", "f 1/1 2/1 4/1"],
        ["v 0 0 0 1", "v 1 0 0", "v 0 1 0 1 1 1", "v 0 0 1", "vn 0 0 1", "f 1//1 3//1 2//1", "f 1 2 4"],
        ["# v 9 9 9", "o thing", "v 0 0 \\", "0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "f 1 3 2", "f 1 2 4"],
    ],
)
def test_obj_files_give_the_same_arrays_however_they_are_written(lines: list[str]) -> None:
    for end in ("\n", "\r\n"):
        vertices, triangles = read_obj(end.join(lines).encode(), "mesh.obj")
        assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        assert triangles.tolist() == [[0, 2, 1], [0, 1, 3]]


def test_an_obj_line_that_cannot_be_read_is_named() -> None:
    with pytest.raises(InputError, match="line 2 cannot be read"):
        read_obj(b"v 0 0 0\nv 1 0 x\nv 0 1 0\nf 1 2 3\n", "mesh.obj")
    with pytest.raises(InputError, match="line 4 cannot be read"):
        read_obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3.5\n", "mesh.obj")
