"""Joint offset: the zero of a joint's encoder is wrong."""

import numpy as np

from poise.geometry import cross
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, motion_response
from poise.types import Array

_LARGEST = 0.35
"""rad: the response is linear in the offset up to about here."""


class JointOffset(Effect):
    """q_read = q_true + d, joint by joint: gravity and all motion before the joint reach the sensor rotated."""

    name = "joint_offset"
    layer = "kinematics"
    equation = "q_read = q_true + d; dw = -(dw/dq) d with the exact derivative of the sensor's motion"
    source = "kinematic calibration (Mooring, Roth, Driels 1991); derivatives: Carpentier and Mansard 2018"
    excited_by = "attitudes in which the joint turns gravity in the sensor"
    separating_motion = "move the other joints: an offset acts through the arm's pose, a turned sensor does not"
    confused_with = ("sensor_rotation", "base_tilt", "payload_parameters")
    needs = ("joints", "load")
    widens = "joints"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        names = () if recorded.joints is None else recorded.joints.names
        return tuple(
            EffectParameter(f"offset_{i}", "rad", 0.01, low=-_LARGEST, high=_LARGEST) for i in range(1, len(names) + 1)
        )

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        return -joint_columns(recorded)

    def twins(self, recorded: RecordedMotion, values: Values) -> tuple[str, ...]:
        """A single joint sees a tilt of its base about its axis alone, which is an offset."""
        del recorded
        return ("base_tilt",) if len(values) == 1 else ()

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        names = () if recorded.joints is None else recorded.joints.names
        offsets = [values[f"offset_{i}"] for i in range(1, len(names) + 1)]
        worst = int(np.argmax(np.abs(offsets)))
        return (
            f"The encoder of {names[worst]} reads {np.degrees(offsets[worst]):+.2f} degrees too much: "
            "the nominal model assumes a correct encoder."
        )


def joint_columns(recorded: RecordedMotion) -> Array:
    """(N, 6, J) change of the nominal wrench with each joint's position."""
    return recorded.once("joint columns", lambda: _joint_columns(recorded))


def _joint_columns(recorded: RecordedMotion) -> Array:
    if recorded.joints is None:
        return np.zeros((len(recorded), 6, 0))
    motion = recorded.joints.motion_by_position
    # Seen from the sensor, gravity turns the other way than the joint: d(R^T g) = (R^T g) x axis.
    axes = recorded.joints.jacobian_in_sensor[:, 3:]
    by_specific = cross(recorded.gravity[:, :, None], axes, axis=1) - motion[:, :3]
    return motion_response(recorded.phi, recorded.angular_velocity, by_specific, motion[:, 3:6], motion[:, 6:])
