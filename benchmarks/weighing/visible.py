"""How far a trouble can be seen at all: what the best payload leaves of a wrench without noise, against the noise."""

import numpy as np

from benchmarks.foreign.robots import Array
from benchmarks.weighing.still_air import STEP

STRIDE = 10
"""Steps of 1 ms between the samples that are compared."""


def columns(felt: Array, omega: Array, alpha: Array) -> Array:
    """(n, 6, 16) wrench by mass, first moments, inertia about the sensor (xx xy xz yy yz zz) and six offsets.

    Args:
        felt: (n, 3) m/s2, gravity less acceleration. omega, alpha: (n, 3) rad/s and rad/s2. All in sensor axes.
    """
    found = np.zeros((len(felt), 6, 16))
    found[:, :3, 0] = felt
    found[:, :, 10:] = np.eye(6)
    for axis, unit in enumerate(np.eye(3)):
        found[:, :3, 1 + axis] = -np.cross(alpha, unit) - np.cross(omega, np.cross(omega, unit))
        found[:, 3:, 1 + axis] = np.cross(unit, felt)
    for column, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), start=4):
        tensor = np.zeros((3, 3))
        tensor[i, j] = tensor[j, i] = 1.0
        found[:, 3:, column] = -alpha @ tensor - np.cross(omega, omega @ tensor)
    return found


def motion(place: Array, turn: Array, gravity: float) -> tuple[Array, Array, Array]:
    """felt, omega and alpha of a course of poses at each step, in sensor axes."""
    acceleration = np.gradient(np.gradient(place, STEP, axis=0), STEP, axis=0)
    rate = np.einsum("nji,njk->nik", turn, np.gradient(turn, STEP, axis=0))
    omega = np.stack([rate[:, 2, 1], rate[:, 0, 2], rate[:, 1, 0]], axis=1)
    felt = np.einsum("nji,nj->ni", turn, [0.0, 0.0, -gravity] - acceleration)
    return felt, omega, np.gradient(omega, STEP, axis=0)


def visibility(place: Array, turn: Array, wrench: Array, noise: Array, rate: float, gravity: float) -> float:
    """Sigmas by which an ideal test would see that no payload explains a wrench.

    Args:
        place, turn: (N, 3) m and (N, 3, 3), the course at each step. wrench: (N, 6) without noise.
        noise: (6,) one sigma of a sample. rate: samples a second. gravity: m/s2, as the model has it.
    """
    rows = np.arange(100, len(place) - 100, STRIDE)
    design = columns(*(part[rows] for part in motion(place, turn, gravity))) / noise[:, None]
    target = wrench[rows] / noise
    flat = design.reshape(-1, 16)
    scale = np.linalg.norm(flat, axis=0)
    solution = np.linalg.lstsq(flat / scale, target.ravel(), rcond=None)[0]
    left = float(np.sum((target.ravel() - flat / scale @ solution) ** 2))
    return float(np.sqrt(left * rate * STRIDE * STEP))
