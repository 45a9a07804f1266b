"""Node: looks at an object from all sides with a camera on the hand, and publishes its shape and parts."""

import itertools
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, JointState, PointCloud2
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory

from poise.calibration import corrected_description
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.manipulation import Arm
from poise.nodes.arm_node import ArmNode
from poise.nodes.clock import node_seconds
from poise.nodes.jobs import Jobs, run_with_jobs
from poise.nodes.object_scanner_parameters import (
    SCANNER_PARAMETERS,
    given_eye,
    near_of,
    scan_options,
    segmentation_options,
    session_options,
    stored_calibration,
    sweep_options,
    transported,
)
from poise.nodes.parameters import declare_parameters
from poise.nodes.readiness import Readiness
from poise.nodes.request_checks import newer_description
from poise.nodes.runtime import LATCHED, SCANS, TF_STATIC, coded, end_goal, guarded, to_message
from poise.nodes.segmented_message import object_transform, segmented_message
from poise.nodes.sweep_execution import Motion, SweepExecution, motion_of_file
from poise.nodes.sweep_planning import PLANNED, SweepPlanner
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal
from poise.recording import image_of, stamp_of
from poise.robot import RobotModel
from poise.scanning import (
    RobotLog,
    Scan,
    ScanSession,
    ViewRegion,
    camera_of,
    chosen_places,
    frame_of_cloud,
    places_of,
    scan_sweep,
    transform_of,
)
from poise.shape import Segmentation, independent_parts
from poise.simulation import WaypointTrajectory
from poise.types import Array
from poise_msgs.action import ScanObject
from poise_msgs.msg import SegmentedObject

_TICK = 0.02
_FEEDBACK_TICKS = 10
_STILL_ENDING = "scan: a cancelled scan is still ending; call again"
_LATE = 0.5
"""s that images may come after the end of a sweep."""
_SETTLE = 1.0
"""s that joint states may come after the last frame."""
_COLLECTING = 0.8
"""Share of the progress that is taking frames; the rest is computing."""
DEPTH, INFO = "camera/aligned_depth_to_color/image_raw", "camera/aligned_depth_to_color/camera_info"
COLOUR, _COLOUR_INFO, _CLOUD = "camera/color/image_raw", "camera/color/camera_info", "camera/depth/color/points"


