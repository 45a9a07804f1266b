"""A software renderer: triangles and a table into an image of depth, by scan lines, without a GPU."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.scanning import Camera
from poise.types import Array, Indices

_NEAR = 0.02
"""m: what comes closer to the camera is cut away."""
NOTHING, TABLE = -1, -2
"""What a pixel shows when it is no triangle."""
_SUN = np.array([0.35, -0.25, 0.9]) / np.linalg.norm([0.35, -0.25, 0.9])
_AMBIENT = 0.45


@dataclass(frozen=True, eq=False)
class Body:
    """A closed surface in the world: triangles (T, 3, 3) m, counter-clockwise from outside, (T, 3) colours 0..1."""

    triangles: Array
    colours: Array


@dataclass(frozen=True, eq=False)
class Scene:
    """What there is to see.

    Args:
        bodies: the objects.
        table: z of the table's top, m; None: there is none.
        middle, half: (2,) m of the table's rectangle, along x and y.
        table_colour: 0..1.
    """

    bodies: tuple[Body, ...]
    table: float | None = 0.0
    middle: tuple[float, float] = (0.0, 0.0)
    half: tuple[float, float] = (0.6, 0.6)
    table_colour: tuple[float, float, float] = (0.62, 0.56, 0.48)


@dataclass(frozen=True, eq=False)
class Rendering:
    """An image without noise.

    Args:
        depth: (H, W) m along the optical axis; 0 where there is nothing.
        shown: (H, W) number of the triangle over all bodies, `TABLE` or `NOTHING`.
        facing: (H, W) cosine between the surface's normal and the ray.
        colours: (H, W, 3) uint8.
    """

    depth: Array
    shown: Indices
    facing: Array
    colours: NDArray[np.uint8]


def render(scene: Scene, camera: Camera, rotation: Array, translation: Array) -> Rendering:
    """See a scene from a camera at `translation`, turned by `rotation` (world <- camera); no lens distortion."""
    triangles = np.concatenate([body.triangles for body in scene.bodies] or [np.zeros((0, 3, 3))])
    colours = np.concatenate([body.colours for body in scene.bodies] or [np.zeros((0, 3))])
    rays = np.moveaxis(camera.rays.astype(np.float64), 0, -1)
    rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
    closeness, shown = _table(scene, rays, rotation, translation)
    normals = _draw((triangles - translation) @ rotation, camera, rays, closeness, shown)
    # The table and nothing at all come after the triangles.
    in_world = np.concatenate([normals @ rotation.T, np.tile([0.0, 0.0, 1.0], (2, 1))])
    paint = np.concatenate([colours, [scene.table_colour, (0.1, 0.1, 0.12)]])
    light = _AMBIENT + (1 - _AMBIENT) * np.clip(in_world @ _SUN, 0, 1)
    painted = np.clip(np.round(255 * paint * light[:, None]), 0, 255).astype(np.uint8)
    seen = closeness > 0
    row = np.where(shown == TABLE, len(triangles), np.where(shown == NOTHING, len(triangles) + 1, shown))
    facing = np.abs(np.einsum("hwi,hwi->hw", in_world[row] @ rotation, rays)) / np.linalg.norm(rays, axis=-1)
    depth = np.divide(1.0, closeness, out=np.zeros_like(closeness), where=seen)
    return Rendering(depth, shown, np.where(seen, facing, 0.0), painted[row])


def look_at(place: Array, target: Array) -> Array:
    """(3, 3) world <- camera, of an upright camera at a place (3,) m that looks at a target (3,) m."""
    forward = (target - place) / np.linalg.norm(target - place)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def _table(scene: Scene, rays: Array, rotation: Array, translation: Array) -> tuple[Array, Indices]:
    """1/z of the table in each pixel, 0 beside it."""
    shown = np.full(rays.shape[:2], NOTHING, dtype=np.int64)
    if scene.table is None:
        return np.zeros(rays.shape[:2]), shown
    closeness = (rays @ rotation[2]) / (scene.table - translation[2])
    with np.errstate(divide="ignore", invalid="ignore"):
        hit = translation + rays @ rotation.T / closeness[..., None]
        on = np.all(np.abs(hit[..., :2] - scene.middle) <= scene.half, axis=-1) & (closeness > 0)
    shown[on] = TABLE
    return np.where(on, closeness, 0.0), shown


def _draw(corners: Array, camera: Camera, rays: Array, closeness: Array, shown: Indices) -> Array:
    """Draw triangles (T, 3, 3) of the optical frame over what is there; (T, 3) normals."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    offset = np.einsum("ti,ti->t", normals, corners[:, 0])
    drawn = np.flatnonzero((corners[..., 2].min(axis=1) > _NEAR) & (offset < -1e-9))  # those that face the camera
    u, v = camera.project(corners[drawn])
    for start in range(0, len(drawn), 20_000):
        part = slice(start, start + 20_000)
        which, column, row = _pixels(u[part], v[part], camera)
        number = drawn[part][which]
        # A plane n . x = d is seen at 1/z = n . ray / d.
        near = np.einsum("pi,pi->p", normals[number], rays[row, column]) / offset[number]
        np.maximum.at(closeness, (row, column), near)
        wins = near >= closeness[row, column]
        shown[row[wins], column[wins]] = number[wins]
    return normals


def _pixels(u: Array, v: Array, camera: Camera) -> tuple[Indices, Indices, Indices]:
    """All pixels whose centres lie in triangles (T, 3): which triangle, column, row."""
    order = np.argsort(v, axis=1)
    u, v = np.take_along_axis(u, order, axis=1), np.take_along_axis(v, order, axis=1)
    first = np.maximum(np.ceil(v[:, 0]), 0)
    count = np.minimum(np.floor(v[:, 2]), camera.height - 1) - first + 1
    which, row = _spread(first, count)
    u, v = u[which], v[which]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (row - v[:, 0]) / (v[:, 2] - v[:, 0])
        upper = (row - v[:, 0]) / (v[:, 1] - v[:, 0])
        lower = (row - v[:, 1]) / (v[:, 2] - v[:, 1])
        long = u[:, 0] + along * (u[:, 2] - u[:, 0])
        short = np.where(row < v[:, 1], u[:, 0] + upper * (u[:, 1] - u[:, 0]), u[:, 1] + lower * (u[:, 2] - u[:, 1]))
    short = np.where(np.isfinite(short), short, u[:, 1])
    long = np.where(np.isfinite(long), long, u[:, 0])
    first = np.maximum(np.ceil(np.minimum(long, short)), 0)
    count = np.minimum(np.floor(np.maximum(long, short)), camera.width - 1) - first + 1
    span, column = _spread(first, count)
    return which[span], column, row[span]


def _spread(first: Array, count: Array) -> tuple[Indices, Indices]:
    """Counting from `first`, `count` steps each: which one, and the numbers."""
    steps = np.maximum(count, 0).astype(np.int64)
    which = np.repeat(np.arange(len(first)), steps)
    within = np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)
    return which, first[which].astype(np.int64) + within
