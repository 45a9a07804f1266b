"""Parts as PLY files that any viewer opens: the points, or the closed surface, coloured by part."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.shape.segmentation import Segmentation
from poise.types import Array, Indices

_PALETTE = np.array(
    [
        [76, 120, 168], [245, 133, 24], [84, 162, 75], [228, 87, 86], [114, 183, 178], [238, 202, 59],
        [178, 121, 162], [255, 157, 166], [157, 117, 93], [130, 130, 130],
    ],
    dtype=np.uint8,
)  # fmt: skip
"""One colour per part, again from the start after ten."""


def colour_of(parts: ArrayLike) -> NDArray[np.uint8]:
    """(..., 3) RGB of parts."""
    return np.asarray(_PALETTE[np.asarray(parts) % len(_PALETTE)])


def labelled_ply(points: Array, labels: Indices) -> bytes:
    """Points (N, 3) m with the colour and the number of their part, as a binary PLY."""
    vertices = _records(len(points), points, colour_of(labels))
    vertices["part"] = labels
    return _header(len(points)) + vertices.tobytes()


def surface_ply(found: Segmentation) -> bytes:
    """The closed surface around all parts, m, each triangle in the colour of its part, as a binary PLY."""
    triangles, parts = found.surface
    used, corners = np.unique(triangles, return_inverse=True)
    vertices = _records(len(used), found.solid.vertices[used], np.full((len(used), 3), 200, np.uint8))
    faces = np.empty(len(triangles), [("n", "u1"), ("corners", "<i4", 3), ("colour", "u1", 3), ("part", "<i4")])
    faces["n"], faces["corners"], faces["colour"], faces["part"] = 3, corners.reshape(-1, 3), colour_of(parts), parts
    return _header(len(used), len(triangles)) + vertices.tobytes() + faces.tobytes()


def _records(count: int, points: Array, colours: NDArray[np.uint8]) -> NDArray[np.void]:
    vertices = np.zeros(count, [("point", "<f8", 3), ("colour", "u1", 3), ("part", "<i4")])
    vertices["point"], vertices["colour"] = points, colours
    return vertices


def _header(n_vertices: int, n_faces: int | None = None) -> bytes:
    attributes = [*(f"property uchar {name}" for name in ("red", "green", "blue")), "property int part"]
    lines = ["ply", "format binary_little_endian 1.0", "comment metres", f"element vertex {n_vertices}"]
    lines += [*(f"property double {axis}" for axis in "xyz"), *attributes]
    if n_faces is not None:
        lines += [f"element face {n_faces}", "property list uchar int vertex_indices", *attributes]
    return "\n".join([*lines, "end_header", ""]).encode()
