"""Distances between planes of bodies and points of others, and how they change when the bodies move a little."""

from dataclasses import dataclass, fields

import numpy as np

from poise.geometry import Pose, cross, rotation_of_vector, vector_of_rotation
from poise.types import Array, Indices, Mask


@dataclass(frozen=True, eq=False)
class DistanceRows:
    """Points of second bodies over planes of first bodies; a distance each.

    Args:
        first, second: (M,) places of the bodies.
        normal, origin: (M, 3) of the plane, in the first body's frame; the normal leaves it.
        point: (M, 3) in the second body's frame, m.
        offset: (M,) m, what the second body reaches beyond its point: the radius, when the point is on an axis.
    """

    first: Indices
    second: Indices
    normal: Array
    origin: Array
    point: Array
    offset: Array

    def __len__(self) -> int:
        return len(self.first)

    def __getitem__(self, rows: Indices | Mask) -> "DistanceRows":
        return DistanceRows(*(getattr(self, field.name)[rows] for field in fields(self)))

    @classmethod
    def joined(cls, parts: "list[DistanceRows]") -> "DistanceRows":
        """The rows of all parts, in order."""
        if not parts:
            none = np.zeros(0, dtype=np.int64)
            return cls(none, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def linearised(self, poses: Pose) -> tuple[Array, Array, Array]:
        """Distances (M,), m, and their derivatives (M, 6) for steps of the first and of the second body.

        Steps are (translation, m, rotation vector, rad) in the assembly's axes, as `moved` applies them.
        """
        normal = np.einsum("mij,mj->mi", poses.rotation[self.first], self.normal)
        origin = np.einsum("mij,mj->mi", poses.rotation[self.first], self.origin) + poses.translation[self.first]
        arm = np.einsum("mij,mj->mi", poses.rotation[self.second], self.point)
        point = arm + poses.translation[self.second]
        distance = np.einsum("mi,mi->m", point - origin, normal) - self.offset
        of_second = np.concatenate([normal, cross(arm, normal)], axis=1)
        of_first = -np.concatenate([normal, cross(point - poses.translation[self.first], normal)], axis=1)
        return distance, of_first, of_second


def moved(poses: Pose, steps: Array) -> Pose:
    """N poses after steps (N, 6): translations, m, and rotation vectors about the origins of the bodies, rad."""
    return Pose(rotation_of_vector(steps[:, 3:]) @ poses.rotation, poses.translation + steps[:, :3])


def steps_between(start: Pose, end: Pose) -> Array:
    """(N, 6) steps that `moved` takes from N poses to others."""
    turn = vector_of_rotation(end.rotation @ np.swapaxes(start.rotation, 1, 2))
    return np.concatenate([end.translation - start.translation, turn], axis=1)
