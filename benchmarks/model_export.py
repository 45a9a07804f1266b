"""Values planted in a MuJoCo model come back from the exported one: `python -m benchmarks.model_export [--models 20]`.

Each model is a robot's URDF as MJCF. Dry and viscous friction, rotors and a heavier payload, drawn for each model,
are planted in it; MuJoCo's inverse dynamics give the joint efforts of a motion, with noise. `poise mismatch --export
mjcf:FILE` sees the recording, the URDF and the MJCF without all that. Its file is loaded by MuJoCo: the planted values
are compared, and both models run freely under the recorded efforts, from the states of the planted one.
"""

import argparse
import json
import re
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table

from poise.cli import run
from poise.files import write_whole
from poise.recording import JointStream, write_recording
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import FourierTrajectory
from poise.types import Array

ROBOTS = ("fr3", "xarm7")
RATE, STEP = 250.0, 5e-4
LOAD = (0.6, (0.0, 0.01, 0.06), (2e-3, 2e-3, 1e-3, 0.0, 0.0, 0.0))
"""Payload of the nominal model: kg, m, kg m2 about it (xx yy zz xy xz yz)."""
KINDS = ("frictionloss", "damping", "armature")
FIELDS = {"friction": "frictionloss", "damping": "damping", "armature": "armature"}
"""Of MuJoCo, by what Poise calls them."""
HORIZON = 1.0
"""s of a free run."""


@dataclass(frozen=True)
class Planted:
    """What the true model has: by joint each of KINDS, and the payload's mass and centre."""

    values: dict[str, Array]
    mass: float
    com: Array


def nominal_mjcf(robot: str) -> tuple[str, list[str]]:
    """The robot as MJCF without shapes, with a body `held` on its sensor; and the names of its arm's joints."""
    shapes = r"<(visual|collision)\b.*?</\1>|<(visual|collision)\b[^>]*/>"
    spec = mujoco.MjSpec.from_string(re.sub(shapes, "", read_urdf(find_urdf(robot)), flags=re.DOTALL))
    spec.compiler.fusestatic = False
    spec.option.timestep = STEP
    arm, there = RobotModel.from_file(robot), {joint.name for joint in spec.joints}
    joints = [each for each in arm.joint_names if each in there]
    held = spec.body(arm.sensor_frame).add_body(name="held")
    mass, com, six = LOAD
    held.mass, held.ipos, held.fullinertia = mass, list(com), list(six)
    held.explicitinertial = True
    spec.compile()
    return spec.to_xml(), joints


def plant(xml: str, joints: list[str], rng: np.random.Generator) -> tuple[mujoco.MjModel, Planted]:
    """The true model: some of friction, rotors and a heavier payload."""
    spec = mujoco.MjSpec.from_string(xml)
    used = rng.permutation(4)[: rng.integers(1, 4)]
    sizes = {"frictionloss": (0.3, 2.0), "damping": (0.5, 4.0), "armature": (0.05, 0.4)}
    fade = np.linspace(1.0, 0.4, len(joints))
    values = {}
    for number, kind in enumerate(KINDS):
        values[kind] = fade * rng.uniform(*sizes[kind], len(joints)) * (number in used)
        for joint, value in zip(joints, values[kind], strict=True):
            each = spec.joint(joint)
            if kind == "damping":
                each.damping = [value, 0.0, 0.0] if np.ndim(each.damping) else value
            else:
                setattr(each, kind, value)
    held = spec.body("held")
    mass, com = LOAD[0], np.array(LOAD[1])
    if 3 in used:
        mass, com = mass + rng.uniform(0.3, 1.5), com + rng.uniform(-0.03, 0.03, 3)
    held.mass, held.ipos = mass, com
    return spec.compile(), Planted(values, float(mass), com)


def addresses(model: mujoco.MjModel, joints: list[str]) -> tuple[list[int], list[int]]:
    """Where positions and velocities of joints stand in MuJoCo's states."""
    found = [model.joint(joint) for joint in joints]
    return [each.qposadr[0] for each in found], [each.dofadr[0] for each in found]


