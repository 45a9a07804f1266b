"""How a frame of the robot moved, and how well that is known.

- `motion`: `SensorMotion`, the motion that every wrench model needs.
- `urdf`, `model`: `RobotModel`, a URDF as untrusted input, with the sensor frame and the links beyond it.
- `kinematics`: joint positions, velocities, accelerations (and a moving base) -> `SensorMotion`.
- `splines`, `smoother`, `rest`, `differentiation`: positions or rotations -> velocities and accelerations with their
  covariance.
- `resampled`, `regular_clock`: positions and their derivatives at other times, by splines of adaptive smoothness, with
  the jitter of a regular clock removed; `odometry`: the motion of a base.
- `frame_tree`, `recorded_frames`, `fixed_frames`: the tree of frames of tf, the transforms of a recording, and which
  frames are fixed to the sensor's.
- `measured`: a recording's joint states or poses -> `SensorMotion` with its noise.
- `sources`: joint states or tf in memory, as they arrive (`stamped_buffer`); `recorded_kinematics` finds them in a
  recording; `imu`, `live_imu` take accelerations from an IMU.
- `motion_buffers`, `low_latency`, `shared_buffers`: the motion at the stamps of wrenches:
  at rest, smoothed, or with low latency.
- `models/`: URDFs of an FR3, an xArm7 and a UR10 on a Ridgeback.
"""

from poise.robot.differentiation import Derivatives, RotationDerivatives, differentiate, differentiate_rotations
from poise.robot.fixed_frames import fixed_frames, frame_names
from poise.robot.frame_tree import FrameTree, Mounting
from poise.robot.imu import Imu, ImuSource, find_imu
from poise.robot.kinematics import BaseMotion, frame_poses, motion_sigma, pinocchio_state, sensor_motion
from poise.robot.live_imu import IMU_LAG_STEP, IMU_LONGEST_DELAY, LiveImu
from poise.robot.measured import MeasuredMotion, motion_from_derivatives, motion_from_joints, motion_from_poses
from poise.robot.model import RobotModel, chains, find_urdf, inertia_of, phi_in_link, phi_of
from poise.robot.motion import SensorMotion
from poise.robot.motion_buffers import (
    NO_KINEMATICS,
    STALE,
    USED,
    MotionBuffer,
    PairingReasons,
    PairingSettings,
    SmoothedMotion,
    StaticPoseBuffer,
)
from poise.robot.odometry import MeasuredBase, base_from_odometry, base_motion_at
from poise.robot.odometry_input import usable_odometry
from poise.robot.recorded_frames import frames_above, is_constant
from poise.robot.recorded_kinematics import Kinematics, find_kinematics, has_topic, robot_of, robot_on_odometry
from poise.robot.regular_clock import regular_clock
from poise.robot.resampled import ResampledSignal, resample, sampling_times
from poise.robot.sample_checks import blanks, each_stamp_once, interpolated, lapsed, left_out, stands_alone
from poise.robot.scatter import ScatterMeter, scatter
from poise.robot.shared_buffers import SharedBuffers
from poise.robot.sources import FrameSource, JointSource, MotionSource, StampedPoses
from poise.robot.splines import Design, Grid, SplineFit
from poise.robot.stamped_buffer import CLOCK_JUMP, StampedBuffer, went_back
from poise.robot.turns import without_turns
from poise.robot.urdf import parse_urdf, read_urdf

__all__ = [
    "CLOCK_JUMP",
    "IMU_LAG_STEP",
    "IMU_LONGEST_DELAY",
    "NO_KINEMATICS",
    "STALE",
    "USED",
    "BaseMotion",
    "Derivatives",
    "Design",
    "FrameSource",
    "FrameTree",
    "Grid",
    "Imu",
    "ImuSource",
    "JointSource",
    "Kinematics",
    "LiveImu",
    "MeasuredBase",
    "MeasuredMotion",
    "MotionBuffer",
    "MotionSource",
    "Mounting",
    "PairingReasons",
    "PairingSettings",
    "ResampledSignal",
    "RobotModel",
    "RotationDerivatives",
    "ScatterMeter",
    "SensorMotion",
    "SharedBuffers",
    "SmoothedMotion",
    "SplineFit",
    "StampedBuffer",
    "StampedPoses",
    "StaticPoseBuffer",
    "base_from_odometry",
    "base_motion_at",
    "blanks",
    "chains",
    "differentiate",
    "differentiate_rotations",
    "each_stamp_once",
    "find_imu",
    "find_kinematics",
    "find_urdf",
    "fixed_frames",
    "frame_names",
    "frame_poses",
    "frames_above",
    "has_topic",
    "inertia_of",
    "interpolated",
    "is_constant",
    "lapsed",
    "left_out",
    "motion_from_derivatives",
    "motion_from_joints",
    "motion_from_poses",
    "motion_sigma",
    "parse_urdf",
    "phi_in_link",
    "phi_of",
    "pinocchio_state",
    "read_urdf",
    "regular_clock",
    "resample",
    "robot_of",
    "robot_on_odometry",
    "sampling_times",
    "scatter",
    "sensor_motion",
    "stands_alone",
    "usable_odometry",
    "went_back",
    "without_turns",
]
