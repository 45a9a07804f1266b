"""A sweep of an eye in a hand around an object: where the camera should be, and joint positions that bring it there."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from poise.errors import ErrorCode, NoAnswerError
from poise.robot import RobotModel, frame_poses
from poise.types import Array

_TOLERANCE, _OFF_AXIS = 0.03, 0.15
"""m that the camera may be off its place, and rad that it may look past the object."""
_HELD = 0.02
"""Weight of staying near the last joint positions against 1 m of distance, per rad."""
_STARTS = 12


@dataclass(frozen=True)
class Ring:
    """Camera places around a point: a ring whose height sways, so that the object is seen from low and from high.

    Args:
        distance: m from the point.
        low, high: rad above the horizon.
        sways: how often it goes from low to high and back.
        turn: rad of the whole ring, begun at `start`.
        start: rad, azimuth of the first place.
    """

    distance: float = 0.33
    low: float = 0.6
    high: float = 1.15
    sways: float = 2.0
    turn: float = 2 * np.pi
    start: float = np.pi

    def places(self, point: Array, count: int) -> Array:
        """(count, 3) m."""
        share = np.linspace(0.0, 1.0, count)
        azimuth = self.start + self.turn * share
        height = (self.low + self.high) / 2 - (self.high - self.low) / 2 * np.cos(2 * np.pi * self.sways * share)
        level = np.cos(height)
        towards = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(height)], axis=1)
        return np.asarray(point + self.distance * towards)


def plan_sweep(
    model: RobotModel, hand_frame: str, hand_eye: tuple[Array, Array], point: Array, places: Array, start: Array
) -> Array:
    """Joint positions (K, J) with which the camera stands at (K, 3) places and looks at a point; its roll is free.

    Args:
        model: the robot; the world is its base.
        hand_frame: the link that carries the camera.
        hand_eye: rotation (3, 3) and translation (3,) m of its optical frame in that link.
        point: (3,) m to look at.
        places: (K, 3) m.
        start: (J,) to search from.

    Raises:
        NoAnswerError: UNREACHABLE, naming the first place that the camera cannot stand at.
    """
    low, high = np.maximum(model.lower, -2 * np.pi) + 1e-3, np.minimum(model.upper, 2 * np.pi) - 1e-3
    starts = [start, *np.random.default_rng(0).uniform(low, high, (_STARTS - 1, len(low)))]

    def eye(joints: Array) -> tuple[Array, Array]:
        rotation, translation = frame_poses(model, joints[None], hand_frame)
        return rotation[0] @ hand_eye[0], rotation[0] @ hand_eye[1] + translation[0]

    def find(place: Array, near: Array, held: float) -> Array:
        wanted = (point - place) / np.linalg.norm(point - place)

        def miss(joints: Array) -> Array:
            rotation, translation = eye(joints)
            return np.concatenate([translation - place, 0.3 * (rotation[:, 2] - wanted), held * (joints - near)])

        return np.asarray(least_squares(miss, np.clip(near, low, high), bounds=(low, high), max_nfev=60).x)

    def reaches(place: Array, joints: Array) -> bool:
        rotation, translation = eye(joints)
        cosine = rotation[:, 2] @ (point - translation) / np.linalg.norm(point - translation)
        return bool(np.linalg.norm(translation - place) < _TOLERANCE and cosine > np.cos(_OFF_AXIS))

    firsts = [joints for near in starts if reaches(places[0], joints := find(places[0], near, 1e-3))]
    for first in sorted(firsts, key=lambda joints: float(np.abs(joints - start).max())):
        path = [first]
        for place in places[1:]:
            path.append(find(place, path[-1], _HELD))
            if not reaches(place, path[-1]):
                break
        else:
            return np.array(path)
    raise NoAnswerError(
        ErrorCode.UNREACHABLE,
        f"sweep: the arm cannot bring the camera around {np.round(point, 3).tolist()}; move the object, or come nearer",
    )