def efforts_along(
    model: mujoco.MjModel, joints: list[str], position: Array, velocity: Array, acceleration: Array
) -> Array:
    """(N, J) N m or N that the joints need for a motion (N, J), by MuJoCo's inverse dynamics."""
    data, efforts = mujoco.MjData(model), np.zeros_like(position)
    places, rates = addresses(model, joints)
    for row in range(len(position)):
        data.qpos[places], data.qvel[rates], data.qacc[rates] = position[row], velocity[row], acceleration[row]
        mujoco.mj_inverse(model, data)
        efforts[row] = data.qfrc_inverse[rates]
    return efforts


def stated_payload() -> dict[str, Any]:
    """LOAD as model.yaml has it."""
    mass, com, six = LOAD
    return {"mass": mass, "com": list(com), "inertia": [six[0], 0.0, 0.0, six[1], 0.0, six[2]]}


def recording(
    model: mujoco.MjModel, robot: str, joints: list[str], rng: np.random.Generator, seconds: float
) -> tuple[JointStream, Array, Array]:
    """Joint states with efforts by inverse dynamics; true positions and velocities, (N, 2 J); true efforts."""
    arm = RobotModel.from_file(robot)
    motion = FourierTrajectory.random(arm, rng, duration=seconds, speed=0.8, amplitude=0.8, frequency=0.1, harmonics=5)
    times = np.arange(round(seconds * RATE)) / RATE
    state = motion.at(times)
    columns = [arm.joint_names.index(joint) for joint in joints]
    position, velocity, acceleration = (
        part[:, columns] for part in (state.position, state.velocity, state.acceleration)
    )
    efforts = efforts_along(model, joints, position, velocity, acceleration)
    noise = 0.01 * np.abs(efforts).max(axis=0) + 0.01
    stamps = 10**18 + np.round(times * 1e9).astype(np.int64)
    seen = position + rng.normal(0.0, 2e-5, position.shape), velocity + rng.normal(0.0, 1e-3, velocity.shape)
    stream = JointStream(stamps, tuple(joints), *seen, efforts + noise * rng.normal(size=efforts.shape))
    return stream, np.hstack([position, velocity]), efforts


def free_run(model: mujoco.MjModel, joints: list[str], states: Array, efforts: Array, windows: int) -> float:
    """rad, the mean error of the joints after HORIZON under the efforts, from states of the recording."""
    places, rates = addresses(model, joints)
    errors, steps, count = [], round(1 / (RATE * STEP)), round(HORIZON * RATE)
    for begin in np.linspace(0, len(states) - count - 2, windows).astype(int):
        data = mujoco.MjData(model)
        data.qpos[places], data.qvel[rates] = np.split(states[begin], 2)
        for row in range(begin, begin + count):
            for step in range(steps):
                share = step / steps
                data.qfrc_applied[rates] = (1 - share) * efforts[row] + share * efforts[row + 1]
                mujoco.mj_step(model, data)
        errors.append(np.abs(data.qpos[places] - states[begin + count, : len(joints)]).mean())
    return float(np.mean(errors))


