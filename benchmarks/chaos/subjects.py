"""For each node: how it is started and fed, a goal to disturb, and what shows that it answers right."""

import math
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from geometry_msgs.msg import Point, Vector3, WrenchStamped
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from benchmarks.chaos.observer import LATCHED, Observer
from poise.assembly import Analysis, Assembly, Box, RigidObject
from poise.errors import ErrorCode
from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor
from poise.force_torque.wire import WrenchSource
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message, assembly_of, object_of
from poise_msgs.action import IdentifyPayload, PlaceObject, ScanObject
from poise_msgs.msg import AccelerationLimits, InertialEstimate, MismatchReport, Push
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import AssessRobustness

_FRICTION, _GRAVITY = 0.5, 9.80665
_WRENCH = np.array([1.0, -2.0, 30.0, 0.4, -0.5, 0.6])
_XARM = {"mode": "arm", "robot": "xarm7", "trajectory": "fourier", "duration": 60.0, "loop": True, "seed": 1}
_PAYLOAD = {"payload.mass": 0.8, "payload.com": [0.01, 0.0, 0.2]}
_PAYLOAD |= {"payload.inertia": [0.003, 0.0, 0.0, 0.003, 0.0, 0.001]}
_FR3 = {"mode": "arm", "robot": "fr3", "sensor": "ft300", "joint_noise": 0.0, "joint_velocity_noise": 0.0}
_DRILL = {"payload.mass": 1.6, "payload.com": [0.0, 0.02, 0.19]}
_DRILL |= {"payload.inertia": [0.009, 0.0, 0.0, 0.006, 0.001, 0.005]}


def box(name: str, size: tuple[float, float, float], z: float, fixed: bool = False) -> RigidObject:
    """An upright box above the origin, of 1 kg."""
    return RigidObject(name, Box(size), Pose.from_vector([0, 0, z, 0, 0, 0, 1]), fixed, 1.0)


CUBE_ON_FLOOR = Assembly(
    (box("floor", (20.0, 20.0, 0.1), -0.05, fixed=True), box("cube", (1.0, 1.0, 1.0), 0.5)), friction=_FRICTION
)


def cube_message() -> AssemblyMessage:
    """A cube of 1 kg on a floor, in the frame of a tray."""
    return assembly_message(CUBE_ON_FLOOR, "tray")


def low_push() -> Push:
    """It slides at mu m g."""
    return Push(object="cube", point=Point(x=-0.5, z=0.1), direction=Vector3(x=1.0))


class Subject:
    """A node under test. A subclass says what is special.

    Attributes:
        node: executable.
        companions: other executables that it needs, with their parameters.
        stream: it publishes by itself; otherwise it has to be asked.
        right: answers so far that are right. Those that a code or a finding qualifies are neither right nor false.
        false: answers that are wrong and do not say so.
    """

    node = ""
    companions: ClassVar[dict[str, dict[str, Any]]] = {}
    stream = False
    arm = False

    def __init__(self) -> None:
        self.right, self.false = 0, list[str]()
        self.open = ExitStack()
        self._moving: JointState | None = None

    def parameters(self) -> dict[str, Any]:
        """Of the node."""
        return {}

    def connect(self, observer: Observer) -> None:
        """Subscribe to what the node publishes."""
        if self.arm:
            observer.hear(JointState, "joint_states", self._see_arm)

    def ask(self, observer: Observer, timeout: float) -> None:
        """Ask for an answer, and judge it."""

    def begin(self, observer: Observer) -> None:
        """Start something that takes long, to be disturbed in its middle."""

    def start_moving(self, observer: Observer, client: Any, goal: Any) -> None:
        """Send a goal until the arm moves: one before the node knows the robot is refused."""
        goals: list[Any] = []
        while self.arm_is_at_rest:
            if not goals or goals[-1].done():
                goals.append(observer.begin(client, goal).get_result_async())
            observer.until(lambda: not self.arm_is_at_rest or goals[-1].done(), "the motion")

    def spoil(self) -> None:
        """Disturb inputs that are no topics."""

    def heal(self, observer: Observer) -> None:
        """End that, and do what the documentation asks for after forged messages."""

    def judge(self, problem: str) -> None:
        """Count an answer; an empty `problem` means that it is right."""
        if problem:
            self.false.append(problem)
        else:
            self.right += 1

    def _see_arm(self, message: JointState) -> None:
        self._moving = message

    @property
    def arm_is_at_rest(self) -> bool:
        """The last joint state has no velocity."""
        return self._moving is not None and max(map(abs, self._moving.velocity), default=0.0) < 1e-3

    def hear_arm(self) -> None:
        """Forget the last joint state."""
        self._moving = None


def _wrong(value: float, truth: float, tolerance: float, what: str) -> str:
    good = math.isfinite(value) and abs(value - truth) <= tolerance
    return "" if good else f"{what} {value:.6g} for {truth:.6g}"


