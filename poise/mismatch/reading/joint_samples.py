"""Which joint states are used: finite ones, averaged down to a rate that the motion can follow."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading.findings import InputFinding
from poise.mismatch.reading.joint_errors import without_driver_errors
from poise.mismatch.reading.wrench_samples import (
    MAX_WRENCH_RATE,
    MAX_WRENCH_SAMPLES,
    averaged,
    averaged_readings,
    begun,
    mean_stamps,
)
from poise.recording import JointStream
from poise.robot import RobotModel, each_stamp_once, interpolated, left_out
from poise.types import Array, Mask

_BURST = 0.05
"""Share of the usual time between two samples up to which they were sent together: no rate is measured between them."""
_MAX_JOINT_RATE = 1000.0
"""Hz; averages over more than a few milliseconds blur the steps of an acceleration."""


def usable_joints(
    joints: JointStream, robot: RobotModel, *, alone: bool = False
) -> tuple[JointStream, list[str], list[InputFinding]]:
    """Without positions that are not finite or wrong and without repeated stamps, at no more than _MAX_JOINT_RATE.

    Args:
        joints: as measured.
        robot: that they move.
        alone: there is no wrench: as long as a wrench may be.

    Returns:
        The joint states; what was left out or corrected; what is wrong with them.

    Raises:
        InputError: TOO_FEW_SAMPLES, BAD_INPUT for those of two publishers.
    """
    finite, given = np.asarray(np.isfinite(joints.position).all(axis=1)), len(joints)
    joints, notes = left_out(joints, ~finite, "joint states are not finite")
    joints = each_stamp_once(joints)
    if len(joints) < 2:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"{len(joints)} of {given} joint states can be used: {int((~finite).sum())} are not finite, "
            f"{int(finite.sum()) - len(joints)} repeat the stamp before them; record more",
        )
    joints, said, findings = without_driver_errors(joints, robot)
    notes += said
    values = np.hstack([joints.position, joints.velocity, joints.effort])
    between = interpolated(joints, values[:, np.isfinite(values).all(axis=0)])
    joints, said = left_out(joints, between, "joint states lie on lines between others")
    notes += said
    if alone:
        joints, said = begun(joints)
        notes += said
    joints, said = averaged_joints(joints)
    together = _together(joints.seconds)
    if together > 1 and np.isfinite(joints.effort).any():
        said.append(f"{together} joint efforts each were averaged")
    return joints, notes + said, findings


def averaged_joints(joints: JointStream) -> tuple[JointStream, list[str]]:
    """Joint states, or commands, at no more than _MAX_JOINT_RATE."""
    period = float(np.median(np.diff(joints.stamps))) * 1e-9 if len(joints) > 1 else 1.0
    together = int(np.ceil(1.0 / max(period, 1e-6) / _MAX_JOINT_RATE - 0.05))
    if together < 2:
        return joints, []
    position, velocity = (averaged(values, together) for values in (joints.position, joints.velocity))
    effort = averaged_readings(joints.effort, together)
    fewer = JointStream(mean_stamps(joints.stamps, together), joints.names, position, velocity, effort)
    return fewer, [f"the joint states came at {1 / period:.0f} Hz; {together} samples each were averaged"]


def apart(seconds: Array) -> Mask:
    """(N,) samples that come some time after the one before: stamps of a burst say when it was sent."""
    steps = np.diff(seconds)
    least = _BURST * float(np.median(steps)) if len(steps) else 0.0
    return np.concatenate([[True], steps > least])


def compared_efforts(seconds: Array, effort: Array) -> tuple[Array, Array]:
    """Stamps and efforts (M, J) of finite samples, averaged to the rate and the number that a wrench may have.

    Args:
        seconds: (N,).
        effort: (N, J); joints without any effort have NaN throughout.
    """
    known = np.isfinite(effort)
    rows = known[:, known.any(axis=0)].all(axis=1)
    rows &= apart(seconds)
    seconds, effort = seconds[rows], effort[rows]
    together = _together(seconds)
    return (seconds, effort) if together < 2 else (averaged(seconds, together), averaged_readings(effort, together))


def _together(seconds: Array) -> int:
    """How many efforts are averaged."""
    rate = 1.0 / float(np.median(np.diff(seconds))) if len(seconds) > 1 else 1.0
    return int(np.ceil(max(len(seconds) / MAX_WRENCH_SAMPLES, rate / MAX_WRENCH_RATE - 0.05)))
