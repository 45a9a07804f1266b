"""The robot's side of `place_object`: where the arm is, a plan that minds it, and commands for arm and gripper."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from poise.assembly import Analysis, RigidObject
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.geometry import Pose
from poise.manipulation import (
    Arm,
    Grip,
    Gripper,
    Hand,
    HeldReach,
    Limits,
    Reach,
    RobotPort,
    Tolerances,
    Transfer,
    TransferExecution,
    TransferStep,
    grasp_of_held,
    plan_transfer,
    pose_of,
    require_room,
    se3_of,
    steps_of,
    with_stops,
)
from poise.nodes.clock import node_seconds
from poise.nodes.parameters import Parameter, declare_parameters
from poise.nodes.placed_arm import base_of, placed_arm
from poise.nodes.runtime import LATCHED, coded, guarded
from poise.nodes.trajectory_message import trajectory_message
from poise.nodes.transforms import heard_frames
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal, execution_options, watch_limits
from poise.placement import Options, Placement, PlacementPlanner, PlacementProgress
from poise.recording import stamp_of
from poise.simulation import WaypointTrajectory
from poise.types import Array

_ARM_TOPIC, _GRIPPER_TOPIC = "joint_trajectory", "gripper_trajectory"

PLACE_EXECUTION_PARAMETERS = (
    Parameter("tcp_frame", "tcp", "execute: frame of robot_description between the finger tips, z out of the hand"),
    Parameter("base", [0.0] * 4, "where tf has no base: its pose in the assembly's frame, x y z m and yaw rad"),
    Parameter("speed", 0.5, "execute: largest speed of the tool, m/s", (0.01, 2.0)),
    Parameter(
        "ways_seconds", 10.0, "execute: time limit for planning paths of the arm, s", (0.1, 3600.0), dynamic=True
    ),
    Parameter(
        "arrival_tolerance",
        0.003,
        "execute: largest error of a joint at the end of a motion, rad",
        (1e-5, 0.1),
        dynamic=True,
    ),
    Parameter(
        "path_tolerance",
        0.05,
        "execute: largest error on the path, rad, plus the travel in 0.15 s",
        (1e-4, 1.0),
        dynamic=True,
    ),
    Parameter("slack", 2.0, "execute: s that arm and fingers may arrive late", (0.0, 600.0), dynamic=True),
    Parameter("gripper_joint", Gripper.joint, "execute: the joint that gripper_trajectory commands"),
    Parameter(
        "gripper_open", Gripper.opened, "execute: its position with the fingers 85 mm apart, rad or m", (-10.0, 10.0)
    ),
    Parameter(
        "gripper_closed", Gripper.closed, "execute: its position with the fingers together, rad or m", (-10.0, 10.0)
    ),
    Parameter(
        "gripper_squeeze", Gripper.squeeze, "execute: m that it closes beyond the width of what it grasps", (0.0, 0.08)
    ),
    Parameter(
        "fingers_show_grasp",
        False,
        "execute: what kept the fingers open when they gripped it is gone when they have closed; not so with soft"
        " objects",
    ),
    Parameter("gripper_seconds", Gripper.seconds, "execute: time that the fingers need, s", (0.05, 60.0)),
)


def seconds_left(due: float, what: str) -> float:
    """s of the monotonic clock until `due`.

    Raises:
        NoAnswerError: DEADLINE when there are none left for what was to come.
    """
    left = due - time.monotonic()
    if left <= 0:
        raise NoAnswerError(ErrorCode.DEADLINE, f"the deadline passed before {what}; allow more time")
    return left


class Carrying:
    """What one goal has of the robot: where it is, the plan, and then its playing.

    Args:
        arm, robot: the same one, to plan with and to command.
        values: parameters.
        assumptions: about where the arm stands.
    """

    def __init__(self, arm: Arm, robot: RobotPort, values: dict[str, Any], assumptions: list[str]) -> None:
        self.arm, self.robot, self._values, self.assumptions = arm, robot, values, assumptions
        self._begun = node_seconds()
        self.start: Array | None = None
        self._transfer: Transfer | None = None
        self._steps: tuple[TransferStep, ...] = ()
        self._grasp: Pose | None = None
        self.pose_tool_object = Pose.identity()
        self._grip: Grip | None = None  # how the fingers hold what is in the hand
        self.playing: TransferExecution | None = None

    def held_by(self, grip: Grip | None) -> None:
        """How the fingers hold what is in the hand; None: not known."""
        if not self._values["fingers_show_grasp"]:
            return
        self._grip = grip
        if grip is None:
            self.assumptions.append("how the fingers hold the object is not known: a drop on the way is not noticed")

    @property
    def tolerances(self) -> Tolerances:
        """How well the robot has to follow."""
        values = self._values
        return Tolerances(values["arrival_tolerance"], values["path_tolerance"], values["slack"])

    def plan_again(self) -> None:
        """Begin again to wait until the arm rests."""
        self.start, self._begun = None, node_seconds()

    def found_start(self, now: float) -> bool:
        """Whether it is known where the arm rests; raises as `RobotPort.rests_at`."""
        self.start = self.robot.rests_at(now, self._begun)
        return self.start is not None

    def plan(
        self,
        planner: PlacementPlanner,
        analysis: Analysis,
        item: RigidObject,
        options: Options,
        seed: int,
        due: float,
        report: Callable[[PlacementProgress], bool],
        pose_tool_object: Pose | None = None,
    ) -> Placement:
        """Where the object stays, and how it gets there, from where it lies or from the hand; in the jobs' thread.

        Raises:
            InputError, NoAnswerError: as the planner, `plan_transfer`, `require_room`, `grasp_of_held`,
                `Reach.require_free_start` and `Reach.require_pick`.
        """
        if pose_tool_object is None or self.start is None:
            require_room(analysis, item)
            reach = Reach(self.arm, analysis, item, start=self.start, seed=seed)
        else:
            opening = np.nan if self._grip is None else sum(self._grip)
            grasp = grasp_of_held(item, pose_tool_object, self.arm, opening)
            reach = HeldReach(self.arm, analysis, item, grasp, self.start, seed)
            item = reach.item
        reach.require_free_start()
        reach.require_pick()
        left = seconds_left(due, "the first pose")
        for_ways = min(self._values["ways_seconds"], left / 2)
        tests, looks = (*options.tests, *reach.tests), (*options.looks, *reach.looks)
        wanted = replace(options, deadline=left - for_ways, tests=tests, looks=looks)
        found = planner.plan(analysis, item, wanted, seed, report)
        seconds = min(self._values["ways_seconds"], seconds_left(due, "a way was looked for"))
        limits = Limits(speed=self._values["speed"])
        transfer = plan_transfer(reach, found.analysis, found.item, limits, seconds, seed)
        held = transfer.grasp.object_tcp.inverse().act(item.pose.undo(item.com_in_world))
        steps = steps_of(transfer, self._values["speed"])
        self._steps = with_stops(steps, self.arm, held, transfer.ends.hold)
        for step in self._steps:
            if step.stops is not None:
                self.robot.commanded.load(step.stops)
        self._transfer = transfer
        self._grasp = pose_of(se3_of(item.pose) * transfer.grasp.object_tcp)
        self.pose_tool_object = pose_of(transfer.grasp.object_tcp.inverse())
        return found

    def planned(self) -> tuple[Pose | None, list[tuple[str, JointTrajectory]]]:
        """The tool frame at the grasp, in the assembly's frame, and the motion of each stage; None before the plan."""
        names = self.arm.joint_names
        motions = [(step.name, trajectory_message(names, step.motion)) for step in self._steps if step.motion]
        return self._grasp, motions

    def play(self, name: str, now: float) -> None:
        """Begin to move."""
        if self._transfer is None:
            raise PoiseError(ErrorCode.INTERNAL, "there is no plan to play")
        self.playing = TransferExecution(name, self._steps, self.robot, self.tolerances, now, self._grip)

    @property
    def tool_pose(self) -> Pose:
        """Of the tool frame where the arm is, in the assembly's frame."""
        return pose_of(self.arm.tool(self.robot.joints.position))

    def stop(self) -> None:
        """Stop the arm, also in the middle of a motion."""
        if self.playing is not None:
            self.playing.cancel(node_seconds())


