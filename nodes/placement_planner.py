"""Node: the action `place_object`: where an object stays in the assembly that stands, and how an arm puts it there."""

import math
import time
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

from geometry_msgs.msg import Pose as PoseMessage

from poise.assembly import Analysis, settle
from poise.assembly.statics import analysis_after
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.geometry import Pose
from poise.manipulation import TransferExecution
from poise.nodes.arm_node import ArmNode
from poise.nodes.assembly_message import assembly_message, assembly_of, assumptions_of, object_of, scene_of_node
from poise.nodes.clock import node_seconds
from poise.nodes.hand_events import HandEvents
from poise.nodes.jobs import ANSWER_GRACE, Jobs, run_with_jobs
from poise.nodes.parameters import WORDS, Parameter, declare_parameters
from poise.nodes.place_execution import Carrying, PlaceExecution, seconds_left
from poise.nodes.placement_task import PlacementTask, cancelled_placement, placement_feedback, placement_result
from poise.nodes.readiness import FEEDBACK_PERIOD, READY_TIMEOUT, WaitingGoal, seconds_of
from poise.nodes.request_checks import check_assembly, check_object
from poise.nodes.runtime import LATCHED, coded, guarded
from poise.nodes.transforms import pose_of
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal
from poise.placement import (
    CRITERIA,
    DEFAULT_PLANNER,
    PLACEMENT_PLANNERS,
    SUPPORT_KINDS,
    Options,
    Placement,
    PlacementProgress,
    Steady,
    Uncertainty,
    kept_free,
)
from poise_msgs.action import PlaceObject as Action
from poise_msgs.msg import Assembly as AssemblyMessage

_TICK = 0.02
"""s between looks at a running goal: what a cancel may wait for an answer."""

PLACEMENT_PLANNER_PARAMETERS = (
    Parameter("scene", "", "scene file to begin with; empty: use the topic assembly"),
    Parameter("frame_id", "world", "frame of the poses of that scene (on a mobile base: the tray's)"),
    Parameter("planner", DEFAULT_PLANNER, "planner that finds a placement", PLACEMENT_PLANNERS.names()),
    Parameter("deadline", 5.0, "s, for goals without a deadline", (0.001, 3600.0), dynamic=True),
    Parameter("attempts", 500, "largest number of poses to test", (1, 1_000_000), dynamic=True),
    Parameter("candidates", 10, "placements to find; the best is returned", (1, 10_000), dynamic=True),
    Parameter("criterion", "least", "criterion of the best placement", CRITERIA),
    Parameter("support", "any", "what may support the object", SUPPORT_KINDS),
    Parameter(
        "robust",
        False,
        "require stability under errors of 2 mm, 2 degrees, 20 % of friction and 10 % of the mass",
        dynamic=True,
    ),
    Parameter(
        "tipping_rise",
        0.001,
        "m that the centre of mass has to rise before the object tips over: the error of a scan, on whose facets round"
        " objects would lie; 0 for exact shapes",
        (0.0, 0.1),
        dynamic=True,
    ),
    Parameter("keep_free", WORDS, "ids of objects over which nothing is placed: the table that objects are taken from"),
    READY_TIMEOUT,
    Parameter("refine", False, "then move the object as long as the criterion improves", dynamic=True),
    Parameter(
        "mesh_folders", WORDS, "folders in which files named by mesh_uri may lie, besides packages' share folders"
    ),
)


