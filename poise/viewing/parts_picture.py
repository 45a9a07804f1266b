"""Parts of objects as a picture: each object from its two broadest sides, a colour per part."""

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from poise.errors import ErrorCode, InputError
from poise.shape import Segmentation, colour_of
from poise.types import Array

_FORMATS = {".png": "png", ".svg": "svg", ".pdf": "pdf"}
_LIGHT = np.array([0.3, 0.4, 0.87])
_COLUMNS = 4


def draw_parts(objects: Sequence[tuple[str, Segmentation]], suffix: str = ".png") -> bytes:
    """A sheet of objects by name, in the format of a file's ending.

    Raises:
        InputError: UNSUPPORTED for another ending.
    """
    if suffix.lower() not in _FORMATS:
        raise InputError(ErrorCode.UNSUPPORTED, f"a picture is written as {', '.join(_FORMATS)}, not {suffix!r}")
    columns = min(_COLUMNS, len(objects))
    rows = -(-len(objects) // columns)
    figure = Figure(figsize=(4.0 * columns, 3.4 * rows), dpi=64, layout="constrained")
    FigureCanvasAgg(figure)
    for number, (name, found) in enumerate(objects):
        axes = figure.add_subplot(rows, columns, number + 1)
        triangles, parts = found.surface
        corners = found.solid.vertices[triangles]
        views = _views(found.solid.vertices)
        low = 0.0
        for view in views:
            turned = corners @ view.T
            turned[..., 1] += low - turned[..., 1].max()
            low = turned[..., 1].min() - 0.06 * np.ptp(turned[..., 0])
            axes.add_collection(_painted(turned, parts))
        axes.set_title(f"{name.replace('_', ' ')}: {found.n_parts}", fontsize=10)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.axis("off")
    out = io.BytesIO()
    metadata = {"Date": None} if suffix.lower() == ".svg" else None
    figure.savefig(out, format=_FORMATS[suffix.lower()], metadata=metadata)
    return out.getvalue()


def _views(points: Array) -> list[Array]:
    """Two (3, 3) rotations that lay the object along x and show its broad and its narrow side."""
    axes = np.linalg.eigh(np.cov((points - points.mean(axis=0)).T))[1][:, ::-1].T
    axes *= np.where(axes[np.arange(3), np.abs(axes).argmax(axis=1)] < 0, -1.0, 1.0)[:, None]
    along, across, _ = axes
    broad = np.stack([along, across, np.cross(along, across)])
    return [broad, np.stack([along, np.cross(along, -across), -across])]


def _painted(corners: Array, parts: np.typing.NDArray[np.int64]) -> PolyCollection:
    """Triangles (F, 3, 3) seen along z, the far ones first, with a light."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    front = np.flatnonzero(normals[:, 2] > 0)
    front = front[np.argsort(corners[front, :, 2].mean(axis=1))]
    shade = 0.55 + 0.45 * np.clip(normals[front] @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
    colours = colour_of(parts[front]) / 255 * shade[:, None]
    return PolyCollection(list(corners[front, :, :2]), facecolors=colours, edgecolors=colours, linewidths=0.3)
