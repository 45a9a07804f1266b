"""The action `identify_payload`: goals in, an identification session run by a timer, a motion for the arm out."""

from dataclasses import replace
from typing import Any

from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.excitation import (
    COLLABORATIVE_SPEED,
    ExcitationOptions,
    Guard,
    MotionLimits,
    plan_excitation,
    plan_stop_and_go,
    tool_centre,
)
from poise.excitation.execution import IdentificationTask, Plan, Session, SessionPhase, TimedMotion
from poise.inertia import InertialEstimate
from poise.inertia.estimators import check_method
from poise.inertia.model import NoiseLevels, Parts
from poise.inertia.pipeline import LiveEstimator
from poise.nodes.arm_node import ArmNode
from poise.nodes.clock import node_seconds
from poise.nodes.estimate_message import estimate_message, no_estimate_message
from poise.nodes.parameters import Parameter, declare_parameters
from poise.nodes.payload_causes import CauseSearch, CheckedAnswer
from poise.nodes.payload_shape import accuracy_of
from poise.nodes.readiness import READY_TIMEOUT, Readiness
from poise.nodes.runtime import coded, end_goal, guarded, to_message
from poise.nodes.trajectory_message import trajectory_message
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal, execution_options, watch_limits
from poise.recording import stamp_of
from poise.robot import RobotModel
from poise.types import Array
from poise_msgs.action import IdentifyPayload as Action

_TICK = 0.02
"""s between looks at a running session."""
_FEEDBACK_TICKS = 10
_PLANNED_NOISE = NoiseLevels(linear_acceleration=0.02, angular_acceleration=0.05, force_bias=5.0, torque_bias=0.25)
"""Motions are planned for these levels where none are given. They show the sensor's bias, even of a zeroed sensor."""

IDENTIFY_PAYLOAD_PARAMETERS = (
    Parameter("speed_limit", COLLABORATIVE_SPEED, "largest speed of any point of hand and object, m/s", (1e-3, 5.0)),
    Parameter(
        "object_radius", 0.15, "largest distance of the object from the tool centre point, m", (0.0, 5.0), dynamic=True
    ),
    Parameter("tcp_frame", "", "frame of the tool centre point; empty: the sensor's"),
    Parameter(
        "joint_speed_share", 0.8, "share of each joint's velocity limit, for identification motions", (0.01, 1.0)
    ),
    Parameter("joint_acceleration", 10.0, "largest joint acceleration of identification motions, rad/s2", (0.1, 1e3)),
    Parameter("room", 0.15, "largest distance of the tool centre point from its start, m", (0.01, 5.0)),
    Parameter("excitation_duration", 1.5, "duration of the optimal motion, s", (0.5, 60.0), dynamic=True),
    Parameter("stop_and_go_poses", 5, "number of poses to stop in", (3, 7), dynamic=True),
    Parameter("stop_and_go_dwell", 0.75, "time at rest in each pose, s", (0.1, 10.0), dynamic=True),
    Parameter("listen_duration", 3.0, "s of samples for MOTION_NONE", (0.1, 600.0), dynamic=True),
    Parameter(
        "expected_mass", 1.0, "approximate mass of the payload for planning motions, kg", (1e-3, 1e3), dynamic=True
    ),
    READY_TIMEOUT,
    Parameter("excitation_seed", 0, "seed of the search for the optimal motion", (0, 2**31 - 1), dynamic=True),
)


class LivePayloadEstimator:
    """The node's live estimator, with a window of its own for one goal.

    Args:
        live: the estimator.
        method: by name; empty: the node's.
        parts, accuracy: of the object, see `LiveEstimator.begin_window`.
    """

    def __init__(self, live: LiveEstimator, method: str, parts: Parts | None, accuracy: float | None) -> None:
        self._live, self._method, self._parts, self._accuracy = live, method, parts, accuracy

    def begin(self) -> None:
        """Open the window."""
        self._live.begin_window(self._method, self._parts, self._accuracy)

    def estimate(self) -> InertialEstimate:
        """Of what is in the window."""
        return self._live.window_estimate()

    def settled(self, stamp: int) -> bool:
        """All samples up to a stamp are in."""
        decided = self._live.window_decided
        return decided is not None and decided >= stamp

    def heard(self) -> float | None:
        """When the last wrench came, s."""
        return self._live.heard.get("wrench")


