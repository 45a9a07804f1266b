"""Node: the action `carry_object`: moves the base, and what stands on it, under the published acceleration limits."""

import math

import numpy as np
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry

from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.geometry import Pose
from poise.manipulation import BaseExecution, BaseLimits, BaseTolerances, plan_base_motion
from poise.nodes.arm_node import MovingNode
from poise.nodes.assembly_message import pose_message
from poise.nodes.clock import node_seconds
from poise.nodes.parameters import Parameter, declare_parameters
from poise.nodes.readiness import FEEDBACK_PERIOD, READY_TIMEOUT, WaitingGoal
from poise.nodes.runtime import LATCHED, coded, end_goal, guarded, run, subscribe, to_message
from poise.nodes.transforms import heard_frames, pose_between, pose_of
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal
from poise.recording import stamp_of
from poise.types import Array
from poise_msgs.action import CarryObject as Action
from poise_msgs.msg import AccelerationLimits, Assembly

_UNFOLLOWED = 2.0
"""s after a change of the assembly by which its limits have to be there."""
_QUIET = 1.0
"""s without odometry after which a goal does not begin."""

OBJECT_CARRIER_PARAMETERS = (
    Parameter("rate", 50.0, "Hz of cmd_vel while it moves", (5.0, 500.0)),
    Parameter("stamped", False, "cmd_vel is geometry_msgs/TwistStamped, as nav2 of Jazzy may want it"),
    Parameter("holonomic", True, "the base drives in any direction; false: it turns, drives forwards, and turns"),
    Parameter("speed", 0.5, "largest speed, m/s", (0.01, 5.0)),
    Parameter("turn_speed", 0.5, "largest angular speed, rad/s", (0.01, 5.0)),
    Parameter("share", 0.8, "largest share of the acceleration limits that is used", (0.01, 1.0)),
    Parameter("path_tolerance", 0.15, "m that the base may be off its path", (0.001, 5.0)),
    Parameter("arrival_tolerance", 0.02, "m that it may be off the goal at the end", (0.001, 1.0)),
    READY_TIMEOUT,
)


