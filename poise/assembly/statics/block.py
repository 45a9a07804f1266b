"""One block of the contact interface graph as numbers: contact points, friction cones and loads, scaled to about 1."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array

from poise.assembly.contact import FIXED_NODE, ContactBlock, Structure
from poise.geometry import cross, plane_axes
from poise.types import Array, Indices, Mask

Sparse = Any
"""A sparse array of scipy, which has no published types."""


@dataclass(frozen=True, eq=False)
class Units:
    """In what a block counts: wrenches about `origin` in `weight` and `weight * length`, twists to match.

    Args:
        origin: (3,) m.
        length: m.
        weight: N.
    """

    origin: Array
    length: float
    weight: float

    def of_wrench(self, wrench: Array) -> Array:
        """Wrenches (..., 6) about the world's origin, N and N m, in these units."""
        force = wrench[..., :3]
        moment = (wrench[..., 3:] - cross(self.origin, force)) / self.length
        return np.concatenate([force, moment], axis=-1) / self.weight

    def wrench(self, scaled: Array) -> Array:
        """The inverse of `of_wrench`."""
        force = scaled[..., :3] * self.weight
        moment = scaled[..., 3:] * (self.weight * self.length) + cross(self.origin, force)
        return np.concatenate([force, moment], axis=-1)

    def of_velocity(self, velocity: Array) -> Array:
        """The inverse of `velocity`."""
        angular = velocity[..., 3:]
        return np.concatenate([velocity[..., :3] + cross(angular, self.origin), angular * self.length], axis=-1)

    def velocity(self, twist: Array) -> Array:
        """Twists (..., 6) as velocity of the body's point at the world's origin, m/s, and angular velocity, rad/s.

        A twist times a wrench, both in these units, is the power in W divided by the weight.
        """
        angular = twist[..., 3:] / self.length
        return np.concatenate([twist[..., :3] - cross(angular, self.origin), angular], axis=-1)


@dataclass(frozen=True, eq=False)
class BlockGeometry:
    """Contact points of all interfaces of a block, one after another, and the loads at rest.

    Args:
        supports: (I, 2) bodies on the first and second side of each interface, or FIXED_NODE.
        units: what everything below is counted in.
        points: (K, 3) contact points, from the units' origin.
        frames: (K, 3, 3) rows: normal from the first into the second body, and two tangents.
        friction: (K,) Coulomb coefficients.
        bodies: (K, 2) block bodies on the first and second side, or FIXED_NODE.
        interface: (K,) to which of the block's interfaces each point belongs.
        gravity: (n, 6) wrench of gravity on each body with all that hangs on it.
    """

    supports: Indices
    units: Units
    points: Array
    frames: Array
    friction: Array
    bodies: Indices
    interface: Indices
    gravity: Array

    @property
    def count(self) -> int:
        """Number of bodies."""
        return len(self.gravity)

    @cached_property
    def wrenches(self) -> Array:
        """(K, 3, 6) of unit contact forces (normal and two tangents at each point) on the second body."""
        return np.concatenate([self.frames, cross(self.points[:, None], self.frames)], axis=2)

    @cached_property
    def grasp(self) -> Sparse:
        """(6 n, 3 K) wrenches on the bodies of unit contact forces (normal and two tangents at each point)."""
        return assembled(self.wrenches, self.bodies, self.count)

    @cached_property
    def dense_grasp(self) -> Array:
        """`grasp` with all its entries, for few bodies."""
        count, size = len(self.points), 6 * self.count
        spread = np.zeros((self.count + 1, 6, count, 3))  # the last is FIXED_NODE
        at, columns = np.arange(count), self.wrenches.transpose(0, 2, 1)
        spread[self.bodies[:, 0], :, at] = -columns
        spread[self.bodies[:, 1], :, at] = columns
        return spread[:-1].reshape(size, 3 * count)

    def without(self, idle: Mask) -> "BlockGeometry":
        """The block without the contact points of some of its interfaces (I,)."""
        kept = ~idle[self.interface]
        points = {name: getattr(self, name)[kept] for name in ("points", "frames", "friction", "bodies", "interface")}
        return replace(self, **points)

    @property
    def statically_determinate(self) -> bool:
        """One body on one interface: no contact force can arise without a load."""
        return self.count == 1 and len(self.supports) == 1


def assembled(wrenches: Array, bodies: Indices, count: int) -> Sparse:
    """(6 count, R K) wrenches (K, R, 6) between bodies (K, 2), + on the second and - on the first, one per column."""
    size, each, _ = wrenches.shape
    rows, columns, values = [], [], []
    for side, sign in ((0, -1.0), (1, 1.0)):
        moves = np.flatnonzero(bodies[:, side] != FIXED_NODE)
        row = 6 * bodies[moves, side][:, None, None] + np.arange(6)
        column = each * moves[:, None, None] + np.arange(each)[:, None]
        shape = (len(moves), each, 6)
        rows.append(np.broadcast_to(row, shape).ravel())
        columns.append(np.broadcast_to(column, shape).ravel())
        values.append(sign * wrenches[moves].ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csc_array(coo_array(entries, shape=(6 * count, each * size)))


def block_geometry(structure: Structure, block: ContactBlock) -> BlockGeometry:
    """Collect the contact points and loads of a block."""
    interfaces = [structure.interfaces[number] for number in block.interfaces]
    which = np.repeat(np.arange(len(interfaces)), [len(interface.points) for interface in interfaces])
    points = np.concatenate([interface.points for interface in interfaces])
    normals = np.array([interface.normal for interface in interfaces])
    supports = np.array(block.supports, dtype=np.int64)
    gravity = gravity_wrenches(structure, block)
    objects = structure.assembly.objects
    heads = np.array([objects[members[0]].com_in_world for members in block.members])
    origin = points.mean(axis=0)
    length = np.linalg.norm(np.concatenate([points, heads]) - origin, axis=1).max()
    weight = np.linalg.norm(gravity[:, :3], axis=1).sum()
    units = Units(origin, float(length) or 1.0, float(weight) or 1.0)
    return BlockGeometry(
        supports=supports,
        units=units,
        points=(points - origin) / units.length,
        frames=np.concatenate([normals[:, None], plane_axes(normals)], axis=1)[which],
        friction=np.array([interface.friction for interface in interfaces])[which],
        bodies=supports[which],
        interface=which,
        gravity=units.of_wrench(gravity),
    )


def gravity_wrenches(structure: Structure, block: ContactBlock) -> Array:
    """(n, 6) wrench of gravity about the world's origin, N and N m, on each body of a block with all it carries."""
    assembly = structure.assembly
    wrenches = np.zeros((len(block.members), 6))
    places = [place for members in block.members for place in members]
    body = np.repeat(np.arange(len(block.members)), [len(members) for members in block.members])
    weights = np.array([assembly.objects[place].mass for place in places])[:, None] * np.asarray(assembly.gravity)
    com = np.array([assembly.objects[place].com_in_world for place in places])
    np.add.at(wrenches, body, np.concatenate([weights, cross(com, weights)], axis=1))
    return wrenches
