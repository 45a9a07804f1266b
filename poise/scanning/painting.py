"""Colours for depth that is not aligned to them: each depth pixel is looked up in the colour camera."""

import numpy as np
from numpy.typing import NDArray

from poise.geometry import Pose
from poise.scanning.camera import Camera, rotated
from poise.types import Single


def painted(
    depth: Single, camera: Camera, colours: NDArray[np.uint8], lens: Camera, pose_colour_depth: Pose
) -> NDArray[np.uint8]:
    """(H, W, 3) RGB of what each depth pixel shows; black where the colour camera does not see it.

    What hides a point from the colour camera alone, a few cm beside, is not asked for.

    Args:
        depth: (H, W) m; 0 where nothing is known.
        camera: of the depth.
        colours: (H', W', 3) RGB.
        lens: of the colours.
        pose_colour_depth: of the depth camera's optical frame in that of the colour camera.
    """
    row, column = np.nonzero(depth > 0)
    there = depth[row, column]
    x, y = camera.rays[:, row, column]
    points = rotated(np.stack([x * there, y * there, there], axis=1), pose_colour_depth.rotation)
    points = points + pose_colour_depth.translation.astype(points.dtype)
    ahead = points[:, 2] > 1e-3
    points[~ahead, 2] = 1.0
    u, v = lens.project(points)
    inside = ahead & (u > -0.5) & (v > -0.5) & (u < lens.width - 0.5) & (v < lens.height - 0.5)
    out = np.zeros((*depth.shape, 3), np.uint8)
    seen = colours[np.round(v[inside]).astype(np.int64), np.round(u[inside]).astype(np.int64)]
    out[row[inside], column[inside]] = seen
    return out
