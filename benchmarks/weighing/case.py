"""One case: an object on a robot in motion, what is wrong, the recording, and the truth."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.foreign import bag
from benchmarks.foreign.events import MassLeak, MassStep
from benchmarks.foreign.fault import Fault, direction
from benchmarks.foreign.honest import Honest
from benchmarks.foreign.load import Body, Load
from benchmarks.foreign.motions import MOTIONS
from benchmarks.foreign.profiles import Profile
from benchmarks.foreign.recorder import Recorder, sensed
from benchmarks.foreign.robots import ROBOTS, Array
from benchmarks.foreign.sensors import LEVER
from benchmarks.foreign.world import GRAVITY, Scene, Track, World
from benchmarks.weighing.effects import Grasped, Resting, turning
from benchmarks.weighing.kinds import BY_NAME, Kind
from benchmarks.weighing.objects import draw_object
from benchmarks.weighing.readings import Moments
from benchmarks.weighing.still_air import fly
from benchmarks.weighing.visible import visibility

SECONDS = (13.0, 19.0)
GENTLE = 0.35
"""Of the usual speed."""
WAYS = {
    "ordinary": ("trapezoidal", "multi_sine", "jogging"),
    "stop_and_go": ("pick_and_place",),
    "gentle": ("trapezoidal", "multi_sine"),
}
"""Kinds of motion, and the courses that belong to each."""
RIGS = ("ur10", "fr3", "xarm7")


@dataclass(frozen=True)
class Plan:
    """One case.

    Args:
        seed: of every chance in it. kind, item, way: names in KINDS, OBJECTS and WAYS.
        generator: `robot` (MuJoCo and joint states) or `tf` (closed form and poses).
    """

    seed: tuple[int, ...]
    kind: str
    item: str
    way: str
    generator: str = "robot"


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, arguments of the command, and the truth."""

    messages: list[bag.Entry]
    arguments: tuple[str, ...]
    label: dict[str, Any]

    def write(self, folder: Path) -> None:
        """recording.mcap, and the arguments that belong to it."""
        folder.mkdir(parents=True)
        bag.save(self.messages, folder / "recording.mcap")
        (folder / "arguments.txt").write_text("\n".join(self.arguments), encoding="utf-8")


def make_case(plan: Plan, seconds: float | None = None) -> Case:
    """Draw, simulate and record a case.

    Args:
        plan: what it is. seconds: length of the recording; None: drawn.
    """
    rng = np.random.default_rng(plan.seed)
    kind = BY_NAME[plan.kind]
    length = float(rng.uniform(*SECONDS)) if seconds is None else seconds
    load = draw_object(plan.item, float(rng.uniform(*kind.share)), rng)
    if plan.generator == "tf":
        flight = fly(load.whole, length, plan.way, rng)
        wrench = _read(kind, flight.moments(load.whole, rng), flight.wrench)
        return Case(flight.messages(wrench), kind.arguments, _label(plan, load, length, flight.start, ()))
    profile = draw_profile(rng)
    honest = draw_honest(len(ROBOTS[profile.robot].joints), rng)
    scene = draw_scene(profile, plan.way, load, honest, length, rng)
    track = World(scene).run()
    faults = [] if kind.effect is None else [kind.effect(scene, track, rng)]
    if any(fault.simulated for fault in faults):
        track = World(scene, faults).run()
    recorder = Recorder(profile, scene, honest, faults, rng)
    streams = recorder.record(track)
    if streams.wrench is None:
        raise RuntimeError("a profile of this benchmark has no wrench")
    at = np.asarray((streams.wrench.stamps - recorder.start) * 1e-9 - honest.late, dtype=np.float64)
    before = copy.deepcopy(rng)
    values = _read(kind, Moments(at, turning(track, at), load.whole, rng), streams.wrench.values)
    streams = replace(streams, wrench=bag.Wrenches(streams.wrench.stamps, values))
    seen = _visible(kind, track, load.whole, recorder, before)
    label = _label(plan, load, length, recorder.start, faults) | {"robot": profile.robot, "visible": seen}
    return Case(bag.messages(_with_gaps(streams, rng) if kind.lost else streams), kind.arguments, label)


def _read(kind: Kind, when: Moments, wrench: Array) -> Array:
    return wrench if kind.reading is None else kind.reading(when, wrench)


def _visible(kind: Kind, track: Track, load: Body, recorder: Recorder, rng: np.random.Generator) -> float | None:
    """Sigmas by which an ideal test would see the trouble; None where encoders are wrong or samples are missing.

    Args:
        rng: as it was when the trouble was drawn.
    """
    if kind.lost or kind.name in ("joint_offset", "spikes", "healthy"):
        return None
    honest = replace(recorder.honest, rotation=np.zeros(3), late=0.0)
    clean = sensed(track, honest, recorder.faults)
    when = Moments(track.seconds, track.turn, load, rng)
    level = recorder.profile.force * np.repeat([1.0, LEVER], 3)
    jolt = level * np.random.default_rng(0).normal(size=clean.shape)
    wrench = _read(kind, replace(when, rng=copy.deepcopy(rng)), clean)
    noise = (_read(kind, replace(when, rng=copy.deepcopy(rng)), clean + jolt) - wrench).std(axis=0)
    gravity = float(kind.arguments[1]) if kind.arguments else GRAVITY
    noise = np.maximum(noise, 0.1 * level)
    return visibility(track.place, track.turn, wrench, noise, recorder.profile.wrench_rate, gravity)


