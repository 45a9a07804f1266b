"""InertialEstimate of the core <-> the message of that name."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Inertia

from poise.errors import NoAnswerError, PoiseError
from poise.inertia import InertialEstimate, InertialParameters
from poise.inertia.bayes import PayloadChange
from poise.nodes.runtime import to_message
from poise_msgs.msg import ErrorCode as ErrorCodeMessage
from poise_msgs.msg import InertialEstimate as InertialEstimateMessage
from poise_msgs.msg import PayloadChange as PayloadChangeMessage
from poise_msgs.msg import RejectedInterval


def time_message(stamp: int) -> Time:
    """Stamp in ns as a message; what a message cannot hold becomes zero."""
    seconds, nanoseconds = divmod(stamp, 10**9)
    return Time(sec=seconds, nanosec=nanoseconds) if 0 <= seconds < 2**31 else Time()


HULL = {
    None: InertialEstimateMessage.COM_UNKNOWN,
    True: InertialEstimateMessage.COM_INSIDE,
    False: InertialEstimateMessage.COM_OUTSIDE,
}


def inertia_message(parameters: InertialParameters) -> Inertia:
    """Mass, centre of mass, and inertia about it."""
    message = Inertia(m=float(parameters.mass))
    message.com.x, message.com.y, message.com.z = parameters.com.tolist()
    message.ixx, message.ixy, message.ixz, message.iyy, message.iyz, message.izz = parameters.inertia_vector.tolist()
    return message


def estimate_message(estimate: InertialEstimate) -> InertialEstimateMessage:
    """Turn an estimate into a message; one whose fit is hopeless becomes an error, without numbers."""
    poor = estimate.fit.finding
    if poor is not None and estimate.fit.is_hopeless:
        return withheld_message(estimate, NoAnswerError(poor.code, poor.message))
    message = InertialEstimateMessage()
    message.header.stamp = time_message(estimate.stamp)
    message.header.frame_id = estimate.frame_id
    message.since = time_message(estimate.since or 0)
    message.inertia = inertia_message(estimate.parameters)
    message.covariance = np.ascontiguousarray(estimate.covariance).ravel()
    force, torque = message.bias.force, message.bias.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = estimate.bias.tolist()
    message.bias_covariance = np.ascontiguousarray(estimate.bias_covariance).ravel()
    message.delay, message.delay_std = float(estimate.delay), float(estimate.delay_std)
    message.method = estimate.method
    message.consistent, message.com_in_hull = estimate.consistent, HULL[estimate.com_in_hull]
    message.unidentified = list(estimate.unidentified)
    message.condition_number = float(estimate.condition_number)
    message.n_samples = min(estimate.n_samples, 2**32 - 1)
    message.rejected = [
        RejectedInterval(
            start=time_message(span.start), end=time_message(span.end), samples=span.n_samples, reason=span.reason
        )
        for span in estimate.rejected
    ]
    message.findings = findings_message(estimate)
    message.residual_force, message.residual_torque = estimate.residual_force, estimate.residual_torque
    return message


def withheld_message(estimate: InertialEstimate, error: PoiseError) -> InertialEstimateMessage:
    """An estimate without its numbers: why, and what was found."""
    message = no_estimate_message(error, estimate.frame_id)
    message.header.stamp, message.findings = time_message(estimate.stamp), findings_message(estimate)
    return message


def findings_message(estimate: InertialEstimate) -> list[ErrorCodeMessage]:
    """Its findings."""
    return [ErrorCodeMessage(code=finding.code, message=finding.message) for finding in estimate.findings]


def change_message(change: PayloadChange, frame_id: str) -> PayloadChangeMessage:
    """Turn a change of the payload into a message."""
    message = PayloadChangeMessage(since=time_message(change.since))
    message.header.stamp, message.header.frame_id = time_message(change.stamp), frame_id
    message.mass_before, message.mass_after = change.mass_before, change.mass_after
    return message


def no_estimate_message(error: PoiseError, frame_id: str) -> InertialEstimateMessage:
    """Say with a message that there is no estimate yet, and why; every number in it is NaN."""
    message = InertialEstimateMessage(error=to_message(error))
    message.header.frame_id = frame_id
    inertia, nan = message.inertia, float("nan")
    inertia.m = inertia.com.x = inertia.com.y = inertia.com.z = nan
    inertia.ixx = inertia.ixy = inertia.ixz = inertia.iyy = inertia.iyz = inertia.izz = nan
    message.covariance, message.bias_covariance = np.full(100, nan), np.full(36, nan)
    force, torque = message.bias.force, message.bias.torque
    force.x = force.y = force.z = torque.x = torque.y = torque.z = nan
    message.delay = message.delay_std = message.condition_number = nan
    message.residual_force = message.residual_torque = nan
    return message
