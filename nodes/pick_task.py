"""One goal of pick_object: what the planning thread and the executor exchange, and its result."""

import math
import time

from geometry_msgs.msg import PoseStamped

from poise.assembly import RigidObject
from poise.errors import ErrorCode, PoiseError
from poise.geometry import Pose
from poise.manipulation import Grasp, Pick, PickExecution, PickSteps, pose_of, se3_of
from poise.nodes.assembly_message import pose_message
from poise.nodes.place_execution import Carrying
from poise.nodes.runtime import end_goal, to_message
from poise.nodes.trajectory_message import trajectory_message
from poise.nodes.watchdog import WatchedGoal
from poise_msgs.action import PickObject as Action
from poise_msgs.msg import Assembly as AssemblyMessage


class PickTask:
    """One goal: what the planning thread and the executor exchange.

    Args:
        goal: its handle.
        assembly: what it is about.
        due: until when the planning lasts, on the monotonic clock, s.
        carrying: the robot.
        object_frame: pose of the frame of the goal's object, in the assembly's.
    """

    def __init__(
        self, goal: WatchedGoal, assembly: AssemblyMessage, due: float, carrying: Carrying, object_frame: Pose
    ) -> None:
        self.goal, self.assembly, self.due, self.carrying = goal, assembly, due, carrying
        self.object_frame, self.accepted = object_frame, time.monotonic()
        self.seconds = 0.0
        self.tried: tuple[Grasp, ...] = ()
        self.item: RigidObject | None = None
        self.pick: Pick | None = None
        self.steps: PickSteps | None = None
        self.running: PickExecution | None = None
        self.error: PoiseError | None = None
        self.begun = self.planned = False
        self.assumptions = [*carrying.assumptions]

    @property
    def stage(self) -> str:
        """As feedback names it."""
        return "planning" if self.running is None else self.running.stage


def cancelled(goal: WatchedGoal) -> PoiseError:
    """The error of a goal that was cancelled before the arm moved."""
    return PoiseError(ErrorCode.CANCELLED, f"picking {goal.request.id} was cancelled; nothing was changed")


def pick_result(
    goal: WatchedGoal, error: PoiseError | None, task: PickTask | None = None, tool_frame: str = ""
) -> Action.Result:
    """What a goal gets in the end; sets its status, too."""
    result = Action.Result(mass=math.nan, mass_std=math.nan, error=to_message(error))
    if task is not None:
        result.seconds, result.attempts, result.assumptions = task.seconds, len(task.tried), task.assumptions
        running, pick, item = task.running, task.pick, task.item
        if running is not None:
            result.holding = running.holding
            if running.mass is not None:
                result.mass, result.mass_std = running.mass.mass, running.mass.std
        if pick is not None and item is not None:
            result.grasp = _stamped(task.assembly.header.frame_id, pose_of(se3_of(item.pose) * pick.grasp.object_tcp))
            result.held = _stamped(tool_frame, pose_of(pick.grasp.object_tcp.inverse()))
        if task.steps is not None:
            names, steps = task.carrying.arm.joint_names, task.steps
            moves = [step for step in (*steps.reach, *steps.lift, *steps.back) if step.motion is not None]
            result.stages = [step.name for step in moves]
            result.trajectories = [trajectory_message(names, step.motion) for step in moves if step.motion is not None]
    end_goal(goal, error is None)
    return result


def _stamped(frame: str, pose: Pose) -> PoseStamped:
    message = PoseStamped(pose=pose_message(pose))
    message.header.frame_id = frame
    return message
