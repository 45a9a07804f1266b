"""A simulated arm as a source of messages: joint states, wrench, odometry, along a trajectory or as commanded."""

import functools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.fake_robots.gripper import SimulatedGripper
from poise.fake_robots.stream import Message, TopicInfo, in_order
from poise.recording import JointStream, WrenchStream, encode_stream, encode_text, typestore
from poise.simulation import (
    IdealRobot,
    JointMotion,
    JointNoise,
    NoisyJoints,
    NoisyWrench,
    Trajectory,
    WaypointTrajectory,
    WrenchNoise,
    check_limits,
    home,
)
from poise.types import Array

_BLOCK = 0.02  # s simulated at a time, and the longest delay of a command
_STOP_TIME = 0.5  # s to stop in when a command says so
_FARTHEST = 60.0  # s ahead that a command may lie
BASE_JOINTS = ("base_x", "base_y", "base_yaw")
"""Joints of a mobile base in a robot description."""


@dataclass(frozen=True)
class ArmOptions:
    """How the arm is sensed and when it ends.

    Args:
        wrench_noise, joint_noise: of the sensors, with their rates.
        seed: of the noise; the same one gives the same bytes.
        start_stamp: ns, header stamp of the beginning; None: the wall clock then.
        end: s after which there are no more messages; None: never.
        tracking_delay: s by which the joints follow their command late.
    """

    wrench_noise: WrenchNoise
    joint_noise: JointNoise
    seed: int = 0
    start_stamp: int | None = 0
    end: float | None = None
    tracking_delay: float = 0.0


class Waypoints(NamedTuple):
    """A commanded motion of K joints: (P,) s from its begin, and (P, K) arrays; None: at rest at every waypoint.

    It begins at `stamp` ns of the stamps of joint states, at once when that is zero.
    """

    names: Sequence[str]
    times: Array
    position: Array
    velocity: Array | None = None
    acceleration: Array | None = None
    stamp: int = 0


