"""Joint efforts that balance a wrench on the sensor, and the wrench that explains joint efforts best."""

import numpy as np

from poise.mismatch.recorded.recorded_motion import RecordedMotion
from poise.mismatch.recorded.resampling import at_times
from poise.types import Array

_LEVER = 0.1
"""m: size of a torque relative to that of a force."""
_DAMPING = 0.05
"""m: efforts that need a lever shorter than this say little about a force."""
_SCALE = np.repeat([1.0, _LEVER], 3)


def joint_torques(recorded: RecordedMotion, wrench: Array) -> Array:
    """(M, J, k) efforts that (N, 6, k) wrenches of the load on the sensor need: tau = -J^T w.

    Raises:
        ValueError: without joints or efforts.
    """
    jacobian, seconds = _jacobian(recorded)
    one = wrench.shape[2] == 1  # `matmul` is five times as fast for several, and slower for one
    along = -(np.einsum("ncj,nck->njk", jacobian, wrench) if one else jacobian.swapaxes(1, 2) @ wrench)
    flat = along.reshape(len(along), int(np.prod(along.shape[1:])))
    return at_times(recorded.seconds, flat, seconds).reshape(len(seconds), *along.shape[1:])


def wrench_of_torques(recorded: RecordedMotion, torque: Array) -> Array:
    """(N, 6) wrench on the sensor, the smallest among those that explain efforts (M, J) best.

    Raises:
        ValueError: without joints or efforts.
    """
    jacobian, seconds = _jacobian(recorded)
    scaled, square = _damped(jacobian)
    there = at_times(seconds, torque, recorded.seconds)
    return np.asarray(-_SCALE * np.einsum("ncj,nj->nc", scaled, np.linalg.solve(square, there[:, :, None])[:, :, 0]))


def shown(recorded: RecordedMotion, wrench: Array) -> Array:
    """(N, 6, ...) what was recorded of wrenches on the sensor: all with a wrench sensor, else what joint efforts show.

    These are the smallest wrenches with the same efforts.
    """
    by_wrench = efforts_alone(recorded)
    if by_wrench is None:
        return wrench

    def made() -> Array:
        scaled, square = _damped(by_wrench.swapaxes(1, 2))
        return np.asarray(_SCALE[:, None] * (scaled @ np.linalg.solve(square, scaled.swapaxes(1, 2))) / _SCALE)

    return np.asarray(np.einsum("ncd,nd...->nc...", recorded.once("shown by efforts", made), wrench))


def efforts_alone(recorded: RecordedMotion) -> Array | None:
    """(N, J, 6) efforts by a wrench on the sensor where they alone were recorded; None with a wrench, or without."""
    if recorded.has("wrench") or recorded.joints is None or recorded.effort is None:
        return None
    return -_jacobian(recorded)[0].swapaxes(1, 2)


def _damped(jacobian: Array) -> tuple[Array, Array]:
    """(N, 6, J) Jacobians with torques as large as forces, and their damped squares (N, J, J)."""
    scaled = jacobian * _SCALE[:, None]
    return scaled, np.einsum("nci,ncj->nij", scaled, scaled) + _DAMPING**2 * np.eye(jacobian.shape[2])


def _jacobian(recorded: RecordedMotion) -> tuple[Array, Array]:
    """(N, 6, J) of the joints with efforts, and the stamps (M,) of these."""
    joints, effort = recorded.joints, recorded.effort
    if joints is None or effort is None:
        raise ValueError("this recording has no joint efforts")
    if effort.names == joints.names:
        return joints.jacobian_in_sensor, effort.seconds
    chosen = [joints.names.index(name) for name in effort.names]
    return recorded.once(("jacobian", effort.names), lambda: joints.jacobian_in_sensor[:, :, chosen]), effort.seconds
