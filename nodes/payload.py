"""The payload that inertial_estimator weighs, as an object of an assembly."""

from dataclasses import replace

import numpy as np

from poise.assembly import RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia.model import frame_change, symmetric
from poise.nodes.assembly_message import require_body
from poise.ranges import check_covariance, check_range
from poise_msgs.msg import InertialEstimate

_QUESTIONED = {ErrorCode.ZEROED_UNDER_LOAD, *(ErrorCode(code) for code in range(70, 87))} - {ErrorCode.PAYLOAD_CHANGED}
"""Findings with which an estimate is not taken over."""


def require_usable(estimate: InertialEstimate, age: float, most_age: float) -> None:
    """Raise unless an estimate is of a body, weighed now, and nothing puts it in question.

    Args:
        estimate: as it came.
        age: s since its newest sample.
        most_age: s.

    Raises:
        InputError: SENSOR_STALE, NOT_IDENTIFIABLE or NOT_CONSISTENT; OBJECT_INVALID for a mass that no object has; the
            code of a finding that puts it in question.
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
    check_range("mass", estimate.inertia.m, "inertial_estimate: ")
    for finding in estimate.findings:
        if finding.code in _QUESTIONED:
            raise InputError(ErrorCode(finding.code), f"the estimate is not taken over: {finding.message}")


class GraspedPayload:
    """The weight of one object: that of the hand from the grasp to the release, and kept from then on.

    Args:
        most_age: s that the newest sample of an estimate may be old.
    """

    def __init__(self, most_age: float) -> None:
        self._most_age = most_age
        self._released = False
        self.estimate: InertialEstimate | None = None

    def take(self, estimate: InertialEstimate, age: float) -> bool:
        """Whether an estimate, `age` s old, is of the object and replaces the one before.

        After a change of the payload (`since` moves on) a hand that weighs at least half as much as before still holds
        the object, now without its spilled part; or it grasps the object now, and was weighed without it before. A
        lighter hand has released it. What it weighs later is something else.

        Raises:
            InputError: as `require_usable`.
        """
        if self._released:
            return False
        kept = self.estimate
        changed = kept is not None and estimate.since != kept.since
        lighter = kept is not None and estimate.inertia.m < kept.inertia.m / 2
        try:
            require_usable(estimate, age, self._most_age)
        except InputError as error:
            empty = lighter or error.code is ErrorCode.NOT_IDENTIFIABLE
            if not (changed and empty) or error.code is ErrorCode.SENSOR_STALE:
                raise
            self._released = True
            return False
        self._released = changed and lighter
        if not self._released:
            self.estimate = estimate
        return not self._released

    def left_assembly(self) -> None:
        """The object is no longer in the assembly: one that was released is grasped again, and weighed again."""
        if self._released:
            self._released, self.estimate = False, None


def weighed(item: RigidObject, estimate: InertialEstimate, pose_sensor_object: Pose) -> RigidObject:
    """The object with mass, centre of mass, inertia and covariance of an estimate; what that does not identify is kept.

    Args:
        item: of an assembly.
        estimate: in the sensor frame.
        pose_sensor_object: of the object frame, in the sensor's.

    Raises:
        InputError: OBJECT_INVALID when no body has such an inertia, or its centre of mass is far off its shape;
            BAD_INPUT for a covariance that no errors have.
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
    heavy = replace(
        item,
        mass=found.m,
        com=com if knows_com else item.com,
        inertia=inertia if knows_inertia else kept,
        covariance=covariance if knows_com and knows_inertia and np.isfinite(covariance).all() else item.covariance,
    )
    require_body(heavy)
    if heavy.covariance is not item.covariance:
        check_covariance(covariance.ravel(), "inertial_estimate: ")
    return heavy
