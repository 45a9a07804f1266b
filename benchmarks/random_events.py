"""Diagnoses of events on random arms (see `benchmarks.random_arms`), with courses that no effect of the tool follows.

python -m benchmarks.random_events [--first SEED] [--count N]; seeds from 7000 to 7999 are for development.

In turn: a person's hand pushes the tool, with or against its motion; a part is picked up and put down again; a tank
begins to lose its content and is empty before the recording ends; the zero of the sensor drifts as it warms up.
"""

import argparse
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.foreign.fault import direction
from benchmarks.foreign.honest import Honest
from benchmarks.foreign.load import Body
from benchmarks.foreign.robots import Array
from benchmarks.foreign.run import answer
from benchmarks.foreign.world import Track, rigid
from benchmarks.random_arms import Recording, SwingingZero, inner, random_recording

EVENTS = {"hand": "contact", "part": "mass_step", "tank": "mass_leak", "zero": "bias_drift"}
"""Events, and the effect that describes each."""
_LIMIT = 300
"""s of CPU for one answer."""
console = Console(width=120)


@dataclass(frozen=True, eq=False)
class WarmingZero(SwingingZero):
    """A sensor whose zero drifts beyond its tolerance while it warms up.

    Args:
        warming: (6,) N and N m. slowness: s.
    """

    warming: Array | None = None
    slowness: float = 1.0

    def sense(self, seconds: Array, wrench: Array) -> Array:
        course = 1.0 - np.exp(-seconds / self.slowness)
        return np.asarray(super().sense(seconds, wrench) + np.outer(course, self.warming))


def point_response(arm: Recording, mass: float, place: Array, field: Array) -> Array:
    """(n, 6 + J) wrench and effort that a point mass in the load adds, under gravity and a field (3,) m/s2."""

    def loaded(added: float) -> Array:
        load = arm.true.load
        heavier = replace(load, main=load.main.joined(Body(added, place, np.zeros((3, 3)))))
        scene = replace(arm.true, load=heavier, tilt=arm.true.tilt + field)
        motion = scene.arm
        return np.hstack(rigid(scene, motion[0], np.zeros((len(motion[0]), 3)), inner(motion)))

    return loaded(mass) - loaded(0.0)


def happened(event: str, arm: Recording, rng: np.random.Generator) -> tuple[Track, Honest]:
    """The track and the sensor of a recording in which an event happens."""
    made, load = arm.track, arm.true.load
    whole, still = made.seconds[-1], np.zeros(3)
    place = load.place + rng.uniform(-0.04, 0.04, 3)
    if event == "zero":
        warming = np.repeat([rng.uniform(0.4, 1.0), rng.uniform(0.03, 0.07)], 3) * rng.normal(size=6)
        slowness = float(whole * rng.uniform(0.1, 0.5))
        return made, WarmingZero(**vars(arm.honest), warming=warming, slowness=slowness)
    if event == "hand":
        start, length = float(whole * rng.uniform(0.2, 0.8)), float(rng.uniform(0.5, 1.5))
        force = rng.uniform(2.0, 6.0) * direction(rng)
        course = np.sin(np.pi * np.clip((made.seconds - start) / length, 0.0, 1.0)) ** 2
        added = point_response(arm, 1.0, load.tip, force) - point_response(arm, 1.0, load.tip, still)
    elif event == "part":
        start, end = float(whole * rng.uniform(0.15, 0.4)), float(whole * rng.uniform(0.6, 0.85))
        course = ((made.seconds >= start) & (made.seconds < end)).astype(np.float64)
        added = point_response(arm, float(rng.uniform(0.1, 0.4)), place, still)
    else:
        start, end = float(whole * rng.uniform(0.1, 0.3)), float(whole * rng.uniform(0.6, 0.85))
        course = -np.clip((made.seconds - start) / (end - start), 0.0, 1.0)
        added = point_response(arm, float(rng.uniform(0.5, 0.9)) * load.part, load.place, still)
    both = course[:, None] * added
    return replace(made, wrench=made.wrench + both[:, :6], effort=made.effort + both[:, 6:]), arm.honest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=7000, help="seed of the first arm")
    parser.add_argument("--count", type=int, default=20, help="number of arms")
    arguments = parser.parse_args()
    named: Counter[str] = Counter()
    tried: Counter[str] = Counter()
    false: Counter[str] = Counter()
    errors: dict[str, list[float]] = {event: [] for event in EVENTS}
    for seed in track(range(arguments.first, arguments.first + arguments.count), description="arms"):
        event = list(EVENTS)[seed % len(EVENTS)]
        with tempfile.TemporaryDirectory() as folder:
            given = answer(recorded(event, seed, Path(folder)), _LIMIT)
        tried[event] += 1
        if given["answer"] is None:
            console.print(f"{seed} {event}: {given['message']}")
            continue
        effects = given["answer"]["effects"]
        names = [effect["name"] for effect in effects]
        named[event] += EVENTS[event] in names
        false[event] += bool(set(names) - {EVENTS[event]})
        errors[event].append(float(given["answer"]["fit"]["holdout"]["augmented"]))
        said = [f"{effect['name']} {100 * effect['probability']:.0f} %" for effect in effects]
        console.print(f"{seed} {event}: {given['answer']['verdict']} {', '.join(said)} ({errors[event][-1]:.2f})")
    table = Table("event", "named", "another name", "held-out error: middle")
    for event, effect in EVENTS.items():
        middle = f"{np.median(errors[event]):.2f}" if errors[event] else "-"
        counts = (f"{count[event]} of {tried[event]}" for count in (named, false))
        table.add_row(f"{event} ({effect})", *counts, middle)
    console.print(table)


def recorded(event: str, seed: int, folder: Path) -> Path:
    """The folder of the recording of an arm with an event."""
    arm = random_recording(seed, folder)
    happening, honest = happened(event, arm, np.random.default_rng([seed, 4712]))
    arm.save(folder / event, happening, honest, [seed, 2])
    return folder / event


if __name__ == "__main__":
    main()
