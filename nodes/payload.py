"""The payload that inertial_estimator weighs, as an object of an assembly."""

from dataclasses import replace

import numpy as np

from poise.assembly import RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia.model import frame_change, symmetric
from poise_msgs.msg import InertialEstimate


def require_usable(estimate: InertialEstimate, age: float, most_age: float) -> None:
    """Raise unless an estimate is of a body, weighed now.

    Args:
        estimate: as it came.
        age: s since its newest sample.
        most_age: s.

    Raises:
        InputError: SENSOR_STALE, NOT_IDENTIFIABLE or NOT_CONSISTENT.
    """
    if not 0 <= age + most_age <= 2 * most_age:
        what = f"its newest sample is {age:.1f} s old; payload_age is {most_age:g} s"
        raise InputError(ErrorCode.SENSOR_STALE, f"inertial_estimate: {what}")
    codes = {finding.code for finding in estimate.findings}
    if "m" in estimate.unidentified or ErrorCode.NOT_IDENTIFIABLE in codes or not estimate.inertia.m > 0:
        what = f"the mass is not identified ({estimate.inertia.m:.3g} kg)"
        raise InputError(ErrorCode.NOT_IDENTIFIABLE, f"inertial_estimate: {what}")
    if not estimate.consistent:
        raise InputError(ErrorCode.NOT_CONSISTENT, "inertial_estimate: no body has this inertia")


def weighed(item: RigidObject, estimate: InertialEstimate, pose_sensor_object: Pose) -> RigidObject:
    """The object with mass, centre of mass, inertia and covariance of an estimate; what that does not identify is kept.

    Args:
        item: of an assembly.
        estimate: in the sensor frame.
        pose_sensor_object: of the object frame, in the sensor's.

    Raises:
        InputError: OBJECT_INVALID when no body has such an inertia.
    """
    found, rotation = estimate.inertia, pose_sensor_object.rotation
    unidentified = set(estimate.unidentified)
    com = pose_sensor_object.undo(np.array([found.com.x, found.com.y, found.com.z]))
    inertia = rotation.T @ symmetric([found.ixx, found.ixy, found.ixz, found.iyy, found.iyz, found.izz]) @ rotation
    inertia = (inertia + inertia.T) / 2  # rounding of the rotation makes it a little asymmetric
    change = frame_change(rotation.T, -rotation.T @ pose_sensor_object.translation)
    covariance = change @ np.array(estimate.covariance).reshape(10, 10) @ change.T
    covariance = (covariance + covariance.T) / 2
    knows_com = bool(np.isfinite(com).all()) and not unidentified & {"cx", "cy", "cz"}
    knows_inertia = bool(np.isfinite(inertia).all()) and not unidentified & {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}
    # The same body with another weight: its radii of gyration are kept.
    kept = None if item.inertia is None else item.inertia * (found.m / item.mass)
    return replace(
        item,
        mass=found.m,
        com=com if knows_com else item.com,
        inertia=inertia if knows_inertia else kept,
        covariance=covariance if knows_com and knows_inertia and np.isfinite(covariance).all() else item.covariance,
    )
