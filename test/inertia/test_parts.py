"""Parts: integrals over shapes against closed forms, and labels that cut a surface into the right pieces."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.inertia import InertialParameters
from poise.inertia.model.parts import Parts, box_moments, surface_moments
from poise.shape.solid import tetrahedron_moments


def box_phi(sides: np.ndarray, centre: np.ndarray, mass: float = 1.0) -> np.ndarray:
    inertia = mass / 12 * (sides @ sides * np.eye(3) - np.diag(sides**2))
    return InertialParameters(mass, centre, inertia).phi


def test_a_box_has_the_inertia_of_the_text_book() -> None:
    sides, centre = np.array([0.1, 0.2, 0.3]), np.array([0.3, -0.1, 0.05])
    mesh = trimesh.creation.box(sides)
    mesh.apply_translation(centre)
    parts = Parts.from_surface(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(parts.volumes, [sides.prod()], rtol=1e-12)
    np.testing.assert_allclose(parts.unit_phi[:, 0], box_phi(sides, centre), atol=1e-14)
    np.testing.assert_allclose(box_moments([centre], [sides])[0], surface_moments(mesh.triangles), atol=1e-15)


def test_a_tetrahedron_agrees_with_its_surface_whatever_its_winding() -> None:
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(4, 3))
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    moments = tetrahedron_moments(corners)
    np.testing.assert_allclose(surface_moments(corners[faces]), moments, atol=1e-14)
    one = Parts.from_tetrahedra(corners, [[0, 1, 2, 3]])
    other = Parts.from_tetrahedra(corners, [[1, 0, 2, 3]])
    np.testing.assert_allclose(one.unit_phi, other.unit_phi, atol=1e-14)
    np.testing.assert_allclose(one.unit_phi[1:4, 0], corners.mean(axis=0), atol=1e-14)


def test_labels_cut_a_bar_into_its_two_parts() -> None:
    sides = np.array([0.3, 0.02, 0.001])
    mesh = trimesh.creation.box(sides)
    cloud = trimesh.sample.sample_surface(mesh, 4000, seed=1)[0]
    labels = np.where(cloud[:, 0] < 0.05, 7, 3)
    parts = Parts.from_surface(mesh.vertices, mesh.faces, cloud, labels)
    np.testing.assert_allclose(parts.volumes.sum(), sides.prod(), rtol=1e-12)
    np.testing.assert_allclose(parts.homogeneous_phi, box_phi(sides, np.zeros(3)), atol=1e-14)
    left = box_phi(np.array([0.2, 0.02, 0.001]), np.array([-0.05, 0, 0]))
    np.testing.assert_allclose(parts.unit_phi[:, 1], left, atol=3e-4)  # as sharp as the cloud is dense
    np.testing.assert_allclose(parts.volumes[1], 2 / 3 * sides.prod(), rtol=5e-3)


def test_parts_move_with_their_frame() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    rotation = Rotation.random(random_state=2).as_matrix()
    shift = np.array([0.1, 0.2, -0.3])
    moved = trimesh.Trimesh(mesh.vertices @ rotation.T + shift, mesh.faces, process=False)
    labels = (mesh.vertices[:, 2] > 0).astype(int)
    parts = Parts.from_surface(mesh.vertices, mesh.faces, mesh.vertices, labels).in_frame(rotation, shift)
    np.testing.assert_allclose(
        parts.whole.unit_phi, Parts.from_surface(moved.vertices, moved.faces).unit_phi, atol=1e-13
    )
    np.testing.assert_allclose(parts.points, moved.vertices, atol=1e-15)


def test_an_open_surface_is_refused() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    labels = (mesh.vertices[:, 2] > 0).astype(int)
    with pytest.raises(InputError) as caught:
        Parts.from_surface(mesh.vertices, mesh.faces[:900], mesh.vertices, labels)
    assert caught.value.code == ErrorCode.MESH_INVALID
    with pytest.raises(InputError) as caught:
        Parts.from_surface(mesh.vertices, mesh.faces[:, ::-1], mesh.vertices, labels)
    assert caught.value.code == ErrorCode.MESH_INVALID


@pytest.mark.parametrize(
    ("unit_phi", "volumes", "code"),
    [
        (np.ones((10, 2)), np.ones(3), ErrorCode.TYPE_MISMATCH),
        (np.full((10, 1), np.nan), np.ones(1), ErrorCode.NOT_FINITE),
        (np.ones((10, 1)), np.zeros(1), ErrorCode.BAD_INPUT),
        (np.ones((10, 0)), np.ones(0), ErrorCode.BAD_INPUT),
    ],
)
def test_parts_that_cannot_be_are_refused(unit_phi: np.ndarray, volumes: np.ndarray, code: ErrorCode) -> None:
    with pytest.raises(InputError) as caught:
        Parts(unit_phi, volumes, np.zeros((4, 3)))
    assert caught.value.code == code
