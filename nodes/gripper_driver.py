"""Lifecycle node: a Robotiq 2F gripper as the action GripperCommand, its joint in joint_states, and diagnostics."""

import math
import time
from dataclasses import dataclass

import numpy as np
import rclpy
from control_msgs.action import GripperCommand
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, InputError, PoiseError
from poise.gripping import GRIPPERS, DriverOptions, Fingers, GripperDriver, GripperReport
from poise.manipulation import Gripper
from poise.nodes.diagnostics import ERROR, OK, WARN, DiagnosticsPublisher
from poise.nodes.estimate_message import time_message
from poise.nodes.lifecycle import ManagedNode
from poise.nodes.parameters import AUTOSTART, Parameter, declare_parameters
from poise.nodes.runtime import end_goal, guarded, publish, run

_TICK = 0.02  # s between looks at a goal
_FEEDBACK = 5  # looks between two feedbacks
_REPORT = 1.0  # s between diagnostics while nothing changes
_SPARE = 1.0  # s that a motion may take longer than its way at its speed

GRIPPER_DRIVER_PARAMETERS = (
    Parameter("address", "/dev/ttyUSB0", "path of the serial port"),
    Parameter("model", "2f85", "the connected gripper", tuple(GRIPPERS)),
    Parameter("slave", 9, "Modbus address", (1, 247)),
    Parameter("gripper_joint", Gripper.joint, "name of its joint in the robot description"),
    Parameter("opened", Gripper.opened, "rad or m, position of that joint with open fingers", (-10.0, 10.0)),
    Parameter("closed", Gripper.closed, "rad or m, position of that joint with closed fingers", (-10.0, 10.0)),
    Parameter("rate", 50.0, "Hz of joint_states", (5.0, 100.0)),
    Parameter("speed", 0.05, "m/s of the fingers", (0.02, 0.25)),
    Parameter("force", 40.0, "N of a goal whose max_effort is 0", (10.0, 235.0)),
    Parameter("activate", True, "activate a gripper that is not active at the start; its fingers move all the way"),
    Parameter("allow_stalling", True, "a goal succeeds when the fingers stop at something before the position"),
    AUTOSTART,
)


@dataclass
class _Goal:
    handle: ServerGoalHandle
    due: float
    looks: int = 0


