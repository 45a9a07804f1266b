"""Points looked up in depth images."""

from collections.abc import Sequence

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.kernels.arrays import address, contiguous
from poise.kernels.library import library
from poise.types import Array, Indices, Single


def pixels_between(
    depth: Single, rays: Single, part: tuple[int, int, int, int], step: int, plane: Array, heights: Array, jump: float
) -> Indices:
    """(N,) numbers of the pixels of an image that show something between two heights and no edge; needs `COMPILED`.

    Args:
        depth, rays: (H, W) m along the optical axis, and (2, H, W) x/z and y/z.
        part: left, right, top, bottom, without the outermost pixels.
        step: pixels from one that is looked at to the next.
        plane: (4,) how the height over it grows along the camera's axes, and what it is at the camera, m.
        heights: (2,) m between which a pixel counts.
        jump: m between it and the four around it.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    image, directions = (np.ascontiguousarray(each, dtype=np.float32) for each in (depth, rays))
    left, right, top, bottom = part
    whole = image.ndim == 2 and directions.shape == (2, *image.shape) and step > 0
    if not whole or min(left, top) < 0 or bottom > image.shape[0] or right > image.shape[1]:
        raise InputError(ErrorCode.TYPE_MISMATCH, f"rays {directions.shape} of {image.shape} pixels, of which {part}")
    corners, down = np.array(part, dtype=np.int64), contiguous(plane, 4, what="plane").astype(np.float32)
    low, high = heights.tolist()
    found = np.empty(max(right - left, 0) * max(bottom - top, 0), dtype=np.int64)
    given = (*map(address, (image, directions)), *image.shape, address(corners), step, address(down))
    count = library.poise_lookup_pixels(*given, float(down[3]), low, high, jump, address(found))
    return found[:count]


class CompiledLookup:
    """Several depth images of cameras without distortion; needs `COMPILED`. See `poise.scanning.looking.Lookup`.

    Args:
        depths: (H, W) each, m along the optical axis; 0 where nothing is known.
        cameras: (V, 16) rotation (row-major) and translation of each camera in the world, m, and fx fy cx cy, pixels.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """

    def __init__(self, depths: Sequence[Single], cameras: Array) -> None:
        self._depths = [np.ascontiguousarray(depth, dtype=np.float32) for depth in depths]
        self._cameras = contiguous(cameras, len(self._depths), 16, what="cameras")
        if any(depth.ndim != 2 for depth in self._depths):
            raise InputError(ErrorCode.TYPE_MISMATCH, "a depth image has rows and columns")
        self._sizes = np.array([depth.shape[::-1] for depth in self._depths], dtype=np.int64).reshape(-1, 2)
        self._first = np.array([address(depth) or 0 for depth in self._depths], dtype=np.uintp)
        self._images = (len(self._depths), *map(address, (self._first, self._sizes, self._cameras)))

    def beyond(self, points: Array) -> Single:
        """(V, N) m from points (N, 3) to what each view sees in their direction; NaN where it sees nothing."""
        at = contiguous(points, -1, 3, what="points")
        found = np.empty((len(self._depths), len(at)), dtype=np.float32)
        library.poise_lookup_beyond(*self._images, len(at), address(at), address(found))
        return found

    def agreement(self, points: Array, band: float) -> tuple[Indices, Indices, Array]:
        """(N,) views that see points within a band, m; (N,) through them; (N, 3) toward the cameras of the former."""
        at = contiguous(points, -1, 3, what="points")
        counts, toward = np.zeros((2, len(at)), dtype=np.int64), np.zeros((len(at), 3))
        sums = map(address, (counts[0], counts[1], toward))
        library.poise_lookup_agreement(*self._images, len(at), address(at), band, *sums)
        return counts[0], counts[1], toward

    def offsets(self, points: Array, normals: Array, band: float, slant: float) -> tuple[Array, Array]:
        """(N,) weights, and (N,) weighted distances along the normals, m, of what the views see within a band, m."""
        at = contiguous(points, -1, 3, what="points")
        up = contiguous(normals, len(at), 3, what="normals")
        sums = np.zeros((2, len(at)))
        given = (len(at), address(at), address(up), band, slant)
        library.poise_lookup_offsets(*self._images, *given, address(sums[0]), address(sums[1]))
        return sums[0], sums[1]
