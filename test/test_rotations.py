"""Conversions of rotations against those of scipy, with bad input, and products of matrices with a vector."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.geometry import (
    applied,
    quaternion_of_rotation,
    rotation_about,
    rotation_of_quaternion,
    rotation_of_vector,
    vector_of_rotation,
)

QUARTERS = np.array(np.meshgrid(*[[0.0, 90.0, 180.0, -90.0, 179.9999999]] * 3)).reshape(3, -1).T
TURNS = Rotation.concatenate([Rotation.random(300, rng=1), Rotation.from_euler("xyz", QUARTERS, degrees=True)])


def test_conversions_are_those_of_scipy() -> None:
    matrices, quaternions = TURNS.as_matrix(), TURNS.as_quat(canonical=True)
    assert np.allclose(quaternion_of_rotation(matrices), Rotation.from_matrix(matrices).as_quat(canonical=True))
    assert np.allclose(rotation_of_quaternion(3.0 * quaternions), matrices, atol=1e-14)
    vectors = np.concatenate([TURNS.as_rotvec(), np.zeros((1, 3)), 1e-9 * np.eye(3), 7.0 * np.eye(3)])
    assert np.allclose(rotation_of_vector(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-14)
    assert np.allclose(rotation_of_vector(vector_of_rotation(matrices)), matrices, atol=1e-12)
    assert np.allclose(vector_of_rotation(np.eye(3)), 0.0)
    assert np.allclose(rotation_about([0, 0, 1.0], 0.3), Rotation.from_euler("z", 0.3).as_matrix())


def test_matrices_that_are_nearly_rotations_are_made_rotations_and_others_refused() -> None:
    rough = TURNS.as_matrix()[:50] + 1e-4 * np.random.default_rng(2).normal(size=(50, 3, 3))
    assert np.allclose(quaternion_of_rotation(rough), Rotation.from_matrix(rough).as_quat(canonical=True))
    with pytest.raises(ValueError, match="determinant"):
        quaternion_of_rotation(np.stack([np.eye(3), np.diag([1.0, 1.0, -1.0])]))
    assert np.isnan(rotation_of_quaternion([[0.0, 0, 0, 0], [np.nan, 0, 0, 1]])).all()
    assert quaternion_of_rotation(np.zeros((0, 3, 3))).shape == (0, 4)


@pytest.mark.parametrize("shape", [(5, 4, 3), (3, 3), (2, 5, 6, 3), (5, 4, 0), (0, 3, 3)])
def test_matrices_applied_to_one_vector(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    matrices, vector = rng.normal(size=shape), rng.normal(size=shape[-1])
    np.testing.assert_allclose(applied(matrices, vector), matrices @ vector, atol=1e-14)
    across = np.moveaxis(rng.normal(size=(shape[-1], *shape[:-1])), 0, -1)
    np.testing.assert_allclose(applied(across, vector), across @ vector, atol=1e-14)