class SimulatedArm:
    """A robot in a nominal world that reports what its sensors would.

    Args:
        world: robot, payload, gravity.
        description: its URDF, for `robot_description`.
        trajectory: what it does from the start; None: rest at home until commanded.
        options: sensors, seed, clock.
        gripper: whose joint goes into joint_states, after the arm's.
    """

    def __init__(
        self,
        world: IdealRobot,
        description: str,
        trajectory: Trajectory | None,
        options: ArmOptions,
        gripper: SimulatedGripper | None = None,
    ) -> None:
        self.world, self._description, self._options, self._gripper = world, description, options, gripper
        self.model = world.model
        self._beginning = trajectory or WaypointTrajectory(np.zeros(1), home(self.model)[None])
        self._lock = threading.Lock()
        self._plans: list[tuple[float, Trajectory]] = [(0.0, self._beginning)]
        self._start = 0  # stamp of the beginning, ns
        self.commands = 0
        """How many commands have been taken: an action sees that another one has replaced its own."""
        self._frontier = 0.0  # s up to which the motion has been simulated and cannot be changed
        self.topics = {
            "robot_description": TopicInfo("std_msgs/msg/String", latched=True, depth=1),
            "joint_states": TopicInfo("sensor_msgs/msg/JointState"),
            "wrench": TopicInfo("geometry_msgs/msg/WrenchStamped"),
        }
        self._drives = set(BASE_JOINTS) <= set(self.model.joint_names)
        if self._drives:
            self.topics["odom"] = TopicInfo("nav_msgs/msg/Odometry")

    def hold(self, world: IdealRobot) -> None:
        """Take another payload (or gravity) from here on: a grasp, a release."""
        self.world = world

    @property
    def now(self) -> float:
        """s that have been simulated."""
        return self._frontier

    def stamp(self, seconds: float) -> int:
        """ns, header stamp of a time of the simulation, s."""
        return self._start + round(seconds * 1e9)

    def lateness(self, stamp: int) -> float:
        """s that a motion which should begin at a stamp (0: now) begins late; negative: it lies ahead."""
        return self._frontier - (stamp - self._start) * 1e-9 if stamp else 0.0

    def states(self, seconds: float) -> tuple[JointMotion, JointMotion]:
        """What is commanded at a time, s, and where the joints are, (1, J) each."""
        with self._lock:
            return self._motion(np.array([seconds])), self._actual(np.array([seconds]))

    def command(self, waypoints: Waypoints) -> tuple[int, float]:
        """Move through waypoints from where the arm then is, or (none at all) stop; what would be past is left out.

        Until a motion begins, the one before it goes on, as with ros2_control. Joints that are not named stop where
        they are.

        Returns:
            The number of the command, and when it begins, s.

        Raises:
            InputError: JOINT_MISSING for a joint that the robot does not have; BAD_INPUT for times or shapes;
                JOINT_LIMIT when the motion would leave the robot's limits.
        """
        names = waypoints.names
        unknown = [name for name in names if name not in self.model.joint_names]
        if unknown:
            raise InputError(
                ErrorCode.JOINT_MISSING,
                f"joint trajectory: the robot has no joint {', '.join(unknown)}; it has "
                f"{', '.join(self.model.joint_names)}",
            )
        columns = [self.model.joint_names.index(name) for name in names]
        with self._lock:
            wanted = (waypoints.stamp - self._start) * 1e-9 if waypoints.stamp else self._frontier
            begin = max(wanted, self._frontier)
            if begin > self._frontier + _FARTHEST:
                raise InputError(
                    ErrorCode.BAD_INPUT,
                    f"joint trajectory: it would begin in {begin - self._frontier:.0f} s; check clocks",
                )
            now = self._motion(np.array([begin]))
            late = waypoints._replace(times=np.asarray(waypoints.times, dtype=np.float64) - (begin - wanted))
            plan = _through(now, columns, late) if len(waypoints.times) else self._halt(begin)
            check_limits(self.model, plan)
            before = [(since, other) for since, other in self._plans if since < begin]
            self._plans = [*before[-3:], (begin, plan)]
            self.commands += 1
            return self.commands, begin

    def grip(self, names: Sequence[str], position: float) -> None:
        """Bring the gripper's joint to a position.

        Raises:
            InputError: JOINT_MISSING for another joint.
        """
        if self._gripper is None or list(names) != [self._gripper.joint]:
            known = "no gripper (parameter gripper_joint)" if self._gripper is None else f"only {self._gripper.joint}"
            raise InputError(
                ErrorCode.JOINT_MISSING, f"gripper trajectory: it is for {', '.join(names)}, and there is {known}"
            )
        with self._lock:
            self._gripper.go(position, self._frontier)

    def messages(self) -> Iterator[Message]:
        """Everything the robot says, simulated block by block as it is asked for."""
        with self._lock:
            self._plans, self._frontier = [(0.0, self._beginning)], 0.0
            self.commands += 1
        start = self._options.start_stamp
        if self._gripper is not None:
            self._gripper.reset()
        self._start = time.time_ns() if start is None else start
        for_joints, for_wrench = np.random.default_rng(self._options.seed).spawn(2)
        encoders = NoisyJoints(self._options.joint_noise, for_joints)
        sensor = NoisyWrench(self._options.wrench_noise, for_wrench)
        yield Message(self._start, "robot_description", encode_text(self._description))
        yield from in_order(
            self._blocks(encoders.noise.rate, functools.partial(self._say_joints, encoders)),
            self._blocks(sensor.noise.rate, functools.partial(self._say_wrench, sensor)),
        )

    def _blocks(
        self, rate: float, say: Callable[[NDArray[np.int64], JointMotion], Iterator[Message]]
    ) -> Iterator[Message]:
        """Samples at `rate`, a block at a time, until the end."""
        size = max(round(_BLOCK * rate), 1)
        first, last = 0, None if self._options.end is None else int(np.floor(self._options.end * rate)) + 1
        while last is None or first < last:
            count = np.arange(first, first + size if last is None else min(first + size, last))
            taken = np.round(count * (1e9 / rate)).astype(np.int64)
            seconds = taken * np.float64(1e-9)
            with self._lock:
                self._frontier = max(self._frontier, float(seconds[-1]) + 1e-9)
                motion = self._actual(seconds)
            yield from say(taken, motion)
            first = int(count[-1]) + 1

    def _actual(self, seconds: Array) -> JointMotion:
        return self._motion(seconds - self._options.tracking_delay)

    def _motion(self, seconds: Array) -> JointMotion:
        """What the plans say, each from its beginning until the next one's."""
        begins = np.array([begin for begin, _ in self._plans])
        which = np.maximum(np.searchsorted(begins, seconds, side="right") - 1, 0)
        out = np.empty((3, len(seconds), len(self.model.joint_names)))
        for i in np.unique(which):
            begin, plan = self._plans[i]
            here = which == i
            out[:, here] = plan.at(seconds[here] - begin)
        return JointMotion(out[0], out[1], out[2])

    def _halt(self, begin: float) -> WaypointTrajectory:
        """Slow down along the path that the arm is on, and stay."""
        u = np.linspace(0.0, 1.0, 26)
        rate, change = (1 - 3 * u**2 + 2 * u**3)[:, None], ((-6 * u + 6 * u**2) / _STOP_TIME)[:, None]
        path = self._motion(begin + _STOP_TIME * (u - u**3 + u**4 / 2))
        velocity = path.velocity * rate
        return WaypointTrajectory(
            u * _STOP_TIME, path.position, velocity, path.acceleration * rate**2 + path.velocity * change
        )

    def _say_joints(self, reports: NoisyJoints, taken: NDArray[np.int64], motion: JointMotion) -> Iterator[Message]:
        effort = self.world.effort(motion)
        stamps = self._start + np.maximum(reports.stamps(taken), 0)
        said = reports.report(motion.position, motion.velocity, effort)
        names = self.model.joint_names
        if self._gripper is not None:
            names = (*names, self._gripper.joint)
            fingers = self._gripper.at(taken * np.float64(1e-9))
            said = tuple(np.column_stack(pair) for pair in zip(said, fingers, strict=True))
        stream = JointStream(stamps, names, said[0], said[1], said[2])
        base = [self.model.joint_names.index(name) for name in BASE_JOINTS] if self._drives else []
        for i, (stamp, data) in enumerate(encode_stream("joint_states", stream)):
            yield Message(stamp, "joint_states", data)
            if self._drives:
                yield Message(stamp, "odom", _odometry(stamp, motion.position[i, base], motion.velocity[i, base]))

    def _say_wrench(self, reports: NoisyWrench, taken: NDArray[np.int64], motion: JointMotion) -> Iterator[Message]:
        truth = self.world.simulate(taken, motion)
        stamps = self._start + np.maximum(reports.stamps(taken), 0)
        stream = WrenchStream(stamps, reports.report(truth.wrench_in_sensor), self.model.sensor_frame)
        for stamp, data in encode_stream("wrench", stream):
            yield Message(stamp, "wrench", data)


