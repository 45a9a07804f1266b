"""One case from its plan: a scene with honest errors, effects of the planned strength, a recording and a label."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.foreign import bag
from benchmarks.foreign.added import ADDED
from benchmarks.foreign.fault import Fault
from benchmarks.foreign.honest import TOLERANCE, draw
from benchmarks.foreign.load import random_load
from benchmarks.foreign.motions import MOTIONS, drive
from benchmarks.foreign.outside import OUTSIDE
from benchmarks.foreign.plan import LIBRARY, Plan
from benchmarks.foreign.profiles import BY_NAME, Profile
from benchmarks.foreign.recorder import DRIVER_DELAY, Recorder
from benchmarks.foreign.robots import ROBOTS
from benchmarks.foreign.strength import Rig, Sized, tuned
from benchmarks.foreign.world import Scene, Track

EVERY: tuple[type[Fault], ...] = (*LIBRARY, *ADDED, *OUTSIDE)
FAULTS = {fault.name: fault for fault in EVERY}


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, the model that it is held against, and the truth."""

    streams: bag.Streams
    model: dict[str, Any]
    label: dict[str, Any]

    def write(self, folder: Path) -> None:
        """recording.mcap and model.yaml."""
        folder.mkdir(parents=True)
        bag.write(self.streams, folder / "recording.mcap")
        (folder / "model.yaml").write_text(yaml.safe_dump(self.model, sort_keys=False), encoding="utf-8")


def make_case(plan: Plan, seconds: float | None = None) -> Case:
    """Draw, simulate and record a case.

    Args:
        plan: what it is. seconds: length of the recording; None: as the profile has it.
    """
    for_scene, for_honest, for_fault, for_recorder = (np.random.default_rng([*plan.seed, i]) for i in range(4))
    profile = BY_NAME[plan.profile]
    rig, motion = draw_rig(profile, for_scene, for_honest, seconds)
    return case_of(rig, plan, motion, for_fault, for_recorder)


def case_of(
    rig: Rig, plan: Plan, motion: str, for_fault: np.random.Generator, for_recorder: np.random.Generator
) -> Case:
    """Simulate and record a rig with the effects of a plan."""
    track = rig.run(())
    chosen = choose(rig, plan, track, for_fault)
    faults = [each.fault for each in chosen]
    if len(chosen) == 1:
        track = chosen[0].track
    elif any(fault.simulated for fault in faults):
        track = rig.run(faults)
    streams = Recorder(rig.profile, rig.true, rig.honest, faults, for_recorder).record(track)
    label = {
        "kind": plan.kind,
        "profile": rig.profile.name,
        "motion": motion,
        "seconds": float(track.seconds[-1]),
        "strength": plan.strength,
        "effects": [
            {
                "name": each.fault.name,
                "accept": list(each.fault.accept),
                "library": each.fault.library,
                "size": each.fault.size,
                "share": each.share,
                "parameters": each.fault.parameters(),
            }
            for each in chosen
        ],
    }
    return Case(streams, model_of(rig), label)


def draw_rig(
    profile: Profile, for_scene: np.random.Generator, for_honest: np.random.Generator, seconds: float | None = None
) -> tuple[Rig, str]:
    """What is declared and what is true of a case, and the name of its motion."""
    robot = ROBOTS[profile.robot]
    load = random_load(*robot.payload, for_scene)
    length = float(for_scene.uniform(*profile.seconds)) if seconds is None else seconds
    motion = str(for_scene.choice(profile.motions))
    base = drive(length, for_scene) if profile.mobile else None
    declared = Scene(robot, load, MOTIONS[motion](robot, length, for_scene), base)
    delay = DRIVER_DELAY if profile.filtering == "driver" else 0.0
    honest = draw(declared, for_honest, delay, profile.skew * 1e-6)
    stiffness = float(for_scene.uniform(25, 50))
    true = Scene(robot, honest.load(load), declared.arm, base, honest.links, honest.gravity(), stiffness)
    return Rig(profile, declared, true, honest), motion


def choose(rig: Rig, plan: Plan, track: Track, rng: np.random.Generator) -> list[Sized]:
    """The first candidates that reach the planned strength, each alone.

    Raises:
        RuntimeError: no candidate does.
    """
    wanted = {"healthy": 0, "pair": 2}.get(plan.kind, 1)
    usual = (track, rig.signals(track, ()))
    chosen: list[Sized] = []
    for name in plan.candidates:
        if len(chosen) == wanted:
            break
        if any(each.fault.freed for each in chosen) and FAULTS[name].__dict__.get("freed"):
            continue  # the load has one part to set free
        found = tuned(rig, FAULTS[name].draw(rig.true, track, rng), plan.strength, usual)
        if found is not None:
            chosen.append(found)
    if len(chosen) < wanted:
        raise RuntimeError(f"case {plan.seed}: {len(chosen)} of {wanted} effects reach strength {plan.strength}")
    return chosen


def model_of(rig: Rig) -> dict[str, Any]:
    """The content of model.yaml: what is declared."""
    payload = rig.declared.load.whole.document()
    return {"sensor_frame": rig.declared.robot.frame, "payload": payload, "tolerance": TOLERANCE}
