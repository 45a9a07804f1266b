"""The rigid pose of a frame in its parent."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.geometry.rotations import quaternion_of_rotation, rotation_of_quaternion
from poise.types import Array


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a child frame is in its parent: x_parent = rotation @ x_child + translation.

    The arrays may have leading axes: N poses are one Pose with rotations (N, 3, 3) and translations (N, 3).

    Args:
        rotation: (..., 3, 3).
        translation: (..., 3) m.
    """

    rotation: Array
    translation: Array

    @classmethod
    def identity(cls) -> "Pose":
        """The pose of a frame in itself."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_vector(cls, vector: ArrayLike) -> "Pose":
        """Read (..., 7) x y z in m and a quaternion x y z w of any length but zero."""
        values = np.asarray(vector, dtype=np.float64)
        return cls(rotation_of_quaternion(values[..., 3:]), values[..., :3].copy())

    @property
    def vector(self) -> Array:
        """(..., 7) x y z and the unit quaternion x y z w, w not negative."""
        return np.concatenate([self.translation, quaternion_of_rotation(self.rotation)], axis=-1)

    @property
    def inverse(self) -> "Pose":
        """The pose of the parent frame in the child."""
        return Pose(np.swapaxes(self.rotation, -1, -2), -_rotated(self.translation, self.rotation))

    def __matmul__(self, pose_child_grandchild: "Pose") -> "Pose":
        """pose_parent_grandchild = pose_parent_child @ pose_child_grandchild; leading axes broadcast."""
        moved = np.einsum("...ij,...j->...i", self.rotation, pose_child_grandchild.translation)
        return Pose(self.rotation @ pose_child_grandchild.rotation, moved + self.translation)

    def apply(self, points: Array) -> Array:
        """Points (..., 3) of the child frame, in the parent's; for a single pose."""
        return points @ self.rotation.T + self.translation

    def undo(self, points: Array) -> Array:
        """Points (..., 3) of the parent frame, in the child's; for a single pose."""
        return (points - self.translation) @ self.rotation


def _rotated(vectors: Array, rotation: Array) -> Array:
    return np.asarray(np.einsum("...ji,...j->...i", rotation, vectors))
