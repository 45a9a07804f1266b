"""The door for shapes: closed bodies are parts, one body is cut, and what is no shape of something held is refused."""

import numpy as np
import pytest
import trimesh

from poise.errors import ErrorCode, InputError
from poise.inertia.model.object_shape import PIECES, load_object
from poise.inertia.model.parts import box_moments, phi_of_pseudo_inertia

SIDES = (0.2, 0.05, 0.03)


@pytest.fixture
def box() -> trimesh.Trimesh:
    return trimesh.creation.box(SIDES).subdivide()


def phi_of_box() -> np.ndarray:
    phi = phi_of_pseudo_inertia(box_moments(np.zeros((1, 3)), np.array([SIDES]))[0])
    return phi / phi[0]


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_a_mesh_of_one_body_is_cut_into_pieces_that_add_up_to_it(box, tmp_path, suffix):
    box.export(tmp_path / f"box.{suffix}")
    shape = load_object(tmp_path / f"box.{suffix}")
    assert len(shape.parts) == PIECES
    assert shape.parts.likeness is not None
    assert 0.6 < shape.parts.likeness.min() < shape.parts.likeness.max() == 1.0
    assert shape.parts.volumes.sum() == pytest.approx(np.prod(SIDES), rel=1e-6)
    np.testing.assert_allclose(shape.parts.homogeneous_phi, phi_of_box(), atol=1e-9)
    assert shape.parts.volumes.min() > 0.5 / PIECES * np.prod(SIDES)


def test_a_mesh_of_one_body_is_cut_where_it_narrows(tmp_path):
    profile = [[0, 0], [0.03, 0], [0.03, 0.05], [0.008, 0.05], [0.008, 0.2], [0, 0.2]]
    mesh = trimesh.creation.revolve(profile, sections=48)
    mesh.export(tmp_path / "mallet.stl")
    shape = load_object(tmp_path / "mallet.stl")
    assert "segmented" in shape.words
    assert shape.parts.volumes.sum() == pytest.approx(mesh.volume, rel=1e-5)
    above = shape.parts.unit_phi[3] > 0.05
    assert shape.parts.volumes[above].sum() == pytest.approx(np.pi * 0.008**2 * 0.15, rel=0.2)


def test_bodies_of_a_mesh_are_its_parts(box, tmp_path):
    ball = trimesh.creation.icosphere(radius=0.02)
    ball.apply_translation([0.12, 0, 0])
    trimesh.util.concatenate([box, ball]).export(tmp_path / "two.ply")
    shape = load_object(tmp_path / "two.ply")
    assert sorted(shape.parts.volumes) == pytest.approx(sorted([np.prod(SIDES), ball.volume]), rel=1e-5)


def test_a_cavity_is_no_part(box, tmp_path):
    hole = trimesh.creation.box(0.5 * np.array(SIDES))
    hole.invert()
    trimesh.util.concatenate([box, hole]).export(tmp_path / "hollow.ply")
    assert load_object(tmp_path / "hollow.ply").parts.volumes.sum() == pytest.approx(0.875 * np.prod(SIDES), rel=1e-3)


def test_a_surface_with_holes_is_filled(box, tmp_path):
    open_box = trimesh.Trimesh(box.vertices, box.faces[6:], process=False)
    open_box.export(tmp_path / "open.ply")
    shape = load_object(tmp_path / "open.ply")
    assert "not closed" in shape.words
    assert shape.parts.volumes.sum() == pytest.approx(np.prod(SIDES), rel=0.15)


@pytest.mark.parametrize("suffix", ["xyz", "npy"])
def test_a_cloud_becomes_a_solid(box, tmp_path, suffix):
    points = np.asarray(trimesh.sample.sample_surface(box, 800, seed=1)[0])
    path = tmp_path / f"cloud.{suffix}"
    if suffix == "npy":
        np.save(path, points)
    else:
        np.savetxt(path, points)
    shape = load_object(path)
    assert shape.parts.volumes.sum() == pytest.approx(np.prod(SIDES), rel=0.1)
    np.testing.assert_allclose(shape.parts.homogeneous_phi[1:4], 0, atol=3e-3)


def test_a_shape_is_placed_in_the_sensor_frame(box, tmp_path):
    box.export(tmp_path / "box.stl")
    half = np.sqrt(0.5)
    placed = load_object(tmp_path / "box.stl").placed([0.1, 0.2, 0.3], [0.0, half, 0.0, half])
    phi = placed.parts.homogeneous_phi
    np.testing.assert_allclose(phi[1:4], [0.1, 0.2, 0.3], atol=1e-9)
    np.testing.assert_allclose(np.ptp(placed.parts.points, axis=0), [0.03, 0.05, 0.2], atol=1e-9)  # x is now along -z


@pytest.mark.parametrize("pose", [([0, 0, 0], [0, 0, 0, 0]), ([0, 0, np.nan], [0, 0, 0, 1])])
def test_a_pose_that_is_none_is_refused(box, tmp_path, pose):
    box.export(tmp_path / "box.stl")
    with pytest.raises(InputError) as caught:
        load_object(tmp_path / "box.stl").placed(*pose)
    assert caught.value.code is ErrorCode.BAD_INPUT


def test_millimetres_are_told_from_metres(box, tmp_path):
    box.apply_scale(1000)
    box.export(tmp_path / "box.stl")
    with pytest.raises(InputError, match=r"--object-scale 0\.001") as caught:
        load_object(tmp_path / "box.stl")
    assert caught.value.code is ErrorCode.OBJECT_INVALID
    assert load_object(tmp_path / "box.stl", 0.001).parts.volumes.sum() == pytest.approx(np.prod(SIDES), rel=1e-5)


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("no.stl", None, ErrorCode.FILE_UNREADABLE),
        ("shape.docx", b"x", ErrorCode.UNSUPPORTED),
        ("bad.stl", b"not a mesh at all", ErrorCode.FILE_CORRUPT),
        ("bad.ply", b"ply\nnonsense", ErrorCode.FILE_CORRUPT),
        ("empty.obj", b"", ErrorCode.FILE_CORRUPT),
        ("nan.ply", None, ErrorCode.NOT_FINITE),
    ],
)
def test_what_is_no_shape_is_refused_with_a_code(box, tmp_path, name, content, code):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    elif name == "nan.ply":
        box.vertices[0] = np.nan
        box.export(path)
    with pytest.raises(InputError) as caught:
        load_object(path)
    assert caught.value.code is code
    assert name in caught.value.message
