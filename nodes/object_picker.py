"""Node: the action `pick_object`: takes an object into the hand, lifts it, and verifies by the wrench what is held."""

import math
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import WrenchStamped

from poise.assembly import Analysis, settle
from poise.assembly.statics import analysis_after
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.manipulation import (
    ForceWatch,
    Limits,
    PickExecution,
    Reach,
    heavier,
    pick_steps,
    plan_pick,
    pose_of,
    require_room,
    without_held,
)
from poise.nodes.arm_node import ArmNode
from poise.nodes.assembly_message import assembly_of, object_of
from poise.nodes.clock import node_seconds
from poise.nodes.hand_events import HandEvents
from poise.nodes.jobs import ANSWER_GRACE, Jobs, run_with_jobs
from poise.nodes.parameters import WORDS, Parameter, declare_parameters
from poise.nodes.pick_task import PickTask, cancelled, pick_result
from poise.nodes.place_execution import PlaceExecution, seconds_left
from poise.nodes.readiness import FEEDBACK_PERIOD, READY_TIMEOUT, WaitingGoal, seconds_of
from poise.nodes.request_checks import check_assembly, check_object
from poise.nodes.runtime import LATCHED, coded, guarded, subscribe
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal
from poise.types import Array
from poise_msgs.action import PickObject as Action
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import WorldObject

_TICK = 0.02
_NEWS = 1.0
"""s that a goal waits for an object that the assembly does not have: world may have reached the client first."""

OBJECT_PICKER_PARAMETERS = (
    Parameter("deadline", 20.0, "s of planning, for goals without a deadline", (0.001, 3600.0)),
    Parameter("attempts", 2, "grasps that are tried when nothing is held", (1, 10)),
    Parameter("verify", True, "verify by the wrench what was lifted; false: trust the fingers"),
    READY_TIMEOUT,
    Parameter(
        "mesh_folders", WORDS, "folders in which files named by mesh_uri may lie, besides packages' share folders"
    ),
)


