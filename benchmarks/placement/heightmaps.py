"""Rivals that pack on a heightmap: deepest-bottom-left-fill, and the heightmap minimisation of Wang and Hauser.

Both let every object down at every cell in every orientation that Poise tries, the largest object first. Neither looks
at stability, nor at another order.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage, signal

from poise.assembly import RigidObject
from poise.geometry import Pose
from poise.placement.packing import Container, Turned, heights_over, turns_of
from poise.types import Array

CELL = 2e-3
"""m: as fine as the gap that Poise leaves."""
_NEAR = 1.0
"""Weight of x + y beside the raised volume, in cells (the c of Wang and Hauser)."""
_FAR = -1e3
"""m: lower than anything."""
RIVALS = ("deepest-bottom-left-fill", "heightmap minimisation")


def pack_on_heightmap(rival: str, container: Container, items: Sequence[RigidObject]) -> list[RigidObject]:
    """The objects where a rival puts them, in order; what finds no place within the walls is left out."""
    size = container.high - container.low
    ground = np.full(np.floor(size / CELL + 1e-9).astype(int), container.floor)
    placed = []
    for item in sorted(items, key=lambda item: -float(np.prod(np.ptp(item.shape.polyhedron.vertices, axis=0)))):
        best: tuple[tuple[float, ...], Array, Pose, Array, tuple[int, int]] | None = None
        for turned in turns_of(item, -np.inf)[0]:
            found = _best(rival, ground, item, turned)
            if found is not None and (best is None or found[0] < best[0]):
                best = found
        if best is None:
            continue
        _, corner, pose, top, (i, j) = best
        part = ground[i : i + top.shape[0], j : j + top.shape[1]]
        np.maximum(part, corner[2] + top, out=part)
        place = pose.translation + corner + np.append(container.low, 0.0)
        there = Pose(container.axes.T @ pose.rotation, container.axes.T @ place)
        placed.append(replace(item, pose=there))
    return placed


def _best(
    rival: str, ground: Array, item: RigidObject, turned: Turned
) -> tuple[tuple[float, ...], Array, Pose, Array, tuple[int, int]] | None:
    polyhedron = item.shape.polyhedron
    corners = turned.pose.apply(polyhedron.vertices)
    count = np.ceil(turned.size[:2] / CELL - 1e-9).astype(int)
    if np.any(count > ground.shape):
        return None
    top, bottom = _maps(item, corners, count)
    inside = np.isfinite(top)
    rests = _let_down(ground, bottom, inside)
    x, y = np.indices(rests.shape)
    if rival == RIVALS[0]:
        order = np.lexsort((x.ravel(), y.ravel(), np.round(rests.ravel(), 9)))[0]
        i, j = np.unravel_index(order, rests.shape)
        cost: tuple[float, ...] = (round(float(rests[i, j]), 9), int(j), int(i), float(turned.size[2]))
    else:
        mask = inside.astype(float)
        under = signal.fftconvolve(ground, mask[::-1, ::-1], mode="valid")
        raised = mask.sum() * rests + np.where(inside, top, 0.0).sum() - under
        score = raised + _NEAR * (x + y) * CELL
        i, j = np.unravel_index(int(np.argmin(np.round(score, 9))), rests.shape)
        cost = (round(float(score[i, j]), 9),)
    corner = np.array([i * CELL, j * CELL, rests[i, j]])
    return cost, corner, turned.pose, top, (int(i), int(j))


def _maps(item: RigidObject, corners: Array, count: Array) -> tuple[Array, Array]:
    """Highest and lowest point of an object over each cell that it reaches into; minus and plus infinity elsewhere."""
    fine = 3
    top = heights_over(item.shape.polyhedron, corners, np.zeros(2), count * fine, CELL / fine)
    bottom = -heights_over(item.shape.polyhedron, corners * [1, 1, -1], np.zeros(2), count * fine, CELL / fine)
    cells = (count[0], fine, count[1], fine)
    return top.reshape(cells).max(axis=(1, 3)), bottom.reshape(cells).min(axis=(1, 3))


def _let_down(ground: Array, bottom: Array, inside: Array) -> Array:
    """Height at which the lowest point comes to rest, for every cell of the corner."""
    if np.ptp(bottom[inside]) < 1e-9:
        options = {"size": inside.shape} if inside.all() else {"footprint": inside}
        highest = ndimage.maximum_filter(ground, mode="constant", cval=-np.inf, **options) - bottom[inside].min()
        first = [n // 2 for n in inside.shape]
    else:
        drop = np.where(inside, -bottom, _FAR)
        highest = ndimage.grey_dilation(ground, structure=drop[::-1, ::-1], mode="constant", cval=_FAR)
        first = [(n - 1) // 2 for n in inside.shape]
    last = np.array(first) + ground.shape - inside.shape + 1
    return np.asarray(highest[first[0] : last[0], first[1] : last[1]])
