"""Planner `hm`: heightmap minimisation (Wang and Hauser 2021, "Dense robotic packing of irregular 3D objects").

Orientations in which the object stands on a plane (Goldberg et al. 1999: the faces of its hull, the likely ones first)
are turned about the vertical; each is let down on every cell of the scene's heightmap; the poses that raise the map
least are tried first. When none of the best stays, orientations leaning about both horizontal axes are added.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product

import numpy as np

from poise.assembly import Analysis, RigidObject
from poise.baselines.placement import first_that_stays, radius, surroundings
from poise.geometry import Pose, plane_axes, rotation_about, rotation_between, unit
from poise.placement import ContactFeatures, PlacementPlanner
from poise.placement.packing import heights_over
from poise.types import Array

_CELL = 0.004
"""m, of the heightmap."""
_STABLE, _YAWS = 4, 8
"""Orientations on a plane, and turns of each."""
_LEANING = np.radians([-15.0, 0.0, 15.0])
_BEST = 100
"""Candidates whose stability is looked at, of each round."""
_SPREAD = 1.0
"""Weight of x + y beside the sum of heights (their c)."""


def lowest_first(analysis: Analysis, item: RigidObject, rng: np.random.Generator) -> Iterator[Pose]:
    """Poses by their score: first upright ones, then leaning ones."""
    up = -unit(analysis.assembly.gravity)
    frame = np.vstack([plane_axes(up), up])
    low, high = surroundings(analysis, radius(item))
    corners = np.array(list(product(*zip(low, high, strict=True)))) @ frame.T
    origin = corners.min(axis=0)[:2]
    count = np.ceil((np.ptp(corners, axis=0)[:2]) / _CELL).astype(int)
    scene = np.full(count, (analysis.assembly.objects[0].vertices @ up).min())
    for other in analysis.assembly.objects:
        heights = heights_over(other.shape.polyhedron, other.vertices @ frame.T, origin, count, _CELL)
        scene = np.where(np.isfinite(heights), np.maximum(scene, heights), scene)
    upright = _upright(item, up, rng)
    yield from _by_score(scene, origin, frame, item, upright)
    leaning = [
        rotation_about(frame[0], roll) @ rotation_about(frame[1], pitch) @ rotation
        for rotation in upright
        for roll, pitch in product(_LEANING, _LEANING)
        if roll or pitch
    ]
    yield from _by_score(scene, origin, frame, item, leaning)


def _upright(item: RigidObject, up: Array, rng: np.random.Generator) -> list[Array]:
    """Rotations on the steady faces, the large ones first, each turned evenly from a random start."""
    faces = [face for face in ContactFeatures.of(item.shape, item.com).faces if face.steady][:_STABLE]
    start = rng.uniform(0, 2 * np.pi / _YAWS)
    return [
        rotation_about(up, start + 2 * np.pi * k / _YAWS) @ rotation_between(face.normal, -up)
        for face in faces
        for k in range(_YAWS)
    ]


def _by_score(scene: Array, origin: Array, frame: Array, item: RigidObject, rotations: list[Array]) -> Iterator[Pose]:
    found = []
    polyhedron = item.shape.polyhedron
    for rotation in rotations:
        corners = polyhedron.vertices @ rotation.T @ frame.T
        start = corners.min(axis=0)[:2]
        count = np.ceil(np.ptp(corners, axis=0)[:2] / _CELL).astype(int)
        top = heights_over(polyhedron, corners, start, count, _CELL)
        bottom = -heights_over(polyhedron, corners * [1, 1, -1], start, count, _CELL)
        if np.any(count > scene.shape):
            continue
        height, score = _let_down(scene, top, bottom)
        for index in np.argsort(score, axis=None)[:_BEST]:
            i, j = np.unravel_index(index, score.shape)
            place = np.append(origin + _CELL * np.array([i, j]) - start, height[i, j])
            found.append((float(score[i, j]), Pose(rotation, frame.T @ place)))
    found.sort(key=lambda pair: pair[0])
    yield from (pose for _, pose in found[:_BEST])


def _let_down(scene: Array, top: Array, bottom: Array) -> tuple[Array, Array]:
    """Height of the object's origin when it touches, and the score, at every cell of its corner."""
    places = tuple(np.array(scene.shape) - top.shape + 1)
    filled = np.argwhere(np.isfinite(top))
    height = np.full(places, -np.inf)
    for i, j in filled:
        np.maximum(height, scene[i : i + places[0], j : j + places[1]] - bottom[i, j], out=height)
    raised = np.zeros(places)
    for i, j in filled:
        raised += height + top[i, j] - scene[i : i + places[0], j : j + places[1]]
    x, y = np.indices(places)
    return height, raised + _SPREAD * (x + y) * _CELL


entry = PlacementPlanner("hm", "heightmap minimisation (Wang and Hauser 2021)", partial(first_that_stays, lowest_first))