def _through(now: JointMotion, columns: list[int], waypoints: Waypoints) -> WaypointTrajectory:
    """The commanded waypoints for all joints, with the present state as the first."""
    times = np.asarray(waypoints.times, dtype=np.float64)
    shape = (len(times), len(columns))
    ahead = times > 0.0
    rows = []
    others = (now.position[0], np.zeros_like(now.position[0]), np.zeros_like(now.position[0]))
    for name, value, present, other in zip(JointMotion._fields, waypoints[2:5], now, others, strict=True):
        given = np.zeros(shape) if value is None else np.asarray(value, dtype=np.float64)
        if given.shape != shape:
            raise InputError(ErrorCode.BAD_INPUT, f"joint trajectory: {name} has shape {given.shape}, expected {shape}")
        full = np.tile(other, (int(ahead.sum()), 1))
        full[:, columns] = given[ahead]
        rows.append(np.vstack([present, full]))
    return WaypointTrajectory(np.concatenate([[0.0], times[ahead]]), rows[0], rows[1], rows[2])


def _odometry(stamp: int, pose: Array, velocity: Array) -> bytes:
    """CDR of nav_msgs/Odometry: x, y, yaw in `odom`, and the twist in `base_link` as REP-105 wants it."""
    make: dict[str, Any] = dict(typestore().types)
    x, y, yaw = (float(value) for value in pose)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    forward = float(cosine * velocity[0] + sine * velocity[1])
    left = float(-sine * velocity[0] + cosine * velocity[1])
    seconds, nanoseconds = divmod(int(stamp), 10**9)

    def vector(kind: str, *values: float) -> Any:
        return make[f"geometry_msgs/msg/{kind}"](*values)

    header = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](seconds, nanoseconds), "odom")
    turned = vector("Quaternion", 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
    where = make["geometry_msgs/msg/Pose"](vector("Point", x, y, 0.0), turned)
    twist = make["geometry_msgs/msg/Twist"](
        vector("Vector3", forward, left, 0.0), vector("Vector3", 0.0, 0.0, float(velocity[2]))
    )
    exact = np.zeros(36)
    message = make["nav_msgs/msg/Odometry"](
        header,
        "base_link",
        make["geometry_msgs/msg/PoseWithCovariance"](where, exact),
        make["geometry_msgs/msg/TwistWithCovariance"](twist, exact),
    )
    return bytes(typestore().serialize_cdr(message, "nav_msgs/msg/Odometry"))
