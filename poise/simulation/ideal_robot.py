"""An ideal robot: rigid, with a rigid load in uniform gravity; its joint efforts and the wrench on its sensor."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from poise.geometry import GRAVITY_IN_WORLD
from poise.inertia.model import regressor
from poise.robot import BaseMotion, RobotModel, SensorMotion, inertia_of, pinocchio_state, sensor_motion
from poise.simulation.trajectories import JointMotion
from poise.types import Array


@dataclass(frozen=True)
class Truth:
    """What happens in the world at each stamp.

    Args:
        stamps: (N,) ns.
        joints: (N, J) positions, velocities, accelerations.
        effort: (N, J) N m or N that the joints must give; without friction.
        motion: of the sensor.
        wrench_in_sensor: (N, 6) N, N m that the load exerts on the sensor.
    """

    stamps: NDArray[np.int64]
    joints: JointMotion
    effort: Array
    motion: SensorMotion
    wrench_in_sensor: Array


class IdealRobot:
    """A robot that holds a payload.

    Args:
        model: the robot.
        payload: (10,) phi = (m, m c, I) about the sensor's origin, in sensor axes.
        gravity: (3,) m/s2 in the world.
        tool_in_wrench: whether the sensor carries the links that the URDF fixes beyond it (`model.load_in_sensor`)
            in addition to the payload. False: the driver subtracts the identified empty gripper in every attitude and
            motion, the usual case. Zeroing a sensor subtracts it in one attitude only: then this is True.
            Joint efforts always carry the gripper.
    """

    def __init__(
        self,
        model: RobotModel,
        payload: ArrayLike | None = None,
        gravity: ArrayLike = GRAVITY_IN_WORLD,
        tool_in_wrench: bool = False,
    ) -> None:
        self.model = model
        self.tool_in_wrench = tool_in_wrench
        self.payload = np.zeros(10) if payload is None else np.asarray(payload, dtype=np.float64)
        self.gravity = np.asarray(gravity, dtype=np.float64)
        self.load = self.payload + model.load_in_sensor if tool_in_wrench else self.payload
        self._loaded = model.pinocchio.copy()
        frame = self._loaded.frames[model.frame_id(model.sensor_frame)]
        self._loaded.inertias[frame.parentJoint] += frame.placement.act(inertia_of(self.payload))
        self._loaded.gravity.linear = self.gravity

    def holding(self, more: Array) -> "IdealRobot":
        """The same robot with (10,) phi added to its payload."""
        return IdealRobot(self.model, self.payload + more, self.gravity, self.tool_in_wrench)

    def simulate(self, stamps: NDArray[np.int64], joints: JointMotion, base: BaseMotion | None = None) -> Truth:
        """Joint efforts and the wrench on the sensor along a motion.

        Args:
            stamps: (N,) ns.
            joints: (N, J).
            base: how the root link moves, for a model with a floating base.

        Raises:
            InputError: as `poise.robot.kinematics.state`.
        """
        motion = sensor_motion(self.model, stamps, *joints, base=base)
        return Truth(stamps, joints, self.effort(joints, base), motion, self.wrench(motion))

    def wrench(self, motion: SensorMotion) -> Array:
        """(N, 6) what the load exerts on the sensor, contract sign (thesis eq. 2.97)."""
        specific = motion.gravity_in_sensor(self.gravity) - motion.linear_acceleration_in_sensor
        matrix = regressor(specific, motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor)
        return np.asarray(matrix @ self.load)

    def effort(self, joints: JointMotion, base: BaseMotion | None = None) -> Array:
        """(N, J) by the recursive Newton-Euler algorithm (Featherstone 2008, section 5.3), payload included."""
        motion = pinocchio_state(self.model, *joints, base=base)
        data = self._loaded.createData()
        moving = len(self.model.coupling)
        torque = np.empty((len(motion.q), moving))
        for i in range(len(motion.q)):
            whole = pin.rnea(self._loaded, data, motion.q[i], motion.v[i], motion.a[i])
            torque[i] = whole[len(whole) - moving :]
        return torque @ self.model.coupling
