"""A solid of tetrahedra: its volume, its moments, its surface."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# The three corners of the face opposite each corner of a tetrahedron.
FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


@dataclass(frozen=True, eq=False)
class Solid:
    """Tetrahedra that fill an object, face to face.

    Args:
        vertices: (V, 3) m.
        tetrahedra: (T, 4) vertex numbers.
        neighbours: (T, 4) the tetrahedron behind the face opposite each corner; -1: outside.
        volume_std: m3, one sigma of the volume.
    """

    vertices: Array
    tetrahedra: Indices
    neighbours: Indices
    volume_std: float = 0.0

    @cached_property
    def volumes(self) -> Array:
        """(T,) m3."""
        return tetrahedron_volumes(self.vertices[self.tetrahedra])

    @cached_property
    def centroids(self) -> Array:
        """(T, 3) m."""
        return np.asarray(self.vertices[self.tetrahedra].mean(axis=1))

    @property
    def volume(self) -> float:
        """m3 of the whole."""
        return float(self.volumes.sum())

    @cached_property
    def surface(self) -> tuple[Indices, Indices]:
        """(F, 3) vertex numbers of the triangles around it, counter-clockwise from outside, and (F,) their owners."""
        owner, corner = np.nonzero(self.neighbours < 0)
        triangles = np.take_along_axis(self.tetrahedra[owner], FACES[corner], axis=1)
        a, b, c = (self.vertices[triangles[:, k]] for k in range(3))
        inner = self.vertices[self.tetrahedra[owner, corner]]
        inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), inner - a) > 0
        triangles[inwards] = triangles[inwards][:, ::-1]
        return triangles, owner


def tetrahedron_volumes(corners: Array) -> Array:
    """(T,) m3 of tetrahedra with corners (T, 4, 3), whichever way they are wound."""
    a, b, c = (corners[:, k] - corners[:, 0] for k in (1, 2, 3))
    return np.asarray(np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6)
