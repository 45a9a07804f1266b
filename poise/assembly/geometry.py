"""Small vector helpers of the assembly: rotations, plane axes, wrenches of forces."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is: x_parent = rotation @ x_child + translation.

    Args:
        rotation: (3, 3).
        translation: (3,) m.
    """

    rotation: Array
    translation: Array

    @classmethod
    def from_vector(cls, vector: ArrayLike) -> "Pose":
        """Read (7,) x y z and a unit quaternion x y z w."""
        values = np.asarray(vector, dtype=np.float64)
        return cls(rotation_of_quaternion(values[3:]), values[:3].copy())

    @property
    def vector(self) -> Array:
        """(7,) x y z and the quaternion x y z w, w not negative."""
        return np.concatenate([self.translation, quaternion_of_rotation(self.rotation)])

    def apply(self, points: Array) -> Array:
        """Points (..., 3) of the child frame, in the parent's."""
        return points @ self.rotation.T + self.translation

    def undo(self, points: Array) -> Array:
        """Points (..., 3) of the parent frame, in the child's."""
        return (points - self.translation) @ self.rotation


def rotation_of_quaternion(quaternion: ArrayLike) -> Array:
    """(3, 3) rotation of a quaternion x y z w of any length but zero."""
    x, y, z, w = np.asarray(quaternion, dtype=np.float64) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of_rotation(rotation: Array) -> Array:
    """(4,) unit quaternion x y z w, w not negative, of a rotation matrix.

    The eigenvector of Bar-Itzhack's matrix (2000, "New method for extracting the quaternion from a rotation matrix"):
    no case splits, and well conditioned for every angle.
    """
    r = rotation
    matrix = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    quaternion: Array = np.linalg.eigh(matrix)[1][:, 3]
    return -quaternion if quaternion[3] < 0 else quaternion


def unit(vector: Array) -> Array:
    """The vector (..., 3) at length 1."""
    length: Array = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / length


def plane_axes(normals: Array) -> Array:
    """(..., 2, 3) two unit vectors that make a right-handed frame (u, v, n) with each unit normal (..., 3).

    Duff et al. 2017, "Building an orthonormal basis, revisited": no branch, no loss of digits.
    """
    x, y, z = np.moveaxis(normals, -1, 0)
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    u = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    v = np.stack([b, sign + y * y * a, -y], axis=-1)
    return np.stack([u, v], axis=-2)


def rotation_about(axis: Array, angle: float) -> Array:
    """(3, 3) rotation about a unit axis (3,) (Rodrigues; thesis eq. 5.17)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def rotation_between(start: Array, end: Array) -> Array:
    """The least rotation (3, 3) that turns a unit vector into another."""
    cosine = float(start @ end)
    if cosine < -1 + 1e-12:
        return rotation_about(plane_axes(start)[0], np.pi)
    cross = np.cross(start, end)
    x, y, z = cross
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1 + cosine))


def wrench_of_force(force: Array, point: Array) -> Array:
    """(..., 6) force, and its moment about the origin, of forces (..., 3) at points (..., 3)."""
    force, point = np.broadcast_arrays(force, point)
    return np.concatenate([force, np.cross(point, force)], axis=-1)


def move_wrench(wrench: Array, origin: Array) -> Array:
    """(..., 6) the same wrench, its moment taken about another origin (3,)."""
    force = wrench[..., :3]
    return np.concatenate([force, wrench[..., 3:] - np.cross(origin, force)], axis=-1)
