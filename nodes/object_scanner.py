"""Node: looks at an object from all sides with a camera on the hand, and publishes its shape and parts."""

import threading
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, JointState, PointCloud2
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.excitation.execution import stop_along
from poise.nodes.jobs import Jobs, run_with_jobs
from poise.nodes.object_scanner_parameters import (
    SCANNER_PARAMETERS,
    near_of,
    scan_options,
    session_options,
    sweep_options,
)
from poise.nodes.parameters import declare_parameters
from poise.nodes.runtime import LATCHED, TF_STATIC, coded, end_goal, guarded, to_message
from poise.nodes.segmented_message import object_transform, segmented_message
from poise.nodes.trajectory_message import trajectory_message
from poise.recording import image_of, stamp_of
from poise.robot import RobotModel
from poise.scanning import RobotLog, ScanSession, camera_of, frame_of_cloud, scan_session, transform_of
from poise.shape import independent_parts, segment
from poise.simulation import WaypointTrajectory, read_trajectory
from poise_msgs.action import ScanObject
from poise_msgs.msg import SegmentedObject

_TICK = 0.05
_FEEDBACK_TICKS = 4
_WAYPOINT_PERIOD = 0.1
"""s between waypoints of the sweep."""
_STOP_TIME = 0.5
"""s in which a cancelled sweep slows down along its path; ros2_control refuses a message without points."""
_SETTLE = 1.0
"""s that joint states may come after the last frame."""
_COLLECTING = 0.8
"""Share of the progress that is taking frames; the rest is computing."""
DEPTH, INFO = "camera/aligned_depth_to_color/image_raw", "camera/aligned_depth_to_color/camera_info"
COLOUR, _CLOUD = "camera/color/image_raw", "camera/depth/color/points"


class SweepExecution(NamedTuple):
    """The motion that was commanded: of which joints, and when it began, s of the monotonic clock."""

    names: tuple[str, ...]
    motion: WaypointTrajectory
    begun: float


