"""What a camera saw of a flat board, with the joints at that moment; the pose of the board in one image."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from poise.geometry import Pose, nearest_rotation, rotation_of_vector, vector_of_rotation
from poise.scanning import Camera
from poise.types import Array, Indices

LEAST_CORNERS = 6
_PLACE = 0.02
"""rad or m that a joint moves to another place."""
_FLAT = 1e-4
"""m within which corners are on one line."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """Corners of a board in one image.

    Args:
        stamp: ns.
        position, velocity: (J,) of the joints at the stamp, rad or m, and per s.
        corners: (N, 2) m on the board.
        pixels: (N, 2) where they were seen.
    """

    stamp: int
    position: Array
    velocity: Array
    corners: Array
    pixels: Array


def show_a_plane(corners: Array) -> bool:
    """Whether corners (N, 2) are enough for the pose of a board: one line, and one corner beside it, are not."""
    if len(corners) < LEAST_CORNERS:
        return False
    rest = [np.delete(corners, k, axis=0) for k in range(len(corners))]
    return all(np.linalg.matrix_rank(each - each.mean(axis=0), tol=_FLAT) == 2 for each in rest)


class CameraCarrier(Protocol):
    """Where the link that carries the camera is."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(J)."""

    def poses(self, position: Array) -> Pose:
        """(V) poses of the link in the base, of (V, J) joint positions."""


def board_pose(sighting: Sighting, camera: Camera) -> tuple[Pose, Array]:
    """The pose of a flat board in the camera that fits one image, and the errors (N, 2) that are left, pixels.

    From the homography of the plane (Zhang 2000), then least squares with a robust loss.
    """
    rays = _rays(sighting.pixels, camera)
    guess = _from_homography(_homography(sighting.corners, rays))
    flat = np.column_stack([sighting.corners, np.zeros(len(sighting.corners))])

    def errors(x: Array) -> Array:
        seen = flat @ rotation_of_vector(x[:3]).T + x[3:]
        seen[:, 2] = np.maximum(seen[:, 2], 1e-3)
        return (np.stack(camera.project(seen), axis=1) - sighting.pixels).ravel()

    start = np.concatenate([vector_of_rotation(guess.rotation), guess.translation])
    best = least_squares(errors, start, loss="soft_l1", x_scale=[0.01, 0.01, 0.01, 1e-3, 1e-3, 1e-3])
    left = errors(best.x).reshape(-1, 2)
    return Pose(rotation_of_vector(best.x[:3]), best.x[3:]), left


def _rays(pixels: Array, camera: Camera) -> Array:
    """(N, 2) x/z and y/z of pixels, without the distortion of the lens."""
    seen = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    straight = seen.copy()
    for _ in range(20 if camera.distortion else 0):
        ahead = np.column_stack([straight, np.ones(len(straight))])
        there = (np.stack(camera.project(ahead), axis=1) - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        straight = straight - (there - seen)
    return np.asarray(straight)


def _homography(corners: Array, rays: Array) -> Array:
    """(3, 3) board to image plane, by the normalised direct linear transform."""
    middle, size = corners.mean(axis=0), np.ptp(corners, axis=0).max()
    x = (corners - middle) / size
    rows = []
    for (a, b), (u, v) in zip(x, rays, strict=True):
        rows += [[a, b, 1, 0, 0, 0, -u * a, -u * b, -u], [0, 0, 0, a, b, 1, -v * a, -v * b, -v]]
    found = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)
    shift = np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]])
    return np.asarray(found @ shift)


def _from_homography(h: Array) -> Pose:
    h = h / np.sqrt(np.linalg.norm(h[:, 0]) * np.linalg.norm(h[:, 1]))
    h = h if h[2, 2] > 0 else -h
    return Pose(nearest_rotation(np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])])), h[:, 2])


def closed_form(links: Pose, boards: Pose) -> tuple[Pose, Pose]:
    """Hand-eye transform and pose of the board in the base, from poses of the link and of the board in the camera.

    Rotation as Park and Martin (1994) of all pairs of views; translations by least squares.

    Args:
        links: (V) link in base.
        boards: (V) board in camera.

    Returns:
        The camera in the link, and the board in the base.
    """
    first, second = np.triu_indices(len(links.rotation), 1)
    motions = np.einsum("nji,njk->nik", links.rotation[first], links.rotation[second])
    seen = np.einsum("nij,nkj->nik", boards.rotation[first], boards.rotation[second])
    turn = nearest_rotation(np.einsum("ni,nj->ij", vector_of_rotation(motions), vector_of_rotation(seen)))
    rows, values = [], []
    offset = np.einsum("nij,nj->ni", links.rotation @ turn, boards.translation) + links.translation
    for rotation, right in zip(links.rotation, offset, strict=True):  # R t_x - t_b = - (R turn t + p)
        rows.append(np.hstack([rotation, -np.eye(3)]))
        values.append(-right)
    shift = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
    in_base = links.rotation @ turn @ boards.rotation
    return Pose(turn, shift[:3]), Pose(nearest_rotation(in_base.sum(axis=0)), shift[3:])


def places_of(position: Array) -> Indices:
    """(V,) number of the place of each view, of joint positions (V, J) in the order of time.

    Images that follow each other while the arm rests share its error: together they say no more of it than one.
    """
    numbers, first = np.zeros(len(position), dtype=np.int64), position[0]
    for k in range(1, len(position)):
        moved = bool(np.abs(position[k] - first).max() > _PLACE)
        numbers[k] = numbers[k - 1] + moved
        first = position[k] if moved else first
    return numbers


def joints_of(sightings: Sequence[Sighting]) -> tuple[Array, Array]:
    """(V, J) positions and velocities."""
    return np.array([each.position for each in sightings]), np.array([each.velocity for each in sightings])