class GripperDriverNode(ManagedNode):
    """Drives one gripper while active; the fault contract is in docs/gripper.md.

    Serves gripper_controller/gripper_cmd (control_msgs/GripperCommand; its position is that of the joint) and
    activate_gripper (std_srvs/Trigger), follows gripper_trajectory (trajectory_msgs/JointTrajectory), and publishes
    joint_states with the one joint.
    """

    def __init__(self) -> None:
        super().__init__("gripper_driver")
        self._values = values = declare_parameters(self, GRIPPER_DRIVER_PARAMETERS)
        model = GRIPPERS[values["model"]]
        if values["opened"] == values["closed"]:
            raise InputError(ErrorCode.BAD_INPUT, "parameters opened and closed must differ")
        for name, (least, greatest) in (("speed", model.speeds), ("force", model.forces)):
            if not least <= values[name] <= greatest:
                raise InputError(ErrorCode.BAD_INPUT, f"parameter {name}: {model.name} does {least:g} to {greatest:g}")
        self._gripper = Gripper(values["gripper_joint"], values["opened"], values["closed"], model.stroke, squeeze=0.0)
        self._options = DriverOptions(
            model, values["slave"], values["rate"], values["speed"], values["force"], values["activate"]
        )
        self._driver: GripperDriver | None = None
        self._goal: _Goal | None = None
        self._reported, self._reported_at = "", -math.inf
        self._diagnostics = DiagnosticsPublisher(self, "gripper")
        self._states = self.create_publisher(JointState, "joint_states", 10)
        self.create_subscription(JointTrajectory, "gripper_trajectory", guarded(self, self._follow), 10)
        self.create_service(Trigger, "activate_gripper", self._activate)
        self._server = ActionServer(
            self,
            GripperCommand,
            "gripper_controller/gripper_cmd",
            lambda handle: self._result(),
            goal_callback=self._consider,
            handle_accepted_callback=guarded(self, self._accept),
            cancel_callback=self._cancel,
        )
        self.create_timer(_TICK, guarded(self, self._tick))
        self.start()

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Connect, and take goals."""
        self._driver = GripperDriver(
            self._values["address"], self._options, self._publish_state, np.random.default_rng()
        )
        self._driver.start()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take no goals; the fingers stay as they are."""
        self._stop("the driver was deactivated")
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take no goals; the fingers stay as they are."""
        self._stop("the driver was shut down")
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """End the thread before the publishers go."""
        if hasattr(self, "_server"):
            self._stop("the driver ends")
            self._server.destroy()
        super().destroy_node()

    def _stop(self, why: str) -> None:
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.halt()
            if not driver.stop() and rclpy.ok():
                self.get_logger().warning("the driver hangs in a system call; it ends when that returns")
        self._end(False, why)

    # -- in the driver's thread ------------------------------------------------------------------------------------

    def _publish_state(self, fingers: Fingers) -> None:
        message = JointState(name=[self._gripper.joint], position=[self._position(fingers)])
        message.header.stamp = time_message(fingers.stamp)
        publish(self._states, message)

    # -- in the executor -------------------------------------------------------------------------------------------

    def _position(self, fingers: Fingers) -> float:
        return self._gripper.position(fingers.opening, gripping=False)

    def _command(self, position: float, force: float = 0.0) -> None:
        """Move the fingers.

        Raises:
            PoiseError: why they cannot.
        """
        driver = self._driver
        if driver is None:
            raise InputError(ErrorCode.BUSY, "gripper: the driver is not active; activate it first")
        share = (position - self._gripper.closed) / (self._gripper.opened - self._gripper.closed)
        if not -1e-3 <= share <= 1 + 1e-3:
            raise InputError(
                ErrorCode.JOINT_LIMIT,
                f"gripper: {self._gripper.joint} goes from {self._gripper.opened:g} (open) to "
                f"{self._gripper.closed:g} (closed), not to {position:g}",
            )
        driver.go(float(np.clip(share, 0.0, 1.0)) * self._gripper.stroke, force)

    def _follow(self, message: JointTrajectory) -> None:
        """Only where it ends counts."""
        last = message.points[-1].positions if message.points else ()
        if list(message.joint_names) != [self._gripper.joint] or len(last) != 1:
            raise InputError(
                ErrorCode.JOINT_MISSING, f"gripper_trajectory: it needs one position of {self._gripper.joint}"
            )
        self._command(last[0])
        self._end(False, "a trajectory has replaced this goal")

    def _consider(self, request: GripperCommand.Goal) -> GoalResponse:
        """Command the fingers; GripperCommand has no field for the reason of a refusal, so the log has it."""
        try:
            self._command(request.command.position, request.command.max_effort)
        except PoiseError as error:
            self.get_logger().error(f"goal rejected: {error.code.name}: {error.message}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _accept(self, handle: ServerGoalHandle) -> None:
        self._end(False, "another goal has replaced this one")
        allowed = self._gripper.stroke / self._options.speed + _SPARE
        self._goal = _Goal(handle, time.monotonic() + allowed)

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._driver is not None and self._goal is not None and self._goal.handle is handle:
            self._driver.halt()
        return CancelResponse.ACCEPT

    def _tick(self) -> None:
        driver = self._driver
        if driver is None:
            return
        report, fingers, goal = driver.report, driver.fingers, self._goal
        self._diagnose(report, fingers)
        if goal is None or fingers is None:
            return
        goal.looks += 1
        if goal.handle.is_cancel_requested:
            self._end(False, "cancelled")
        elif not report.works:
            self._end(False, report.text)
        elif fingers.at_request or fingers.holds:
            self._end(fingers.at_request or self._values["allow_stalling"], report.text)
        elif time.monotonic() > goal.due:
            driver.halt()
            self._end(False, "the fingers did not arrive in time")
        elif goal.looks % _FEEDBACK == 0:
            goal.handle.publish_feedback(GripperCommand.Feedback(**self._fields()))

    def _end(self, succeeded: bool, why: str) -> None:
        goal, self._goal = self._goal, None
        if goal is None:
            return
        if not succeeded:
            self.get_logger().warning(f"goal ended: {why}")

        def conclude(handle: ServerGoalHandle) -> GripperCommand.Result:
            end_goal(handle, succeeded)
            return self._result()

        goal.handle.execute(conclude)

    def _result(self) -> GripperCommand.Result:
        return GripperCommand.Result(**self._fields())

    def _fields(self) -> dict[str, float | bool]:
        """What result and feedback share. The gripper reports no force; its effort is not known."""
        fingers = None if self._driver is None else self._driver.fingers
        if fingers is None:
            return {"position": math.nan, "effort": math.nan}
        return {
            "position": self._position(fingers),
            "effort": math.nan,
            "stalled": fingers.holds,
            "reached_goal": fingers.at_request,
        }

    def _activate(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Activate the gripper (again); what it holds falls."""
        driver = self._driver
        if driver is None:
            response.message = "the driver is not active: activate it first"
            return response
        try:
            driver.activate()
        except PoiseError as error:
            response.message = f"{error.code.name}: {error.message}"
            return response
        self._end(False, "the gripper is activated again")
        response.success, response.message = True, "the gripper is being activated; see diagnostics"
        return response

    def _diagnose(self, report: GripperReport, fingers: Fingers | None) -> None:
        now = time.monotonic()
        changed = report.kind != self._reported
        if not changed and now - self._reported_at < _REPORT:
            return
        self._reported, self._reported_at = report.kind, now
        level = OK if report.works and report.kind != "lost" else WARN if report.works else ERROR
        level = WARN if report.kind in ("connecting", "activating") else level
        text = f"{report.code.name}: {report.text}" if report.code else report.text
        values = {
            "condition": report.kind,
            "opening_m": "" if fingers is None else f"{fingers.opening:.4f}",
            "current_a": f"{report.current:.2f}",
            "connects": report.connects,
        }
        self._diagnostics.publish(level, text, values, f"{self._options.model.name} {self._values['address']}")
        if changed and level == ERROR:
            self.get_logger().error(text)
        elif changed and level == WARN:
            self.get_logger().warning(text)


def main() -> None:
    """Run until Ctrl-C."""
    run(GripperDriverNode)


if __name__ == "__main__":
    main()
