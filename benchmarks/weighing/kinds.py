"""The kinds of trouble, each with what makes it and the names by which the tool may call it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.foreign.events import MassLeak, MassStep
from benchmarks.foreign.fault import Fault
from benchmarks.foreign.loads import Cable
from benchmarks.foreign.sensors import BaseTilt, ClockOffset, JointOffset, LowPass
from benchmarks.foreign.world import Scene, Track
from benchmarks.weighing import readings
from benchmarks.weighing.effects import Driving, Grasped, Resting
from benchmarks.weighing.readings import Reading

Draw = Callable[[Scene, Track, np.random.Generator], Fault]
KGF, LBF = 9.80665, 4.4482216


@dataclass(frozen=True)
class Kind:
    """One kind of trouble.

    Args:
        name: of it. accept: findings that name it, by `ErrorCode`; none: no finding is expected.
        effect: what is simulated or belongs to clocks and encoders. reading: what becomes of the wrenches.
        arguments: of the command.
        share: of the payload's mass that is its point mass: drawn between these.
        lost: pieces of the recording are missing.
    """

    name: str
    accept: tuple[str, ...] = ()
    effect: Draw | None = None
    reading: Reading | None = None
    arguments: tuple[str, ...] = ()
    share: tuple[float, float] = (0.15, 0.35)
    lost: bool = False


def _sized(fault: type[Fault], low: float, high: float | None = None) -> Draw:
    """An effect of a size between two values, the rest of it by chance."""
    return lambda scene, track, rng: fault(
        float(low if high is None else rng.uniform(low, high)), fault.random(scene, track, rng)
    )


def _late(seconds: float) -> Draw:
    return lambda scene, track, rng: ClockOffset(seconds, {"sign": 1.0})


def _at_once(fault: type[MassStep], sign: float) -> Draw:
    """The point mass comes (1.0) or falls off (-1.0) in the middle third of the recording."""

    def draw(scene: Scene, track: Track, rng: np.random.Generator) -> Fault:
        time = float(track.seconds[-1] * rng.uniform(0.35, 0.65))
        return fault(scene.load.part, {"time": time, "sign": sign, "place": list(scene.load.place)})

    return draw


def _spill(scene: Scene, track: Track, rng: np.random.Generator) -> Fault:
    """The point mass runs out within one to two seconds."""
    start = float(track.seconds[-1] * rng.uniform(0.35, 0.6))
    truth = {"start": start, "end": start + float(rng.uniform(1.0, 2.0)), "place": list(scene.load.place)}
    return MassLeak(scene.load.part, truth)


def _hose(scene: Scene, track: Track, rng: np.random.Generator) -> Fault:
    """A hose that pulls the whole time, with a few newtons and more where it is stretched."""
    drawn = Cable.random(scene, track, rng) | {"damping": 2.0}
    path = track.place + track.turn @ np.array(drawn["place"])
    lengths = np.linalg.norm(path - np.array(drawn["anchor"]), axis=1)
    return Cable(float(rng.uniform(8, 25)), drawn | {"rest": float(lengths.min() - rng.uniform(0.05, 0.15))})


HEALTHY = Kind("healthy")
CONTACT, CHANGED = ("IN_CONTACT",), ("PAYLOAD_CHANGED",)
FRAME, HANDS = ("SENSOR_ROTATED",), ("LEFT_HANDED_AXES",)

KINDS: tuple[Kind, ...] = (
    Kind("contact_20", CONTACT, _sized(Resting, 0.2)),
    Kind("contact_50", CONTACT, _sized(Resting, 0.5)),
    Kind("contact_80", CONTACT, _sized(Resting, 0.8)),
    Kind("frame_5", FRAME, reading=readings.turned(5)),
    Kind("frame_35", FRAME, reading=readings.turned(35)),
    Kind("frame_90", FRAME, reading=readings.turned(90)),
    Kind("base_axes", ("WRONG_FRAME",), reading=readings.in_base_axes),
    Kind("mirror_z", HANDS, reading=readings.scaled(1, 1, -1, 1, 1, -1)),
    Kind("mirror_y", HANDS, reading=readings.scaled(1, -1, 1, 1, -1, 1)),
    Kind("swapped_xy", HANDS, reading=readings.swapped),
    Kind("sign_force", ("FORCE_SIGN", "NOT_CONSISTENT"), reading=readings.scaled(-1, 1)),
    Kind("sign_torque", ("TORQUE_SIGN",), reading=readings.scaled(1, -1)),
    Kind("sign_both", ("FORCE_SIGN", "NOT_CONSISTENT"), reading=readings.scaled(-1, -1)),
    Kind("force_kgf", ("FORCE_UNIT",), reading=readings.scaled(1 / KGF, 1)),
    Kind("force_lbf", ("FORCE_UNIT",), reading=readings.scaled(1 / LBF, 1)),
    Kind("torque_nmm", ("TORQUE_UNIT",), reading=readings.scaled(1, 1000)),
    Kind("torque_ncm", ("TORQUE_UNIT",), reading=readings.scaled(1, 100)),
    Kind("clipped", ("CLIPPED",), reading=readings.clipped),
    Kind("compensated_fully", ("COMPENSATED",), reading=readings.compensated(1, 1)),
    Kind("compensated_partly", ("COMPENSATED",), reading=readings.compensated(0.3, 0.7)),
    Kind("compensated_too_much", ("COMPENSATED", "NOT_CONSISTENT"), reading=readings.compensated(1.3, 1.7)),
    Kind("grasped", CHANGED, _at_once(Grasped, 1.0), share=(0.6, 0.8)),
    Kind("released", CHANGED, _at_once(MassStep, -1.0), share=(0.6, 0.8)),
    Kind("spilled", CHANGED, _spill, share=(0.25, 0.45)),
    Kind("base_drives", ("BASE_MOVED",), _sized(Driving, 0.8)),
    Kind("base_on_slope", ("GRAVITY_WRONG",), _sized(BaseTilt, np.radians(4), np.radians(8))),
    Kind("drift_linear", ("SENSOR_DRIFT",), reading=readings.drifting(False)),
    Kind("drift_thermal", ("SENSOR_DRIFT",), reading=readings.drifting(True)),
    Kind("late_20", (), _late(0.02)),
    Kind("late_150", ("CLOCK_LATE",), _late(0.15)),
    Kind("late_500", ("CLOCK_LATE",), _late(0.5)),
    Kind("filter_100", ("FILTERED",), _sized(LowPass, 0.1)),
    Kind("filter_500", ("FILTERED",), _sized(LowPass, 0.5)),
    Kind("tared_1", ("ZEROED_UNDER_LOAD",), reading=readings.tared(1)),
    Kind("tared_100", ("ZEROED_UNDER_LOAD",), reading=readings.tared(100)),
    Kind("gravity_9", ("GRAVITY_WRONG",), arguments=("--gravity", "9.0")),
    Kind("joint_offset", ("POOR_FIT", "GRAVITY_WRONG", "SENSOR_ROTATED"), _sized(JointOffset, np.radians(5))),
    Kind("hose", ("IN_CONTACT", "POOR_FIT"), _hose),
    Kind("stuck_channel", ("POOR_FIT", "SENSOR_STALE", "SENSOR_FAULT", "CLIPPED"), reading=readings.stuck),
    Kind("spikes", (), reading=readings.spiked),
    Kind("gaps", (), lost=True),
)
BY_NAME = {kind.name: kind for kind in (*KINDS, HEALTHY)}
