"""A simulator and a robot under the same commands, in closed loop: `python -m benchmarks.simulator_loop [--cases 20]`.

Each case is an arm (FR3, xArm7) with position drives in MuJoCo. The simulator is the user's model; the robot is the
same model with one to three of dry friction, damping, rotors, a heavier payload, a delay and softer drives. Both get
the same commands and run freely in closed loop, so that their motions differ, too. The tool sees both recordings, and
the user's MJCF, which has some friction already.

- `poise mismatch ROBOT --against SIMULATOR`, without any model: are the joints that differ located? With the MJCF: is
  the cause named?
- `poise mismatch ROBOT --model MJCF --export mjcf:FILE`: do the planted values come back?
- `poise rollout`: which part of the excess error of free runs under the commands, on the part of the recording that no
  fit saw, is gone over 0.1, 1 and 10 s?
"""

import argparse
import json
import tempfile
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model_export import LOAD, ROBOTS, addresses, nominal_mjcf
from poise.cli import run
from poise.files import write_whole
from poise.recording import JointStream, write_recording
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory
from poise.types import Array

SECONDS, RATE, COMMAND_RATE, STEP = 36.0, 250.0, 1000.0, 1e-3
GAIN, DAMPING = 900.0, 40.0
"""N m/rad and N m s/rad of the drive of the first joint; the others are softer."""
KINDS = ("frictionloss", "damping", "armature", "load", "delay", "gain")
NAMES = {
    "frictionloss": "coulomb_friction",
    "damping": "viscous_friction",
    "armature": "motor_inertia",
    "load": "payload_parameters",
}
SIZES = {"frictionloss": (0.6, 2.5), "damping": (1.0, 5.0), "armature": (0.1, 0.4)}


@dataclass(frozen=True)
class Case:
    """A simulator's MJCF, the robot's, and what was planted: by kind, a value for each joint, or one."""

    robot: str
    joints: list[str]
    nominal: str
    true: str
    planted: dict[str, Array]


def make_case(seed: int) -> Case:
    """One to three differences, drawn."""
    rng = np.random.default_rng([23, seed])
    robot = ROBOTS[seed % len(ROBOTS)]
    xml, joints = nominal_mjcf(robot)
    fade = np.linspace(1.0, 0.3, len(joints))
    there = {"frictionloss": 0.2 * fade, "damping": 0.5 * fade, "armature": 0.05 * fade}
    nominal = driven(xml, joints, there, GAIN * fade)
    chosen = [KINDS[k] for k in rng.permutation(len(KINDS))[: rng.integers(1, 4)]]
    planted: dict[str, Array] = {}
    values = dict(there)
    for kind in chosen:
        if kind in SIZES:
            planted[kind] = values[kind] = there[kind] + fade * rng.uniform(*SIZES[kind], len(joints))
    gain = GAIN * fade * (rng.uniform(0.5, 0.85) if "gain" in chosen else 1.0)
    delay = float(rng.uniform(0.008, 0.03)) if "delay" in chosen else 0.0
    more = float(rng.uniform(0.4, 1.6)) if "load" in chosen else 0.0
    planted |= {"gain": gain} if "gain" in chosen else {}
    planted |= {"delay": np.array([delay])} if delay else {}
    planted |= {"load": np.array([LOAD[0] + more])} if more else {}
    return Case(robot, joints, nominal, driven(xml, joints, values, gain, delay, more), planted)


def driven(
    xml: str, joints: list[str], values: dict[str, Array], gain: Array, delay: float = 0.0, more: float = 0.0
) -> str:
    """The model with position drives, and values of its joints."""
    spec = mujoco.MjSpec.from_string(xml)
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER  # efforts act as they are reported
    for j, name in enumerate(joints):
        joint = spec.joint(name)
        for kind, sizes in values.items():
            setattr(joint, kind, [sizes[j], 0.0, 0.0] if np.ndim(getattr(joint, kind)) else sizes[j])
        drive = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.set_to_position(kp=float(gain[j]), kv=float(DAMPING * gain[0] / GAIN * gain[j] / gain[0]))
        if delay:
            drive.delay, drive.nsample = delay, int(np.ceil(delay / STEP)) + 2
    held = spec.body("held")
    held.mass = LOAD[0] + more
    spec.compile()
    return str(spec.to_xml())


