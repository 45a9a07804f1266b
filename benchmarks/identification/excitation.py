"""What a planned motion is worth: errors of `poise` after it, beside the thesis' motion, random series and stop-and-go.

All motions start from one configuration of an FR3 and keep to the same limits, which the same certificate proves: joint
limits, 10 rad/s2, and 0.25 m/s of the tool's every point. Each moves a workshop tool of the thesis; wrench and
accelerations get its moderate noise, and the sensor an unknown bias.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.identification.motions import AMPLITUDE, FREQUENCIES
from benchmarks.identification.objects import BenchmarkObject, load_tools
from poise.excitation import ExcitationOptions, Guard, Information, MotionLimits, certify, plan_excitation, slowed
from poise.excitation import plan_stop_and_go as plan_rests
from poise.excitation.hand import hand_motion
from poise.excitation.plan import believe
from poise.inertia.bayes.estimator import poise
from poise.inertia.model.metrics import errors, predict_wrench
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.parts import Parts
from poise.inertia.model.problem import IdentificationProblem, NoiseLevels
from poise.inertia.model.signals import motion_signals
from poise.robot import RobotModel, sensor_motion
from poise.simulation import FourierTrajectory, JointMotion, WaypointTrajectory

START = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
RATE, DURATION = 100.0, 1.5  # Hz, s
NOISE = NoiseLevels(
    force_bias=0.5, torque_bias=0.02
)  # thesis table 3.2, moderate; bias as in benchmarks/identification
SEEDS = range(9_100, 9_104)  # nothing was tuned on these
LIMITS = MotionLimits(room=1.0)  # the thesis' motion goes far


@dataclass(frozen=True)
class Record:
    """One motion, one tool, one seed: e_m, e_c, e_I in %, and what the motion is."""

    motion: str
    shape: str
    tool: str
    seed: int
    mass: float
    com: float
    inertia: float
    nats: float
    seconds: float
    mean_turning: float
    planning: float


@dataclass(frozen=True)
class Held:
    """A tool, what has to stay slow, and its parts when its shape is known."""

    tool: BenchmarkObject
    guard: Guard
    parts: Parts | None

    @classmethod
    def of(cls, tool: BenchmarkObject, shape: str) -> "Held":
        """With its shape `known`, or `unknown` but for how far it reaches."""
        if shape == "unknown":
            return cls(tool, Guard.ball(np.zeros(3), float(np.linalg.norm(tool.hull, axis=1).max())), None)
        return cls(tool, Guard.outline(np.zeros(3), tool.hull), Parts(tool.unit_parts, tool.part_volumes, tool.hull))


Make = Callable[[RobotModel, Held, int], WaypointTrajectory]


def planned(model: RobotModel, held: Held, seed: int) -> WaypointTrajectory:
    """The optimal motion."""
    options = ExcitationOptions(duration=DURATION, noise=NOISE, seed=seed)
    return plan_excitation(model, START, held.guard, LIMITS, options, parts=held.parts).motion


def rests(model: RobotModel, held: Held, seed: int) -> WaypointTrajectory:
    """Stop-and-go."""
    return plan_rests(model, START, held.guard, LIMITS, ExcitationOptions(noise=NOISE), parts=held.parts).motion


def thesis(model: RobotModel, held: Held, seed: int) -> WaypointTrajectory:
    """Thesis eq. 3.14: the last three joints swing by 45 degrees; as fast as the limits allow, 1.5 s of it."""
    phase = 2 * np.pi * FREQUENCIES * np.random.default_rng(seed).uniform(0.0, 35.0)

    def at(seconds: np.ndarray) -> JointMotion:
        rate, argument = 2 * np.pi * FREQUENCIES, 2 * np.pi * FREQUENCIES * seconds[:, None] + phase
        rows = np.zeros((3, len(seconds), 7))
        rows[0] = START
        rows[0, :, 4:] += AMPLITUDE * np.sin(argument)
        rows[1, :, 4:] = AMPLITUDE * rate * np.cos(argument)
        rows[2, :, 4:] = -AMPLITUDE * rate**2 * np.sin(argument)
        return JointMotion(*rows)

    return as_fast_as_allowed(model, at, held.guard)


def random(model: RobotModel, held: Held, seed: int) -> WaypointTrajectory:
    """A random Fourier series of all joints, as large as the limits allow."""
    rng = np.random.default_rng(seed)
    series = FourierTrajectory.random(model, rng, duration=DURATION, speed=0.9, frequency=1 / DURATION, centre=START)
    knots = np.linspace(0.0, DURATION, 61)
    rows = series.at(knots)
    low, high = 0.0, 1.0
    for _ in range(10):
        scale = (low + high) / 2
        moved = START + scale * (rows.position - START)
        motion = WaypointTrajectory(knots, moved, scale * rows.velocity, scale * rows.acceleration)
        if certify(model, motion, held.guard).holds(LIMITS):
            low, kept = scale, motion
        else:
            high = scale
    return kept


MOTIONS: dict[str, Make] = {"planned": planned, "thesis 3.14": thesis, "random series": random, "stop-and-go": rests}


def as_fast_as_allowed(model: RobotModel, at: Callable[[np.ndarray], JointMotion], guard: Guard) -> WaypointTrajectory:
    """The first 1.5 s of a motion that goes on for ever, played so fast that it just keeps the limits."""
    low, high = 0.01, 30.0
    for _ in range(12):
        pace = np.sqrt(low * high)
        knots = np.linspace(0.0, DURATION * pace, 61)
        motion = slowed(WaypointTrajectory(knots, *at(knots)), 1 / pace)
        if certify(model, motion, guard).slow_down(LIMITS) <= 1.0:
            low, kept = pace, motion
        else:
            high = pace
    return kept


def trials(tools: tuple[BenchmarkObject, ...], seeds: range) -> Iterator[Record]:
    """Every motion with every tool and seed, with its shape known and unknown."""
    model = RobotModel.from_file("fr3")
    for seed in seeds:
        for tool in tools:
            for shape in ("unknown", "known"):
                held = Held.of(tool, shape)
                for name, make in MOTIONS.items():
                    begun = time.process_time()
                    motion = make(model, held, seed)
                    planning = time.process_time() - begun
                    yield weighed(model, motion, name, held, seed, planning)


def weighed(model: RobotModel, motion: WaypointTrajectory, name: str, held: Held, seed: int, planning: float) -> Record:
    """What `poise` makes of one motion."""
    tool, parts = held.tool, held.parts
    rng = np.random.default_rng([seed, *tool.name.encode(), *name.encode()])
    seconds = np.arange(0.0, motion.duration, 1 / RATE)
    moved = sensor_motion(model, np.round(seconds * 1e9).astype(np.int64), *motion.at(seconds))
    n = len(moved)
    bias = rng.normal(0.0, np.repeat([NOISE.force_bias, NOISE.torque_bias], 3))
    noise = rng.normal(size=(2, n, 3))
    known = {} if parts is None else {"unit_parts": tool.unit_parts, "part_volumes": tool.part_volumes}
    problem = IdentificationProblem(
        stamps=moved.stamps,
        gravity_in_sensor=moved.gravity_in_sensor(),
        linear_acceleration=moved.linear_acceleration_in_sensor + noise[0] * NOISE.linear_acceleration,
        angular_velocity=moved.angular_velocity_in_sensor,
        angular_acceleration=moved.angular_acceleration_in_sensor
        + rng.normal(size=(n, 3)) * NOISE.angular_acceleration,
        wrench=predict_wrench(tool.truth, moved) + bias + rng.normal(size=(n, 6)) * NOISE.wrench,
        noise=NOISE,
        **known,
    )
    found = errors(InertialParameters.from_phi(poise(problem).phi), tool.truth, tool.bounding_box)
    hand = hand_motion(model, *motion.at(seconds))
    information = Information(believe(held.guard, parts, tool.truth.mass), NOISE, RATE)
    nats = information.value(motion_signals(hand.specific, hand.omega, hand.alpha), 1 / RATE)
    turning = float(np.linalg.norm(hand.omega, axis=1).mean())
    shape = "unknown" if parts is None else "known"
    return Record(
        name, shape, tool.name, seed, found.mass, found.com, found.inertia, nats, motion.duration, turning, planning
    )


def table(records: list[Record]) -> Table:
    """Means over tools and seeds; e_I with the median and the worst tool's mean."""
    made = Table(title=f"under {LIMITS.speed} m/s, {len({r.tool for r in records})} tools", title_justify="left")
    heads = ("shape", "motion", "e_m %", "e_c %", "e_I %", "median", "worst tool", "nats", "s", "rad/s", "planning s")
    for head in heads:
        made.add_column(head, justify="left" if head in heads[:2] else "right")
    for shape in ("unknown", "known"):
        made.add_section()
        for name in MOTIONS:
            group = [r for r in records if (r.motion, r.shape) == (name, shape)]
            by_tool = [np.mean([r.inertia for r in group if r.tool == tool]) for tool in {r.tool for r in group}]
            fields = ("mass", "com", "inertia")
            means = [f"{np.mean([getattr(r, field) for r in group]):.2f}" for field in fields]
            made.add_row(
                shape,
                name,
                *means,
                f"{np.median([r.inertia for r in group]):.2f}",
                f"{max(by_tool):.1f}",
                f"{np.mean([r.nats for r in group]):.0f}",
                f"{np.mean([r.seconds for r in group]):.1f}",
                f"{np.mean([r.mean_turning for r in group]):.2f}",
                f"{np.median([r.planning for r in group]):.2f}",
            )
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="four tools, one seed")
    parser.add_argument("--json", type=Path, help="write every trial")
    options = parser.parse_args()
    tools = load_tools()
    records = list(trials(tools[::4] if options.quick else tools, SEEDS[:1] if options.quick else SEEDS))
    Console(width=120).print(table(records))
    if options.json:
        options.json.write_text(json.dumps([vars(record) for record in records]))


if __name__ == "__main__":
    main()