def one(seed: int, folder: Path, seconds: float = 30.0, windows: int = 8) -> dict[str, Any]:
    """One model: planted, recorded, diagnosed, exported, compared."""
    rng = np.random.default_rng([7, seed])
    robot = ROBOTS[seed % len(ROBOTS)]
    xml, joints = nominal_mjcf(robot)
    true, planted = plant(xml, joints, rng)
    stream, states, efforts = recording(true, robot, joints, rng, seconds)
    bag, source, target, stated = (folder / name for name in ("run.mcap", "robot.xml", "found.xml", "model.yaml"))
    write_recording(bag, {"joint_states": stream}, robot_description=read_urdf(find_urdf(robot)))
    source.write_text(xml)
    link = RobotModel.from_file(robot).sensor_frame
    mass = LOAD[0]
    stated.write_text(yaml.safe_dump({"sensor_frame": link, "payload": stated_payload()}))
    words = ["mismatch", str(bag), "--model", str(stated), "--export", f"mjcf:{target}", "--into", str(source)]
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        status = run([*words, "--payload-link", f"held={link}", "--json", str(folder / "a.json")])
    answer = json.loads((folder / "a.json").read_text()) if (folder / "a.json").exists() else {"effects": []}
    nominal = mujoco.MjModel.from_xml_string(xml)
    found = mujoco.MjModel.from_xml_path(str(target)) if target.exists() else nominal
    errors = [free_run(each, joints, states, efforts, windows) for each in (true, nominal, found)]
    dofs = addresses(found, joints)[1]
    read = {"frictionloss": found.dof_frictionloss, "damping": found.dof_damping, "armature": found.dof_armature}
    exports = answer.get("exports", [])
    said = {(each["joint"], FIELDS[each["kind"]]) for each in (exports[0]["unsure"] if exports else [])}
    off, unsure = [], []
    for kind in KINDS:
        for joint, dof, value in zip(joints, dofs, planted.values[kind], strict=True):
            if value > 0:
                off.append(abs(float(np.ravel(read[kind])[dof]) - value) / value)
                unsure.append((joint, kind) in said)
    held = found.body("held")
    if planted.mass != mass:
        off.append(abs(float(held.mass[0]) - planted.mass) / planted.mass)
        unsure.append(False)
    return {
        "robot": robot,
        "exit": status,
        "planted": [kind for kind in KINDS if planted.values[kind].any()] + ["payload"] * (planted.mass != mass),
        "named": [each["name"] for each in answer["effects"]],
        "off": off,
        "unsure": unsure,
        "com_off": float(np.linalg.norm(held.ipos - planted.com)) if planted.mass != mass else None,
        "free_run": dict(zip(("true", "nominal", "exported"), errors, strict=True)),
        "left": (errors[2] - errors[0]) / (errors[1] - errors[0]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--quick", action="store_true", help="two models")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/model_export.json"))
    options = parser.parse_args()
    results = []
    for seed in track(range(options.first, options.first + (2 if options.quick else options.models)), "models"):
        with tempfile.TemporaryDirectory() as folder:
            results.append(one(seed, Path(folder)))
    write_whole(options.output, json.dumps(results, indent=1).encode())
    off = np.array([value for each in results for value in each["off"]])
    centres = np.array([each["com_off"] for each in results if each["com_off"] is not None])
    removed = [1.0 - each["left"] for each in results]
    table = Table("what", f"{len(results)} models")
    table.add_row("planted values: off in the middle", f"{np.median(off):.1%} of {len(off)}")
    table.add_row("within 5 %; within 15 %", f"{np.mean(off < 0.05):.0%}; {np.mean(off < 0.15):.0%}")
    said = np.array([value for each in results for value in each["unsure"]])
    for words, kept in (("called unsure", said), ("not called unsure", ~said)):
        worst = f"worst {off[kept].max():.0%}" if kept.any() else ""
        table.add_row(words, f"{kept.sum()} values; over 15 %: {np.sum(off[kept] > 0.15)}; {worst}")
    if len(centres):
        middle, worst = 1e3 * np.median(centres), 1e3 * centres.max()
        table.add_row("payload's centre: off in the middle, worst", f"{middle:.1f} mm, {worst:.1f} mm")
    spread = f"{np.median(removed):.0%}, {np.min(removed):.0%}"
    table.add_row("excess error of a free run of 1 s that is removed: middle, least", spread)
    Console().print(table)
    for seed, each in enumerate(results, options.first):
        summary = f"off {np.median(each['off']):.3f}, {np.max(each['off']):.3f}; left {each['left']:.3f}"
        print(seed, each["robot"], each["planted"], each["named"], summary)


if __name__ == "__main__":
    main()