class Driver(Subject):
    """ft_driver with an ATI sensor in software."""

    node, stream = "ft_driver", True

    def parameters(self) -> dict[str, Any]:
        self._sensor = self.open.enter_context(FakeRdtSensor(WrenchSource(_WRENCH), rate=1000.0))
        return {"address": "127.0.0.1", "port": self._sensor.port, "http_port": self._sensor.http_port}

    @property
    def streams(self) -> int:
        """How often the driver has asked the sensor to begin: more than once after a silence."""
        return self._sensor.starts

    def connect(self, observer: Observer) -> None:
        observer.hear(WrenchStamped, "wrench", self._judge)

    def _judge(self, message: WrenchStamped) -> None:
        force, torque = message.wrench.force, message.wrench.torque
        got = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
        self.judge("" if np.allclose(got, _WRENCH, atol=1e-6) else f"wrench {got}")

    def spoil(self) -> None:
        """Datagrams that are cut, repeated, or hold nothing."""
        self._sensor.fault = lambda grams: [part for gram in grams for part in (gram[:7], b"", gram + b"x", gram, gram)]

    def heal(self, observer: Observer) -> None:
        """Whole datagrams again."""
        self._sensor.fault = None


class _Weighing(Subject):
    """A subject with an inertial_estimator."""

    def heal(self, observer: Observer) -> None:
        """Forged odometry has shown a base that moves; the diagnostics ask for this call."""
        observer.call(Trigger, "reset_estimate", Trigger.Request())


class Estimator(_Weighing):
    """inertial_estimator beside an arm that moves 0.8 kg."""

    node, stream = "inertial_estimator", True
    companions: ClassVar[dict[str, dict[str, Any]]] = {"fake_robot": _XARM | _PAYLOAD | {"sensor": "ft300"}}

    def connect(self, observer: Observer) -> None:
        observer.hear(InertialEstimate, "inertial_estimate", self._judge, latched=True)

    def _judge(self, message: InertialEstimate) -> None:
        qualified = message.error.code or message.findings or "m" in message.unidentified
        if message.error.code:
            return  # coded: neither right nor false
        deviation = math.sqrt(message.covariance[0]) if message.covariance[0] >= 0 else math.nan
        wrong = _wrong(message.inertia.m, 0.8, max(5 * deviation, 0.016), "mass")
        if not (wrong and qualified):
            self.judge(wrong)


class Identification(_Weighing):
    """The action identify_payload, with an arm that follows."""

    node, arm = "inertial_estimator", True
    companions: ClassVar[dict[str, dict[str, Any]]] = {"fake_robot": _FR3 | _DRILL}

    def parameters(self) -> dict[str, Any]:
        return {"tcp_frame": "tcp", "object_radius": 0.12}

    def ask(self, observer: Observer, timeout: float) -> None:
        goal = IdentifyPayload.Goal(motion=IdentifyPayload.Goal.MOTION_NONE, duration=1.0)
        result = observer.act(IdentifyPayload, "identify_payload", goal, timeout)
        found = result.estimate
        qualified = result.error.code == ErrorCode.NOT_IDENTIFIABLE or found.findings or "m" in found.unidentified
        if not result.error.code or qualified:
            self.judge("" if qualified else _wrong(found.inertia.m, 1.6, 0.05, "mass"))
        else:
            observer.rest(0.1)

    def begin(self, observer: Observer) -> None:
        client, phases = observer.actor(IdentifyPayload, "identify_payload"), list[str]()
        observer.until(client.server_is_ready, "action identify_payload")
        goal = IdentifyPayload.Goal(motion=IdentifyPayload.Goal.MOTION_STOP_AND_GO)
        goals: list[Any] = []

        def ended() -> bool:
            return not goals or goals[-1].done()

        while not ("moving" in phases and not self.arm_is_at_rest):
            if ended():  # a goal before the node knows the robot is refused
                handle = observer.begin(client, goal, lambda said: phases.append(said.feedback.phase))
                goals.append(handle.get_result_async())
            observer.until(lambda: ("moving" in phases and not self.arm_is_at_rest) or ended(), "the motion")


class Diagnoser(Subject):
    """mismatch_diagnoser on a robot without a fault."""

    node, stream = "mismatch_diagnoser", True
    companions: ClassVar[dict[str, dict[str, Any]]] = {
        "fake_robot": _XARM | _PAYLOAD | {"rate": 2.0, "sensor": "ft300", "duration": 600.0}
    }

    def parameters(self) -> dict[str, Any]:
        folder = Path(self.open.enter_context(tempfile.TemporaryDirectory()))
        effects = ["sensor_bias", "clock_offset"]
        own = {"window": 8.0, "period": 0.5, "share": 1.0, "effects": effects}
        return own | {"keep": str(folder / "kept"), "save": str(folder / "model.yaml")}

    def connect(self, observer: Observer) -> None:
        observer.hear(MismatchReport, "mismatch_report", self._judge, latched=True)

    def _judge(self, message: MismatchReport) -> None:
        self.judge(", ".join(effect.name for effect in message.effects))


