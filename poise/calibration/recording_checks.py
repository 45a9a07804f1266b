"""What views must have before anything is estimated: finite numbers, enough places, turns about two axes."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from poise.calibration.sightings import Sighting, joints_of, places_of
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose

LEAST_VIEWS = 8
_TURN = np.radians(8.0)
"""The hand has to turn by this about two axes."""


def require_finite(sightings: Sequence[Sighting]) -> None:
    """Check the numbers of all views.

    Raises:
        InputError: NOT_FINITE.
    """
    for each in sightings:
        if not all(np.isfinite(part).all() for part in (each.position, each.velocity, each.corners, each.pixels)):
            raise InputError(ErrorCode.NOT_FINITE, f"calibrate: the view at {each.stamp} ns has numbers not finite")


def require_places(sightings: Sequence[Sighting]) -> None:
    """Check that the views are of enough places.

    Raises:
        NoAnswerError: TOO_FEW_SAMPLES.
    """
    count = int(places_of(joints_of(sightings)[0])[-1]) + 1
    if count < LEAST_VIEWS:
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"calibrate: the {len(sightings)} images of the board are from {count} places of the arm; {LEAST_VIEWS} are"
            " needed, 15 to 30 are better",
        )


def require_turns(links: Pose) -> None:
    """Check that the hand turns about two axes or more.

    Raises:
        NoAnswerError: NOT_IDENTIFIABLE.
    """
    mean = Rotation.from_matrix(links.rotation).mean()
    turns = (mean.inv() * Rotation.from_matrix(links.rotation)).as_rotvec()
    spread = np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False) / np.sqrt(len(turns))
    if spread[1] < _TURN / 2:
        what = "only moves along" if spread[0] < _TURN / 2 else "turns about one axis only"
        raise NoAnswerError(
            ErrorCode.NOT_IDENTIFIABLE,
            f"calibrate: the hand {what} (rotations spread by {np.degrees(spread[0]):.1f} and"
            f" {np.degrees(spread[1]):.1f} deg): where the camera is cannot be found; turn it about two axes by 20 deg"
            " or more",
        )
