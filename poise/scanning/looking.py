"""Points looked up in depth images: does a view see a point, look through it, or see something before it?"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from poise.scanning.camera import rotated
from poise.scanning.frames import View
from poise.types import Single

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
    ahead = there[:, 2]
    safe = np.where(ahead > 1e-3, ahead, np.float32(1))
    there[:, 2] = safe
    u, v = camera.project(there)
    inside = (ahead > 1e-3) & (u > -0.5) & (v > -0.5) & (u < camera.width - 0.5) & (v < camera.height - 0.5)
    column, row = (np.where(inside, value + 0.5, 0).astype(np.int32) for value in (u, v))
    seen = depth.ravel()[row * camera.width + column]
    beyond = np.where(inside & (seen > 0), seen - ahead, np.float32(np.nan))
    return Looked(beyond, rotated(there / safe[:, None], view.rotation_world_camera))


def each(views: Sequence[View], work: Callable[[View], Result]) -> list[Result]:
    """Work on all views, on two cores, in their order."""
    if WORKERS < 2:
        return [work(view) for view in views]
    with ThreadPoolExecutor(WORKERS) as pool:
        return list(pool.map(work, views))
