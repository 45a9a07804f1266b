"""Node: compares a running robot, or bags, with the simulation, and reports the missing physics."""

import math
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.files import package_file, write_whole
from poise.geometry import rotation_of_quaternion
from poise.memory import release_memory
from poise.mismatch.answer import Diagnosis, LiveWindow, diagnose, effects_called, examine
from poise.mismatch.reading import NominalModel, dump_model, joined, load_model, read_recording
from poise.nodes.diagnostics import OK, WARN, DiagnosticsPublisher
from poise.nodes.jobs import Jobs, run_with_jobs
from poise.nodes.mismatch_message import no_report_message, report_message
from poise.nodes.parameters import WORDS, Parameter, declare_parameters
from poise.nodes.request_checks import newer_description
from poise.nodes.runtime import LATCHED, coded, guarded, subscribe, topic_hint
from poise.recording import open_recording, stamp_of
from poise_msgs.msg import MismatchReport

_DEPTH = 2000
_LOOK_PERIOD = 0.25
"""s between checks whether the next window is due."""
_FULL = 0.95
"""Share of the window that must be filled."""
_GIL_SLICE = 5e-4
"""s that the thread of the diagnosis may hold the interpreter while a message waits; Python's own 5 ms is too long."""

_PARAMETERS = (
    Parameter("model", "", "model.yaml: payload, tolerances, noise; empty: the payload is identified from each window"),
    Parameter("bags", WORDS, "bags to diagnose once, instead of topics; with several, the last is held out"),
    Parameter("window", 35.0, "s of messages that are examined together", (8.0, 600.0)),
    Parameter("period", 10.0, "least time from the start of one examination to the next, s", (0.1, 3600.0)),
    Parameter("share", 0.4, "largest share of a core on average, messages included", (0.01, 1.0)),
    Parameter("wrench", "auto", "auto: efforts alone while no wrench has a publisher; required; none: efforts alone"),
    Parameter("deadline", 0.0, "s after which an examination ends with its best answer so far; 0: none", (0.0, 3600.0)),
    Parameter("effects", WORDS, "effects to search for; empty: the whole library"),
    Parameter("keep", "", "folder in which windows with a mismatch are saved as bags; empty: none"),
    Parameter("save", "", "model.yaml to write with the effects found, after each finding; empty: none"),
)


_CHANGEABLE = ("period", "share", "deadline")
"""Parameters that hold from the next examination on."""
_WRENCH = ("auto", "required", "none")
_LEAST_SHARE = 0.2
"""Of the share: what examinations get when messages need more than the rest."""


class _ShareMeter:
    """How much of a core the process needs beside its examinations."""

    def __init__(self) -> None:
        self._clock, self._used = time.monotonic(), time.process_time()

    def left(self, share: float, examined: float) -> float:
        """What a share of a core leaves for examinations, since the last call.

        Args:
            share: of a core, of the whole process.
            examined: s of processor time that the last examination took.
        """
        clock, used = time.monotonic(), time.process_time()
        beside = max(used - self._used - examined, 0.0) / max(clock - self._clock, 1e-3)
        self._clock, self._used = clock, used
        return max(share - beside, _LEAST_SHARE * share)