def draw_profile(rng: np.random.Generator) -> Profile:
    """A rig: robot, rates, noise and clocks."""
    return Profile(
        "weighing",
        robot=str(rng.choice(RIGS)),
        wrench_rate=float(rng.choice([100.0, 125.0, 250.0])),
        joint_rate=float(rng.choice([100.0, 125.0, 200.0])),
        noise=str(rng.choice(["white", "heavy_tailed", "quantised", "first_order"])),
        force=float(np.exp(rng.uniform(np.log(0.02), np.log(0.15)))),
        velocity=str(rng.choice(["measured", "absent"])),
        clock=str(rng.choice(["steady", "jitter", "late"])),
        skew=float(rng.uniform(-20, 20)),
        lost=float(rng.choice([0.0, 0.0, 0.01])),
    )


def draw_honest(joints: int, rng: np.random.Generator) -> Honest:
    """Errors of a machine that is in order: an offset of the sensor, zeros of the encoders, a clock some ms off."""
    zeroed = bool(rng.random() < 0.5)
    bias = rng.normal(size=6) * [0.2, 0.2, 0.2, 0.01, 0.01, 0.01] if zeroed else _offset(rng)
    return Honest(
        mass=0.0,
        com=np.zeros(3),
        inertia=0.0,
        gain=np.zeros((6, 6)),
        rotation=2e-4 * direction(rng),
        bias=bias,
        drift=np.zeros(6),
        zeros=1e-4 * rng.normal(size=joints),
        tilt=1e-4 * direction(rng, 2),
        links={},
        late=float(rng.uniform(-0.003, 0.003)),
    )


def _offset(rng: np.random.Generator) -> Array:
    return np.asarray(rng.uniform(-8, 8, 6) * np.repeat([1.0, 0.04], 3))


def draw_scene(
    profile: Profile, way: str, load: Load, honest: Honest, length: float, rng: np.random.Generator
) -> Scene:
    """The robot with its load and its motion."""
    robot = ROBOTS[profile.robot]
    pace = GENTLE if way == "gentle" else 1.0
    slowed = replace(robot, speed=tuple(pace * speed for speed in robot.speed))
    course = MOTIONS[str(rng.choice(WAYS[way]))](slowed, length, rng)
    return Scene(robot, load, course, tilt=honest.gravity(), stiffness=float(rng.uniform(25, 50)))


def _with_gaps(streams: bag.Streams, rng: np.random.Generator) -> bag.Streams:
    """Without four pieces of 0.3 to 1.2 s of the wrench and two of the joints."""
    for name, count in (("wrench", 4), ("joints", 2)):
        stream = getattr(streams, name)
        kept = np.ones(len(stream.stamps), dtype=bool)
        for _ in range(count):
            first = float(rng.uniform(stream.stamps[0], stream.stamps[-1]))
            kept &= (stream.stamps < first) | (stream.stamps > first + 1e9 * rng.uniform(0.3, 1.2))
        streams = replace(streams, **{name: type(stream)(*(values[kept] for values in vars(stream).values()))})
    return streams


def _label(plan: Plan, load: Load, length: float, start: int, faults: Sequence[Fault]) -> dict[str, Any]:
    """The truth: the payload at the end, and of each part of the recording."""
    parts = payloads(load, length, faults)
    last = parts[-1][2]
    spans = [fault.spans(length) for fault in faults if isinstance(fault, Resting)]
    return {
        "kind": plan.kind,
        "item": plan.item,
        "way": plan.way,
        "generator": plan.generator,
        "seconds": length,
        "start": start,
        **last.document(),
        "segments": [{"start": a, "end": b, "mass": body.mass} for a, b, body in parts],
        "contact": spans,
        "laws": [fault.truth["law"] for fault in faults if isinstance(fault, Resting)],
    }


def payloads(load: Load, length: float, faults: Sequence[Fault]) -> list[tuple[float, float, Body]]:
    """Begin and end, s, and what the sensor carries in between."""
    rest = load.without(load.part)
    for fault in faults:
        if isinstance(fault, Grasped):
            time = fault.truth["time"]
            return [(0.0, time, rest), (time, length, load.whole)]
        if isinstance(fault, MassStep):
            time = fault.truth["time"]
            return [(0.0, time, load.whole), (time, length, rest)]
        if isinstance(fault, MassLeak):
            return [(0.0, fault.truth["start"], load.whole), (fault.truth["end"], length, rest)]
    return [(0.0, length, load.whole)]
