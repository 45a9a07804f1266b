"""A camera of two infrared images and a projector of dots, on the world of `stereo_world`."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.stereo_world import BASELINE, CAMERA, PROJECTOR, Paint, World, rays_of_camera
from poise.types import Array

_LEAST_DISPARITY, _DISPARITIES = 16, 112
"""Pixels: from 1.2 m to 0.15 m."""
_WINDOW = 9
_STEPS = 16
"""Of OpenCV's block matching in one pixel of disparity."""
_READOUT, _PHOTONS = 1.5, 8.0
"""Grey values of noise of the infrared images; photons in one grey value."""
_EXPOSED = 90.0
"""Grey value below which three quarters of the pixels are, by automatic exposure."""
_DOTS = 0.09
"""Share of the pattern's pixels in which a dot is."""
_PATTERN = (1000, 1400)
_LAMP = np.array([0.3, 0.2, 0.93])


@dataclass(frozen=True, eq=False)
class Shot:
    """What the camera reports of one view.

    Args:
        depth: (H, W) m; 0 where it is unknown.
        colours: (H, W, 3) of the left camera.
    """

    depth: Array
    colours: NDArray[np.uint8]


@cache
def _pattern() -> Array:
    """(H, W) of the projector, whose pixels are as wide as the camera's; dots as wide as a pixel and a half."""
    rng = np.random.default_rng(435)
    dots = (rng.random(_PATTERN) < _DOTS) * rng.uniform(0.5, 1.5, _PATTERN)
    return np.asarray(ndimage.gaussian_filter(dots, 0.75) * 3)


def _normals(at: Array) -> Array:
    """(H, W, 3) of the surface through (H, W, 3) points; by differences to the nearer neighbour on either side."""
    sides = []
    for axis in (1, 0):
        ahead, behind = np.roll(at, -1, axis) - at, at - np.roll(at, 1, axis)
        nearer = np.linalg.norm(ahead, axis=-1) < np.linalg.norm(behind, axis=-1)
        sides.append(np.where(nearer[..., None], ahead, behind))
    across = np.cross(sides[1], sides[0])
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12))


def _albedo(paint: Paint, at: Array, object_: Array, middle: float) -> tuple[NDArray[np.int64], Array]:
    """Which side of the border of colours a place is on, and its albedo; wood on the table."""
    side = (at @ paint.border > middle).astype(np.int64)
    grain = 0.6 + 0.05 * np.sin(300 * at[..., 0] + 4 * np.sin(40 * at[..., 1]))
    return side, np.where(object_, paint.albedo[side], grain)


def shoot(world: World, rotation: Array, translation: Array, rng: np.random.Generator) -> Shot:
    """One view: two infrared images, matched.

    Args:
        world: what is seen.
        rotation: (3, 3) of the left camera's optical frame in the world.
        translation: (3,) m.
        rng: draws the noise of the images.
    """
    images = []
    for number, x in enumerate((0.0, BASELINE)):
        place = translation + x * rotation[:, 0]
        depth, object_ = world.depth(rotation, place)
        local = depth[..., None] * rays_of_camera()
        at = local @ rotation.T + place
        normals = _normals(at)
        side, albedo = _albedo(world.paint, at, object_, float(world.vertices[:, 2].mean()) * world.paint.border[2])
        if number == 0:
            shade = 0.35 + 0.65 * np.clip(normals @ _LAMP, 0, 1)
            tint = np.where(object_[..., None], world.paint.colours[side], [0.62, 0.5, 0.38])
            tint = np.where(depth[..., None] > 0, tint * shade[..., None], 0.05)
            colours = np.clip(255 * tint + rng.normal(scale=3.0, size=tint.shape), 0, 255).astype(np.uint8)
        gloss = np.where(object_, world.paint.gloss, 0.0)
        images.append(_infrared(local - [PROJECTOR - x, 0, 0], local, normals @ rotation, albedo, gloss, rng))
    return Shot(_matched(*images), colours)


def _infrared(
    from_lamp: Array, local: Array, normals: Array, albedo: Array, gloss: Array, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """(H, W) grey: a room's light and the dots, by Lambert and by a mirror that is rough."""
    depth = local[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = from_lamp[..., 0] / depth * CAMERA.fx + _PATTERN[1] / 2
        v = from_lamp[..., 1] / depth * CAMERA.fy + _PATTERN[0] / 2
        light = -from_lamp / np.linalg.norm(from_lamp, axis=-1, keepdims=True)
        back = -local / np.linalg.norm(local, axis=-1, keepdims=True)
        half = light + back
        half /= np.linalg.norm(half, axis=-1, keepdims=True)
    known = depth > 0
    dots = ndimage.map_coordinates(_pattern(), np.nan_to_num([v, u]), order=1)
    facing = np.clip((normals * light).sum(axis=-1), 0, 1)
    mirrored = gloss * np.clip((normals * half).sum(axis=-1), 0, 1) ** 60
    beam = dots * (0.35 / np.where(known, depth, 1.0)) ** 2
    grey = albedo * (0.3 + beam * facing) + 6 * mirrored * (0.1 + beam)
    grey = np.where(known, grey, 0.02)
    grey *= _EXPOSED / np.percentile(grey, 75)
    grey = ndimage.gaussian_filter(grey, 0.6)
    grey = grey + rng.normal(size=grey.shape) * np.sqrt(_READOUT**2 + np.maximum(grey, 0) / _PHOTONS)
    return np.clip(np.round(grey), 0, 255).astype(np.uint8)


def _matched(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Array:
    """(H, W) m of the left image: block matching, from left to right and back."""
    forth = _disparity(left, right)
    back = _disparity(right[:, ::-1].copy(), left[:, ::-1].copy())[:, ::-1]
    rows, columns = np.indices(left.shape)
    there = np.clip(np.round(columns - forth).astype(int), 0, CAMERA.width - 1)
    same = (forth > 0) & (back[rows, there] > 0) & (np.abs(back[rows, there] - forth) <= 1)
    return np.divide(CAMERA.fx * BASELINE, forth, out=np.zeros(left.shape), where=same)


def _disparity(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> Array:
    matcher = cv2.StereoBM.create(numDisparities=_DISPARITIES, blockSize=_WINDOW)
    matcher.setMinDisparity(_LEAST_DISPARITY)
    matcher.setTextureThreshold(60)
    matcher.setUniquenessRatio(6)
    matcher.setSpeckleWindowSize(60)
    matcher.setSpeckleRange(_STEPS)
    matcher.setPreFilterType(cv2.STEREO_BM_PREFILTER_NORMALIZED_RESPONSE)
    wide = _LEAST_DISPARITY + _DISPARITIES  # so that the left edge is matched, too
    pad = [cv2.copyMakeBorder(image, 0, 0, wide, 0, cv2.BORDER_CONSTANT, value=0) for image in (one, other)]
    found = matcher.compute(pad[0], pad[1])[:, wide:].astype(float) / _STEPS
    return np.where(found >= _LEAST_DISPARITY, found, 0.0)
