"""What no view saw into may be a hollow: both hypotheses are stated, and identification may take either."""

import numpy as np
import pytest
import trimesh

from poise.inertia.model.object_shape import PIECES, parts_of_segmentation, shape_of_cloud
from poise.inertia.model.parameters import pseudo_inertia
from poise.shape.segmentation import Segmentation, segment

SIDES = np.array([0.1, 0.07, 0.06])


def scanned(sides: np.ndarray, unseen: bool = True, colours: bool = False) -> Segmentation:
    """A box of sides (3,) m whose bottom was not seen, as a scan makes it; in two colours, if wanted."""
    mesh = trimesh.creation.box(sides)
    points, face = trimesh.sample.sample_surface(mesh, 6000, seed=1)
    points = np.asarray(points) + np.random.default_rng(0).normal(scale=3e-4, size=(6000, 3))
    normals = np.asarray(mesh.face_normals)[face]
    seen = (normals[:, 2] > -0.9) | (not unseen)
    shades = np.where(points[:, :1] > 0, [[0.8, 0.1, 0.1]], [[0.1, 0.1, 0.8]]) if colours else None
    return segment(points, shades, normals=normals, seen=seen, doubt=np.where(seen, 0.0, 5e-4))


def test_a_box_may_be_solid_or_upside_down_without_a_bottom() -> None:
    found = scanned(SIDES)
    solid, shell = np.prod(SIDES), np.prod(SIDES) - np.prod(SIDES - [0.004, 0.004, 0.002])
    assert found.solid.volume == pytest.approx(solid, abs=2 * found.solid.volume_std)
    assert found.solid.volume_std < 0.05 * solid  # of the one that is solid, it stays useful
    assert found.volume_if_hollow is not None
    assert found.volume_if_hollow == pytest.approx(shell, rel=0.2)
    assert found.hollow is not None
    assert found.hollow.opening == pytest.approx(SIDES[0] * SIDES[1], rel=0.15)
    assert "if it is hollow" in " ".join(found.notes)


def test_what_was_seen_all_around_or_has_no_room_is_no_hollow() -> None:
    assert scanned(SIDES, unseen=False).hollow is None
    plate = scanned(np.array([0.1, 0.07, 0.003]))
    assert plate.volume_if_hollow is None
    assert "if it is hollow" not in " ".join(plate.notes)


def test_the_hollow_is_a_part_that_may_weigh_nothing() -> None:
    found = scanned(SIDES, colours=True)
    parts = parts_of_segmentation(found)
    assert found.volume_if_hollow is not None
    assert parts.volumes.sum() == pytest.approx(found.solid.volume, rel=1e-6)
    assert parts.volumes[:-1].sum() == pytest.approx(found.volume_if_hollow, rel=0.1)
    walls = pseudo_inertia(parts.unit_phi[:, :-1] @ parts.volumes[:-1])
    assert walls[2, 3] / walls[3, 3] > 0.004  # the centre of a box without a bottom is higher
    assert parts.likeness is not None
    assert np.all(parts.likeness[-1, :-1] == 0)


def test_pieces_of_one_part_leave_the_hollow_to_another() -> None:
    found = scanned(SIDES)
    parts = shape_of_cloud(found).parts
    assert len(parts) == PIECES + 1
    assert parts.likeness is not None
    assert np.all(parts.likeness[-1, :-1] == 0)
    assert parts.volumes.sum() == pytest.approx(found.solid.volume, rel=1e-6)
    for phi in parts.unit_phi.T:
        assert np.linalg.eigvalsh(pseudo_inertia(phi)).min() > 0
