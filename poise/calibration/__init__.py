"""Where a camera sits on the hand, and where the joints' zeros are, from views of a printed board.

- `sightings`: corners of a board in one image, its pose there, and the closed form of the hand-eye transform.
- `adjustment`: least squares over all parameters, with a covariance by the jackknife over places of the arm.
- `recording_checks`: what views must have. `calibrate`: outliers, what can be identified, and the verdict.
- `boards`: detection of ChArUco boards (needs OpenCV). `recorded`: the views of a recording.
- `results`: the file calibration.yaml, and a robot description with the offsets.
"""

from poise.calibration.boards import Board
from poise.calibration.calibrate import HandEyeCalibration, HandEyeOptions, calibrate
from poise.calibration.recorded import LinkKinematics, RecordedViews, recorded_views
from poise.calibration.results import (
    StoredCalibration,
    calibration_content,
    corrected_description,
    read_calibration,
)
from poise.calibration.sightings import Sighting

__all__ = [
    "Board",
    "HandEyeCalibration",
    "HandEyeOptions",
    "LinkKinematics",
    "RecordedViews",
    "Sighting",
    "StoredCalibration",
    "calibrate",
    "calibration_content",
    "corrected_description",
    "read_calibration",
    "recorded_views",
]
