"""Turns and mirrorings about the vertical that carry a block into itself: they carry answers into answers, too."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.elastic_contacts import ElasticContacts
from poise.geometry import cross, lengths, plane_axes
from poise.types import Array, Indices

_SAME = 1e-8
"""By how much lengths, forces and stiffnesses of a block and of its image may differ, in the block's units."""
_ON_AXIS = 1e-3
"""Interfaces nearer than this to the axis do not show how far a turn goes."""
_MOST = 16
"""Images of one interface that are tried at most: discs have many."""
_GENERIC = np.array([0.7548776662466927, 0.5698402909980532, 0.4301597090019468, *np.sqrt([2, 3, 5, 7, 11, 13, 17])])
"""Weights of a sum that no two different places share by accident."""


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A turn or mirroring of space that carries a block into itself, gravity and friction included.

    Args:
        turn: (3, 3) orthogonal, about the origin of the block's units.
        bodies: (n,) the body into which each is carried.
    """

    turn: Array
    bodies: Indices

    @cached_property
    def _turned(self) -> Array:
        """(6, 6) of wrenches and twists about the origin, as rows: moments and rotations do not follow mirrors."""
        both = np.zeros((6, 6))
        both[:3, :3] = self.turn.T
        both[3:, 3:] = np.linalg.det(self.turn) * self.turn.T
        return both

    @cached_property
    def inverse(self) -> "Symmetry":
        """What undoes it."""
        return Symmetry(self.turn.T, np.argsort(self.bodies))

    def vectors(self, vectors: Array) -> Array:
        """Images of vectors (..., 3), or of points from the origin."""
        return np.asarray(vectors @ self.turn.T)

    def wrenches(self, wrenches: Array) -> Array:
        """Images of wrenches or twists (..., 6) about the origin."""
        return np.asarray(wrenches @ self._turned)

    def of_bodies(self, rows: Array) -> Array:
        """Images of loads, displacements or motions (6 n,) of the bodies."""
        image = np.empty((len(self.bodies), 6))
        image[self.bodies] = self.wrenches(rows.reshape(-1, 6))
        return image.ravel()

    def carries(self, loads: Array) -> bool:
        """Whether the image of each combination of loads (6 n, 3) along x, y and z is that of the image direction."""
        images = np.stack([self.of_bodies(load) for load in loads.T], axis=1)
        return bool(np.abs(images - loads @ self.turn).max() <= _SAME * max(float(np.abs(loads).max()), 1.0))


def symmetries(geometry: BlockGeometry, contacts: ElasticContacts) -> tuple[Symmetry, ...]:
    """All turns and mirrorings about gravity's direction through the origin that carry a block into itself.

    Without the identity. What is compared are gravity and the springs of elastic contacts, whose corners are the
    contact points of limit analysis. Shapes and inertias are not part of it.
    """
    weight = geometry.gravity[:, :3].sum(axis=0)
    size = float(np.linalg.norm(weight))
    if size <= _SAME:
        return ()
    springs = _Springs(geometry, contacts)
    found = (springs.symmetry(turn) for turn in springs.turns(-weight / size))
    return tuple(one for one in found if one is not None)


class _Springs:
    """Places, normals, stiffness and friction of the springs of a block, to be compared with their images."""

    def __init__(self, geometry: BlockGeometry, contacts: ElasticContacts) -> None:
        wrenches = contacts.wrenches
        self._gravity, self._sides, self._interface = geometry.gravity, contacts.sides, contacts.interface
        # m = p x f for three forces f at right angles: the sum of f x m is 2 p.
        self._points = cross(wrenches[:, :, :3], wrenches[:, :, 3:]).sum(axis=1) / 2
        self._values = np.column_stack([contacts.stiffness, contacts.friction])
        self._starts = np.searchsorted(contacts.interface, np.arange(len(contacts.sides)))
        self._normals = wrenches[self._starts, 0, :3]
        counts = np.diff(np.append(self._starts, len(wrenches)))
        self._centres = np.add.reduceat(self._points, self._starts) / counts[:, None]
        self._original = self._interfaces_as(np.eye(3))
        self._rank = np.argsort(self._original @ _GENERIC)
        self._order = np.lexsort((self._points @ _GENERIC[:3], self._interface))

    def _interfaces_as(self, turn: Array) -> Array:
        """(I, 10) centre, plane and stiffness of each interface after a turn."""
        normals = self._normals @ turn.T
        x, y, z = normals.T
        planes = np.stack([x * x, y * y, z * z, x * y, y * z, z * x], axis=1)
        stiffness = np.add.reduceat(self._values[:, 0], self._starts)
        return np.column_stack([self._centres @ turn.T, planes, stiffness])

    def turns(self, up: Array) -> Iterator[Array]:
        """(3, 3) turns and mirrorings that carry an interface, of which there are few alike, into one like it.

        Or a spring, where the axis passes through all interfaces.
        """
        axes = plane_axes(up)
        places, normals = self._centres, self._normals
        if (lengths(places - np.outer(places @ up, up)) <= _ON_AXIS).all():
            places, normals = self._points, normals[self._interface]
        x, y = (places @ axes.T).T
        height, radius, flat = places @ up, np.hypot(x, y), np.abs(normals @ up)
        kinds = np.column_stack([height, radius, flat])
        _, group, sizes = np.unique(np.round(kinds, 6), axis=0, return_inverse=True, return_counts=True)
        usable = np.flatnonzero(radius > _ON_AXIS)
        if not len(usable):
            return
        one = usable[sizes[group.ravel()[usable]].argmin()]
        others = np.flatnonzero(np.abs(kinds - kinds[one]).max(axis=1) <= _SAME)
        frame = np.vstack([axes, up])
        for other in others.tolist() if len(others) <= _MOST else ():
            for mirrored in (False, True):
                # A turn carries an azimuth a into a + b; a mirroring into b - a.
                angle = np.arctan2(y[other], x[other]) + (1 if mirrored else -1) * np.arctan2(y[one], x[one])
                if other == one and not mirrored:
                    continue
                c, s, sign = np.cos(angle), np.sin(angle), -1.0 if mirrored else 1.0
                yield frame.T @ np.array([[c, -sign * s, 0.0], [s, sign * c, 0.0], [0.0, 0.0, 1.0]]) @ frame

    def symmetry(self, turn: Array) -> Symmetry | None:
        """The symmetry with a turn or mirroring (3, 3); None where the block is another one after it."""
        moved = self._interfaces_as(turn)
        rank = np.argsort(moved @ _GENERIC)
        if np.abs(moved[rank] - self._original[self._rank]).max() > _SAME:
            return None
        image = np.empty(len(rank), dtype=np.int64)
        image[rank] = self._rank
        bodies = self._bodies(turn, image)
        if bodies is None:
            return None
        found = Symmetry(turn, bodies)
        points = found.vectors(self._points)
        order = np.lexsort((points @ _GENERIC[:3], image[self._interface]))
        same = (
            np.array_equal(image[self._interface][order], self._interface[self._order])
            and np.abs(points[order] - self._points[self._order]).max() <= _SAME
            and np.abs(self._values[order] - self._values[self._order]).max() <= _SAME
            and np.abs(found.wrenches(self._gravity) - self._gravity[bodies]).max() <= _SAME
        )
        return found if same else None

    def _bodies(self, turn: Array, image: Indices) -> Indices | None:
        """(n,) into which body each is carried when interfaces are carried into their images (I,); None: no one."""
        ground = len(self._gravity)
        along = np.einsum("ij,ij->i", self._normals @ turn.T, self._normals[image])
        there = np.where(along[:, None] > 0, self._sides[image], self._sides[image][:, ::-1])
        bodies = np.full(ground + 1, -1)
        bodies[self._sides] = there
        if not np.array_equal(bodies[self._sides], there) or bodies[ground] not in (-1, ground):
            return None
        return bodies[:ground] if np.array_equal(np.sort(bodies[:ground]), np.arange(ground)) else None