class ObjectPicker(ArmNode):
    """Serves `pick_object` (poise_msgs/PickObject), one goal at a time; publishes grasp_events.

    Subscribes to assembly and world (latched) and wrench. Planning belongs to the thread of the jobs.
    """

    def __init__(self) -> None:
        super().__init__("object_picker")
        self._values = declare_parameters(self, OBJECT_PICKER_PARAMETERS)
        self._folders = tuple(Path(folder) for folder in self._values["mesh_folders"])
        self._assembly: AssemblyMessage | None = None
        self._known: Analysis | None = None
        self._task: PickTask | None = None
        self._waiting = WaitingGoal(self._begin, pick_result, cancelled, Action.Feedback(stage="waiting"))
        self._last_feedback = 0.0
        self._forces, self._sensor_frame = ForceWatch(), ""
        self._execution = PlaceExecution(self)
        self._hand = HandEvents(self, self._execution.values["tcp_frame"])
        self._jobs = Jobs(self, 1)
        self.create_subscription(AssemblyMessage, "assembly", guarded(self, self._on_assembly), LATCHED)
        subscribe(self, WrenchStamped, "wrench", self._on_wrench, 1000)
        self.create_timer(_TICK, guarded(self, self._tick))
        self.watchdog = ProcessWatchdog(self, Action, "pick_object", self._accept)
        self.start()

    def destroy_node(self) -> None:
        """Stop the arm, then end the thread, before the node goes."""
        if hasattr(self, "watchdog"):
            self.watchdog.close()
        if hasattr(self, "_jobs"):
            self._jobs.close()
        super().destroy_node()

    # -- what is heard ----------------------------------------------------------------------------------------------

    def _on_assembly(self, message: AssemblyMessage) -> None:
        self._assembly = message

    def _on_wrench(self, message: WrenchStamped) -> None:
        force = message.wrench.force
        self._sensor_frame = message.header.frame_id
        self._forces.add((force.x, force.y, force.z), node_seconds())

    # -- a goal -----------------------------------------------------------------------------------------------------

    def halt(self, reason: str) -> None:
        """Stop the arm and end the goal."""
        self._waiting.refuse(PoiseError(ErrorCode.CANCELLED, reason))
        if self._task is not None:
            self._task.goal.is_cancel_requested = True

    def _accept(self, goal: WatchedGoal) -> None:
        if self._task is not None or self._waiting.goal is not None:
            busy = NoAnswerError(ErrorCode.BUSY, "another object is being picked: cancel it, or wait for its end")
            goal.execute(lambda handle: pick_result(handle, busy))
            return
        self._waiting.take(goal, self._values["ready_timeout"])

    def _begin(self, goal: WatchedGoal, accepted: float) -> None:
        self._task = self._task_of(goal, accepted)

    def _task_of(self, goal: WatchedGoal, accepted: float) -> PickTask:
        """What the goal asks for, accepted at s of `node_seconds`.

        Raises:
            InputError: when it makes no sense; EMPTY, TOPIC_MISSING and others while something is missing.
        """
        request = goal.request
        seconds = seconds_of(goal, self._values["deadline"])
        if self._assembly is None:
            raise InputError(ErrorCode.EMPTY, "no assembly has come on the topic assembly; start world_model")
        known = bool(request.object) or request.id in (each.id for each in self._assembly.objects)
        if not known and node_seconds() < accepted + min(_NEWS, self._values["ready_timeout"]):
            raise InputError(ErrorCode.EMPTY, f"the assembly has no object {request.id!r} yet")
        frame = self._assembly.header.frame_id
        joined = self._execution.pose(request.object_frame_id or frame, frame)
        if joined is None:
            what = f"goal: tf does not connect {request.object_frame_id} with {frame}"
            raise InputError(ErrorCode.FRAME_UNKNOWN, what)
        held = self._hand.held
        if held is not None:
            raise InputError(ErrorCode.BUSY, f"the hand holds {held.object.id}: place it first")
        if request.plan_only:
            if not self._execution.known:
                raise InputError(ErrorCode.ROBOT_DESCRIPTION_MISSING, "there is no robot_description: publish it")
            carrying = self._execution.to_plan(frame)
        else:
            if self._values["verify"] and node_seconds() - self._forces.heard > 1.0:
                what = "no wrench comes: what is held cannot be verified; start the sensor, or set verify to false"
                raise InputError(ErrorCode.TOPIC_MISSING, what)
            carrying = self._execution.open(goal, self.watchdog, frame)
        return PickTask(goal, self._assembly, time.monotonic() + seconds, carrying, joined)

    def _tick(self) -> None:
        now = node_seconds()
        self._waiting.tick()
        task = self._task
        if task is None:
            return
        try:
            self._advance(task, now)
        except Exception as failure:  # of any kind: the caller must get an answer, and the arm must stop
            if task.running is not None:
                task.running.cancel(now)
            self._end(task, coded(failure))
        if self._task is not None and now > self._last_feedback + FEEDBACK_PERIOD:
            self._last_feedback = now
            task.goal.publish_feedback(Action.Feedback(stage=task.stage, attempt=len(task.tried)))

    def _advance(self, task: PickTask, now: float) -> None:
        running = task.running
        if running is not None:
            if task.goal.is_cancel_requested:
                running.cancel(now)
            running.tick(now)
            if running.done:
                self._attempted(task, running)
        elif task.planned and (task.error is not None or task.goal.request.plan_only):
            self._end(task, task.error)
        elif task.goal.is_cancel_requested:
            self._end(task, cancelled(task.goal))
        elif task.planned:
            task.running = self._run(task, now)
        elif time.monotonic() > task.due + ANSWER_GRACE:
            self._end(task, NoAnswerError(ErrorCode.DEADLINE, "the deadline passed while planning; allow more time"))
        elif not task.begun and task.carrying.found_start(now):
            task.begun = self._jobs.do(partial(self._plan, task))

    def _run(self, task: PickTask, now: float) -> PickExecution:
        pick, item, steps = task.pick, task.item, task.steps
        if pick is None or item is None or steps is None:
            raise PoiseError(ErrorCode.INTERNAL, "there is no plan to play")
        gravity, forces = np.asarray(self._gravity(task)), self._forces if self._values["verify"] else None
        state = self._hand.known(item.id)
        return PickExecution(
            item,
            state is None or state.source != WorldObject.ASSUMED,
            pick,
            steps,
            task.carrying.robot,
            task.carrying.tolerances,
            forces,
            self._down(task, gravity),
            float(np.linalg.norm(gravity)),
            lambda: self._grasped(task),
            lambda: self._released(task),
            now,
        )

    def _gravity(self, task: PickTask) -> Array:
        gravity = task.assembly.gravity
        return np.array([gravity.x, gravity.y, gravity.z])

    def _down(self, task: PickTask, gravity: Array) -> Array | None:
        """(3,) gravity in the sensor frame at the grasp; None when the robot has no such frame."""
        arm, pick = task.carrying.arm, task.pick
        if pick is None or not arm.model.existFrame(self._sensor_frame):
            task.assumptions.append(
                f"{self._sensor_frame}: no frame of the robot; the force across gravity is not checked"
            )
            return None
        frame = arm.model.getFrameId(self._sensor_frame)
        pin.framesForwardKinematics(arm.model, arm.data, pick.end.hand_away[0])
        rotation = (arm.base * arm.data.oMf[frame]).rotation
        return np.asarray(rotation.T @ gravity)

    # -- the hand ---------------------------------------------------------------------------------------------------

    def _grasped(self, task: PickTask) -> None:
        """Publish that the object is held, and what it weighs as soon as that is known."""
        if task.item is not None and task.pick is not None:
            lifted = None if task.running is None else task.running.mass
            mass, std = (math.nan, math.nan) if lifted is None else (lifted.mass, lifted.std)
            in_hand, grip = pose_of(task.pick.grasp.object_tcp.inverse()), task.running.grip if task.running else None
            self._hand.grasped(task.item, in_hand, grip, mass, std)

    def _released(self, task: PickTask) -> None:
        """Publish where the object was put down."""
        if task.item is not None and task.pick is not None:
            tool = task.carrying.arm.tool(task.carrying.robot.joints.position)
            pose = pose_of(tool * task.pick.grasp.object_tcp.inverse())
            self._hand.released(task.item.id, pose, task.assembly.header.frame_id)

    def _attempted(self, task: PickTask, running: PickExecution) -> None:
        """End the goal, or try another grasp."""
        error = running.error
        if task.pick is not None:
            task.tried = (*task.tried, task.pick.grasp)
        if running.holding and running.mass is not None and error is None:
            self._grasped(task)
        if running.retry and len(task.tried) < self._values["attempts"] and not task.goal.is_cancel_requested:
            task.running, task.pick = None, None
            task.carrying.plan_again()
            task.begun = task.planned = False
            task.due = time.monotonic() + seconds_of(task.goal, self._values["deadline"])
            return
        if error is not None and error.code is ErrorCode.NOT_HELD:
            self._hand.lost(task.item.id if task.item is not None else task.goal.request.id)
        self._end(task, error)

    def _end(self, task: PickTask, error: PoiseError | None) -> None:
        self._task = None
        self._execution.close()
        self.watchdog.rest()
        task.goal.execute(lambda goal: pick_result(goal, error, task, self._hand.tool_frame))

    # -- in the thread of the jobs ----------------------------------------------------------------------------------

    def _plan(self, task: PickTask) -> None:
        if task is not self._task:  # it has ended
            return
        try:
            self._find(task)
        except Exception as failure:
            task.error = coded(failure)
        task.seconds += time.monotonic() - task.accepted if not task.tried else 0.0
        task.planned = True

    def _find(self, task: PickTask) -> None:
        request, values = task.goal.request, self._execution.values
        check_assembly(task.assembly)
        self._known = analysis_after(self._known, settle(assembly_of(task.assembly, self._folders)).assembly)
        if request.object:
            check_object(request.object[0])
            item = object_of(request.object[0], self._folders)
            item = replace(item, pose=task.object_frame @ item.pose)
            require_room(self._known, item)
            rest = self._known
        else:
            rest = without_held(self._known, request.id)
            item = self._known.assembly.objects[self._known.assembly.place_of(request.id)]
        task.item = item
        carrying, planned = task.carrying, heavier(item)
        reach = Reach(carrying.arm, rest, planned, start=carrying.start, seed=request.seed)
        reach.require_free_start()
        seconds = min(values["ways_seconds"], seconds_left(task.due, "a way was looked for"))
        pick = plan_pick(reach, Limits(speed=values["speed"]), seconds, request.seed, task.tried)
        steps = pick_steps(pick, planned, carrying.arm, values["speed"])
        if not request.plan_only:
            for step in (*steps.reach, *steps.lift, *steps.back, *steps.undo):
                if step.stops is not None:
                    carrying.robot.commanded.load(step.stops)
        task.pick, task.steps = pick, steps


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_with_jobs(ObjectPicker, args)


if __name__ == "__main__":
    main()