class ObjectScanner(Node):
    """Serves scan_object; publishes segmented_object (latched) and the object's frame on tf_static.

    Camera topics are listened to only while a goal is running. Computing belongs to the thread of the jobs.
    """

    def __init__(self) -> None:
        super().__init__("object_scanner")
        self._values = declare_parameters(self, SCANNER_PARAMETERS)
        sweep_options(self._values)  # invalid parameters are reported at the start
        near_of(self._values)
        self._robot = RobotLog()
        self._goal: ServerGoalHandle | None = None
        self._session: ScanSession | None = None
        self._sweep: SweepExecution | None = None
        self._answer: tuple[PoiseError | None, SegmentedObject | None] | None = None
        self._share, self._ticks, self._taken, self._ended = 0.0, 0, 0, 0.0
        self._cancelled = threading.Event()
        self._listening: list[Any] = []
        self._frames: dict[str, Any] = {}
        self._objects = self.create_publisher(SegmentedObject, "segmented_object", LATCHED)
        self._transforms = self.create_publisher(TFMessage, "tf_static", LATCHED)
        self._arm = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.create_subscription(JointState, "joint_states", guarded(self, self._on_joint_state), 1000)
        self.create_subscription(String, "robot_description", guarded(self, self._on_description), LATCHED)
        self.create_subscription(TFMessage, "tf_static", guarded(self, self._on_tf_static), TF_STATIC)
        self._jobs = Jobs(self, 1)
        self.create_timer(_TICK, guarded(self, self._tick))
        self._server = ActionServer(
            self,
            ScanObject,
            "scan_object",
            self._conclude_busy,  # every goal is given its own callback when it ends
            handle_accepted_callback=guarded(self, self._accept),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def destroy_node(self) -> None:
        """End the thread before the node goes."""
        self._cancelled.set()
        if hasattr(self, "_jobs"):
            self._jobs.close()
        super().destroy_node()

    # -- what is heard ---------------------------------------------------------------------------------------------

    def _on_joint_state(self, message: JointState) -> None:
        self._robot.add_joint_state(stamp_of(message), message.name, message.position)

    def _on_description(self, message: String) -> None:
        self._robot.description = message.data

    def _on_tf_static(self, message: TFMessage) -> None:
        for stamped in message.transforms:
            self._robot.fixed[stamped.child_frame_id] = transform_of(stamped)

    def _listen(self) -> None:
        reliability = ReliabilityPolicy.BEST_EFFORT if self._values["best_effort"] else ReliabilityPolicy.RELIABLE
        qos = QoSProfile(depth=20, reliability=reliability)
        self._listening = [
            self.create_subscription(kind, topic, guarded(self, partial(self._take, take)), qos)
            for kind, topic, take in (
                (CameraInfo, INFO, lambda session, message: session.set_camera(camera_of(message))),
                (Image, DEPTH, lambda session, message: session.add_depth(image_of(message, DEPTH), time.monotonic())),
                (Image, COLOUR, lambda session, message: session.add_colour(image_of(message, COLOUR))),
                (
                    PointCloud2,
                    _CLOUD,
                    lambda session, message: session.add_cloud(frame_of_cloud(message), time.monotonic()),
                ),
            )
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

    def _accept(self, goal: ServerGoalHandle) -> None:
        if self._goal is not None:
            goal.execute(self._conclude_busy)
            return
        try:
            command = None if goal.request.stationary else self._sweep_command()
        except PoiseError as error:
            goal.execute(lambda handle, error=error: self._conclude(handle, error, None))
            return
        options = session_options(self._values, goal.request)
        self._goal, self._answer, self._share, self._ended = goal, None, 0.0, 0.0
        self._cancelled.clear()
        self._session = ScanSession(options, self._values["depth_unit"], time.monotonic())
        self._listen()
        self._sweep = command
        if command is not None:
            self._arm.publish(trajectory_message(command.names, command.motion))

    def _sweep_command(self) -> SweepExecution | None:
        """The motion of the parameter `sweep`; None when another program moves the arm.

        Raises:
            InputError: TOPIC_MISSING, ROBOT_DESCRIPTION_MISSING, NOT_FOLLOWING when the arm is not where it begins.
        """
        if not self._values["sweep"]:
            return None
        if not self._arm.get_subscription_count():
            raise InputError(ErrorCode.TOPIC_MISSING, "no controller listens on joint_trajectory: remap or start it")
        if not self._robot.description:
            raise InputError(ErrorCode.ROBOT_DESCRIPTION_MISSING, "there is no robot_description to sweep with")
        model = RobotModel.from_urdf(self._robot.description, self._values["hand_frame"])
        motion = read_trajectory(Path(self._values["sweep"]), model)
        states = self._robot.joints(model.joint_names).position
        away = float(np.abs(states[-1] - motion.at(np.zeros(1)).position[0]).max())
        if away > self._values["start_tolerance"]:
            raise InputError(
                ErrorCode.NOT_FOLLOWING,
                f"the arm is {away:.2f} rad away from where the sweep begins: bring it there first (start_tolerance)",
            )
        times = np.linspace(0.0, motion.duration, int(np.ceil(motion.duration / _WAYPOINT_PERIOD)) + 1)
        return SweepExecution(model.joint_names, WaypointTrajectory(times, *motion.at(times)), time.monotonic())

    def _tick(self) -> None:
        goal, session = self._goal, self._session
        if goal is None:
            return
        if goal.is_cancel_requested and not self._cancelled.is_set():
            self._cancelled.set()
            if session is not None:
                self._stop(NoAnswerError(ErrorCode.CANCELLED, "scan: cancelled"))
        elif session is not None and session.enough(time.monotonic()) and self._settled(session):
            self._compute(session, goal)
        if self._answer is not None:
            self._end()
            return
        self._ticks += 1
        if self._ticks % _FEEDBACK_TICKS == 0 and session is not None:
            self._tell(goal, session.count, _COLLECTING * session.progress)
        elif self._ticks % _FEEDBACK_TICKS == 0:
            self._tell(goal, self._taken, _COLLECTING + (1 - _COLLECTING) * self._share)

    def _tell(self, goal: ServerGoalHandle, frames: int, progress: float) -> None:
        goal.publish_feedback(ScanObject.Feedback(frames=frames, progress=float(progress)))

    def _settled(self, session: ScanSession) -> bool:
        """Joint states after the last frame are there, or do not come."""
        now = time.monotonic()
        self._ended = self._ended or now
        return self._robot.newest >= session.newest or now - self._ended > _SETTLE

    def _stop(self, error: PoiseError) -> None:
        """End a goal that still takes frames."""
        self._session, self._answer = None, (error, None)
        if self._sweep is not None:
            at = time.monotonic() - self._sweep.begun
            self._arm.publish(trajectory_message(self._sweep.names, stop_along(self._sweep.motion, at, _STOP_TIME)))

    def _compute(self, session: ScanSession, goal: ServerGoalHandle) -> None:
        self._session, self._taken = None, session.count
        self._hush()
        name, robot = goal.request.id or self._values["object_id"], self._robot.copy()
        if not self._jobs.do(lambda: self._work(session, robot, name)):
            self._answer = NoAnswerError(ErrorCode.BUSY, "scan: a cancelled scan is still ending; call again"), None

    def _hush(self) -> None:
        for subscription in self._listening:
            self.destroy_subscription(subscription)
        self._listening = []

    def _end(self) -> None:
        goal, (error, message) = self._goal, self._answer
        self._goal = self._session = self._answer = None
        self._hush()
        goal.execute(lambda handle: self._conclude(handle, error, message))

    def _conclude(
        self, goal: ServerGoalHandle, error: PoiseError | None, message: SegmentedObject | None
    ) -> ScanObject.Result:
        end_goal(goal, message is not None)
        if message is not None:
            return ScanObject.Result(object=message, error=to_message(None))
        return ScanObject.Result(error=to_message(error))

    def _conclude_busy(self, goal: ServerGoalHandle) -> ScanObject.Result:
        busy = InputError(ErrorCode.BUSY, "another scan is running: cancel it, or wait for its end")
        return self._conclude(goal, busy, None)

    # -- in the thread of the jobs ---------------------------------------------------------------------------------

    def _work(self, session: ScanSession, robot: RobotLog, name: str) -> None:
        cancelled = self._cancelled.is_set
        try:
            where, how = sweep_options(self._values), scan_options(self._values)
            sweep, scanned = scan_session(session, robot, where, how, self._reach, cancelled)
            found = segment(scanned.points, scanned.colours)
            parts = independent_parts(found) if self._values["independent_parts"] else found.tetrahedron_labels
            notes = (*sweep.notes, *scanned.notes, *found.notes)
            message = segmented_message(name, name, session.newest, scanned, found, parts, notes)
            if cancelled():
                raise NoAnswerError(ErrorCode.CANCELLED, "scan: cancelled")
            self._frames[name] = object_transform(sweep.base, name, session.newest, scanned)
            self._transforms.publish(TFMessage(transforms=list(self._frames.values())))
            self._objects.publish(message)
            self._answer = None, message
        except PoiseError as error:
            self._answer = error, None
        except Exception as error:
            self.get_logger().error(f"internal error: {error!r}")
            self._answer = coded(error), None

    def _reach(self, share: float) -> None:
        self._share = share


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_with_jobs(ObjectScanner, args)


if __name__ == "__main__":
    main()
