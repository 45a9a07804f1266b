"""A solid of tetrahedra: its volume, its moments, its surface."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.geometry import cross, lengths
from poise.shape.grouping import linked
from poise.types import Array, Indices, Mask

_TINY = 1e-30
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


@dataclass(frozen=True, eq=False)
class Solid:
    """Tetrahedra that fill an object, face to face.

    Args:
        vertices: (V, 3) m.
        tetrahedra: (T, 4) vertex numbers, right-handed; one that is inside out takes away.
        neighbours: (T, 4) the tetrahedron behind the face opposite each corner; -1: outside.
        volume_std: m3, one sigma of the volume.
        between: m3, where its points leave a wide gap: about the volume if the gap is an opening, as that of a cup, and
            if it is a hole in the sampling; None where there is no such gap.
    """

    vertices: Array
    tetrahedra: Indices
    neighbours: Indices
    volume_std: float = 0.0
    between: tuple[float, float] | None = None

    @cached_property
    def volumes(self) -> Array:
        """(T,) m3; negative where a tetrahedron is inside out."""
        return tetrahedron_volumes(self.vertices[self.tetrahedra])

    def require_substance(self) -> None:
        """Check that it is more than noise.

        Raises:
            InputError: EMPTY: its volume is uncertain by more than itself.
        """
        if self.volume_std > self.volume:
            uncertain = f"{100 * self.volume_std / max(self.volume, 1e-12):.0f} %"
            raise InputError(ErrorCode.EMPTY, f"its volume, {1e6 * self.volume:.2g} cm3, is uncertain by {uncertain}")

    def only(self, kept: Mask) -> "Solid":
        """Some of its tetrahedra (T,)."""
        number = np.full(len(kept) + 1, -1)
        number[:-1][kept] = np.arange(np.count_nonzero(kept))
        return replace(self, tetrahedra=self.tetrahedra[kept], neighbours=number[self.neighbours[kept]])

    def pieces(self) -> tuple[Array, Indices]:
        """(P,) m3 of what hangs together by faces, and (T,) the piece of each tetrahedron."""
        owner, behind = np.repeat(np.arange(len(self.tetrahedra)), 4), self.neighbours.ravel()
        member = linked(len(self.tetrahedra), np.stack([owner[behind >= 0], behind[behind >= 0]], axis=1))
        return np.bincount(member, self.volumes).astype(np.float64), member

    @cached_property
    def centroids(self) -> Array:
        """(T, 3) m."""
        return np.asarray(self.vertices[self.tetrahedra].mean(axis=1))

    @property
    def volume(self) -> float:
        """m3 of the whole."""
        return float(self.volumes.sum())

    @cached_property
    def areas(self) -> Array:
        """(F,) m2 of the triangles around it."""
        corners = self.vertices[self.surface[0]]
        return lengths(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])) / 2

    @cached_property
    def surface(self) -> tuple[Indices, Indices]:
        """(F, 3) vertex numbers of the triangles around it, counter-clockwise from outside, and (F,) their owners."""
        owner, corner = np.nonzero(self.neighbours < 0)
        triangles = np.take_along_axis(self.tetrahedra[owner], FACES[corner], axis=1)
        return triangles, owner


def tetrahedron_volumes(corners: Array) -> Array:
    """(T,) m3 of tetrahedra with corners (T, 4, 3); negative for left-handed ones."""
    a, b, c = (corners[:, k] - corners[:, 0] for k in (1, 2, 3))
    return np.asarray(np.einsum("ij,ij->i", a, cross(b, c)) / 6)


def tetrahedron_moments(corners: ArrayLike) -> Array:
    """(..., 4, 4) pseudo-inertia at unit density of tetrahedra (..., 4, 3); negative for left-handed corners.

    With homogeneous corners p and their sum s it is V/20 (s s^T + sum p p^T), the integral of quadratics on a simplex.
    """
    points = np.asarray(corners, dtype=np.float64)
    homogeneous = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    edges = points[..., 1:, :] - points[..., :1, :]
    volume = np.linalg.det(edges) / 6
    total = homogeneous.sum(axis=-2)
    outer = total[..., :, None] * total[..., None, :] + homogeneous.swapaxes(-1, -2) @ homogeneous
    return np.asarray(volume[..., None, None] / 20 * outer)


def part_moments(solid: Solid, labels: Indices) -> Array:
    """(P, 4, 4) pseudo-inertia of each part at unit density; the sums of `tetrahedron_moments`.

    Args:
        solid: its tetrahedra.
        labels: (T,) the part of each, from 0 on.
    """
    order = np.argsort(labels, kind="stable")
    bounds = np.searchsorted(labels[order], np.arange(int(labels.max()) + 2))
    corners = solid.vertices[solid.tetrahedra[order]]
    points = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2)
    volumes, totals = solid.volumes[order], points.sum(axis=1)
    moments = np.empty((len(bounds) - 1, 4, 4))
    for part, own in enumerate(slice(*pair) for pair in pairwise(bounds)):
        weighted = (points[own] * volumes[own, None, None]).reshape(-1, 4)
        sums = (totals[own] * volumes[own, None]).T @ totals[own]
        moments[part] = (sums + weighted.T @ points[own].reshape(-1, 4)) / 20
    return moments


def circumspheres(corners: Array) -> tuple[Array, Array]:
    """(T, 3) m, centres, and (T,) m, radii of the spheres through tetrahedra (T, 4, 3); infinite for flat ones."""
    edges = corners[:, 1:] - corners[:, :1]
    squares = np.einsum("tij,tij->ti", edges, edges)
    a, b, c = edges[:, 0], edges[:, 1], edges[:, 2]
    turned = squares[:, :1] * cross(b, c) + squares[:, 1:2] * cross(c, a) + squares[:, 2:] * cross(a, b)
    doubled = 2 * np.einsum("ij,ij->i", a, cross(b, c))
    flat = np.abs(doubled) < _TINY
    off = turned / np.where(flat, 1.0, doubled)[:, None]
    return corners[:, 0] + off, np.where(flat, np.inf, lengths(off))
