"""A simulated arm as a source of messages: joint states, wrench, odometry, along a trajectory or as commanded."""

import functools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.fake_robots.drive import Drive
from poise.fake_robots.gripper import SimulatedGripper
from poise.fake_robots.link_frames import LinkFrames, odometry_bytes, tf_bytes
from poise.fake_robots.stream import Message, TopicInfo, in_order
from poise.geometry import Pose
from poise.recording import JointStream, WrenchStream, encode_stream, encode_text
from poise.robot import sensor_motion
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

if TYPE_CHECKING:  # slow to import; few arms have a world or a camera
    from poise.fake_robots.camera import RenderedCamera
    from poise.fake_robots.handling import Handling

_BLOCK = 0.02  # s simulated at a time, and the longest delay of a command
_STOP_TIME = 0.5  # s to stop in when a command says so
_TRUTH_RATE = 10.0  # Hz of world_truth
_FARTHEST = 60.0  # s ahead that a command may lie


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


@dataclass(frozen=True)
class Equipment:
    """What an arm has besides its joints and its sensor; None: it has none.

    Args:
        gripper: whose joint goes into joint_states, after the arm's.
        drive: that moves the base joints in addition to their trajectories.
        handling: the world in which the hand grasps.
        camera: in that world.
        tf_rate: Hz of the links' frames; 0: they are not published.
        fixed_frames: parents, children and poses for tf_static, beside the description's.
    """

    gripper: SimulatedGripper | None = None
    drive: Drive | None = None
    handling: "Handling | None" = None
    camera: "RenderedCamera | None" = None
    tf_rate: float = 0.0
    fixed_frames: tuple[tuple[str, str, Pose], ...] = ()


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
        gear: what else it has.
    """

    def __init__(
        self,
        world: IdealRobot,
        description: str,
        trajectory: Trajectory | None,
        options: ArmOptions,
        gear: Equipment | None = None,
    ) -> None:
        self.world, self._description, self._options, self.gear = world, description, options, gear or Equipment()
        self.model = world.model
        self._beginning = trajectory or WaypointTrajectory(np.zeros(1), home(self.model)[None])
        self._lock = threading.Lock()
        self._plans: list[tuple[float, Trajectory]] = [(0.0, self._beginning)]
        self._start = 0  # stamp of the beginning, ns
        self.commands = 0
        """How many commands have been taken: an action sees that another one has replaced its own."""
        self._frontier = 0.0  # s up to which the motion has been simulated and cannot be changed
        self._held = (np.zeros(10), world)  # phi of what is held, and the robot with it
        self._base_world = world
        self._gripper = self.gear.gripper
        self._frames = LinkFrames(description, self.model, self.gear.fixed_frames)
        self._base = self._frames.base_columns
        self.topics = {
            "robot_description": TopicInfo("std_msgs/msg/String", latched=True, depth=1),
            "joint_states": TopicInfo("sensor_msgs/msg/JointState"),
            "wrench": TopicInfo("geometry_msgs/msg/WrenchStamped"),
        }
        if self._base:
            self.topics["odom"] = TopicInfo("nav_msgs/msg/Odometry")
        if self.gear.tf_rate:
            self.topics["tf"] = TopicInfo("tf2_msgs/msg/TFMessage")
            self.topics["tf_static"] = TopicInfo("tf2_msgs/msg/TFMessage", latched=True, depth=1)
        if self.gear.handling is not None:
            self.topics["world_truth"] = TopicInfo("tf2_msgs/msg/TFMessage", depth=10)
        if self.gear.camera is not None:
            self.topics |= self.gear.camera.topics

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
                JOINT_LIMIT when the motion would leave the robot's limits. A stop is never refused.
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
            if len(waypoints.times):  # a stop is never refused
                check_limits(self.model, plan)
            before = [(since, other) for since, other in self._plans if since < begin]
            self._plans = [*before[-3:], (begin, plan)]
            self.commands += 1
            return self.commands, begin

    def drive(self, velocity: Array) -> None:
        """Drive the base from now on: (3,) forward, left, m/s, and turning, rad/s.

        Raises:
            InputError: NOT_FINITE; UNSUPPORTED without a base.
        """
        if self.gear.drive is None:
            raise InputError(ErrorCode.UNSUPPORTED, "cmd_vel: the robot has no base that drives")
        self.gear.drive.command(velocity, self._frontier)

    def grip(self, names: Sequence[str], position: float, force: float = 0.0) -> None:
        """Bring the gripper's joint to a position, with a force, N; 0: the gripper's own.

        Raises:
            InputError: JOINT_MISSING for another joint.
        """
        if self._gripper is None or list(names) != [self._gripper.joint]:
            known = "no gripper (parameter gripper_joint)" if self._gripper is None else f"only {self._gripper.joint}"
            raise InputError(
                ErrorCode.JOINT_MISSING, f"gripper trajectory: it is for {', '.join(names)}, and there is {known}"
            )
        with self._lock:
            self._gripper.go(position, self._frontier, force)

    def messages(self) -> Iterator[Message]:
        """Everything the robot says, simulated block by block as it is asked for."""
        with self._lock:
            self._plans, self._frontier = [(0.0, self._beginning)], 0.0
            self.commands += 1
            for part in (self._gripper, self.gear.drive, self.gear.handling):
                if part is not None:
                    part.reset()
        start = self._options.start_stamp
        self._start = time.time_ns() if start is None else start
        for_joints, for_wrench = np.random.default_rng(self._options.seed).spawn(2)
        encoders = NoisyJoints(self._options.joint_noise, for_joints)
        sensor = NoisyWrench(self._options.wrench_noise, for_wrench)
        yield Message(self._start, "robot_description", encode_text(self._description))
        streams = [
            self._blocks(encoders.noise.rate, functools.partial(self._say_joints, encoders)),
            self._blocks(sensor.noise.rate, functools.partial(self._say_wrench, sensor)),
        ]
        if self.gear.tf_rate:
            yield Message(self._start, "tf_static", self._frames.fixed(self._start))
            streams.append(self._blocks(self.gear.tf_rate, self._say_frames))
        if self.gear.handling is not None:
            streams.append(self._blocks(_TRUTH_RATE, self._say_truth))
        if self.gear.camera is not None:
            streams.append(self._blocks(self.gear.camera.mounted.rate, self._say_images))
        yield from (message for message in in_order(*streams) if message.topic)

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
            if 1 / rate > _BLOCK:  # its time has to come: a command may change what is said
                yield Message(self._start + int(taken[0]) - round(_BLOCK * 1e9), "", b"")
            with self._lock:
                self._go_on(float(seconds[-1]) + 1e-9)
                motion = self._actual(seconds)
            yield from say(taken, motion)
            first = int(count[-1]) + 1

    def _go_on(self, until: float) -> None:
        """Simulate base and world up to a time, s: what happens until then is no longer changed."""
        self._frontier = max(self._frontier, until)
        if self.gear.drive is not None:
            self.gear.drive.advance(self._frontier)
        if self.gear.handling is not None:
            self.gear.handling.advance(self._frontier, self._actual)

    def _actual(self, seconds: Array) -> JointMotion:
        """Where the joints are."""
        motion = self._motion(seconds - self._options.tracking_delay)
        if self.gear.drive is not None:
            for value, driven in zip(motion, self.gear.drive.at(seconds), strict=True):
                value[:, self._base] += driven
        return motion

    def _robot(self, seconds: float) -> IdealRobot:
        """The robot with what it holds at a time."""
        if self.gear.handling is None:
            return self.world
        phi = self.gear.handling.payload(seconds)
        if not np.any(phi):
            return self.world
        if not np.array_equal(phi, self._held[0]) or self._base_world is not self.world:
            self._held, self._base_world = (phi, self.world.holding(phi)), self.world
        return self._held[1]

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
        effort = self._robot(taken[0] * 1e-9).effort(motion)
        stamps = self._start + np.maximum(reports.stamps(taken), 0)
        said = reports.report(motion.position, motion.velocity, effort)
        names = self.model.joint_names
        if self._gripper is not None:
            names = (*names, self._gripper.joint)
            fingers = self._gripper.at(taken * np.float64(1e-9))
            said = tuple(np.column_stack(pair) for pair in zip(said, fingers, strict=True))
        stream = JointStream(stamps, names, said[0], said[1], said[2])
        for i, (stamp, data) in enumerate(encode_stream("joint_states", stream)):
            yield Message(stamp, "joint_states", data)
            if self._base:
                place, velocity = motion.position[i, self._base], motion.velocity[i, self._base]
                odometry = odometry_bytes(stamp, self._frames.root, self._frames.base, place, velocity)
                yield Message(stamp, "odom", odometry)

    def _say_wrench(self, reports: NoisyWrench, taken: NDArray[np.int64], motion: JointMotion) -> Iterator[Message]:
        robot = self._robot(taken[0] * 1e-9)
        moved = sensor_motion(self.model, taken, *motion)
        wrench = robot.wrench(moved)
        if self.gear.handling is not None:
            wrench = wrench + self.gear.handling.reaction(taken[0] * 1e-9, moved, robot.gravity)
        stamps = self._start + np.maximum(reports.stamps(taken), 0)
        stream = WrenchStream(stamps, reports.report(wrench), self.model.sensor_frame)
        for stamp, data in encode_stream("wrench", stream):
            yield Message(stamp, "wrench", data)

    def _say_frames(self, taken: NDArray[np.int64], motion: JointMotion) -> Iterator[Message]:
        for time_taken, position in zip(taken.tolist(), motion.position, strict=True):
            stamp = self._start + time_taken
            yield Message(stamp, "tf", self._frames.moving(stamp, position))

    def _say_truth(self, taken: NDArray[np.int64], motion: JointMotion) -> Iterator[Message]:
        handling = self.gear.handling
        if handling is not None:
            stamp = self._start + int(taken[-1])
            objects = handling.world.objects.values()
            yield Message(stamp, "world_truth", tf_bytes([(stamp, "world", item.id, item.pose) for item in objects]))

    def _say_images(self, taken: NDArray[np.int64], motion: JointMotion) -> Iterator[Message]:
        handling, camera = self.gear.handling, self.gear.camera
        if handling is None or camera is None:
            return
        for time_taken, position in zip(taken.tolist(), motion.position, strict=True):
            stamp = self._start + time_taken
            yield Message(stamp, "", b"")  # the image is taken when its time has come
            parent = handling.root @ self._frames.poses((camera.mounted.parent,), position)[0]
            number = round(time_taken * 1e-9 * camera.mounted.rate)
            yield from camera.expose(number, stamp, parent @ camera.mounted.pose, handling.world.objects)


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
