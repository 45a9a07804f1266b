"""Weighing what a sensor holds: from wrenches and motion to mass, centre of mass and inertia, and how sure that is.

- `parameters`: `InertialParameters`, the 10-vector phi, the pseudo-inertia, other frames.
- `regressor`: the wrench of a moving load, linear in phi.
- `information`: `InformationAccumulator`, what all samples say in sums that do not grow.
- `least_squares`: `solve`, phi and sensor bias with covariance, and the names of what cannot be seen.
- `estimate`: `InertialEstimate`, `Identification`, `RejectedInterval`: what is handed over.
- `sources`, `tracks`: joint states or tf -> the sensor's motion and where it rests, as they come in (`buffer`).
- `online`: `OnlineEstimator`, wrenches and motion stream in; `rejection` keeps count of what was not used.
- `live`: `LiveEstimator`, the same for messages as they arrive, of whatever comes; `status` says how it goes.
- `identification`: `identify`, the same for a recording; `samples`, `clock_offset`, `offline` do it for Poise's own
  estimator, with `imu` where there is one and `object_shape` from a file.
"""

from poise.inertia.estimate import Identification, InertialEstimate
from poise.inertia.findings import RejectedInterval
from poise.inertia.identification import identify, identify_wrenches
from poise.inertia.information import InformationAccumulator
from poise.inertia.least_squares import Solution, solve
from poise.inertia.online import OnlineEstimator
from poise.inertia.parameters import (
    PARAMETER_NAMES,
    InertialParameters,
    about_com_jacobian,
    frame_change,
    phi_of_pseudo_inertia,
    pseudo_inertia,
)
from poise.inertia.regressor import regressor

__all__ = [
    "PARAMETER_NAMES",
    "Identification",
    "InertialEstimate",
    "InertialParameters",
    "InformationAccumulator",
    "OnlineEstimator",
    "RejectedInterval",
    "Solution",
    "about_com_jacobian",
    "frame_change",
    "identify",
    "identify_wrenches",
    "phi_of_pseudo_inertia",
    "pseudo_inertia",
    "regressor",
    "solve",
]
