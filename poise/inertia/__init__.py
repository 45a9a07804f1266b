"""Weighing a payload: from wrenches and motion to mass, centre of mass and inertia with their covariance.

- `model`: inertial parameters, the regressor, parts of a shape, the problem and the solution of an estimator.
- `bayes`: the `poise` estimator. `estimators`: the registry of all estimators.
- `verdict`: whether a payload explains its samples.
- `pipeline`: samples are paired, checked and estimated, live and from a recording.
"""

from poise.inertia.estimators import InformationAccumulator, solve
from poise.inertia.model import (
    PARAMETER_NAMES,
    InertialParameters,
    RejectedInterval,
    about_com_jacobian,
    frame_change,
    phi_of_pseudo_inertia,
    pseudo_inertia,
    regressor,
)
from poise.inertia.pipeline import Identification, InertialEstimate, OnlineEstimator, identify, identify_wrenches

__all__ = [
    "PARAMETER_NAMES",
    "Identification",
    "InertialEstimate",
    "InertialParameters",
    "InformationAccumulator",
    "OnlineEstimator",
    "RejectedInterval",
    "about_com_jacobian",
    "frame_change",
    "identify",
    "identify_wrenches",
    "phi_of_pseudo_inertia",
    "pseudo_inertia",
    "regressor",
    "solve",
]
