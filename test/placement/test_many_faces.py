"""Features of meshes with thousands of faces: convex edges, pairs of faces at an angle, and a placement of a scan."""

import numpy as np
import pytest
import trimesh

from poise.assembly import Assembly, Box, RigidObject
from poise.assembly.scene import Mesh
from poise.geometry import Pose
from poise.placement import ContactFeatures, plan_placement


def potato(subdivisions: int) -> Mesh:
    """An uneven ball."""
    rough = trimesh.creation.icosphere(subdivisions, radius=0.05)
    sizes = 1 + 0.02 * np.random.default_rng(1).normal(size=(len(rough.vertices), 1))
    return Mesh(rough.vertices * [1, 0.8, 0.6] * sizes, rough.faces.astype(np.int64))


def test_convex_edges_of_an_uneven_mesh_are_those_that_trimesh_finds() -> None:
    shape = potato(2)
    features, other = (
        ContactFeatures.of(shape, None),
        trimesh.Trimesh(shape.vertices, shape.triangles, process=False),
    )
    places = {tuple(np.round(np.sort([edge.start, edge.end], axis=0).ravel(), 9)) for edge in features.edges}
    convex = other.face_adjacency_edges[other.face_adjacency_convex]
    assert places == {tuple(np.round(np.sort(ends, axis=0).ravel(), 9)) for ends in other.vertices[convex]}
    assert 0 < len(places) < len(other.face_adjacency)


@pytest.mark.parametrize("subdivisions", [1, 3])  # few faces are all compared, many are drawn
def test_pairs_of_faces_are_at_the_angle_that_is_asked_for(subdivisions: int) -> None:
    features = ContactFeatures.of(potato(subdivisions), None)
    assert (len(features.faces) > 500) == (subdivisions == 3)
    rng = np.random.default_rng(3)
    pairs = [features.pair_at(np.pi / 2, np.radians(1), rng) for _ in range(30)]
    angles = [np.arccos(pair[0].normal @ pair[1].normal) for pair in pairs if pair is not None]
    assert len(angles) >= 25
    assert np.allclose(angles, np.pi / 2, atol=np.radians(1))
    assert features.pair_at(3.5, np.radians(1), rng) is None


def test_a_scan_of_thousands_of_faces_is_placed() -> None:
    floor = RigidObject("floor", Box((1.0, 1.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    box = RigidObject("box", Box((0.3, 0.2, 0.1)), Pose(np.eye(3), np.array([0, 0, 0.05])), mass=1.0)
    scene = Assembly((floor, box), np.array([0, 0, -9.81]), 0.5)
    item = RigidObject("potato", potato(4), Pose.identity(), mass=0.5)
    assert len(plan_placement(scene, item).analysis.assembly.objects) == 3