class PlaceExecution:
    """Hears robot_description (latched) and, while a goal is executed, joint_states; commands arm and gripper.

    Args:
        node: the placement_planner.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._values = values = declare_parameters(node, PLACE_EXECUTION_PARAMETERS)
        self._base = base_of(values)
        self._gripper = Gripper(
            values["gripper_joint"],
            values["gripper_open"],
            values["gripper_closed"],
            Hand().stroke,
            values["gripper_squeeze"],
            values["gripper_seconds"],
        )
        self._arm: Arm | None = None
        self._problem: PoiseError = InputError(
            ErrorCode.ROBOT_DESCRIPTION_MISSING, "execute needs a robot, and there is no robot_description: publish it"
        )
        self._listening: Any = None
        self._outlets = {
            name: node.create_publisher(JointTrajectory, name, 10) for name in (_ARM_TOPIC, _GRIPPER_TOPIC)
        }
        node.create_subscription(String, "robot_description", guarded(node, self._on_description), LATCHED)
        self._frames = heard_frames(node)

    @property
    def values(self) -> dict[str, Any]:
        """The parameters."""
        return self._values

    @property
    def known(self) -> bool:
        """There is a robot to plan for."""
        return self._arm is not None

    def to_plan(self, frame: str) -> Carrying:
        """Begin to listen for a goal that is only planned; the assembly's frame."""
        assumptions, options = self._stand(frame), execution_options(self._node)
        robot = RobotPort(self._arm, self._gripper, lambda *_: None, lambda _: None, options=options)
        return self._listen(robot, assumptions)

    def open(self, goal: WatchedGoal, watchdog: ProcessWatchdog, frame: str) -> Carrying:
        """Begin to listen for a goal, with the watchdog of its motions; the assembly's frame.

        Raises:
            InputError: ROBOT_DESCRIPTION_MISSING, or what is wrong with it; TOPIC_MISSING without controllers.
        """
        if self._arm is None:
            raise self._problem
        for name, outlet in self._outlets.items():
            if not outlet.get_subscription_count():
                raise InputError(
                    ErrorCode.TOPIC_MISSING, f"no controller listens on {name}: remap it to the robot's, or start it"
                )
        assumptions, options = self._stand(frame), execution_options(self._node)
        move = partial(self._move, self._arm.joint_names)
        robot = RobotPort(self._arm, self._gripper, move, self._grip, watchdog, options)
        watchdog.watch(goal, self._arm.joint_names, watch_limits(self._node))
        return self._listen(robot, assumptions)

    def pose(self, frame: str, reference: str) -> Pose | None:
        """By tf; None when nothing joins the frames."""
        return Pose.identity() if frame == reference else self._frames.pose(frame, reference)

    def _stand(self, frame: str) -> list[str]:
        """Place the arm's base in a frame: by tf, or by the parameter; return what was assumed."""
        arm, assumptions = placed_arm(self._arm, self._frames, frame, self._values["base"])
        if not np.allclose(arm.base.homogeneous, self._arm.base.homogeneous, atol=1e-6):
            self._arm = arm
        return assumptions

    def _listen(self, robot: RobotPort, assumptions: list[str]) -> Carrying:
        self._listening = self._node.create_subscription(
            JointState, "joint_states", guarded(self._node, partial(_hear, robot)), 100
        )
        return Carrying(self._arm, robot, self._values, assumptions)

    def close(self) -> None:
        """Listen no more."""
        if self._listening is not None:
            self._node.destroy_subscription(self._listening)
            self._listening = None

    def _on_description(self, message: String) -> None:
        try:
            self._arm = Arm.from_urdf(message.data, self._base, tcp_frame=self._values["tcp_frame"])
        except Exception as failure:
            if self._arm is not None:
                raise  # an invalid description does not replace a valid one
            self._problem = coded(failure)  # raised when a goal needs the robot

    def _move(self, names: tuple[str, ...], motion: WaypointTrajectory, stamp: int) -> None:
        self._outlets[_ARM_TOPIC].publish(trajectory_message(names, motion, stamp))

    def _grip(self, position: float) -> None:
        there = WaypointTrajectory(np.array([self._gripper.seconds]), np.array([[position]]))
        self._outlets[_GRIPPER_TOPIC].publish(trajectory_message([self._gripper.joint], there))


def _hear(robot: RobotPort, message: JointState) -> None:
    robot.add_joint_state(stamp_of(message), message.name, message.position, node_seconds())
