"""One goal of place_object: what the planning thread and the executor exchange, its feedback and its result."""

import math
import time

from geometry_msgs.msg import PoseStamped

from poise.assembly import RigidObject
from poise.errors import ErrorCode, PoiseError
from poise.geometry import Pose
from poise.manipulation import TransferExecution
from poise.nodes.assembly_message import pose_message
from poise.nodes.place_execution import Carrying
from poise.nodes.runtime import end_goal, to_message
from poise.nodes.watchdog import WatchedGoal
from poise.placement import PlacementProgress
from poise_msgs.action import PlaceObject as Action
from poise_msgs.msg import Assembly as AssemblyMessage


class PlacementTask:
    """One goal: what the planning thread and the executor exchange.

    Args:
        goal: its handle.
        assembly: what it is about.
        due: when it is answered, also when the planner is still busy; on the monotonic clock, s.
        carrying: the robot that puts it there; None: it is only planned.
    """

    def __init__(self, goal: WatchedGoal, assembly: AssemblyMessage, due: float, carrying: Carrying | None) -> None:
        self.goal, self.assembly, self.due, self.carrying = goal, assembly, due, carrying
        self.accepted = time.monotonic()
        self.seconds: float | None = None
        self.progress = PlacementProgress(0, None, None)
        self.abandoned = self.begun = self.done = False
        self.error: PoiseError | None = None
        self.assumptions: list[str] = []
        self.remarks: list[str] = []
        self.object_frame = Pose.identity()
        self.pose_tool_object: Pose | None = None  # of what is in the hand
        self.item: RigidObject | None = None
        self._grip: bool | None = None

    def hand_changed(self, playing: TransferExecution) -> bool:
        """The fingers have closed or opened since this was asked last."""
        before, self._grip = self._grip, playing.grip
        return playing.grip is not None and playing.grip != before and (playing.grip or before is True or self.held)

    @property
    def held(self) -> bool:
        """It was in the hand at the beginning."""
        return self.pose_tool_object is not None

    def report(self, progress: PlacementProgress) -> bool:
        """Called by the planner; False ends it."""
        self.progress = progress
        return not self.abandoned

    @property
    def moves(self) -> bool:
        """The arm moves, too."""
        return bool(self.goal.request.execute)

    def without_arm(self, error: PoiseError) -> None:
        """Plan the placement alone; the answer says why."""
        self.carrying = None
        self.remarks = [f"the motion of the arm is not planned: {error.message}"]

    @property
    def ready(self) -> bool:
        """It can be planned: no arm has to move, or its start is known."""
        return self.carrying is None or self.carrying.start is not None

    @property
    def stage(self) -> str:
        """As feedback names it."""
        playing = None if self.carrying is None else self.carrying.playing
        return "planning" if playing is None else playing.stage

    def best(self) -> tuple[PoseStamped, float]:
        """The best pose so far, without a frame when there is none, and its robustness, N; NaN while unknown."""
        message, best, score = PoseStamped(), self.progress.best, self.progress.score
        if best is not None:
            message.pose, message.header.frame_id = pose_message(best.pose), self.assembly.header.frame_id
        return message, math.nan if score is None else float(score.least)


def cancelled_placement(goal: WatchedGoal) -> PoiseError:
    """The error of a goal that was cancelled before the arm moved."""
    return PoiseError(ErrorCode.CANCELLED, f"placing {goal.request.object.id} was cancelled; nothing was changed")


def placement_feedback(task: PlacementTask) -> Action.Feedback:
    """The stage, and the best placement so far."""
    pose, robustness = task.best()
    return Action.Feedback(
        stage=task.stage, iteration=task.progress.iteration, best_pose=pose, best_robustness=robustness
    )


def placement_result(goal: WatchedGoal, error: PoiseError | None, task: PlacementTask | None = None) -> Action.Result:
    """What a goal gets in the end; sets its status, too."""
    result = Action.Result(robustness=math.nan)
    if task is not None:
        result.seconds = task.seconds or time.monotonic() - task.accepted
        result.iterations, result.assumptions = task.progress.iteration, task.assumptions
        result.pose, result.robustness = task.best()
        result.assumptions = [*result.assumptions, *task.remarks]
        grasp, motions = (None, []) if task.carrying is None else task.carrying.planned()
        if grasp is not None:
            result.grasp.header.frame_id, result.grasp.pose = task.assembly.header.frame_id, pose_message(grasp)
        result.stages, result.trajectories = [name for name, _ in motions], [motion for _, motion in motions]
    result.error = to_message(error)
    end_goal(goal, error is None)
    return result
