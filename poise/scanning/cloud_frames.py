"""sensor_msgs/PointCloud2 as frames: a cloud is drawn into the image of a pinhole camera, its own where that shows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.recording import stamp_of
from poise.scanning.camera import Camera
from poise.scanning.frames import FARTHEST, NEAREST, SANE, Frame
from poise.types import Array, Mask

_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_MOST_POINTS = 4_000_000
_LEAST_POINTS = 100
_WIDEST = 1.5
"""Greatest x/z that a virtual camera takes in."""
_FITS = 1.0
"""Pixels that an organised cloud may be off a pinhole camera."""


def columns_of(message: Any, name: str) -> dict[str, NDArray[Any]]:
    """The fields of a PointCloud2, each (N,).

    Raises:
        InputError: TYPE_MISMATCH when there are fewer bytes than it says, or no x, y, z; UNSUPPORTED when too large.
    """
    count = int(message.width) * int(message.height)
    step, data = int(message.point_step), np.frombuffer(message.data, np.uint8)
    if count > _MOST_POINTS:
        raise InputError(ErrorCode.UNSUPPORTED, f"{name}: {count} points, at most {_MOST_POINTS}; thin it out")
    order = ">" if message.is_bigendian else "<"
    places = {str(field.name): (int(field.offset), int(field.datatype)) for field in message.fields}
    kinds = {key: np.dtype(order + _KINDS[kind]) for key, (_, kind) in places.items() if kind in _KINDS}
    ends = [places[key][0] + kind.itemsize for key, kind in kinds.items()]
    if not {"x", "y", "z"} <= kinds.keys() or max(ends, default=0) > step or len(data) < step * count:
        raise InputError(
            ErrorCode.TYPE_MISMATCH,
            f"{name}: {len(data)} bytes for {count} points of {step} with fields {', '.join(places) or 'none'}: a cloud"
            " has x, y, z and the number of bytes in its header; fix its publisher",
        )
    rows = data[: step * count].reshape(count, step)
    return {
        key: np.ascontiguousarray(rows[:, places[key][0] : places[key][0] + kind.itemsize]).view(kind)[:, 0]
        for key, kind in kinds.items()
    }


def frame_of_cloud(message: Any, name: str = "cloud") -> Frame:
    """A cloud in an optical frame (z forwards) as an image.

    Raises:
        InputError: as `columns_of`; EMPTY without points; BAD_INPUT for millimetres; FRAME_UNKNOWN for a cloud that is
            not in an optical frame.
    """
    columns = columns_of(message, name)
    points = np.stack([columns[axis] for axis in "xyz"], axis=1).astype(np.float64)
    finite = np.isfinite(points).all(axis=1) & np.any(points != 0, axis=1)
    if finite.sum() < _LEAST_POINTS:
        raise InputError(
            ErrorCode.EMPTY, f"{name}: {finite.sum()} of {len(points)} points are finite; is the camera covered?"
        )
    frame_id = str(message.header.frame_id)
    middle = float(np.median(points[finite, 2]))
    if middle > SANE:
        raise InputError(
            ErrorCode.BAD_INPUT, f"{name}: {middle:.0f} is the typical z: these are millimetres; ROS wants metres"
        )
    ahead = finite & (points[:, 2] > NEAREST) & (points[:, 2] < FARTHEST)
    ahead &= np.all(np.abs(points[:, :2]) < _WIDEST * points[:, 2:], axis=1)
    if ahead.sum() < 0.5 * finite.sum():
        raise InputError(
            ErrorCode.FRAME_UNKNOWN,
            f"{name}: most points are not in front of the z axis of {frame_id!r}, so that is not the camera's optical"
            " frame; publish the cloud in the frame of the sensor (z forwards, x right, y down)",
        )
    camera = _camera(points, ahead, int(message.width), int(message.height))
    colours = _colours(columns)
    u, v = camera.project(points[ahead])
    column, row = np.round(u).astype(int), np.round(v).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    order = np.argsort(-points[ahead, 2][inside], kind="stable")  # the nearest is drawn last
    pixel = (row[inside] * camera.width + column[inside])[order]
    depth = np.zeros(camera.width * camera.height, np.float32)
    depth[pixel] = points[ahead, 2][inside][order]
    paint = None
    if colours is not None:
        flat = np.zeros((len(depth), 3), np.uint8)
        flat[pixel] = colours[ahead][inside][order]
        paint = flat.reshape(camera.height, camera.width, 3)
    return Frame(stamp_of(message), frame_id, camera, depth.reshape(camera.height, camera.width), paint)


def _camera(points: Array, ahead: Mask, width: int, height: int) -> Camera:
    """The pinhole camera that an organised cloud came from; for others, one that gives each point about a pixel."""
    directions = points[ahead, :2] / points[ahead, 2:]
    if height > 1:
        u, v = (np.flatnonzero(ahead) % width).astype(np.float64), (np.flatnonzero(ahead) // width).astype(np.float64)
        (fx, cx), (fy, cy) = np.polyfit(directions[:, 0], u, 1), np.polyfit(directions[:, 1], v, 1)
        off = np.abs(np.stack([fx * directions[:, 0] + cx - u, fy * directions[:, 1] + cy - v]))
        if min(fx, fy) > 0 and np.quantile(off, 0.95) < _FITS:
            return Camera(width, height, float(fx), float(fy), float(cx), float(cy))
    low, high = np.quantile(directions, 0.001, axis=0), np.quantile(directions, 0.999, axis=0)
    focal = float(np.clip(np.sqrt(0.7 * ahead.sum() / np.prod(np.maximum(high - low, 1e-3))), 50, 2000))
    size = np.ceil(focal * (high - low)).astype(int) + 1
    return Camera(int(size[0]), int(size[1]), focal, focal, float(-focal * low[0]), float(-focal * low[1]))


def _colours(columns: dict[str, NDArray[Any]]) -> NDArray[np.uint8] | None:
    """(N, 3) RGB of the packed field `rgb` or `rgba`."""
    packed = columns.get("rgb", columns.get("rgba"))
    if packed is None or packed.dtype.itemsize != 4:
        return None
    values = np.ascontiguousarray(packed.astype(packed.dtype.newbyteorder("="))).view(np.uint32)
    return np.stack([values >> 16 & 255, values >> 8 & 255, values & 255], axis=1).astype(np.uint8)
