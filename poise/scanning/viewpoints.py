"""Places from which a camera on a hand sees a region from all sides: candidates, and the next best one by coverage."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.scanning.camera import Camera
from poise.types import Array, Mask

_ACROSS = 6
"""Patches along the longest side of a region, at least."""
_STEEP = 0.3
"""Cosine between a face's normal and the direction to the camera from which on the face is seen."""
_APART = np.cos(np.radians(25.0))
"""Views of one patch count twice when their directions differ by this angle."""
_OUTSIDE = 0.01
"""m that the middle of an object may be outside of its region."""
_AIMS = 0.25
"""m between the points of a wide region that are looked at."""


@dataclass(frozen=True)
class ViewOptions:
    """How a region is looked at.

    Args:
        nearest, farthest: m from the camera to the point that it looks at.
        elevations: rad above the horizon.
        azimuths: directions around the region.
        times: views of each patch, from directions that differ.
        most: views at most.
        enough: share of the wanted views that a further one has to add.
    """

    nearest: float = 0.3
    farthest: float = 0.5
    elevations: tuple[float, ...] = (0.5, 0.8, 1.2)
    azimuths: int = 16
    times: int = 3
    most: int = 14
    enough: float = 0.015


@dataclass(frozen=True, eq=False)
class ViewRegion:
    """An upright box to look at.

    Args:
        pose: of its middle; z is up.
        size: (3,) m along its axes.
    """

    pose: Pose
    size: Array

    def patches(self) -> tuple[Array, Array]:
        """(P, 3) points on its faces, m, without the lowest one, and their normals (P, 3)."""
        step = float(self.size.max()) / _ACROSS
        points, normals = [], []
        for axis, sign in ((2, 1), (0, 1), (0, -1), (1, 1), (1, -1)):
            others = [k for k in range(3) if k != axis]
            grids = [_middles(self.size[k], step) for k in others]
            face = np.zeros((len(grids[0]) * len(grids[1]), 3))
            face[:, others] = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 2)
            face[:, axis] = sign * self.size[axis] / 2
            points.append(face)
            normals.append(np.tile(sign * np.eye(3)[axis], (len(face), 1)))
        return self.pose.apply(np.concatenate(points)), np.concatenate(normals) @ self.pose.rotation.T

    def aims(self) -> Array:
        """(A, 3) m: points in it to look at, on a grid at half of its height."""
        x, y = (_middles(self.size[k], _AIMS) for k in range(2))
        flat = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        return self.pose.apply(np.column_stack([flat, np.zeros(len(flat))]))

    def holds(self, points: Array, margin: float = 0.0) -> Mask:
        """Which of (N, 3) points are above or below it, m, or in it."""
        return np.asarray(np.all(np.abs(self.pose.undo(points)[:, :2]) <= self.size[:2] / 2 + margin, axis=1))


def chosen_places(
    places: Array, region: ViewRegion | None, near: tuple[float, float, float] | None, every: bool
) -> list[tuple[float, float, float] | None]:
    """Where the objects are that are scanned, the one that is meant first.

    Args:
        places: (K, 3) m, of all objects.
        region: others than those in it are left out; None: none is.
        near: the point that the meant one is nearest to; None: the region's middle.
        every: all of them; else only the one that is meant.

    Raises:
        InputError: EMPTY when none is in the region.
    """
    if region is not None:
        places = places[region.holds(places, _OUTSIDE)]
        if not len(places):
            raise InputError(ErrorCode.EMPTY, "scan: nothing stands in the region that was looked at")
        near = near or (*region.pose.translation.tolist(),)
    if near is None:
        return [None] if not every else [(*place.tolist(),) for place in places]
    order = np.argsort(np.linalg.norm((places - near)[:, :2], axis=1), kind="stable")
    return [(*place.tolist(),) for place in places[order[: None if every else 1]]]


def _middles(size: float, step: float) -> Array:
    count = max(round(float(size) / step), 1)
    return np.asarray((np.arange(count) + 0.5) * size / count - size / 2)


