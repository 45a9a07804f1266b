"""The parameters of fake_robot: declared with their ranges, and turned into a source of messages."""

from dataclasses import replace
from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.fake_robots.arm import ArmOptions, SimulatedArm
from poise.fake_robots.bag_replay import BagSource
from poise.fake_robots.drive import mounted_on_base
from poise.fake_robots.equipment import EQUIPMENT_PARAMETERS, make_equipment
from poise.files import package_file
from poise.geometry import GRAVITY_IN_WORLD
from poise.inertia import InertialParameters
from poise.nodes.parameters import WORDS, Parameter
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import FourierTrajectory, IdealRobot, JointNoise, check_limits, read_trajectory, wrench_noise

_MODES = ("replay", "arm")
PAYLOAD = ("payload.mass", "payload.com", "payload.inertia")


PARAMETERS = (
    Parameter("mode", "replay", "replay a bag, or simulate an arm", _MODES),
    Parameter("rate", 1.0, "how many times faster than the recording, or than reality", (1e-3, 1e3)),
    Parameter("loop", False, "restart at the end"),
    Parameter("playing", True, "start at once; false: wait for the service `play`"),
    Parameter("stay", False, "do not exit at the end: replay waits for `play`, an arm stays where it is"),
    Parameter("publish_clock", False, "publish /clock in the time of the messages"),
    Parameter("clock_rate", 100.0, "Hz of /clock", (1.0, 1e4)),
    Parameter(
        "clock_lead",
        0.0,
        "with publish_clock: s that /clock may be ahead of each node that follows it (topic clock_heard), at least two"
        " ticks and 0.2 s. The clock slows down when a node is late; 0: it waits for no node",
        (0.0, 10.0),
    ),
    Parameter("wait_for_subscribers", WORDS, "topics that must have a subscriber before the first message"),
    Parameter("wait_timeout", 30.0, "largest time to wait for them, s; 0: no limit", (0.0, 1e6)),
    Parameter("faults", WORDS, "faults to inject, one entry each, as `drop: {topic: wrench, share: 0.1}`"),
    Parameter("seed", 0, "seed of noise, faults and the trajectory `fourier`", (0, 2**31 - 1)),
    Parameter("bag", "", "replay: path of the bag, or package://NAME/path"),
    Parameter("topics", WORDS, "replay: topics to replay; empty: all"),
    Parameter("refuse_unknown", False, "replay: end with an error when a topic's type is not installed"),
    Parameter("robot", "fr3", "arm: fr3, xarm7, ur5e, ur10e, ridgeback_ur10, or the path of a URDF"),
    Parameter("sensor_frame", "ft_sensor", "arm: frame of the force-torque sensor"),
    Parameter("trajectory", "", "arm: path of a YAML or CSV file, or `fourier`; empty: follow joint_trajectory"),
    Parameter("duration", 20.0, "arm: s of the trajectory `fourier`", (1.0, 3600.0)),
    Parameter("speed", 0.3, "arm: largest share of the velocity limits in `fourier`", (1e-3, 1.0)),
    Parameter("payload.mass", 0.0, "arm: kg in the gripper; can be changed while it runs", (0.0, 1e3)),
    Parameter("payload.com", [0.0] * 3, "arm: its centre of mass in sensor axes, m"),
    Parameter("payload.inertia", [0.0] * 6, "arm: ixx ixy ixz iyy iyz izz about it, kg m2"),
    Parameter("tool_in_wrench", False, "arm: the wrench includes the empty gripper"),
    Parameter("gravity", list(GRAVITY_IN_WORLD), "arm: gravity in the world frame, m/s2"),
    Parameter("start_time", -1.0, "arm: s of the first stamp; negative: the wall clock", (-1.0, 4e9)),
    Parameter("sensor", "ft300", "arm: noise of none, ft300, axia80, gamma, low, moderate or high"),
    Parameter("sensor_rate", 0.0, "arm: rate of wrench, Hz; 0: the sensor's own", (0.0, 1e4)),
    Parameter("sensor_bias", [0.0] * 6, "arm: bias of the sensor, N and N m"),
    Parameter("sensor_drift", [0.0] * 2, "arm: random walk of force and torque, N and N m after one second"),
    Parameter("sensor_latency", 0.0, "arm: s that the stamps of the wrench are late", (0.0, 10.0)),
    Parameter("sensor_stamp_jitter", 0.0, "arm: jitter of the wrench stamps, s, one sigma", (0.0, 1.0)),
    Parameter("joint_rate", 125.0, "arm: Hz of joint_states", (1.0, 1e4)),
    Parameter("joint_noise", 1e-5, "arm: noise of positions, rad, one sigma", (0.0, 1.0)),
    Parameter("joint_resolution", 0.0, "arm: step of the encoders, rad; 0: none", (0.0, 1.0)),
    Parameter("joint_velocity_noise", 1e-3, "arm: noise of velocities, rad/s, one sigma", (0.0, 10.0)),
    Parameter("joint_effort_noise", 0.1, "arm: noise of efforts, N m, one sigma", (0.0, 100.0)),
    Parameter("joint_stamp_jitter", 0.0, "arm: jitter of the joint stamps, s, one sigma", (0.0, 1.0)),
    Parameter("tracking_delay", 0.0, "arm: s by which the joints follow their command late", (0.0, 5.0)),
    Parameter("trajectory_action", "joint_trajectory_controller/follow_joint_trajectory", "arm: name of the action"),
    Parameter("allow_partial_joints_goal", False, "arm: goals of the action may leave out joints"),
    Parameter("path_tolerance", 0.0, "arm: default of path_tolerance, rad or m; 0: none", (0.0, 10.0)),
    Parameter("goal_tolerance", 0.01, "arm: default of goal_tolerance, rad or m; 0: none", (0.0, 10.0)),
    Parameter("goal_time", 5.0, "arm: default of goal_time_tolerance, s", (0.0, 600.0)),
    *EQUIPMENT_PARAMETERS,
)