class ObjectCarrier(MovingNode):
    """Serves `carry_object` (poise_msgs/CarryObject), one goal at a time; publishes cmd_vel while it moves.

    Subscribes to acceleration_limits and assembly (latched), odom, tf and tf_static.
    """

    def __init__(self) -> None:
        super().__init__("object_carrier")
        self._values = values = declare_parameters(self, OBJECT_CARRIER_PARAMETERS)
        self._limits: AccelerationLimits | None = None
        self._assembly_stamp, self._assembly_heard = 0, 0.0
        self._odom: tuple[Array, str, str] | None = None
        self._heard = -math.inf
        self._frames = heard_frames(self)
        self._waiting = WaitingGoal(self._begin, self._result, _cancelled, Action.Feedback(stage="waiting"))
        self._goal: WatchedGoal | None = None
        self._running: BaseExecution | None = None
        self._begun = self._last_feedback = self._least = 0.0
        kind = TwistStamped if values["stamped"] else Twist
        self._commands = self.create_publisher(kind, "cmd_vel", 10)
        self.create_subscription(AccelerationLimits, "acceleration_limits", guarded(self, self._on_limits), LATCHED)
        self.create_subscription(Assembly, "assembly", guarded(self, self._on_assembly), LATCHED)
        subscribe(self, Odometry, "odom", self._on_odom, 10)
        self.create_timer(1.0 / values["rate"], guarded(self, self._tick))
        self.watchdog = ProcessWatchdog(self, Action, "carry_object", self._accept)
        self.start()

    # -- what is heard ----------------------------------------------------------------------------------------------

    def _on_limits(self, message: AccelerationLimits) -> None:
        self._limits = message
        if self._running is None:
            return
        try:
            self._running.limits = self._in_base()
        except Exception as failure:  # of any kind: the base must stop
            self._running.stop(coded(failure))

    def _on_assembly(self, message: Assembly) -> None:
        self._assembly_stamp, self._assembly_heard = stamp_of(message), node_seconds()

    def _on_odom(self, message: Odometry) -> None:
        pose = pose_of(message.pose.pose, "odom: ")
        yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
        place = np.array([*pose.translation[:2], yaw])
        self._odom, self._heard = (place, message.header.frame_id, message.child_frame_id), node_seconds()
        if self._running is not None:
            self._running.add_odometry(place, self._heard, 1e-9 * stamp_of(message))

    # -- a goal -----------------------------------------------------------------------------------------------------

    def halt(self, reason: str) -> None:
        """Stop the base and end the goal."""
        error = PoiseError(ErrorCode.CANCELLED, reason)
        self._waiting.refuse(error)
        if self._running is not None:
            self._running.stop(error)

    def _accept(self, goal: WatchedGoal) -> None:
        if self._waiting.goal is not None or self._running is not None:
            busy = NoAnswerError(ErrorCode.BUSY, "the base is carrying already: cancel that, or wait for its end")
            goal.execute(lambda handle: self._result(handle, busy))
            return
        self._waiting.take(goal, self._values["ready_timeout"])

    def _begin(self, goal: WatchedGoal, _accepted: float) -> None:
        self._running = self._motion(goal)
        self._goal, self._begun = goal, node_seconds()

    def _motion(self, goal: WatchedGoal) -> BaseExecution:
        """The motion that a goal asks for.

        Raises:
            InputError, NoAnswerError: as `_in_base` and `plan_base_motion`; BAD_INPUT; TOPIC_MISSING.
        """
        request, values, now = goal.request, self._values, node_seconds()
        speed, share = request.speed or values["speed"], request.share or values["share"]
        if not (0 < speed <= values["speed"] and 0 < share <= values["share"]):
            what = f"goal: speed {request.speed:g} and share {request.share:g}; they may be up to"
            raise InputError(ErrorCode.BAD_INPUT, f"{what} {values['speed']:g} m/s and {values['share']:g}")
        if self._odom is None or now - self._heard > _QUIET:
            raise InputError(ErrorCode.TOPIC_MISSING, "no odom comes: start the driver of the base")
        if not self._commands.get_subscription_count():
            raise InputError(ErrorCode.TOPIC_MISSING, "no base listens on cmd_vel: remap it to the base's, or start it")
        limits, (start, frame, _) = self._in_base(), self._odom
        path = [self._place(each, frame) for each in request.path]
        motion = plan_base_motion(start, path, limits, speed, values["turn_speed"], share, values["holonomic"])
        self._least = min(motion.least, 1e6)
        tolerances = BaseTolerances(values["path_tolerance"], values["arrival_tolerance"])
        running = BaseExecution(motion, limits, share, tolerances, now)
        running.add_odometry(start, now)
        return running

    def _place(self, message: PoseStamped, frame: str) -> Array:
        """(3,) x, y, yaw of a pose, in the frame of the odometry."""
        joined = pose_between(self._frames, message.header.frame_id or frame, frame)
        pose = joined @ pose_of(message.pose, "path: ")
        return np.array([*pose.translation[:2], math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])])

    def _in_base(self) -> BaseLimits:
        """The limits of the moment, in the frame of the base.

        Raises:
            InputError: TOPIC_MISSING without limits, or without the node that publishes them; SENSOR_STALE when the
                assembly has changed since; FRAME_UNKNOWN.
            NoAnswerError: the error of the limits; DEADLINE while they are being computed.
        """
        message = self._limits
        if message is None or not self.count_publishers("acceleration_limits"):
            raise InputError(ErrorCode.TOPIC_MISSING, "no acceleration_limits: start the node of that name")
        if message.error.code not in (ErrorCode.OK, ErrorCode.DEADLINE):
            raise NoAnswerError(ErrorCode(message.error.code), f"acceleration_limits: {message.error.message}")
        if not message.limits:  # an answer without limits is no freedom from limits
            what = message.error.message or "a message without limits"
            raise NoAnswerError(ErrorCode.DEADLINE, f"acceleration_limits: {what}")
        if stamp_of(message) < self._assembly_stamp:
            waited = node_seconds() - self._assembly_heard
            code = ErrorCode.SENSOR_STALE if waited > _UNFOLLOWED else ErrorCode.EMPTY
            raise InputError(code, "acceleration_limits are of an earlier assembly: they have not followed its change")
        base = "" if self._odom is None else self._odom[2]
        turn = pose_between(self._frames, message.header.frame_id, base or message.header.frame_id).rotation
        normals = np.array([[each.x, each.y, each.z] for each in message.normals]).reshape(-1, 3) @ turn.T
        turning = message.angular_acceleration, message.angular_speed
        return BaseLimits(normals[:, :2], np.array(message.offsets), *turning)

    def _tick(self) -> None:
        now = node_seconds()
        self._waiting.tick()
        goal, running = self._goal, self._running
        if goal is None or running is None:
            return
        if goal.is_cancel_requested:
            running.stop(PoiseError(ErrorCode.CANCELLED, "carrying was cancelled, and the base came to rest"))
        self._require_fresh(running)
        try:
            self._command(running.tick(now))
        except Exception as failure:  # of any kind: the caller must get an answer, and the base must stop
            running.done, running.error = True, coded(failure)
            guarded(self, self._command)(np.zeros(3))
        if running.done:
            self._goal = self._running = None
            goal.execute(lambda handle: self._result(handle, running.error, running, now - self._begun))
        elif now > self._last_feedback + FEEDBACK_PERIOD:
            self._last_feedback = now
            goal.publish_feedback(Action.Feedback(stage=running.stage, progress=running.progress))

    def _require_fresh(self, running: BaseExecution) -> None:
        """Stop when the limits are no longer those of what stands on the base."""
        try:
            self._in_base()
        except Exception as failure:  # of any kind: the base must stop
            error = coded(failure)
            if error.code is not ErrorCode.EMPTY:  # they may still follow
                running.stop(error)

    def _command(self, velocity: Array) -> None:
        twist = Twist()
        twist.linear.x, twist.linear.y, twist.angular.z = velocity.tolist()
        if not self._values["stamped"]:
            self._commands.publish(twist)
            return
        message = TwistStamped(twist=twist)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = "" if self._odom is None else self._odom[2]
        self._commands.publish(message)

    def _result(
        self, goal: WatchedGoal, error: PoiseError | None, running: BaseExecution | None = None, seconds: float = 0.0
    ) -> Action.Result:
        """What a goal gets in the end; sets its status, too."""
        result = Action.Result(seconds=seconds, error=to_message(error))
        if running is not None:
            result.distance, result.used, result.limit = running.distance, min(running.used, 1e6), self._least
        if self._odom is not None:
            place, result.pose.header.frame_id, _ = self._odom
            turn = [0.0, 0.0, math.sin(place[2] / 2), math.cos(place[2] / 2)]
            result.pose.pose = pose_message(Pose.from_vector([place[0], place[1], 0.0, *turn]))
        end_goal(goal, error is None)
        return result


def _cancelled(_goal: WatchedGoal) -> PoiseError:
    return PoiseError(ErrorCode.CANCELLED, "cancelled before the base moved")


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run(ObjectCarrier, args)


if __name__ == "__main__":
    main()
