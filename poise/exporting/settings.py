"""What the user asks of an export: the frame of the values, the gripper to take off, the robot to write into."""

from dataclasses import dataclass, replace

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia import InertialEstimate, InertialParameters
from poise.types import Array


@dataclass(frozen=True, eq=False)
class GripperLoad:
    """What was weighed besides the object.

    Args:
        parameters: in the sensor frame; NaN for what is not known.
        covariance: (10, 10) of its phi, as in `InertialEstimate`; None: exact.
        frame_id: the frame of the values, where it is stated; it has to be the sensor's.
    """

    parameters: InertialParameters
    covariance: Array | None = None
    frame_id: str | None = None

    def taken_off(self, estimate: InertialEstimate) -> InertialEstimate:
        """The estimate of the object alone. What is not known of either stays unknown.

        Raises:
            InputError: FRAME_UNKNOWN when the gripper is stated in another frame.
        """
        if self.frame_id not in (None, estimate.frame_id):
            raise InputError(
                ErrorCode.FRAME_UNKNOWN,
                f"the gripper is given in {self.frame_id}, and the payload was weighed in {estimate.frame_id}: give"
                " both in the same sensor frame",
            )
        parameters = estimate.parameters - self.parameters
        unknown = ~np.isfinite(parameters.phi)
        covariance = estimate.covariance + (0.0 if self.covariance is None else self.covariance)
        covariance[unknown], covariance[:, unknown] = np.nan, np.nan
        return replace(
            estimate,
            parameters=parameters,
            phi=parameters.phi,
            covariance=covariance,
            consistent=parameters.is_consistent,
        )


@dataclass(frozen=True, eq=False)
class ExportSettings:
    """What the user asks of an export.

    Args:
        flange_from_sensor: pose of the sensor frame in the flange frame, for formats that take values in the flange
            frame; None: both coincide, or `frame_id` says where the values belong.
        frame_id: frame of the values of every format; None: the flange or the sensor frame, as the format has it.
        frame_from_sensor: pose of the sensor frame in `frame_id`.
        gripper: to take off; None: nothing.
        transition_time: s in which the controller changes its payload, for formats that have it.
        robot_description: URDF, for the formats that write into it.
    """

    flange_from_sensor: Pose | None = None
    frame_id: str | None = None
    frame_from_sensor: Pose | None = None
    gripper: GripperLoad | None = None
    transition_time: float = 0.0
    robot_description: str | None = None