def commanded(case: Case, rng: np.random.Generator) -> JointStream:
    """Commands of a smooth motion."""
    arm = RobotModel.from_file(case.robot)
    path = FourierTrajectory.random(arm, rng, duration=SECONDS, speed=0.8, amplitude=0.8, frequency=0.1, harmonics=5)
    times = np.arange(round(SECONDS * COMMAND_RATE)) / COMMAND_RATE
    columns = [arm.joint_names.index(joint) for joint in case.joints]
    position = path.at(times).position[:, columns]
    nothing = np.full(position.shape, np.nan)
    return JointStream(10**18 + np.round(times * 1e9).astype(np.int64), tuple(case.joints), position, nothing, nothing)


def recorded(xml: str, joints: list[str], commands: JointStream, noise: float, rng: np.random.Generator) -> JointStream:
    """Joint states of a model under commands, from rest at the first one; efforts are those of the drives."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    places, rates = addresses(model, joints)
    drives = [model.actuator(joint).id for joint in joints]
    data.qpos[places] = commands.position[0]
    for drive, first in zip(drives, commands.position[0], strict=True):
        if model.actuator_delay[drive] > 0.0:  # a robot at rest has had its first command for a while
            count = int(model.actuator_history[drive, 0])
            mujoco.mj_initCtrlHistory(model, data, drive, None, np.full((count, 1), first))
    every = round(1.0 / RATE / STEP)
    sent = commands.seconds
    rows = []
    for step in range(round(SECONDS / STEP)):
        at = step * STEP
        row = max(int(np.searchsorted(sent, at + 1e-9, side="right")) - 1, 0)
        data.ctrl[drives] = commands.position[row]
        state = [[at], data.qpos[places], data.qvel[rates]]
        mujoco.mj_step(model, data)
        if step % every == 0:
            rows.append(np.concatenate([*state, data.actuator_force[drives]]))
    values = np.array(rows)
    position, velocity, effort = np.split(values[:, 1:], 3, axis=1)
    position = position + noise * rng.normal(0.0, 2e-5, position.shape)
    velocity = velocity + noise * rng.normal(0.0, 1e-3, velocity.shape)
    effort = effort + noise * (0.01 * np.abs(effort).max(axis=0) + 0.01) * rng.normal(size=effort.shape)
    stamps = 10**18 + np.round(values[:, 0] * 1e9).astype(np.int64)
    return JointStream(stamps, tuple(joints), position, velocity, effort)


def asked(words: list[str], answer: Path) -> tuple[dict[str, Any], int, float]:
    """The JSON of a command, its exit status and CPU seconds."""
    begin = time.process_time()
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        status = run([*words, "--json", str(answer)])
    content = json.loads(answer.read_text()) if answer.exists() else {}
    return content, status, time.process_time() - begin


def one(seed: int, folder: Path) -> dict[str, Any]:
    """One case: recorded twice, compared, exported, run freely."""
    case = make_case(seed)
    rng = np.random.default_rng([29, seed])
    commands = commanded(case, rng)
    for name, xml, noise in (("sim", case.nominal, 0.05), ("real", case.true, 1.0)):
        states = recorded(xml, case.joints, commands, noise, rng)
        write_recording(folder / f"{name}.mcap", {"joint_states": states, "joint_commands": commands})
        (folder / f"{name}.xml").write_text(xml)
    bags = {name: str(folder / f"{name}.mcap") for name in ("sim", "real")}
    model = str(folder / "sim.xml")
    bare, _, seconds = asked(["mismatch", bags["real"], "--against", bags["sim"]], folder / "bare.json")
    pair = ["mismatch", bags["real"], "--against", bags["sim"], "--model", model, "--payload-link", "held"]
    named, _, more = asked(pair, folder / "named.json")
    found = folder / "found.xml"
    export = ["mismatch", bags["real"], "--model", model, "--payload-link", "held", "--into", model]
    own, status, longest = asked([*export, "--export", f"mjcf:{found}"], folder / "own.json")
    rolled = {}
    models = [str(folder / "real.xml"), model, *([str(found)] if found.exists() else [])]
    for kind in models:
        rolled[kind], _, _ = asked(["rollout", kind, "--commands", bags["real"]], folder / "r.json")
    return {
        "seed": seed,
        "planted": {name: np.ravel(value).tolist() for name, value in case.planted.items()},
        "located": bare.get("verdict"),
        "goes_with": [each["goes_with"] for each in bare.get("channels", []) if each["differs"]],
        "named": [each["name"] for each in named.get("effects", [])],
        "own": [each["name"] for each in own.get("effects", [])],
        "exit": status,
        "off": _off(case, found) if found.exists() else {},
        "free": [[each["error"] for each in rolled[kind]["models"][0]["windows"]] for kind in models],
        "seconds": [seconds, more, longest],
    }


def _off(case: Case, found: Path) -> dict[str, list[float]]:
    """Relative errors of the planted values in the exported file."""
    model = mujoco.MjModel.from_xml_path(str(found))
    dofs = addresses(model, case.joints)[1]
    drives = [model.actuator(joint).id for joint in case.joints]
    read = {
        "frictionloss": model.dof_frictionloss[dofs],
        "damping": np.ravel(model.dof_damping[dofs]),
        "armature": model.dof_armature[dofs],
        "gain": model.actuator_gainprm[drives, 0],
        "delay": model.actuator_delay[drives],
        "load": model.body("held").mass,
    }
    return {name: (np.abs(read[name] - value) / value).tolist() for name, value in case.planted.items()}


def shares(result: dict[str, Any]) -> list[float]:
    """By length of the windows: part of the excess error over that of the true model that is gone."""
    true, before, *after = result["free"]
    return [1.0 - (c - a) / max(b - a, 1e-12) for a, b, c in zip(true, before, after[0], strict=True)] if after else []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/simulator_loop.json"))
    options = parser.parse_args()
    results = []
    for seed in track(range(options.first, options.first + options.cases), "cases"):
        with tempfile.TemporaryDirectory() as folder:
            results.append(one(seed, Path(folder)))
        write_whole(options.output, json.dumps(results, indent=1).encode())
    table = Table("what", f"{len(results)} cases")
    table.add_row("without a model: a difference is located", f"{sum(r['located'] == 'unknown' for r in results)}")
    wanted = [{NAMES[kind] for kind in r["planted"] if kind in NAMES} for r in results]
    for what in ("named", "own"):
        right = sum(set(r[what]) == want for r, want in zip(results, wanted, strict=True))
        table.add_row(f"names exactly what was planted ({what})", str(right))
    for kind in KINDS:
        off = np.array([value for r in results for value in r["off"].get(kind, [])])
        if len(off):
            said = f"{np.median(off):.1%}, {np.mean(off < 0.15):.0%}, {off.max():.0%} of {len(off)}"
            table.add_row(f"{kind}: off in the middle; within 15 %; worst", said)
    removed = np.array([shares(r) for r in results if len(r["free"]) == 3])
    for column, length in enumerate((0.1, 1.0, 10.0)):
        if len(removed):
            part = removed[:, column]
            table.add_row(
                f"free runs of {length:g} s: excess gone, middle, least", f"{np.median(part):.0%}, {part.min():.0%}"
            )
    table.add_row(
        "CPU s: located, named, exported (middle)", str(np.median([r["seconds"] for r in results], axis=0).round(1))
    )
    Console().print(table)
    for r in results:
        print(r["seed"], list(r["planted"]), r["named"], r["own"], [round(s, 3) for s in shares(r)])


if __name__ == "__main__":
    main()