class ObjectScanner(ArmNode):
    """Serves scan_object; publishes segmented_object (latched) and the object's frame on tf_static.

    Camera topics are listened to only while a goal is running. Computing belongs to the thread of the jobs.
    """

    def __init__(self) -> None:
        super().__init__("object_scanner")
        self._values = declare_parameters(self, SCANNER_PARAMETERS)
        sweep_options(self._values)  # invalid parameters are reported at the start
        near_of(self._values)
        self._robot = RobotLog()
        self._goal: WatchedGoal | None = None
        self._session: ScanSession | None = None
        self._sweep: SweepExecution | None = None
        self._answer: tuple[PoiseError | None, SegmentedObject | None] | None = None
        self._error: PoiseError | None = None
        self._readiness = Readiness(0.0)
        self._share, self._ticks, self._taken, self._ended, self._computing = 0.0, 0, 0, 0.0, False
        self._cancelled = threading.Event()
        self._listening: list[Any] = []
        self._frames: dict[str, Any] = {}
        self._objects = self.create_publisher(SegmentedObject, "segmented_object", SCANS)
        self._transforms = self.create_publisher(TFMessage, "tf_static", LATCHED)
        self._arm = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.create_subscription(JointState, "joint_states", guarded(self, self._on_joint_state), 1000)
        self.create_subscription(String, "robot_description", guarded(self, self._on_description), LATCHED)
        self.create_subscription(TFMessage, "tf_static", guarded(self, self._on_tf_static), TF_STATIC)
        self._planner = SweepPlanner(self, INFO, self._values)
        self._region: ViewRegion | None = None
        self._plan_notes: tuple[str, ...] = ()
        self._jobs = Jobs(self, 1)
        self.create_timer(_TICK, guarded(self, self._tick))
        self.watchdog = ProcessWatchdog(self, ScanObject, "scan_object", self._accept)
        self.start()

    def destroy_node(self) -> None:
        """Stop the arm first; then end the thread before the node goes."""
        self._cancelled.set()
        if hasattr(self, "watchdog"):
            self.watchdog.close()
        if hasattr(self, "_jobs"):
            self._jobs.close()
        super().destroy_node()

    # -- what is heard ---------------------------------------------------------------------------------------------

    def _on_joint_state(self, message: JointState) -> None:
        self._robot.add_joint_state(stamp_of(message), message.name, message.position)
        if self._sweep is not None:
            self._sweep.add_joint_state(message)

    def _on_description(self, message: String) -> None:
        stored = stored_calibration(self._values)
        text = message.data if stored is None else corrected_description(message.data, stored.offsets)
        self._robot.description = newer_description(text, self._robot.description)

    def _on_tf_static(self, message: TFMessage) -> None:
        for stamped in message.transforms:
            self._robot.fixed[stamped.child_frame_id] = transform_of(stamped)

    def _listen(self) -> None:
        reliability = ReliabilityPolicy.BEST_EFFORT if self._values["best_effort"] else ReliabilityPolicy.RELIABLE
        qos = QoSProfile(depth=20, reliability=reliability)
        depth_kind, depth = transported(DEPTH, self._values["depth_image_transport"])
        colour_kind, colour = transported(COLOUR, self._values["image_transport"])
        takes: list[tuple[Any, str, Callable[[ScanSession, Any], None]]] = [
            (CameraInfo, INFO, lambda session, said: session.set_camera(camera_of(said))),
            (CameraInfo, _COLOUR_INFO, lambda session, said: session.set_colour_camera(camera_of(said))),
            (depth_kind, depth, lambda session, said: session.add_depth(image_of(said, depth), node_seconds())),
            (colour_kind, colour, lambda session, said: session.add_colour(image_of(said, colour))),
            (PointCloud2, _CLOUD, lambda session, said: session.add_cloud(frame_of_cloud(said), node_seconds())),
        ]
        self._listening = [
            self.create_subscription(kind, name, guarded(self, partial(self._take, use)), qos)
            for kind, name, use in takes
        ]

    def _take(self, take: Any, message: Any) -> None:
        """Hand a message of the camera to the session; what is wrong with it may become the goal's error."""
        if self._session is None:
            return
        try:
            take(self._session, message)
        except InputError as error:
            self._session.problem = error
            raise

    # -- a goal ----------------------------------------------------------------------------------------------------

    def _accept(self, goal: WatchedGoal) -> None:
        if self._goal is not None:
            goal.execute(self._conclude_busy)
            return
        self._goal, self._answer, self._share, self._ended = goal, None, 0.0, 0.0
        self._cancelled = threading.Event()  # the one of a goal before still ends its computation
        self._error = self._session = self._sweep = self._region = None
        self._over, self._plan_notes = 0.0, ()
        self._readiness = Readiness(self._values["ready_timeout"])
        if goal.request.stationary or not self._values["sweep"]:
            self._begin_to_look(goal)
        elif self._values["sweep"] == PLANNED:
            self._planner.listen()
        self._tick()

    def halt(self, reason: str) -> None:
        """Stop the arm and end the goal."""
        if self._goal is not None:
            self._cancelled.set()
            self._fail(NoAnswerError(ErrorCode.CANCELLED, f"scan: {reason}"))

    def _begin_to_look(self, goal: WatchedGoal) -> None:
        options = session_options(self._values, goal.request, 0.0 if self._sweep is None else self._sweep.seconds)
        self._session = ScanSession(options, node_seconds())
        self._listen()

    def _await_robot(self, goal: WatchedGoal) -> None:
        """Begin with the sweep as soon as what it needs is known.

        Raises:
            PoiseError: it does not become known in time.
        """
        try:
            model, motion = self._to_plan(goal) if self._values["sweep"] == PLANNED else self._to_read()
            tolerance = self._values["start_tolerance"]
            self._sweep = SweepExecution(self, self._arm, self.watchdog, goal, tolerance, model, motion)
        except PoiseError as error:
            if not self._readiness.may_change(error):
                raise

    def _to_read(self) -> tuple[RobotModel, Motion]:
        """The robot, and the sweep of the file."""
        if not self._robot.description:
            raise InputError(ErrorCode.ROBOT_DESCRIPTION_MISSING, "there is no robot_description to sweep with")
        model = RobotModel.from_urdf(self._robot.description, self._values["hand_frame"])
        return model, motion_of_file(Path(self._values["sweep"]), model)

    def _to_plan(self, goal: WatchedGoal) -> tuple[Arm, Motion]:
        """The robot, and the sweep of a plan; the camera has to be there."""
        eye = given_eye(self._values)
        arm, assumptions = self._planner.arm(self._robot)
        task = self._planner.task(goal.request.id, arm, self._robot, [] if eye is None else [eye])
        seconds, cancelled = self._values["plan_seconds"], self._cancelled.is_set

        def motion(start: Array) -> WaypointTrajectory:
            plan = task.plan(start, seconds, cancelled)
            self._region, self._plan_notes = task.region, (*assumptions, *plan.notes)
            return plan.motion

        return task.arm, motion

    def _tick(self) -> None:
        goal = self._goal
        if goal is None:
            return
        try:
            self._advance(goal)
        except Exception as failure:  # of any kind: the caller must get an answer, and the arm must stop
            self._fail(coded(failure))
        answer = self._answer if self._error is None else self._stopped(self._error)
        if answer is not None and (self._error is not None or self._sweep is None or self._sweep.over):
            self._end(goal, *answer)
            return
        self._ticks += 1
        if self._ticks % _FEEDBACK_TICKS == 0:
            self._report(goal)

    def _advance(self, goal: WatchedGoal) -> None:
        session, sweep, answer = self._session, self._sweep, self._answer
        if self._error is not None:
            return
        if goal.is_cancel_requested and not self._cancelled.is_set():
            self._cancelled.set()
            if answer is not None or not self._computing:
                raise NoAnswerError(ErrorCode.CANCELLED, "scan: cancelled")
        if answer is not None and answer[0] is not None:
            raise answer[0]
        if session is None and sweep is None and not self._computing:
            self._await_robot(goal)
        now = node_seconds()
        if sweep is not None:
            if sweep.start is None and sweep.found_start(now) and not self._jobs.do(sweep.prepare):
                raise NoAnswerError(ErrorCode.BUSY, _STILL_ENDING)
            begun = sweep.begun
            sweep.tick(now)
            if sweep.begun and not begun:
                self._begin_to_look(goal)
            self._over = self._over or (now if sweep.over else 0.0)
        if session is not None and self._enough(session, now) and self._settled(session):
            self._compute(session, goal)

    def _enough(self, session: ScanSession, now: float) -> bool:
        """All frames are there, or none that is wanted comes; a camera that pauses does not end a sweep."""
        if self._sweep is not None and not self._sweep.over and session.count:
            return session.full
        late = bool(self._over) and min(now - self._over, session.silent(now)) > _LATE and session.count > 0
        return late or session.enough(now)

    def _fail(self, error: PoiseError) -> None:
        """End a goal that still moves or takes frames, as soon as the arm has its stop."""
        if self._error is None:
            self._session, self._error = None, error
            self._cancelled.set()
            if self._sweep is not None:
                self._sweep.stopping(node_seconds())

    def _stopped(self, error: PoiseError) -> tuple[PoiseError | None, SegmentedObject | None] | None:
        """The answer once the arm has its stop; None before."""
        remark = "" if self._sweep is None else self._sweep.stop(error, node_seconds())
        return None if remark is None else (type(error)(error.code, error.message + remark), None)

    def _report(self, goal: WatchedGoal) -> None:
        session, frames, progress = self._session, self._taken, 0.0
        if session is not None:
            frames, progress = session.count, _COLLECTING * session.progress
        elif self._computing:
            progress = _COLLECTING + (1 - _COLLECTING) * self._share
        goal.publish_feedback(ScanObject.Feedback(frames=frames, progress=float(progress)))

    def _settled(self, session: ScanSession) -> bool:
        """Joint states after the last frame are there, or do not come."""
        now = node_seconds()
        self._ended = self._ended or now
        return self._robot.newest >= session.newest or now - self._ended > _SETTLE

    def _compute(self, session: ScanSession, goal: WatchedGoal) -> None:
        self._session, self._taken, self._computing = None, session.count, True
        self._hush()
        robot, cancelled = self._robot.copy(), self._cancelled.is_set
        if not self._jobs.do(lambda: self._work(goal, session, robot, cancelled)):
            self._answer = NoAnswerError(ErrorCode.BUSY, _STILL_ENDING), None

    def _hush(self) -> None:
        self._planner.hush()
        for subscription in self._listening:
            self.destroy_subscription(subscription)
        self._listening = []

    def _end(self, goal: WatchedGoal, error: PoiseError | None, message: SegmentedObject | None) -> None:
        self._goal = self._session = self._answer = self._error = self._sweep = None
        self._taken, self._computing = 0, False
        self.watchdog.rest()
        self._hush()
        goal.execute(lambda handle: self._conclude(handle, error, message))

    def _conclude(
        self, goal: WatchedGoal, error: PoiseError | None, message: SegmentedObject | None
    ) -> ScanObject.Result:
        end_goal(goal, message is not None)
        if message is not None:
            return ScanObject.Result(object=message, error=to_message(None))
        return ScanObject.Result(error=to_message(error))

    def _conclude_busy(self, goal: WatchedGoal) -> ScanObject.Result:
        busy = InputError(ErrorCode.BUSY, "another scan is running: cancel it, or wait for its end")
        return self._conclude(goal, busy, None)

    # -- in the thread of the jobs ---------------------------------------------------------------------------------

    def _work(self, goal: WatchedGoal, session: ScanSession, robot: RobotLog, cancelled: Callable[[], bool]) -> None:
        answer: tuple[PoiseError | None, SegmentedObject | None]
        try:
            answer = None, self._scanned(goal.request.id, session, robot, cancelled)
        except PoiseError as error:
            answer = error, None
        except Exception as error:
            self.get_logger().error(f"internal error: {error!r}")
            answer = coded(error), None
        if self._goal is goal:  # else the caller was answered
            self._answer = answer

    def _scanned(
        self, asked: str, session: ScanSession, robot: RobotLog, cancelled: Callable[[], bool]
    ) -> SegmentedObject:
        """The object that was meant; with `all_objects` the others are published, too, under names of their own."""
        where, how = sweep_options(self._values), scan_options(self._values)
        region, planned = self._region, self._plan_notes
        sweep = session.sweep(robot, where)
        near = [how.near]
        if region is not None or self._values["all_objects"]:
            near = chosen_places(places_of(sweep.views, how), region, how.near, self._values["all_objects"])
        objects, notes = list[tuple[Scan, Segmentation]](), [*planned, *sweep.notes]
        for number, point in enumerate(near):

            def reach(share: float, number: int = number) -> None:
                self._share = (number + share) / len(near)

            try:
                scanned = scan_sweep(sweep, replace(how, near=point), reach, cancelled)
                found = scanned.segmented(segmentation_options(self._values))
                if number:  # what was asked for is answered in any case
                    found.solid.require_substance()
                objects.append((scanned, found))
            except InputError as error:
                if number == 0:
                    said = [error.message, f"{len(sweep.views)} views were used", *notes]
                    raise InputError(error.code, "; ".join(said), **error.data) from error
                notes.append(f"what is at {np.round(point, 3).tolist()} m was left out: {error.message}")
        if cancelled():
            raise NoAnswerError(ErrorCode.CANCELLED, "scan: cancelled")
        messages = []
        names = self._planner.names(asked, [found.solid for _, found in objects], sweep.base)
        stamps = itertools.count(session.newest)  # a scan must be newer than the last
        for own, stamp, (scanned, found) in zip(names, stamps, objects, strict=False):
            messages.append(self._message(own, stamp, scanned, found, notes))
            self._frames[own] = object_transform(sweep.base, own, stamp, scanned)
        self._transforms.publish(TFMessage(transforms=list(self._frames.values())))
        for message in messages:
            self._objects.publish(message)
        return messages[0]

    def _message(self, name: str, stamp: int, scanned: Scan, found: Segmentation, notes: list[str]) -> SegmentedObject:
        parts = independent_parts(found) if self._values["independent_parts"] else found.tetrahedron_labels
        remarks = (*notes, *scanned.notes, *found.notes)
        return segmented_message(name, name, stamp, scanned, found, parts, remarks)


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_with_jobs(ObjectScanner, args)


if __name__ == "__main__":
    main()