def make_source(values: dict[str, Any]) -> BagSource | SimulatedArm:
    """The bag or the arm that the parameters describe.

    Raises:
        InputError: as `BagSource`, `RobotModel`, `read_trajectory`, `wrench_noise` and `make_world`.
    """
    if values["mode"] == "replay":
        if not values["bag"]:
            raise InputError(ErrorCode.BAD_INPUT, "parameter bag: give the path of a bag, or set mode to arm")
        return BagSource(package_file(values["bag"]), values["topics"], values["refuse_unknown"])
    description = read_urdf(find_urdf(values["robot"]))
    if values["base"]:
        description = mounted_on_base(description, values["base_height"])
    model = RobotModel.from_urdf(description, values["sensor_frame"])
    trajectory = None
    if values["trajectory"] == "fourier":
        rng = np.random.default_rng(values["seed"])
        trajectory = FourierTrajectory.random(model, rng, duration=values["duration"], speed=values["speed"])
    elif values["trajectory"]:
        trajectory = read_trajectory(values["trajectory"], model)
        check_limits(model, trajectory)
    options = ArmOptions(
        wrench_noise=_sensor(values),
        joint_noise=JointNoise(
            rate=values["joint_rate"],
            position=values["joint_noise"],
            resolution=values["joint_resolution"],
            velocity=values["joint_velocity_noise"],
            effort=values["joint_effort_noise"],
            stamp_jitter=values["joint_stamp_jitter"],
        ),
        seed=values["seed"],
        start_stamp=None if values["start_time"] < 0 else round(values["start_time"] * 1e9),
        end=None if trajectory is None or values["stay"] else trajectory.duration,
        tracking_delay=values["tracking_delay"],
    )
    gear = make_equipment(values, model, description)
    return SimulatedArm(make_world(model, values), description, trajectory, options, gear)


def make_world(model: RobotModel, values: dict[str, Any]) -> IdealRobot:
    """The nominal world with the payload that the parameters describe.

    Raises:
        InputError: BAD_INPUT for numbers that are not finite or not as many as there should be, OBJECT_INVALID for a
            payload that cannot exist.
    """
    _finite(values, ("payload.com", 3), ("payload.inertia", 6), ("gravity", 3))
    xx, xy, xz, yy, yz, zz = values["payload.inertia"]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] < -1e-12 or moments[2] > (moments[0] + moments[1]) * (1 + 1e-9) + 1e-12:
        raise InputError(
            ErrorCode.OBJECT_INVALID,
            "parameter payload.inertia: no body has these moments (each at most the sum of the other two); "
            "the order is ixx ixy ixz iyy iyz izz",
        )
    phi = InertialParameters(values["payload.mass"], np.array(values["payload.com"]), inertia).phi
    return IdealRobot(model, phi, values["gravity"], values["tool_in_wrench"])


def _sensor(values: dict[str, Any]) -> Any:
    _finite(values, ("sensor_bias", 6), ("sensor_drift", 2))
    noise = wrench_noise(
        values["sensor"],
        bias=tuple(values["sensor_bias"]),
        drift_force=values["sensor_drift"][0],
        drift_torque=values["sensor_drift"][1],
        latency=values["sensor_latency"],
        stamp_jitter=values["sensor_stamp_jitter"],
    )
    return replace(noise, rate=values["sensor_rate"]) if values["sensor_rate"] else noise


def _finite(values: dict[str, Any], *lists: tuple[str, int]) -> None:
    for name, count in lists:
        if len(values[name]) != count or not np.isfinite(values[name]).all():
            raise InputError(ErrorCode.BAD_INPUT, f"parameter {name} must be {count} finite numbers")