class MismatchDiagnoser(Node):
    """Subscribes to wrench, joint_states, joint_commands or joint_trajectory, odom, robot_description.

    Publishes mismatch_report (latched) and diagnostics.

    Examinations run one at a time in a worker thread; the executor only receives and publishes.
    """

    def __init__(self) -> None:
        super().__init__("mismatch_diagnoser")
        values = declare_parameters(self, _PARAMETERS, changeable=_CHANGEABLE)
        sys.setswitchinterval(_GIL_SLICE)
        self._model = load_model(package_file(values["model"])) if values["model"] else NominalModel()
        self._library = effects_called(values["effects"])
        self._limits: dict[str, float] = {}
        self._take_limits([self.get_parameter(name) for name in _CHANGEABLE])
        self.add_post_set_parameters_callback(self._take_limits)
        self._keep = Path(values["keep"]) if values["keep"] else None
        self._save = Path(values["save"]) if values["save"] else None
        self._wrench = values["wrench"]
        if self._wrench not in _WRENCH:
            raise InputError(ErrorCode.BAD_INPUT, f"wrench must be one of {', '.join(_WRENCH)}; got {self._wrench}")
        self._window = LiveWindow(values["window"], expects_wrench=self._wrench != "none")
        self._full: float = values["window"]
        self._busy, self._due, self._seen = False, 0.0, 0
        self._count, self._spent = 0, 0.0
        self._meter = _ShareMeter()
        self._last: MismatchReport | None = None
        self._input: dict[str, str] = {}
        self._reports = self.create_publisher(MismatchReport, "mismatch_report", LATCHED)
        self._diagnostics = DiagnosticsPublisher(self)
        self._jobs = Jobs(self, 1)
        self.create_timer(1.0, guarded(self, self._diagnose))
        if values["bags"]:
            bags = [package_file(bag) for bag in values["bags"]]
            self._start(lambda: self._examine_bags(bags))
        else:
            self._listen()

    def _listen(self) -> None:
        # At 1 kHz, messages that are decoded one by one take more than the examinations: bytes are kept.
        for kind, topic, callback, raw in (
            (WrenchStamped, "wrench", self._window.add_wrench_message, True),
            (JointState, "joint_states", self._window.add_joint_state_message, True),
            (JointState, "joint_commands", self._window.add_command_message, True),
            (JointTrajectory, "joint_trajectory", self._on_trajectory, True),
            (Odometry, "odom", self._on_odometry, False),
        ):
            if topic != "wrench" or self._wrench != "none":
                subscribe(self, kind, topic, callback, _DEPTH, raw=raw)
        self.create_subscription(String, "robot_description", guarded(self, self._on_description), LATCHED)
        self.create_service(Trigger, "reset_window", self._on_reset)
        self.create_timer(_LOOK_PERIOD, guarded(self, self._look))

    def destroy_node(self) -> None:
        """Stop the thread before the node is destroyed."""
        if hasattr(self, "_jobs"):
            self._jobs.close()
        super().destroy_node()

    # -- on the executor -------------------------------------------------------------------------------------------

    def _on_odometry(self, message: Odometry) -> None:
        turn, place = message.pose.pose.orientation, message.pose.pose.position
        rotation = rotation_of_quaternion([turn.x, turn.y, turn.z, turn.w])
        frames = (message.header.frame_id, message.child_frame_id)
        self._window.add_odometry(stamp_of(message), frames, rotation, (place.x, place.y, place.z))

    def _on_trajectory(self, data: bytes) -> None:
        self._window.add_trajectory_message(data, self.get_clock().now().nanoseconds)

    def _on_description(self, message: String) -> None:
        self._window.description = newer_description(message.data, self._window.description)

    def _take_limits(self, parameters: list[Any]) -> None:
        """Take the limits of the next examination."""
        for parameter in parameters:
            self._limits[parameter.name] = parameter.value

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, f"forgot {self._window.seconds:.1f} s"
        self._window.clear()
        return response

    @property
    def _deadline(self) -> float:
        return self._limits["deadline"] or math.inf

    def _look(self) -> None:
        """Start an examination when the window is full and holds new messages."""
        window = self._window
        if self._wrench == "auto":
            window.expect_wrench(self.count_publishers("wrench") > 0 or not window.counts[1])
        full = not window.lacks and window.seconds > _FULL * self._full
        if self._busy or not full or window.newest == self._seen or time.monotonic() < self._due:
            return
        self._seen = window.newest
        kept = window.snapshot()
        self._start(lambda: self._examine_window(kept))

    def _start(self, work: Any) -> None:
        self._busy = True  # set before the thread can reset it
        if self._jobs.do(work):
            self._diagnose()  # an examination may be shorter than the period of the diagnostics
        else:
            self._busy = False

    def _diagnose(self) -> None:
        level, text = self._status()
        values = {
            "window_seconds": f"{self._window.seconds:.1f}",
            "wrenches": str(self._window.counts[0]),
            "joint_states": str(self._window.counts[1]),
            "examinations": str(self._count),
            "seconds_of_the_last": f"{self._spent:.2f}",
            "late_messages": str(self._window.late),
            "wrenches_of_other_frames": str(self._window.foreign),
            **self._input,
        }
        self._diagnostics.publish(level, text, values, self._window.frame_id)

    def _status(self) -> tuple[int, str]:
        report = self._last
        if report is None:
            return OK, "examining" if self._busy else self._lacks() or "filling the window"
        if report.error.code:
            at_rest = report.error.code == ErrorCode.NOT_IDENTIFIABLE
            return OK if at_rest else WARN, report.error.message
        sentences = [*(effect.sentence for effect in report.effects), report.unknown_sentence]
        summary = " ".join(sentence for sentence in sentences if sentence)
        return (WARN, summary) if summary else (OK, "recording and simulation agree")

    def _lacks(self) -> str:
        """What is missing for an examination, and why, when the graph shows it."""
        lacks, (wrenches, joints) = self._window.lacks, self._window.counts
        if not wrenches and self._window.expects_wrench:
            return lacks + topic_hint(self, "wrench", "geometry_msgs/msg/WrenchStamped")
        return lacks if joints else lacks + topic_hint(self, "joint_states", "sensor_msgs/msg/JointState")

    # -- in the thread of the jobs ---------------------------------------------------------------------------------

    def _examine_window(self, kept: LiveWindow) -> None:
        newest, frame = kept.newest, kept.frame_id

        def work() -> MismatchReport:
            made = examine(kept.streams(), self._model, self._library, self._keep, self._deadline)
            self._input = {each.kind: each.sentence for each in made.reading.findings}
            self._save_model(made.found)
            return report_message(made.found, made.start, newest, frame or made.reading.model.sensor_frame or "")

        self._report(work, newest, frame)

    def _examine_bags(self, bags: list[Path]) -> None:
        def work() -> MismatchReport:
            first = read_recording(open_recording(bags[0]), self._model)
            readings = [first, *(read_recording(open_recording(bag), first.model) for bag in bags[1:])]
            recorded, last = joined([reading.recorded for reading in readings])
            last_one = last if last.any() else None
            found = diagnose(recorded, first.model, last_one, self._library, deadline=self._deadline)
            self._save_model(found)
            newest = recorded.start + round(float(recorded.seconds[-1]) * 1e9)
            return report_message(found, recorded.start, newest, first.model.sensor_frame or "")

        self._report(work, 0, "")

    def _report(self, work: Any, newest: int, frame: str) -> None:
        """Publish the result of the work, and pause to keep to the share of a core."""
        begin, used = time.monotonic(), time.thread_time()
        try:
            message = work()
        except NoAnswerError as error:  # the robot stands still
            self.get_logger().info(f"{error.code.name}: {error.message}", throttle_duration_sec=60.0)
            message = no_report_message(error, newest, frame)
        except PoiseError as error:
            self.get_logger().error(f"{error.code.name}: {error.message}", throttle_duration_sec=10.0)
            message = no_report_message(error, newest, frame)
        except Exception as error:
            self.get_logger().error(f"internal error: {error!r}", throttle_duration_sec=10.0)
            message = no_report_message(coded(error), newest, frame)
        finally:
            release_memory()
            self._spent = time.monotonic() - begin
            busy = time.thread_time() - used
            self._due = begin + max(self._limits["period"], busy / self._meter.left(self._limits["share"], busy))
            self._count += 1
            self._busy = False
        self._last = message
        if not rclpy.ok():  # the node is being shut down
            return
        self._reports.publish(message)
        self.get_logger().info(f"examined in {self._spent:.1f} s: {self._status()[1]}")

    def _save_model(self, found: Diagnosis) -> None:
        if self._save is None or not found.findings:
            return
        try:
            write_whole(self._save, dump_model(found.augmented).encode())
        except InputError as error:
            self.get_logger().error(f"{error.code.name}: {error.message}", throttle_duration_sec=10.0)


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_with_jobs(MismatchDiagnoser, args)


if __name__ == "__main__":
    main()