class Server(Subject):
    """robustness_server, asked for the force that moves a cube."""

    node = "robustness_server"

    def ask(self, observer: Observer, timeout: float) -> None:
        request = AssessRobustness.Request(assembly=[cube_message()], pushes=[low_push()], deadline=10.0)
        response = observer.call(AssessRobustness, "assess_robustness", request, timeout)
        truth = _FRICTION * _GRAVITY
        if response.error.code:
            observer.rest(0.1)
        else:
            self.judge(_wrong(response.robustness[0].robustness, truth, 1e-3 * truth, "robustness"))

    def begin(self, observer: Observer) -> None:
        client = observer.node.create_client(AssessRobustness, "assess_robustness")
        observer.until(client.service_is_ready, "the service")
        for _ in range(20):
            client.call_async(AssessRobustness.Request(assembly=[cube_message()], map_points=20_000, deadline=5.0))
        observer.rest(0.2)


class AccelerationLimitsOfCube(Subject):
    """acceleration_limits of a cube on a floor."""

    node = "acceleration_limits"

    def parameters(self) -> dict[str, Any]:
        return {"azimuths": 8, "rate": 20.0}

    def connect(self, observer: Observer) -> None:
        self._heard = 0
        observer.hear(AccelerationLimits, "acceleration_limits", self._judge, latched=True)
        self._assemblies = observer.node.create_publisher(AssemblyMessage, "assembly", LATCHED)

    def ask(self, observer: Observer, timeout: float) -> None:
        before = self._heard
        stack = Assembly(
            (*CUBE_ON_FLOOR.objects, box("lid", (1.0, 1.0, 0.1 + 0.1 * (before % 7)), 1.05 + 0.05 * (before % 7)))
        )
        self._assemblies.publish(assembly_message(stack, "tray"))
        observer.until(lambda: self._heard > before, "limits", timeout)

    def _judge(self, message: AccelerationLimits) -> None:
        self._heard += 1
        if not message.error.code and message.header.frame_id == "tray" and "lid" in str(message.first_to_move):
            # All slides at mu g, before anything topples.
            self.judge("".join(_wrong(limit, 0.5 * _GRAVITY, 0.01, "limit") for limit in message.limits[:1]))


class Planner(Subject):
    """The action place_object without a motion."""

    node = "placement_planner"

    def parameters(self) -> dict[str, Any]:
        return {"candidates": 10_000, "attempts": 1_000_000, "support": "objects"}

    def goal(self, deadline: float) -> PlaceObject.Goal:
        """A box to be placed on a cube."""
        item = assembly_message(Assembly((CUBE_ON_FLOOR.objects[0], box("parcel", (0.2, 0.2, 0.2), 0.1))), "tray")
        return PlaceObject.Goal(assembly=[cube_message()], object=item.objects[1], seed=5, deadline=deadline)

    def ask(self, observer: Observer, timeout: float) -> None:
        goal = self.goal(1.0)
        result = observer.act(PlaceObject, "place_object", goal, timeout)
        if result.error.code not in (ErrorCode.OK, ErrorCode.DEADLINE):
            observer.rest(0.1)
            return
        goal.object.pose = result.pose.pose
        stands = assembly_of(goal.assembly[0]).with_object(object_of(goal.object))
        self.judge("" if Analysis.of(stands).stability().margin > 0 else "a placement that falls")

    def begin(self, observer: Observer) -> None:
        client = observer.actor(PlaceObject, "place_object")
        observer.until(client.server_is_ready, "action place_object")
        observer.begin(client, self.goal(6.0))
        observer.rest(0.3)


class Scanner(Subject):
    """The action scan_object without a camera: a goal ends with a code."""

    node = "object_scanner"

    def parameters(self) -> dict[str, Any]:
        return {"patience": 0.5, "duration": 5.0}

    def ask(self, observer: Observer, timeout: float) -> None:
        result = observer.act(ScanObject, "scan_object", ScanObject.Goal(id="hammer"), timeout)
        if result.error.code == ErrorCode.INTERNAL:  # the watchdog's farewell for a node that has ended
            observer.rest(0.1)
        else:
            self.judge("" if result.error.code else "an object without a camera")

    def begin(self, observer: Observer) -> None:
        client = observer.actor(ScanObject, "scan_object")
        observer.until(client.server_is_ready, "action scan_object")
        observer.begin(client, ScanObject.Goal(id="hammer"))


class Robot(Subject):
    """fake_robot as an arm at rest that follows trajectories."""

    node, stream, arm = "fake_robot", True, True

    def parameters(self) -> dict[str, Any]:
        return _FR3 | _DRILL

    def connect(self, observer: Observer) -> None:
        super().connect(observer)
        observer.hear(WrenchStamped, "wrench", self._judge)

    def _judge(self, message: WrenchStamped) -> None:
        force = message.wrench.force
        self.judge(_wrong(math.hypot(force.x, force.y, force.z), 1.6 * _GRAVITY, 20.0, "weight"))


ESTIMATING: dict[str, type[Subject]] = {
    "ft_driver": Driver,
    "inertial_estimator": Estimator,
    "identify_payload": Identification,
    "mismatch_diagnoser": Diagnoser,
    "robustness_server": Server,
    "acceleration_limits": AccelerationLimitsOfCube,
    "placement_planner": Planner,
    "object_scanner": Scanner,
    "fake_robot": Robot,
}
