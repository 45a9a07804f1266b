"""An identification session with a simulated arm and the live estimator, in simulated time: no ROS, no waiting."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.excitation import ExcitationPlan, Guard, MotionLimits
from poise.excitation.execution import IdentificationTask, Session, SessionPhase, TimedMotion
from poise.fake_robots.arm import ArmOptions, SimulatedArm, Waypoints
from poise.inertia.model.problem import UNKNOWN_NOISE, NoiseLevels
from poise.inertia.pipeline.live import LiveEstimator
from poise.inertia.pipeline.live_options import LiveOptions
from poise.recording.encoding import typestore
from poise.robot import RobotModel, frame_poses
from poise.robot.model import find_urdf
from poise.simulation import IdealRobot, JointNoise, wrench_noise

TICK = 0.02
TYPES = {
    "joint_states": "sensor_msgs/msg/JointState",
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "robot_description": "std_msgs/msg/String",
}


class LivePayloadEstimator:
    """As in the node."""

    def __init__(self, live: LiveEstimator) -> None:
        self.live = live

    def begin(self) -> None:
        self.live.begin_window()

    def estimate(self):
        return self.live.window_estimate()

    def settled(self, stamp: int) -> bool:
        decided = self.live.window_decided
        return decided is not None and decided >= stamp

    def heard(self) -> float | None:
        return self.live.heard.get("wrench")


class DeafScale:
    """Hears wrenches and weighs nothing: where only the motion matters."""

    def __init__(self) -> None:
        self.last: float | None = None

    def begin(self) -> None:
        pass

    def estimate(self):
        raise NoAnswerError(ErrorCode.TOO_FEW_SAMPLES, "nothing was weighed")

    def settled(self, stamp: int) -> bool:
        return True

    def heard(self) -> float | None:
        return self.last


@dataclass
class Rehearsal:
    """A simulated arm holds a payload; `run` plays a session on it.

    `lost` says which messages do not arrive: (topic, seconds) -> bool. `deaf`: the arm takes no commands.
    Without `weighs` the estimator is left out, which takes most of the time.
    """

    payload: np.ndarray
    robot: str = "fr3"
    start: np.ndarray | None = None
    sensor: str = "ft300"
    bias: tuple[float, ...] = (0.0,) * 6
    noise: NoiseLevels = UNKNOWN_NOISE
    seed: int = 0
    lost: Callable[[str, float], bool] = lambda topic, seconds: False
    deaf: bool = False
    weighs: bool = True
    moving: object = None

    def __post_init__(self) -> None:
        self.model = RobotModel.from_file(self.robot)
        options = ArmOptions(
            wrench_noise(self.sensor, bias=self.bias), JointNoise(125.0, position=1e-5, velocity=1e-3), seed=self.seed
        )
        self.arm = SimulatedArm(
            IdealRobot(self.model, self.payload), find_urdf(self.robot).read_text(), self.moving, options
        )
        self.live = LiveEstimator(LiveOptions(method="poise", noise=self.noise))
        self.scale = LivePayloadEstimator(self.live) if self.weighs else DeafScale()
        self.commands: list[TimedMotion] = []
        self.phases: list[tuple[float, SessionPhase]] = []
        self.stamps: list[int] = []
        self.positions: list[np.ndarray] = []

    def send(self, command: TimedMotion) -> None:
        self.commands.append(command)
        if not self.deaf:
            motion = command.motion
            self.arm.command(
                Waypoints(
                    self.model.joint_names,
                    motion.times,
                    motion.position,
                    motion.velocity,
                    motion.acceleration,
                    command.stamp,
                )
            )

    def run(self, plan, guard: Guard, limits: MotionLimits, duration: float = 3.0, events=(), longest: float = 90.0):
        """Play until the session is done; `events` are (seconds, call) with call(session, now). Return the session."""
        todo = sorted(events, key=lambda event: event[0])
        session: Session | None = None
        next_tick = 0.5
        for message in self.arm.messages():
            now = message.time * 1e-9
            while now >= next_tick:
                if session is None:
                    task = IdentificationTask(plan, guard, limits, duration)
                    session = Session(self.model, task, self.scale, self.send, next_tick)
                while todo and todo[0][0] <= next_tick:
                    todo.pop(0)[1](session, next_tick)
                self._tick(session, next_tick)
                if session.phase is SessionPhase.DONE:
                    return session
                next_tick += TICK
            if now > longest:
                raise AssertionError(f"not done after {longest} s: {session.phase}")
            if not self.lost(message.topic, now):
                self._hand_over(message, session, now)
        raise AssertionError("the arm ended")

    def _tick(self, session: Session, now: float) -> None:
        if self.weighs:
            self.live.update(now)
        session.tick(now)
        if session.phase is SessionPhase.PLANNING:
            for thread in threading.enumerate():
                if thread.name == "excitation":
                    thread.join()
        if not self.phases or self.phases[-1][1] is not session.phase:
            self.phases.append((now, session.phase))

    def _hand_over(self, message, session: Session | None, now: float) -> None:
        if message.topic == "wrench" and not self.weighs:
            self.scale.last = now
            return
        said = typestore().deserialize_cdr(message.data, TYPES[message.topic])
        if message.topic == "robot_description":
            if self.weighs:
                self.live.set_robot_description(said.data, now)
            return
        stamp = said.header.stamp.sec * 10**9 + said.header.stamp.nanosec
        if message.topic == "wrench":
            force, torque = said.wrench.force, said.wrench.torque
            wrench = (force.x, force.y, force.z, torque.x, torque.y, torque.z)
            self.live.add_wrench(stamp, said.header.frame_id, wrench, now)
            return
        if self.weighs:
            self.live.add_joint_state(stamp, said.name, said.position, said.velocity, now)
        self.stamps.append(stamp)
        self.positions.append(np.array(said.position))
        if session is not None:
            session.add_joint_state(stamp, said.name, said.position, now)

    def fastest(self, points: np.ndarray, smoothing: int = 5) -> float:
        """m/s of points (P, 3) in the sensor frame, as an onlooker sees it: chords over a few joint states."""
        rotation, where = frame_poses(self.model, np.array(self.positions))
        places = np.einsum("nij,pj->npi", rotation, points) + where[:, None]
        seconds = np.array(self.stamps) * 1e-9
        chords = np.linalg.norm(places[smoothing:] - places[:-smoothing], axis=2)
        return float((chords / (seconds[smoothing:] - seconds[:-smoothing])[:, None]).max())


def ready(plan: ExcitationPlan):
    """A planner that has its answer already, for any start."""
    return lambda start: lambda progress, cancelled: plan