class PlacementPlannerNode(ArmNode):
    """Serves `place_object` (poise_msgs/PlaceObject), one goal at a time; subscribes to assembly and world.

    Planning belongs to the thread of the jobs; a timer answers the caller, in time also when the thread is not done,
    and moves the robot of a goal with `execute` (see `PlaceExecution`).
    The assembly is never changed here: what the hand does is on grasp_events, for world_model.
    """

    def __init__(self) -> None:
        super().__init__("placement_planner")
        self._values = values = declare_parameters(self, PLACEMENT_PLANNER_PARAMETERS)
        self._planner = PLACEMENT_PLANNERS.find(values["planner"])
        self._folders = tuple(Path(folder) for folder in values["mesh_folders"])
        self._heard: AssemblyMessage | None = None
        self._seen: set[str] = set()  # of keep_free: what has been in an assembly
        if values["scene"]:
            assembly = settle(scene_of_node(values["scene"])).assembly
            self._on_assembly(assembly_message(assembly, values["frame_id"]))
        self._known: tuple[AssemblyMessage, Analysis] | None = None
        self._task: PlacementTask | None = None
        feedback = Action.Feedback(stage="waiting", best_robustness=math.nan)
        self._waiting = WaitingGoal(self._begin, placement_result, cancelled_placement, feedback)
        self._last_feedback, self._last_stage = 0.0, ""
        self._execution = PlaceExecution(self)
        self._hand = HandEvents(self, self._execution.values["tcp_frame"])
        self._jobs = Jobs(self, 1)
        self.create_subscription(AssemblyMessage, "assembly", guarded(self, self._on_assembly), LATCHED)
        self.create_timer(_TICK, guarded(self, self._tick))
        self.watchdog = ProcessWatchdog(self, Action, "place_object", self._accept)
        self.start()

    @property
    def _options(self) -> Options:
        """As the parameters say now."""
        values = self._values
        return Options(
            values["attempts"],
            candidates=values["candidates"],
            criterion=values["criterion"],
            on=values["support"],
            tests=(("tips easily", Steady(values["tipping_rise"])),),
            uncertainty=Uncertainty() if values["robust"] else None,
            refining=values["refine"],
        )

    def destroy_node(self) -> None:
        """Stop the arm, then end the thread, before the node goes."""
        if hasattr(self, "watchdog"):
            self.watchdog.close()
        if hasattr(self, "_jobs"):
            if self._task is not None:
                self._task.abandoned = True
            self._jobs.close()
        super().destroy_node()

    # -- in the executor -------------------------------------------------------------------------------------------

    def _on_assembly(self, message: AssemblyMessage) -> None:
        self._heard = message
        self._seen.update({each.id for each in message.objects} & set(self._values["keep_free"]))

    def halt(self, reason: str) -> None:
        """Stop the arm and end the goal."""
        self._waiting.refuse(PoiseError(ErrorCode.CANCELLED, reason))
        if self._task is not None:
            self._task.goal.is_cancel_requested = True

    def _accept(self, goal: WatchedGoal) -> None:
        if self._task is not None or self._waiting.goal is not None:
            goal.execute(self._conclude_busy)
            return
        self._waiting.take(goal, min(self._values["ready_timeout"], goal.request.deadline or self._values["deadline"]))

    def _begin(self, goal: WatchedGoal, accepted: float) -> None:
        self._task = task = self._task_of(goal, accepted)
        if task.ready:
            self._begin_to_plan()

    def _begin_to_plan(self) -> None:
        self._jobs.do(self._plan)  # where no more can wait, one that waits will find the task

    def _task_of(self, goal: WatchedGoal, accepted: float) -> PlacementTask:
        """What the goal asks for, accepted at s of `node_seconds`.

        Raises:
            InputError: when it makes no sense, or there is no assembly.
        """
        request = goal.request
        seconds = seconds_of(goal, self._values["deadline"])
        message = request.assembly[0] if request.assembly else self._heard
        if message is None:
            raise InputError(
                ErrorCode.EMPTY, "no assembly has come on the topic assembly; publish it, or send it along"
            )
        frame, carrying = message.header.frame_id, None
        in_hand = self._in_hand(goal) if request.held else None
        with_arm = request.execute or (self._execution.known and (request.held or request.object.pose != PoseMessage()))
        joined = self._execution.pose(request.object_frame_id or frame, frame) if with_arm else Pose.identity()
        if joined is None:
            raise InputError(
                ErrorCode.FRAME_UNKNOWN, f"goal: tf does not connect {request.object_frame_id} with {frame}"
            )
        if request.execute:
            carrying = self._execution.open(goal, self.watchdog, frame)
        elif with_arm:
            carrying = self._execution.to_plan(frame)
        if in_hand is not None and carrying is not None:
            carrying.held_by(self._hand.grip(request.object.id))
        due = time.monotonic() + seconds - (node_seconds() - accepted)  # the time limit of a computation
        task = PlacementTask(goal, message, due, carrying)
        task.object_frame, task.pose_tool_object = joined, in_hand
        return task

    def _in_hand(self, goal: WatchedGoal) -> Pose:
        """The pose in the tool frame of what is held; the goal's object becomes it.

        Raises:
            InputError: NOT_HELD, FRAME_UNKNOWN.
        """
        held = self._hand.require_held(goal.request.object.id)
        joined = self._execution.pose(held.frame_id, self._hand.tool_frame)
        if joined is None:
            what = f"tf does not connect {held.frame_id}, which holds {held.object.id}, with {self._hand.tool_frame}"
            raise InputError(ErrorCode.FRAME_UNKNOWN, what)
        # A copy: what is done to a goal must not change what the world says.
        goal.request.object, goal.request.object_frame_id = deepcopy(held.object), ""
        return joined @ pose_of(held.object.pose)

    def _tick(self) -> None:
        """Answer the goal when it ends; otherwise continue it and publish feedback."""
        now = node_seconds()
        self._waiting.tick()
        task = self._task
        if task is None:
            return
        try:
            if task.carrying is not None and task.carrying.playing is not None:
                self._play(task, task.carrying.playing, now)
            else:
                self._await_plan(task, now)
        except Exception as failure:  # of any kind: the caller must get an answer, and the arm must stop
            self._stop_arm()
            self._end(task, coded(failure))
        if self._task is not None and (now > self._last_feedback + FEEDBACK_PERIOD or task.stage != self._last_stage):
            self._last_feedback, self._last_stage = now, task.stage
            task.goal.publish_feedback(placement_feedback(task))

    def _play(self, task: PlacementTask, playing: TransferExecution, now: float) -> None:
        if task.goal.is_cancel_requested:
            playing.cancel(now)
        playing.tick(now)
        if task.carrying is not None and task.item is not None and task.hand_changed(playing):
            in_hand = task.carrying.pose_tool_object
            if playing.grip:
                self._hand.grasped(task.item, in_hand, playing.held)
            else:
                there = task.carrying.tool_pose @ in_hand
                self._hand.released(task.item.id, there, task.assembly.header.frame_id)
        if playing.dropped:
            self._hand.lost(task.goal.request.object.id)
        if playing.done:
            self._end(task, playing.error)

    def _await_plan(self, task: PlacementTask, now: float) -> None:
        if task.done and (task.error is not None or not task.moves):
            self._end(task, task.error)
        elif task.goal.is_cancel_requested:
            self._end(task, cancelled_placement(task.goal))
        elif task.done and task.carrying is not None:
            task.carrying.play(task.goal.request.object.id, now)
        elif time.monotonic() > task.due + ANSWER_GRACE:
            best = "the best so far comes along" if task.progress.best is not None else "nothing was found by then"
            self._end(task, NoAnswerError(ErrorCode.DEADLINE, f"the deadline passed, and {best}; allow more time"))
        elif not task.ready and task.carrying is not None and self._found_start(task, task.carrying, now):
            self._begin_to_plan()

    def _found_start(self, task: PlacementTask, carrying: Carrying, now: float) -> bool:
        """Whether it is known where the arm rests, or that the goal has to be planned without it."""
        try:
            return carrying.found_start(now)
        except PoiseError as error:
            if task.moves:
                raise
            task.without_arm(error)
            return True

    def _stop_arm(self) -> None:
        if self._task is not None and self._task.carrying is not None:
            self._task.carrying.stop()

    def _end(self, task: PlacementTask, error: PoiseError | None) -> None:
        task.abandoned = True
        self._task = None
        self._execution.close()
        self.watchdog.rest()
        task.goal.execute(lambda goal: placement_result(goal, error, task))

    def _conclude_busy(self, goal: WatchedGoal) -> Action.Result:
        busy = NoAnswerError(ErrorCode.BUSY, "another object is being placed: cancel it, or wait for its end")
        return placement_result(goal, busy)

    # -- in the thread of the jobs ---------------------------------------------------------------------------------

    def _plan(self) -> None:
        """The task of the moment, unless it has been begun."""
        task = self._task
        if task is None or task.begun or not task.ready:
            return
        task.begun = True
        try:
            found = self._placement(task)
            task.progress = PlacementProgress(found.iterations, found.item, found.score)
        except Exception as failure:
            task.error = coded(failure)
        task.seconds = time.monotonic() - task.accepted
        task.done = True

    def _placement(self, task: PlacementTask) -> Placement:
        request = task.goal.request
        if task.carrying is None:
            request.object.pose = PoseMessage()  # ignored
        check_object(request.object)
        item = object_of(request.object, self._folders)
        task.item = item = replace(item, pose=task.object_frame @ item.pose)
        analysis = self._analysis(task.assembly)
        about_base = [] if task.carrying is None else task.carrying.assumptions
        task.assumptions = [*about_base, *assumptions_of(analysis.assembly.with_object(item))]
        options = replace(self._options, looks=kept_free(analysis.assembly, self._values["keep_free"], self._seen))
        if task.carrying is not None:
            try:
                return task.carrying.plan(
                    self._planner,
                    analysis,
                    item,
                    options,
                    request.seed,
                    task.due,
                    task.report,
                    task.pose_tool_object,
                )
            except NoAnswerError as error:
                if task.moves or error.code is not ErrorCode.UNREACHABLE:
                    raise
                task.without_arm(error)
        left = seconds_left(task.due, "the first pose")
        return self._planner.plan(analysis, item, replace(options, deadline=left), request.seed, task.report)

    def _analysis(self, message: AssemblyMessage) -> Analysis:
        """Of the assembly in a message; what is unchanged since the last one is not computed again."""
        if self._known is None or self._known[0] is not message:
            before = None if self._known is None else self._known[1]
            check_assembly(message)
            assembly = settle(assembly_of(message, self._folders)).assembly
            for note in assembly.notes:
                self.get_logger().warning(note)
            self._known = message, analysis_after(before, assembly)
        return self._known[1]


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_with_jobs(PlacementPlannerNode, args)


if __name__ == "__main__":
    main()
