"""Published estimates of a running robot held against the truth at every moment: `python -m benchmarks.weighing.live`.

Each run grasps an object, rests against something with it, and releases it. Messages are fed one by one in the order
of their stamps, as the node inertial_estimator gets them; it publishes at 10 Hz.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.progress import track

from benchmarks.foreign.bag import Streams
from benchmarks.foreign.events import MassChange
from benchmarks.foreign.recorder import Recorder
from benchmarks.foreign.robots import ROBOTS
from benchmarks.foreign.world import World
from benchmarks.weighing.case import draw_honest, draw_profile, draw_scene
from benchmarks.weighing.effects import Resting
from benchmarks.weighing.objects import OBJECTS, draw_object
from poise.errors import PoiseError
from poise.inertia.pipeline import LiveEstimator, LiveOptions

SEEDS = {"dev": 72104, "final": 287640913}
SIGMAS = 3.0
PERIOD = 0.1
"""s between published estimates."""
GRACE = 0.6
"""s after a change in which the payload before it is accepted too: the estimator needs up to half a second."""
START = 1_700_000_000.0


class Held(MassChange):
    """The point mass is in the hand between two times; size: kg."""

    @property
    def freed(self) -> float:
        return self.size

    def push(self, world: World) -> None:
        begin, end = self.truth["span"]
        self.put(world, self.size if begin <= world.time < end else 0.0)


class Leaking(Held):
    """The point mass runs out evenly between two times instead of being released."""

    def push(self, world: World) -> None:
        begin, (first, last) = self.truth["span"][0], self.truth["leak"]
        left = np.clip((last - world.time) / (last - first), 0.0, 1.0)
        self.put(world, self.size * float(left) if world.time >= begin else 0.0)


class Pressing(Resting):
    """The load rests against something between two times."""

    def spans(self, length: float) -> tuple[float, float]:
        begin, end = self.truth["span"]
        return float(begin), float(end)


@dataclass(frozen=True)
class Run:
    """What was published in a run.

    Args:
        number, item, robot: of it. published: estimates with a number. refused: without one.
        beyond: over three sigma from the mass in the hand. silent: of these, without a finding.
        early, contact, later: `beyond` in the first 3 s of a payload, while it rests against something, and afterwards.
        worst: the largest z. changes: reported. false: of these, without a change in the last 1.5 s. missed: changes.
        cpu: s.
    """

    number: int
    item: str
    robot: str
    published: int
    refused: int
    beyond: int
    silent: int
    early: int
    contact: int
    later: int
    worst: float
    changes: int
    false: int
    missed: int
    cpu: float


@dataclass(frozen=True)
class Story:
    """A recording with its truth: stamps are s since its begin."""

    streams: Streams
    start: int
    item: str
    robot: str
    grasp: float
    release: float
    contact: tuple[float, float]
    masses: tuple[float, float]
    emptied: float

    def mass(self, second: float) -> float:
        """Kg, what the sensor carries at a moment."""
        empty, full = self.masses
        if not self.grasp <= second < self.emptied:
            return empty
        if second < self.release:
            return full
        return empty + (full - empty) * (self.emptied - second) / (self.emptied - self.release)

    def error(self, mass: float, second: float) -> float:
        """Kg from a stated mass to those of this moment and of the time of grace before it."""
        true = [self.mass(second), self.mass(second - GRACE)]
        leaks = self.release < second and second - GRACE < self.emptied and self.emptied > self.release
        if leaks and min(true) <= mass <= max(true):
            return 0.0
        return min(abs(mass - each) for each in true)


def draw_story(seed: tuple[int, int], seconds: float, leaks: bool = False) -> Story:
    """Draw and simulate a run; `leaks`: the object loses its load over 1 to 6 s instead of being released."""
    rng = np.random.default_rng(seed)
    item, way = str(rng.choice(list(OBJECTS))), str(rng.choice(["ordinary", "stop_and_go"]))
    profile, load = draw_profile(rng), draw_object(item, float(rng.uniform(0.5, 0.8)), rng)
    honest = draw_honest(len(ROBOTS[profile.robot].joints), rng)
    scene = draw_scene(profile, way, load, honest, seconds, rng)
    free = World(scene).run()
    grasp, first = seconds * float(rng.uniform(0.2, 0.3)), seconds * float(rng.uniform(0.45, 0.5))
    contact = (first, first + seconds * float(rng.uniform(0.08, 0.2)))
    release = seconds * float(rng.uniform(0.78, 0.85))
    emptied = release
    if leaks:
        release, emptied = 0.7 * seconds, 0.7 * seconds + float(rng.uniform(1.0, 6.0))
    kind, truth = (Leaking, {"leak": (release, emptied)}) if leaks else (Held, {})
    held = kind(load.part, {"span": (grasp, release), "place": list(load.place), **truth})
    pressing = Pressing(0.1, Resting.random(scene, free, rng) | {"span": contact, "where": "middle"})
    faults = [held, pressing]
    recorder = Recorder(profile, scene, honest, faults, rng)
    streams = recorder.record(World(scene, faults).run())
    masses = (load.without(load.part).mass, load.whole.mass)
    return Story(streams, recorder.start, item, profile.robot, grasp, release, contact, masses, emptied)


def fed(story: Story, live: LiveEstimator) -> Iterator[float]:
    """Feed all messages; yields the time, s since the begin, each time that the node would publish."""
    joints, wrench = story.streams.joints, story.streams.wrench
    if wrench is None:
        raise ValueError("the run has no wrench")
    live.set_robot_description(story.streams.robot_description, START)
    order = np.argsort(np.concatenate([joints.stamps, wrench.stamps]), kind="stable")
    due = PERIOD
    for index in order.tolist():
        at_joint = index < len(joints.stamps)
        row = index if at_joint else index - len(joints.stamps)
        stamp = int((joints.stamps if at_joint else wrench.stamps)[row])
        second = (stamp - story.start) * 1e-9
        while second > due:
            live.update(START + due)
            yield due
            due += PERIOD
        if at_joint:
            velocity = joints.velocity[row] if joints.velocity.shape[1] else []
            live.add_joint_state(stamp, list(story.streams.names), joints.position[row], velocity, START + second)
        else:
            live.add_wrench(stamp, story.streams.frame, wrench.values[row], START + second)


def follow(number: int, story: Story) -> Run:
    """Feed a run and judge each published estimate."""
    live = LiveEstimator(LiveOptions(continuous=True))
    counts = dict.fromkeys(("published", "refused", "beyond", "silent", "early", "contact", "later"), 0)
    worst, began, seen = 0.0, time.process_time(), 0
    for _ in fed(story, live):
        if live.n_samples == seen:
            continue
        seen = live.n_samples
        try:
            estimate = live.estimate()
        except PoiseError:
            counts["refused"] += 1
            continue
        if estimate.fit.is_hopeless:  # the node publishes an error instead
            counts["refused"] += 1
            continue
        second = (estimate.stamp - story.start) * 1e-9
        z = story.error(estimate.parameters.mass, second) / estimate.mass_std
        counts["published"] += 1
        worst = max(worst, float(z))
        if z > SIGMAS:
            counts["beyond"] += 1
            counts["silent"] += not estimate.findings
            counts[_phase(story, second)] += 1
    moments = [(change.stamp - story.start) * 1e-9 for change in live.changes]
    true = ((story.grasp, story.grasp), (story.release, story.emptied))
    return Run(
        number=number,
        item=story.item,
        robot=story.robot,
        **counts,
        worst=round(worst, 1),
        changes=len(moments),
        false=sum(not any(_belongs(moment, *at) for at in true) for moment in moments),
        missed=sum(not any(_belongs(moment, *at) for moment in moments) for at in true),
        cpu=round(time.process_time() - began, 2),
    )


def _belongs(reported: float, begin: float, end: float) -> bool:
    """A change that is reported at this second is the one that happened then."""
    return begin - 0.3 < reported < end + 1.5


def _phase(story: Story, second: float) -> str:
    begin, end = story.contact
    if begin <= second < end + GRACE:
        return "contact"
    begins = [at for at in (0.0, story.grasp, story.release) if at <= second]
    return "early" if second - begins[-1] < 3.0 else "later"


def report(runs: list[Run]) -> str:
    """The table as Markdown."""
    total = {name: sum(getattr(run, name) for run in runs) for name in ("published", "beyond", "silent", "false")}
    published = max(total["published"], 1)
    lines = ["| what | number |", "| --- | --- |", f"| runs | {len(runs)} |"]
    lines.append(f"| published estimates | {total['published']} |")
    for name in ("beyond", "silent"):
        text = "beyond 3 sigma" if name == "beyond" else "of these without a finding"
        lines.append(f"| {text} | {total[name]} ({100 * total[name] / published:.1f} %) |")
    for name, text in (
        ("early", "in the first 3 s of a payload"),
        ("contact", "while it rests against something"),
        ("later", "at other times"),
    ):
        lines.append(f"| beyond 3 sigma {text} | {sum(getattr(run, name) for run in runs)} |")
    lines.append(f"| false payload changes | {total['false']} |")
    lines.append(f"| missed payload changes, of {2 * len(runs)} | {sum(run.missed for run in runs)} |")
    lines.append(f"| largest error, in sigma | {max(run.worst for run in runs):.1f} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed-set", choices=sorted(SEEDS), default="dev")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--leak", action="store_true", help="the load runs out instead of being released")
    parser.add_argument("--out", type=Path, help="JSON of each run")
    arguments = parser.parse_args()
    runs = []
    seeds = SEEDS[arguments.seed_set]
    for number in track(range(arguments.runs), description="runs"):
        runs.append(follow(number, draw_story((seeds, number), arguments.seconds, arguments.leak)))
    print(report(runs))
    for run in runs:
        print(run)
    if arguments.out is not None:
        arguments.out.write_text(json.dumps([asdict(run) for run in runs], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
