"""Least squares over hand-eye transform, board, joint offsets, delay and board scale; covariance robust to the noise.

All corners that are seen from one place share the error of the arm's pose, so that pixels are not independent. The
covariance is the cluster jackknife (CR3 of Bell and McCaffrey 2002), with places as clusters.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from poise.calibration.sightings import CameraCarrier, Sighting, joints_of, places_of
from poise.geometry import Pose, rotation_of_vector
from poise.scanning import Camera
from poise.types import Array, Mask

EYE, BOARD = slice(0, 6), slice(6, 12)
"""Of the parameters: rotation vector about the parent's axes, rad, and translation, m."""
_BEHIND = 1e-3
_ROBUST = 2.0
"""Pixels from which on an error counts less."""


@dataclass(frozen=True, eq=False)
class Parameters:
    """What is estimated.

    Args:
        eye: camera in the link.
        board: board in the base.
        offsets: (J,) that are added to the joint positions, rad or m.
        delay: s that the stamps of images are late.
        scale: true size of the board through the stated one.
    """

    eye: Pose
    board: Pose
    offsets: Array
    delay: float = 0.0
    scale: float = 1.0

    def moved(self, step: Array) -> "Parameters":
        """After a step (12 + J + 2,)."""
        count = len(self.offsets)
        return Parameters(
            _moved(self.eye, step[EYE]),
            _moved(self.board, step[BOARD]),
            self.offsets + step[12 : 12 + count],
            self.delay + float(step[12 + count]),
            self.scale + float(step[13 + count]),
        )


def _moved(pose: Pose, step: Array) -> Pose:
    return Pose(rotation_of_vector(step[:3]) @ pose.rotation, pose.translation + step[3:])


class BoardProblem:
    """Reprojection errors of many sightings.

    Args:
        kinematics: of the link that carries the camera.
        camera: intrinsics.
        sightings: at least one.
    """

    def __init__(self, kinematics: CameraCarrier, camera: Camera, sightings: Sequence[Sighting]) -> None:
        self._kinematics, self._camera = kinematics, camera
        self._position, self._velocity = joints_of(sightings)
        self.of_view = np.repeat(np.arange(len(sightings)), [2 * len(each.corners) for each in sightings])
        self._row = self.of_view[::2]
        places = places_of(self._position)
        self.of_place = places[self.of_view]
        self.places = int(places[-1]) + 1
        flat = np.concatenate([each.corners for each in sightings])
        self._corners = np.column_stack([flat, np.zeros(len(flat))])
        self._pixels = np.concatenate([each.pixels for each in sightings])
        self.views = len(sightings)
        self.size = 14 + self._position.shape[1]
        """Number of parameters."""

    def errors(self, x: Parameters) -> Array:
        """(2 N,) pixels."""
        links = self._kinematics.poses(self._position + x.offsets - x.delay * self._velocity)
        cameras = links @ x.eye
        in_base = x.board.apply(x.scale * self._corners)
        there = np.einsum("nji,nj->ni", cameras.rotation[self._row], in_base - cameras.translation[self._row])
        there[:, 2] = np.maximum(there[:, 2], _BEHIND)
        return np.asarray((np.stack(self._camera.project(there), axis=1) - self._pixels).ravel())

    def slopes(self, x: Parameters) -> Array:
        """(2 N, P) by central differences."""
        step = np.full(self.size, 1e-6)
        columns = [(self.errors(x.moved(d)) - self.errors(x.moved(-d))) / 2e-6 for d in np.diag(step)]
        return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class BoardFit:
    """A solution.

    Args:
        parameters: the estimate.
        active: (P,) which of them were estimated.
        covariance: (P, P) zero where not.
        errors: (2 N,) pixels that are left.
        rms: (V,) pixels of each view.
    """

    parameters: Parameters
    active: Mask
    covariance: Array
    errors: Array
    rms: Array

    @property
    def sigma(self) -> Array:
        """(P,) standard deviations."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def adjust(
    problem: BoardProblem, start: Parameters, active: Mask, considered: Array | None = None, robust: bool = False
) -> BoardFit:
    """Least squares over the active parameters.

    Args:
        problem: the errors.
        start: near the solution; parameters that are not active stay there.
        active: (P,) bool.
        considered: (P,) one sigma of parameters that stay where they are and may be wrong: the covariance of the
            others includes them (consider covariance, Tapley et al. 2004).
        robust: large errors count less: outliers are still among the views.
    """
    rows = np.flatnonzero(active)

    def at(values: Array) -> Parameters:
        step = np.zeros(problem.size)
        step[rows] = values
        return start.moved(step)

    loss = {"loss": "soft_l1", "f_scale": _ROBUST} if robust else {}
    found = least_squares(lambda v: problem.errors(at(v)), np.zeros(len(rows)), x_scale=_scales(problem)[rows], **loss)
    best = at(found.x)
    errors, slopes = problem.errors(best), problem.slopes(best)
    covariance = np.zeros((problem.size, problem.size))
    inner = jackknife(slopes[:, rows], errors, problem)
    if considered is not None and considered.any():
        drag = np.linalg.lstsq(slopes[:, rows], slopes[:, considered > 0], rcond=None)[0] * considered[considered > 0]
        inner = inner + drag @ drag.T
    covariance[np.ix_(rows, rows)] = inner
    squares = np.bincount(problem.of_view, errors**2, problem.views) / np.bincount(problem.of_view)
    return BoardFit(best, active, covariance, errors, np.sqrt(squares))


def _scales(problem: BoardProblem) -> Array:
    return np.array([*[0.01] * 3, *[1e-3] * 3, *[0.01] * 3, *[1e-3] * 3, *[0.01] * (problem.size - 14), 0.01, 0.01])


def jackknife(slopes: Array, errors: Array, problem: BoardProblem) -> Array:
    """(P, P) covariance by leaving out one place at a time."""
    unit = np.linalg.norm(slopes, axis=0)
    unit[unit == 0] = 1.0
    scaled = slopes / unit
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13)
    steps = []
    for place in range(problem.places):
        here = problem.of_place == place
        own = scaled[here]
        left = np.eye(len(unit)) - own.T @ own @ inverse
        steps.append(inverse @ np.linalg.lstsq(left, own.T @ errors[here], rcond=1e-10)[0])
    moves = np.array(steps) / unit
    moves -= moves.mean(axis=0)
    return np.asarray((problem.places - 1) / problem.places * moves.T @ moves)
