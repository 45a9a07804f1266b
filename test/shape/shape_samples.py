"""Points on surfaces whose volume is known, for the tests of this folder."""

import numpy as np
from numpy.typing import NDArray

from poise.types import Array


def box(rng: np.random.Generator, sides: tuple[float, float, float], count: int, middle: Array | None = None) -> Array:
    """(count, 3) m on the six faces of a box, as many per area everywhere."""
    size = np.array(sides)
    areas = size.prod() / size
    axis = rng.choice(3, count, p=areas / areas.sum())
    points = rng.uniform(-0.5, 0.5, (count, 3))
    points[np.arange(count), axis] = rng.choice([-0.5, 0.5], count)
    return points * size + (0 if middle is None else middle)


def sphere(rng: np.random.Generator, radius: float, count: int) -> Array:
    """(count, 3) m."""
    directions = rng.normal(size=(count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def torus(rng: np.random.Generator, ring: float, tube: float, count: int) -> Array:
    """(count, 3) m; the tube's outside is drawn more often, as its area asks."""
    around, across = rng.uniform(0, 2 * np.pi, (2, 4 * count))
    kept = rng.uniform(0, ring + tube, 4 * count) < ring + tube * np.cos(across)
    around, across = around[kept][:count], across[kept][:count]
    reach = ring + tube * np.cos(across)
    return np.stack([reach * np.cos(around), reach * np.sin(around), tube * np.sin(across)], axis=1)


def cylinder(rng: np.random.Generator, radius: float, length: float, count: int) -> Array:
    """(count, 3) m along x, with its two ends."""
    ends = rng.random(count) < radius / (radius + length)
    angle = rng.uniform(0, 2 * np.pi, count)
    reach = np.where(ends, radius * np.sqrt(rng.random(count)), radius)
    x = np.where(ends, rng.choice([-0.5, 0.5], count), rng.uniform(-0.5, 0.5, count)) * length
    return np.stack([x, reach * np.cos(angle), reach * np.sin(angle)], axis=1)


def mallet(rng: np.random.Generator, count: int) -> tuple[Array, Array, NDArray[np.int64]]:
    """A grey box 0.04 x 0.12 x 0.04 m on a brown handle 0.2 m long: points, colours and true parts."""
    head = box(rng, (0.04, 0.12, 0.04), count, np.array([0.12, 0.0, 0.0]))
    handle = cylinder(rng, 0.012, 0.2, count)
    handle = handle[handle[:, 0] < 0.0999]
    labels = np.repeat([0, 1], [len(head), len(handle)])
    colours = np.array([[0.5, 0.5, 0.5], [0.5, 0.3, 0.1]])[labels]
    return np.concatenate([head, handle]), colours, labels
