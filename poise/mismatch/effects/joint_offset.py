"""Joint offset: a joint's zero is not where its encoder says."""

import numpy as np

from poise.mismatch.effects.base import Array, Effect, Parameter, Values
from poise.mismatch.load import motion_response
from poise.mismatch.world import World


class JointOffset(Effect):
    """q_true = q_read + d, joint by joint: gravity and all motion above the joint reach the sensor turned."""

    name = "joint_offset"
    layer = "kinematics"
    equation = "q_true = q_read + d; dw = (dw/dq) d with the exact derivative of the sensor's motion"
    source = "kinematic calibration (Mooring, Roth, Driels 1991); derivatives: Carpentier and Mansard 2018"
    excited_by = "attitudes in which the joint turns gravity in the sensor"
    separating_motion = "move the other joints: an offset acts through the arm's pose, a turned sensor does not"
    confused_with = ("sensor_rotation", "base_tilt", "payload_parameters")
    needs = ("joints", "load")
    widens = "joints"

    def parameters(self, world: World) -> tuple[Parameter, ...]:
        names = () if world.joints is None else world.joints.names
        return tuple(Parameter(name, "rad", 0.02) for name in names)

    def columns(self, world: World, nonlinear: Values) -> Array:
        del nonlinear
        return joint_columns(world)

    def sentence(self, world: World, values: Values) -> str:
        worst = max(values, key=lambda name: abs(values[name]))
        return (
            f"The zero of {worst} is off by {np.degrees(values[worst]):+.2f} degrees: "
            "the nominal model takes its encoder at its word."
        )


def joint_columns(world: World) -> Array:
    """(N, 6, J) change of the nominal wrench with each joint's position."""
    if world.joints is None:
        return np.zeros((len(world), 6, 0))
    motion = world.joints.motion_by_position
    # Seen from the sensor, gravity turns the other way than the joint: d(R^T g) = (R^T g) x axis.
    axes = world.joints.jacobian_in_sensor[:, 3:]
    by_specific = np.cross(world.gravity[:, :, None], axes, axis=1) - motion[:, :3]
    return motion_response(world.phi, world.angular_velocity, by_specific, motion[:, 3:6], motion[:, 6:])
