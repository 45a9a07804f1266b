"""A pinhole camera: from pixels to rays and back, with the lens distortion of sensor_msgs/CameraInfo."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.types import Array, Single

_MODELS = ("", "plumb_bob", "rational_polynomial")
_COEFFICIENTS = (0, 4, 5, 8)
_LARGEST = 8192
_ROUNDS = 20
"""Of the fixed point that undoes the distortion; lenses of depth cameras need fewer than ten."""


def rotated(points: NDArray[np.floating], rotation: Array) -> NDArray[np.floating]:
    """rotation @ point for each of (N, 3) points, in their precision.

    By components: for so thin a product OpenBLAS starts all cores, which then wait for each other.
    """
    out = np.empty_like(points)
    turn = rotation.astype(points.dtype)
    for axis in range(3):
        out[:, axis] = turn[axis, 0] * points[:, 0] + turn[axis, 1] * points[:, 1] + turn[axis, 2] * points[:, 2]
    return out


@dataclass(frozen=True)
class Camera:
    """Intrinsics; pixel (u, v) has its centre at u right and v down, the optical axis is z (REP-103 optical frame).

    Args:
        width, height: pixels.
        fx, fy, cx, cy: pixels.
        distortion: k1 k2 p1 p2 [k3 [k4 k5 k6]] (plumb_bob, rational_polynomial); empty: none.

    Raises:
        InputError: BAD_INPUT for numbers that no camera has, UNSUPPORTED for other distortion.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        numbers = np.array([self.fx, self.fy, self.cx, self.cy, *self.distortion])
        if not np.isfinite(numbers).all() or self.fx <= 0 or self.fy <= 0:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"camera_info: fx {self.fx:g}, fy {self.fy:g}, cx {self.cx:g}, cy {self.cy:g} are no camera's; an"
                " uncalibrated driver publishes zeros: calibrate it, or take the camera_info of the aligned depth",
            )
        if not (0 < self.width <= _LARGEST and 0 < self.height <= _LARGEST):
            raise InputError(ErrorCode.BAD_INPUT, f"camera_info: {self.width} x {self.height} pixels are no image")
        if len(self.distortion) not in _COEFFICIENTS:
            raise InputError(
                ErrorCode.UNSUPPORTED, f"camera_info: {len(self.distortion)} distortion coefficients; rectify first"
            )

    @classmethod
    def from_info(cls, width: int, height: int, k: Sequence[float], model: str, d: Sequence[float]) -> "Camera":
        """From the fields of sensor_msgs/CameraInfo.

        Raises:
            InputError: UNSUPPORTED for a lens of another model, or as the class.
        """
        bent = tuple(float(value) for value in d)
        if not any(bent):
            bent = ()
        if bent and model not in _MODELS:
            raise InputError(
                ErrorCode.UNSUPPORTED,
                f"camera_info: distortion model {model!r} is not known ({', '.join(_MODELS[1:])} are); rectify first",
            )
        return cls(int(width), int(height), float(k[0]), float(k[4]), float(k[2]), float(k[5]), bent)

    @cached_property
    def rays(self) -> Single:
        """(2, H, W) x/z and y/z of what each pixel sees."""
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        seen = np.stack([(u - self.cx) / self.fx, (v - self.cy) / self.fy])
        if not self.distortion:
            return seen.astype(np.float32)
        straight = seen.copy()
        for _ in range(_ROUNDS):
            straight = straight - (self._bend(straight) - seen)
        return straight.astype(np.float32)

    def _bend(self, straight: Array) -> Array:
        """Brown's model with Claus and Fitzgibbon's denominator (as OpenCV writes it): (2, ...) to (2, ...)."""
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, *[0.0] * (8 - len(self.distortion)))
        x, y = straight
        r2 = x * x + y * y
        stretch = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return np.stack(
            [
                x * stretch + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * stretch + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ]
        )

    def project(self, points: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Pixels u and v (...) of points (..., 3) in the optical frame, z > 0."""
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        if self.distortion:
            x, y = self._bend(np.stack([x, y]))
        return self.fx * x + self.cx, self.fy * y + self.cy
