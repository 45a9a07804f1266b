"""Unit vectors, axes in a plane, cross products, and wrenches of forces."""

import math

import numpy as np

from poise.types import Array


def unit(vector: Array) -> Array:
    """The vectors (..., 3) at length 1."""
    length: Array = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / length


def cross(a: Array, b: Array, axis: int = -1) -> Array:
    """a x b along an axis of length three, broadcast; `numpy.cross` is slower on small arrays."""
    last = a.swapaxes(axis, -1), b.swapaxes(axis, -1)
    (a0, a1, a2), (b0, b1, b2) = ((v[..., 0], v[..., 1], v[..., 2]) for v in last)
    first = np.asarray(a1 * b2 - a2 * b1)
    out = np.empty((*first.shape, 3))
    out[..., 0], out[..., 1], out[..., 2] = first, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return out.swapaxes(axis, -1)


def lengths(vectors: Array) -> Array:
    """(...,) of vectors (..., 3); `numpy.linalg.norm` along the last axis takes several times as long."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def applied(matrices: Array, vector: Array) -> Array:
    """(..., a) matrices (..., a, b) applied to one vector (b,), in one product: `matmul` takes ten times as long."""
    rows = matrices.reshape(math.prod(matrices.shape[:-1]), matrices.shape[-1])
    return np.asarray(rows @ vector).reshape(matrices.shape[:-1])


def plane_axes(normals: Array) -> Array:
    """(..., 2, 3) two unit vectors that make a right-handed frame (u, v, n) with each unit normal (..., 3).

    Duff et al. 2017, "Building an orthonormal basis, revisited": no branch, no loss of digits.
    """
    x, y, z = normals[..., 0], normals[..., 1], normals[..., 2]
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    axes = np.empty((*normals.shape[:-1], 2, 3))
    axes[..., 0, 0], axes[..., 0, 1], axes[..., 0, 2] = 1 + sign * x * x * a, sign * b, -sign * x
    axes[..., 1, 0], axes[..., 1, 1], axes[..., 1, 2] = b, sign + y * y * a, -y
    return axes


def wrench_of_force(force: Array, point: Array) -> Array:
    """(..., 6) force, and its moment about the origin, of forces (..., 3) at points (..., 3)."""
    force, point = np.broadcast_arrays(force, point)
    return np.concatenate([force, cross(point, force)], axis=-1)


def move_wrench(wrench: Array, origin: Array) -> Array:
    """(..., 6) wrenches with their moments taken about another origin (3,)."""
    force = wrench[..., :3]
    return np.concatenate([force, wrench[..., 3:] - cross(np.asarray(origin), force)], axis=-1)


def sphere_directions(count: int) -> Array:
    """(count, 3) unit vectors spread evenly over the sphere, from +z to -z (a Fibonacci lattice)."""
    steps = np.arange(count) + 0.5
    height = 1.0 - 2.0 * steps / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * steps
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), height], axis=1)