class Coverage:
    """Which patches of a region which places see, and how much of it the chosen ones have seen.

    Args:
        region: to see.
        camera: intrinsics; its roll is free, so that only the circle in its image counts.
        options: how.
        hiding: (low, high) corners (3,) m of upright boxes through which nothing is seen.
    """

    def __init__(
        self, region: ViewRegion, camera: Camera, options: ViewOptions, hiding: Sequence[tuple[Array, Array]] = ()
    ) -> None:
        self._options = options
        points, normals = region.patches()
        self.eyes, self.aims = _candidates(region, options)
        rays = points - self.eyes[:, None]
        length = np.linalg.norm(rays, axis=2)
        rays /= length[..., None]
        axes = self.aims - self.eyes
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        narrow = np.cos(np.arctan(min(camera.width / camera.fx, camera.height / camera.fy) / 2))
        sees = np.einsum("cpi,ci->cp", rays, axes) > narrow
        sees &= np.einsum("cpi,pi->cp", rays, normals) < -_STEEP
        for low, high in hiding:
            sees &= ~_crossed(self.eyes, rays, length, low, high)
        self._sees, self._rays = sees, rays
        self._chosen: list[int] = []
        self._open = sees.any(axis=1)

    @property
    def gains(self) -> Array:
        """(C,) share of the wanted views of patches that each candidate would add."""
        counts = self._sees[self._chosen].sum(axis=0) if self._chosen else np.zeros(self._sees.shape[1], dtype=int)
        adds = self._sees & (counts < self._options.times)
        for number in self._chosen:
            alike = np.einsum("cpi,pi->cp", self._rays, self._rays[number]) > _APART
            adds &= ~(alike & self._sees[number])
        return np.where(self._open, adds.sum(axis=1) / (self._options.times * self._sees.shape[1]), 0.0)

    def best(self, preferred: Array) -> int | None:
        """The candidate that adds most; None when none adds enough, or there are enough views.

        Args:
            preferred: (C,) 0..1, decides between candidates that add about as much.
        """
        gains = self.gains
        if len(self._chosen) >= self._options.most or gains.max(initial=0.0) < self._options.enough:
            return None
        return int(np.argmax(gains * (1 + 0.2 * preferred)))

    def choose(self, number: int) -> None:
        """Take a candidate."""
        self._chosen.append(number)
        self._open[number] = False

    def refuse(self, number: int) -> None:
        """The camera cannot be at a candidate."""
        self._open[number] = False

    @property
    def seen(self) -> float:
        """0..1 of the patches that at least one chosen view sees."""
        return float(self._sees[self._chosen].any(axis=0).mean()) if self._chosen else 0.0


def _candidates(region: ViewRegion, options: ViewOptions) -> tuple[Array, Array]:
    """(C, 3) m places of a camera, and the points (C, 3) that it looks at."""
    azimuth = 2 * np.pi * np.arange(options.azimuths) / options.azimuths
    eyes, aims = [], []
    for distance in np.unique([options.nearest, (options.nearest + options.farthest) / 2, options.farthest]):
        for elevation in options.elevations:
            level = np.cos(elevation)
            away = np.stack(
                [level * np.cos(azimuth), level * np.sin(azimuth), np.full_like(azimuth, np.sin(elevation))]
            )
            for aim in region.aims():
                eyes.append(aim + distance * away.T)
                aims.append(np.tile(aim, (len(azimuth), 1)))
    return np.concatenate(eyes), np.concatenate(aims)


def _crossed(eyes: Array, rays: Array, length: Array, low: Array, high: Array) -> Mask:
    """(C, P) whether the way from an eye along a ray (C, P, 3) crosses a box before `length`, m."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - eyes)[:, None] / rays, (high - eyes)[:, None] / rays
    begin = np.nanmax(np.minimum(first, second), axis=2)
    end = np.nanmin(np.maximum(first, second), axis=2)
    return np.asarray((begin < end) & (end > 0) & (begin < length - 1e-6))