class IdentifyPayload:
    """Serves `identify_payload` (poise_msgs/IdentifyPayload), one goal at a time; moves the arm by `joint_trajectory`.

    Args:
        node: the inertial_estimator, with its `live` estimator.
    """

    def __init__(self, node: ArmNode) -> None:
        self._node, self._live = node, node.live
        self._values = declare_parameters(node, IDENTIFY_PAYLOAD_PARAMETERS)
        self._arm = node.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self._goal: WatchedGoal | None = None
        self._session: Session | None = None
        self._ticks = 0
        self._told: SessionPhase | None = None
        self._joints: Any = None
        self._timer: Any = None
        self._causes = CauseSearch()
        self.watchdog = ProcessWatchdog(node, Action, "identify_payload", self._accept)

    # -- a goal comes ------------------------------------------------------------------------------------------

    def _accept(self, goal: WatchedGoal) -> None:
        if self._goal is not None:
            goal.execute(self._conclude_busy)
            return
        self._goal, self._session, self._ticks, self._told = goal, None, 0, None
        self._waiting = Readiness(self._values["ready_timeout"])
        self._joints = self._node.create_subscription(
            JointState, "joint_states", guarded(self._node, self._on_joint_state), 100
        )
        self._timer = self._node.create_timer(_TICK, guarded(self._node, self._tick))
        self._tick()

    def halt(self, reason: str) -> None:
        """Stop the arm and end the goal."""
        if self._session is not None:
            self._session.cancel(node_seconds(), reason)
        elif self._goal is not None:
            self._end(PoiseError(ErrorCode.CANCELLED, reason))

    def _begin(self, request: Action.Goal) -> Session:
        """What the goal asks for.

        Raises:
            InputError: when it makes no sense, or there is no robot to move.
        """
        check_method(request.method or self._live.options.method)
        if request.motion not in (
            Action.Goal.MOTION_NONE,
            Action.Goal.MOTION_STOP_AND_GO,
            Action.Goal.MOTION_EXCITATION,
        ):
            raise InputError(ErrorCode.BAD_INPUT, f"goal: there is no motion {request.motion}; 0, 1 and 2 there are")
        for name in ("duration", "speed_limit", "object_radius"):
            if not 0 <= getattr(request, name) < 1e3:
                raise InputError(
                    ErrorCode.BAD_INPUT, f"goal: {name} is {getattr(request, name)}: give 0 for the default"
                )
        limits = self._limits(request)
        model = self._model()
        parts = self._node.parts_of(request.object[0]) if request.object else self._live.parts
        guard = self._guard(model, request, parts)
        duration = request.duration or self._values["listen_duration"]
        watchdog = None
        if request.motion == Action.Goal.MOTION_NONE:
            task = IdentificationTask(None, guard, limits, duration, execution_options(self._node))
        else:
            if not self._arm.get_subscription_count():
                raise InputError(
                    ErrorCode.TOPIC_MISSING,
                    "no controller listens on joint_trajectory: remap it to the arm's, or start it",
                )
            plan = self._planner(model, request, guard, limits, parts)
            task = IdentificationTask(plan, guard, limits, options=execution_options(self._node))
            watchdog = self.watchdog
            watchdog.watch(self._goal, model.joint_names, watch_limits(self._node, needs_wrench=True))
        accuracy = accuracy_of(request.object[0]) if request.object else None
        scale = LivePayloadEstimator(self._live, request.method, parts, accuracy)
        return Session(model, task, scale, self._send, node_seconds(), watchdog)

    def _model(self) -> RobotModel:
        if self._live.problem is not None:
            raise self._live.problem
        if self._live.joints is None:
            heard = "wrench" in self._live.heard or self._live.options.sensor_frame
            what = (
                "robot_description: publish it" if heard else "wrench, which names the sensor's frame: start the driver"
            )
            code = ErrorCode.ROBOT_DESCRIPTION_MISSING if heard else ErrorCode.TOPIC_MISSING
            raise InputError(code, f"identify_payload needs to know the robot, and there is no {what}")
        return self._live.joints.model

    def _guard(self, model: RobotModel, request: Action.Goal, parts: Parts | None) -> Guard:
        tcp = tool_centre(model, self._values["tcp_frame"])
        if parts is not None and len(parts.points):
            return Guard.outline(tcp, parts.points)
        return Guard.ball(tcp, request.object_radius or self._values["object_radius"])

    def _limits(self, request: Action.Goal) -> MotionLimits:
        highest = self._values["speed_limit"]
        if request.speed_limit > highest:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"goal: speed_limit {request.speed_limit:g} m/s is above the node's {highest:g} m/s",
            )
        return MotionLimits(
            speed=request.speed_limit or highest,
            joint_speed=self._values["joint_speed_share"],
            acceleration=self._values["joint_acceleration"],
            room=self._values["room"],
        )

    def _planner(
        self, model: RobotModel, request: Action.Goal, guard: Guard, limits: MotionLimits, parts: Parts | None
    ) -> Any:
        noise = self._live.options.noise.filled(_PLANNED_NOISE)
        options = ExcitationOptions(
            duration=request.duration or self._values["excitation_duration"],
            poses=self._values["stop_and_go_poses"],
            dwell=self._values["stop_and_go_dwell"],
            mass=self._values["expected_mass"],
            noise=replace(
                noise,
                force_bias=max(noise.force_bias, _PLANNED_NOISE.force_bias),
                torque_bias=max(noise.torque_bias, _PLANNED_NOISE.torque_bias),
            ),
            seed=self._values["excitation_seed"],
        )
        plan = plan_stop_and_go if request.motion == Action.Goal.MOTION_STOP_AND_GO else plan_excitation

        def from_here(start: Array) -> Plan:
            return lambda progress, cancelled: plan(
                model, start, guard, limits, options, parts=parts, progress=progress, cancelled=cancelled
            )

        return from_here

    # -- while it runs -----------------------------------------------------------------------------------------

    def _on_joint_state(self, message: JointState) -> None:
        if self._session is not None:
            self._session.add_joint_state(stamp_of(message), message.name, message.position, node_seconds())

    def _tick(self) -> None:
        goal, session = self._goal, self._session
        if goal is None:
            return
        if session is None:
            self._wait(goal)
            return
        now = node_seconds()
        if goal.is_cancel_requested:
            session.cancel(now)
        session.tick(now)
        self._ticks += 1
        if session.phase is SessionPhase.DONE:
            if session.answer is None or self._causes.done(session.answer):
                self._end()
        elif session.phase is not self._told or self._ticks % _FEEDBACK_TICKS == 0:
            self._told = session.phase
            goal.publish_feedback(self._feedback(session))

    def _wait(self, goal: WatchedGoal) -> None:
        """Begin as soon as the robot is known."""
        if goal.is_cancel_requested:
            self._end(PoiseError(ErrorCode.CANCELLED, "the goal was cancelled"))
            return
        try:
            self._session = self._begin(goal.request)
        except Exception as failure:  # of any kind: the caller must not wait for ever
            error = coded(failure)
            if not self._waiting.may_change(error):
                self._end(error)
                return
        self._ticks += 1
        if self._ticks % _FEEDBACK_TICKS == 1:
            goal.publish_feedback(Action.Feedback(phase=SessionPhase.WAITING.value))

    def _feedback(self, session: Session) -> Action.Feedback:
        feedback = Action.Feedback(phase=session.phase.value, progress=float(session.progress))
        try:
            feedback.estimate = estimate_message(self._live.window_estimate())
        except PoiseError as error:
            feedback.estimate = no_estimate_message(error, self._live.sensor_frame)
        return feedback

    def _send(self, command: TimedMotion) -> None:
        """Hand a motion to the arm's controller."""
        names = self._live.joints.model.joint_names
        self._arm.publish(trajectory_message(names, command.motion, command.stamp))

    # -- and ends ----------------------------------------------------------------------------------------------

    def _end(self, error: PoiseError | None = None) -> None:
        """Close everything that was opened for the goal, then let it have its result."""
        goal, session = self._goal, self._session
        self._goal = self._session = None
        self.watchdog.rest()
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._joints)
        answer = None if session is None or session.answer is None else self._causes.take()
        error = error or (session and session.error) or (answer and answer.error)
        self._live.end_window(keep=answer is not None and answer.error is None)
        goal.execute(lambda handle: self._conclude(handle, error, answer))

    def _conclude(self, goal: WatchedGoal, error: PoiseError | None, answer: CheckedAnswer | None) -> Action.Result:
        result = Action.Result(error=to_message(error))
        if answer is not None:
            result.estimate = answer.message
        else:
            error = error or NoAnswerError(ErrorCode.TOO_FEW_SAMPLES, "there is no estimate")
            result.estimate = no_estimate_message(error, self._live.sensor_frame)
        end_goal(goal, answer is not None and answer.error is None)
        return result

    def _conclude_busy(self, goal: WatchedGoal) -> Action.Result:
        busy = InputError(ErrorCode.BUSY, "another identification is running: cancel it, or wait for its end")
        return self._conclude(goal, busy, None)
