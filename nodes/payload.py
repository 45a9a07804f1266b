"""The payload that inertial_estimator weighs, as an object of an assembly."""

from dataclasses import replace

import numpy as np

from poise.assembly import RigidObject
from poise.geometry import Pose
from poise.inertia.model import frame_change, symmetric
from poise_msgs.msg import InertialEstimate


def weighed(item: RigidObject, estimate: InertialEstimate, pose_sensor_object: Pose) -> RigidObject:
    """The object with the mass, centre of mass, inertia and covariance of an estimate; what that lacks is kept.

    Args:
        item: of an assembly.
        estimate: in the sensor frame.
        pose_sensor_object: of the object frame, in the sensor's.

    Raises:
        InputError: OBJECT_INVALID when no body has such an inertia.
    """
    found, rotation = estimate.inertia, pose_sensor_object.rotation
    com = pose_sensor_object.undo(np.array([found.com.x, found.com.y, found.com.z]))
    inertia = rotation.T @ symmetric([found.ixx, found.ixy, found.ixz, found.iyy, found.iyz, found.izz]) @ rotation
    inertia = (inertia + inertia.T) / 2  # rounding of the rotation makes it a little asymmetric
    inertia = (inertia + inertia.T) / 2
    change = frame_change(rotation.T, -rotation.T @ pose_sensor_object.translation)
    covariance = change @ np.array(estimate.covariance).reshape(10, 10) @ change.T
    covariance = (covariance + covariance.T) / 2
    return replace(
        item,
        mass=found.m if np.isfinite(found.m) else item.mass,
        com=com if np.isfinite(com).all() else item.com,
        inertia=inertia if np.isfinite(inertia).all() else None,
        covariance=covariance if np.isfinite(covariance).all() else None,
    )
