"""One case, whole: the bag, its model.yaml and its label."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.concealed.changes import AKIN, DECOYS, DEPENDS_ON, EVERYTHING, LIBRARY, UNKNOWNS
from benchmarks.concealed.changes.base import Change
from benchmarks.concealed.changes.decoys import motion_of
from benchmarks.concealed.changes.honest import TOLERANCE, honest_errors
from benchmarks.concealed.engine import Engine
from benchmarks.concealed.motions import Motion, drive, fourier, pick_and_place, still
from benchmarks.concealed.payload import Payload
from benchmarks.concealed.recorder import FORCE, TORQUE, WHITE, Equipment, Recorded, clean, expected, record
from benchmarks.concealed.robot import SENSOR
from benchmarks.concealed.scene import Scene
from benchmarks.concealed.twins import TWINS


@dataclass(frozen=True)
class Plan:
    """What a case shall be, before chance fills it in.

    Args:
        kind: single, pair, null, decoy, twin or foreign.
        names: of the changes; of the situation for a twin.
        strength: 0.3 to 1.
        effort: joint efforts are recorded.
        seed: numbers of the case's own chance.
    """

    kind: str
    names: tuple[str, ...]
    strength: float
    effort: bool
    seed: tuple[int, ...]


@dataclass(frozen=True)
class Label:
    """What is true about a case, sealed until it is judged.

    Args:
        kind, strength: as planned.
        effects: name, parameters and windows of each change of the library; times since the first wrench stamp.
        accept: names that are as right on this motion; of what is outside the library, names that come near.
        foreign: what is outside the library, or "".
        decoy: or "".
        depends_on: any of these states is right for what is outside the library.
        motion: its name.
        nominal_rms: whitened rms of the nominal residual, without noise.
    """

    kind: str
    strength: float
    effects: list[dict[str, Any]] = field(default_factory=list)
    accept: list[str] = field(default_factory=list)
    foreign: str = ""
    decoy: str = ""
    depends_on: list[str] = field(default_factory=list)
    motion: str = ""
    nominal_rms: float = 0.0

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Case:
    """A recording, the model that it is held against, and the truth."""

    recorded: Recorded
    model: dict[str, Any]
    label: Label

    def write(self, folder: Path, name: str) -> None:
        """NAME.mcap and NAME.yaml."""
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(self.model, sort_keys=False), encoding="utf-8")
        self.recorded.write(folder / f"{name}.mcap")


def make_case(plan: Plan, honest: bool = True, quiet: bool = False) -> Case:
    """Draw and simulate a case.

    Args:
        plan: what it shall be.
        honest: with calibration errors inside the tolerances.
        quiet: without noise and jitter.
    """
    for_scene, for_honest, for_change, for_sensor = (np.random.default_rng([*plan.seed, i]) for i in range(4))
    declared = Payload.random(for_scene)
    motion = usual_motion(plan.names, for_scene)
    if plan.kind == "decoy":
        motion = motion_of(plan.names[0], motion, for_change)
    scene, accept = Scene(declared, motion), list(AKIN.get("".join(plan.names), ()))
    if plan.kind == "twin":
        changes, accept, motion = TWINS[plan.names[0]](scene, plan.strength, for_change)
    else:
        changes = [EVERYTHING[name](scene, plan.strength, for_change) for name in plan.names]
    settled = frozenset(group for change in changes for group in change.settles)
    errors = honest_errors(for_honest, settled) if honest else []
    true = declared
    for error in errors:
        true = error.carry(true)
    every = [*errors, *changes]
    engine = Engine(true, motion, changes)
    log = engine.run()
    equipment = Equipment(effort=plan.effort, imu=bool(for_scene.random() < 2 / 3))
    recorded = record(engine, log, every, equipment, for_sensor, quiet)
    residual = (clean(log, every, recorded.taken) - expected(declared, motion, every, recorded.taken)) / WHITE
    label = Label(
        kind=plan.kind,
        strength=plan.strength,
        effects=[_effect(change, recorded) for change in changes if change.name in LIBRARY],
        accept=accept,
        foreign=next((change.name for change in changes if change.name in UNKNOWNS), ""),
        decoy=next((change.name for change in changes if change.name in DECOYS), ""),
        depends_on=[state for change in changes for state in DEPENDS_ON.get(change.name, ())],
        motion=motion.name,
        nominal_rms=float(np.sqrt(np.mean(residual**2))),
    )
    loud = any(change.noise != 1.0 for change in every)
    return Case(recorded, model_of(declared, for_scene.random() < 0.5 and not loud), label)


def usual_motion(names: Sequence[str], rng: np.random.Generator) -> Motion:
    """Fourier or pick and place, in half the cases on a base that drives."""
    by_series = rng.random() < 0.5
    arm = fourier(rng) if by_series else pick_and_place(rng)
    drives = rng.random() < 0.5 or "drive_interference" in names
    base = drive(rng)
    name = f"{'Fourier' if by_series else 'pick and place'}, {'driving' if drives else 'standing'}"
    return Motion(name, arm, base if drives else still(3))


def _effect(change: Change, recorded: Recorded) -> dict[str, Any]:
    """The label of a change, its times on the clock of the wrench's stamps."""
    parameters = {
        key: recorded.on_the_clock(value) if key in ("time", "start") else float(value)
        for key, value in change.parameters.items()
    }
    windows = [[recorded.on_the_clock(time) for time in window] for window in change.windows]
    return {"name": change.name, "parameters": parameters, "windows": windows}


def model_of(declared: Payload, with_noise: bool) -> dict[str, Any]:
    """The content of model.yaml."""
    matrix = declared.inertia
    moments = matrix[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    model: dict[str, Any] = {
        "sensor_frame": SENSOR,
        "payload": {
            "mass": float(declared.mass),
            "com": declared.com.tolist(),
            "inertia": moments.tolist(),
        },
        "tolerance": TOLERANCE.document(),
    }
    if with_noise:
        model["noise"] = {"force": FORCE, "torque": TORQUE}
    return model
