"""Points looked up in depth images: does a view see a point, look through it, or see something before it?"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from poise.kernels import COMPILED, CompiledLookup
from poise.scanning.camera import rotated
from poise.scanning.frames import View
from poise.types import Array, Indices, Single

Item = TypeVar("Item")
Result = TypeVar("Result")
WORKERS = min(2, os.cpu_count() or 1)


@dataclass(frozen=True, eq=False)
class Looked:
    """What one view knows of N points.

    Args:
        beyond: (N,) m along the optical axis from a point to what the camera sees in its direction; NaN where the
            camera sees nothing, or the point is outside of the image.
        rays: (N, 3) from the camera to each point in the world, with length 1 along the optical axis.
    """

    beyond: Single
    rays: NDArray[np.floating]


def look(view: View, points: NDArray[np.floating]) -> Looked:
    """Look up points (N, 3) of the world."""
    camera, depth = view.frame.camera, view.frame.depth
    there = view.in_camera(points)
    ahead = there[:, 2].copy()
    safe = np.where(ahead > 1e-3, ahead, np.float32(1))
    there[:, 2] = safe
    u, v = camera.project(there)
    inside = (ahead > 1e-3) & (u > -0.5) & (v > -0.5) & (u < camera.width - 0.5) & (v < camera.height - 0.5)
    column, row = (np.where(inside, value + 0.5, 0).astype(np.int32) for value in (u, v))
    seen = depth.ravel()[row * camera.width + column]
    beyond = np.where(inside & (seen > 0), seen - ahead, np.float32(np.nan))
    return Looked(beyond, rotated(there / safe[:, None], view.rotation_world_camera))


class Lookup:
    """Points (N, 3) of the world looked up in several views: `CompiledLookup` in Python, and for lenses that distort.

    Args:
        views: whose depth is asked.
    """

    def __init__(self, views: Sequence[View]) -> None:
        self._views = views

    def beyond(self, points: Array) -> Single:
        """(V, N) m from points to what each view sees in their direction; NaN where it sees nothing."""
        return np.array([look(view, points).beyond for view in self._views], np.float32).reshape(-1, len(points))

    def agreement(self, points: Array, band: float) -> tuple[Indices, Indices, Array]:
        """(N,) views that see points within a band, m; (N,) through them; (N, 3) toward the cameras of the former."""
        agree, through = np.zeros((2, len(points)), dtype=np.int64)
        toward = np.zeros((len(points), 3))
        for view in self._views:
            looked = look(view, points)
            near = np.abs(looked.beyond) < band
            agree += near
            through += looked.beyond > band
            toward -= np.where(near, 1 / _lengths(looked.rays), 0)[:, None] * looked.rays
        return agree, through, toward

    def offsets(self, points: Array, normals: Array, band: float, slant: float) -> tuple[Array, Array]:
        """(N,) weights, and (N,) weighted distances along the normals, m, of what the views see within a band, m.

        A view counts with the cosine between ray and normal (N, 3), from `slant` on.
        """
        weights, steps = np.zeros((2, len(points)))
        for view in self._views:
            looked = look(view, points)
            along = np.einsum("ni,ni->n", looked.rays, normals.astype(np.float32))
            facing = -along / _lengths(looked.rays)
            weight = np.where((np.abs(looked.beyond) < band) & (facing > slant), facing, 0)
            weights += weight
            steps += weight * np.nan_to_num(looked.beyond) * along
        return weights, steps


def _lengths(rays: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", rays, rays)))


def lookup(views: Sequence[View]) -> "Lookup | CompiledLookup":
    """The depth images of some views, to look points up in."""
    if not COMPILED or any(view.frame.camera.distortion for view in views):
        return Lookup(views)
    cameras = [
        [
            *view.rotation_world_camera.ravel(),
            *view.translation_world_camera,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
        ]
        for view in views
        for camera in (view.frame.camera,)
    ]
    return CompiledLookup([view.frame.depth for view in views], np.array(cameras).reshape(-1, 16))


def in_all(views: Sequence[View], work: "Callable[[Lookup | CompiledLookup], Result]") -> list[Result]:
    """Work on the views in shares, on two cores."""
    return each([views[first::WORKERS] for first in range(WORKERS)], lambda share: work(lookup(share)))


def each(items: Sequence[Item], work: Callable[[Item], Result]) -> list[Result]:
    """Work on all items, such as views, on two cores, in their order."""
    if WORKERS < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(WORKERS) as pool:
        return list(pool.map(work, items))
