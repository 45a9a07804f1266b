"""Pairs of recordings with one change between them: `python -m benchmarks.compare [--pairs 40] [--first 0]`.

MuJoCo's inverse dynamics of an arm (FR3, xArm7) give the efforts of both recordings; both have friction, rotors and a
payload that the model lacks. One recording may have more: dry friction or damping of some joints, rotors, or a load.
The motions are the same with noise of its own, start later, run at another speed, pause, have a clock that is 2 %
fast, or differ. `poise compare` gets two bags and a model file. The rival is `poise mismatch` of each recording by
itself: the change is the name that one answer has and the other lacks, or the largest change of a value.
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
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

from benchmarks.model_export import LOAD, RATE, ROBOTS, efforts_along, nominal_mjcf, stated_payload
from poise.cli import run
from poise.files import write_whole
from poise.recording import JointStream, write_recording
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import FourierTrajectory
from poise.types import Array

SECONDS = 30.0
CHANGES = {
    "none": "",
    "frictionloss": "coulomb_friction",
    "damping": "viscous_friction",
    "armature": "motor_inertia",
    "load": "payload_parameters",
}
MOTIONS = ("same", "later", "faster", "pause", "skew", "other")
SIZES = {"frictionloss": (0.3, 2.0), "damping": (0.5, 4.0), "armature": (0.05, 0.4)}


@dataclass(frozen=True)
class World:
    """Values of an arm: by joint each of SIZES, and the payload's mass and centre."""

    values: dict[str, Array]
    mass: float
    com: Array

    def model(self, xml: str, joints: list[str]) -> mujoco.MjModel:
        """MuJoCo's model."""
        spec = mujoco.MjSpec.from_string(xml)
        for kind, sizes in self.values.items():
            for name, value in zip(joints, sizes, strict=True):
                joint = spec.joint(name)
                setattr(joint, kind, [value, 0.0, 0.0] if np.ndim(getattr(joint, kind)) else value)
        held = spec.body("held")
        held.mass, held.ipos = self.mass, list(self.com)
        return spec.compile()

    def changed(self, kind: str, rng: np.random.Generator) -> "World":
        """With one change of typical size: a half more in up to three joints, or a load of 0.4 to 1.7 kg."""
        if kind == "none":
            return self
        if kind == "load":
            more = rng.uniform(0.4, 1.7)
            at = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.03, 0.12)])
            total = self.mass + more
            return World(self.values, total, (self.mass * self.com + more * at) / total)
        joints = rng.permutation(len(self.values[kind]))[: rng.integers(1, 4)]
        typical = np.linspace(1.0, 0.4, len(self.values[kind])) * np.mean(SIZES[kind])
        step = np.zeros(len(typical))
        step[joints] = rng.uniform(0.4, 0.8, len(joints)) * typical[joints]
        return World({**self.values, kind: self.values[kind] + step}, self.mass, self.com)


def common_world(joints: int, rng: np.random.Generator) -> World:
    """What both recordings have and the model lacks."""
    used = rng.random(3) < 0.7
    fade = np.linspace(1.0, 0.4, joints)
    values = {kind: fade * rng.uniform(*SIZES[kind], joints) * on for kind, on in zip(SIZES, used, strict=True)}
    return World(values, LOAD[0] * rng.uniform(0.9, 1.1), np.array(LOAD[1]) + rng.uniform(-0.005, 0.005, 3))


def place_in_motion(times: Array, motion: str, rng: np.random.Generator) -> Array:
    """(3, N) s of the motion and its rate and acceleration at times (N,)."""
    rate = np.full(len(times), 1.3 if motion == "faster" else 1.0)
    if motion == "pause":
        begin, length = times[-1] * rng.uniform(0.3, 0.5), rng.uniform(2.0, 5.0)
        edge = np.clip((np.abs(times - begin - length / 2) - length / 2) / 0.5, 0.0, 1.0)
        rate *= edge**2 * (3 - 2 * edge)
    step = times[1] - times[0]
    start = rng.uniform(1.0, 5.0) if motion == "later" else 0.0
    return np.array(
        [start + np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * step, rate, np.gradient(rate, step)]
    )


def recording(
    world: mujoco.MjModel,
    robot: str,
    joints: list[str],
    path: FourierTrajectory,
    motion: str,
    rng: np.random.Generator,
    seconds: float,
) -> JointStream:
    """Joint states with efforts by inverse dynamics, with noise of their own."""
    arm = RobotModel.from_file(robot)
    times = np.arange(round(seconds * RATE)) / RATE
    place, rate, more = place_in_motion(times, motion, rng)
    state = path.at(np.clip(place, 0.0, path.duration))
    columns = [arm.joint_names.index(joint) for joint in joints]
    q, v, a = (part[:, columns] for part in (state.position, state.velocity, state.acceleration))
    v, a = v * rate[:, None], a * rate[:, None] ** 2 + v * more[:, None]
    efforts = efforts_along(world, joints, q, v, a)
    noise = noise_of(efforts)
    clock = 1.02 if motion == "skew" else 1.0
    stamps = 10**18 + round(rng.uniform(0, 1e12)) + np.round(times * clock * 1e9).astype(np.int64)
    read = q + rng.normal(0.0, 2e-5, q.shape), v / clock + rng.normal(0.0, 1e-3, v.shape)
    return JointStream(stamps, tuple(joints), *read, efforts + noise * rng.normal(size=efforts.shape))


def noise_of(efforts: Array) -> Array:
    """(J,) one sigma."""
    return np.asarray(0.01 * np.abs(efforts).max(axis=0) + 0.01)


def evidence_of(worlds: Sequence[mujoco.MjModel], joints: list[str], moved: Sequence[Array]) -> float:
    """Nats by which a comparison that knows the change exactly prefers it to no change; below about 20 it is hidden.

    Args:
        worlds: before and after. moved: (N, J) position, velocity and acceleration.
    """
    efforts = [efforts_along(world, joints, *moved) for world in worlds]
    return float(0.25 * np.sum(((efforts[1] - efforts[0]) / noise_of(efforts[0])) ** 2))


def make_pair(
    seed: int, folder: Path, change: str = "", motion: str = "", seconds: float = SECONDS
) -> tuple[list[str], dict[str, Any]]:
    """Two bags and a model file in a folder; change and motion by chance when they are not given.

    Returns:
        The bags, and the truth.
    """
    rng = np.random.default_rng([17, seed])
    robot = ROBOTS[seed % len(ROBOTS)]
    xml, joints = nominal_mjcf(robot)
    drawn = list(CHANGES)[rng.integers(len(CHANGES))], MOTIONS[rng.integers(len(MOTIONS))]
    change, motion = change or drawn[0], motion or drawn[1]
    before = common_world(len(joints), rng)
    after, in_b = before.changed(change, rng), bool(rng.integers(2))
    arm = RobotModel.from_file(robot)
    settings = {"speed": 0.8, "amplitude": 0.8, "frequency": 0.1, "harmonics": 5}
    paths = [FourierTrajectory.random(arm, rng, duration=seconds * 1.35, **settings) for _ in range(2)]
    worlds = (before, after) if in_b else (after, before)
    for name, world, path, moved in zip(
        "ab", worlds, (paths[0], paths[motion == "other"]), ("same", motion), strict=True
    ):
        stream = recording(world.model(xml, joints), robot, joints, path, moved, rng, seconds)
        write_recording(
            folder / f"{name}.mcap", {"joint_states": stream}, robot_description=read_urdf(find_urdf(robot))
        )
    document = {
        "sensor_frame": arm.sensor_frame,
        "payload": stated_payload(),
        "tolerance": {"payload": {"mass": 0.15, "com": 0.01}},
    }
    (folder / "model.yaml").write_text(yaml.safe_dump(document))
    state, thin = paths[0].at(np.arange(0.0, seconds, 10 / RATE)), [arm.joint_names.index(joint) for joint in joints]
    moved = [part[:, thin] for part in (state.position, state.velocity, state.acceleration)]
    evidence = 10 * evidence_of([world.model(xml, joints) for world in (before, after)], joints, moved)
    truth = {"change": change, "motion": motion, "in": "b" if in_b else "a", "mass": after.mass - before.mass}
    truth["evidence"] = evidence
    if change == "load":
        truth["com"] = ((after.mass * after.com - before.mass * before.com) / truth["mass"]).tolist()
    return [str(folder / f"{name}.mcap") for name in "ab"], truth


def asked(words: list[str], answer: Path) -> tuple[dict[str, Any], float]:
    """The JSON of a command, and its CPU seconds."""
    begin = time.process_time()
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        status = run([*words, "--json", str(answer)])
    seconds = time.process_time() - begin
    return json.loads(answer.read_text()) if answer.exists() else {"effects": [], "verdict": f"exit {status}"}, seconds


def load_errors(found: dict[str, float], truth: dict[str, Any]) -> tuple[float, float]:
    """The relative error of an added load's mass, and the error of its centre, m.

    Args:
        found: mass and com_x, com_y, com_z of the payload with the load minus those without it.
        truth: mass and com of the load.
    """
    mass, moved = found["mass"], np.array([found[f"com_{axis}"] for axis in "xyz"])
    # The answer says where the centre of the whole payload moves, from that of the nominal one.
    centre = np.array(LOAD[1]) + moved * (LOAD[0] + mass) / mass
    return abs(mass / truth["mass"] - 1.0), float(np.linalg.norm(centre - truth["com"]))


def one(seed: int, folder: Path, rival: bool = True) -> dict[str, Any]:
    """One pair, compared, and judged by its truth."""
    bags, truth = make_pair(seed, folder)
    stated = ["--model", str(folder / "model.yaml")]
    found, seconds = asked(["compare", *bags, *stated], folder / "answer.json")
    expected = CHANGES[truth["change"]]
    named = [each["name"] for each in found["effects"]]
    side = found["effects"][0]["more_in"] if named else ""
    right = (found["verdict"] == "none") if not expected else named[:1] == [expected] and side == truth["in"]
    answers = (
        [asked(["mismatch", bag, *stated], folder / f"{i}.json")[0] for i, bag in enumerate(bags)] if rival else []
    )
    off: tuple[float, float] | None = None
    if right and truth["change"] == "load":
        sign = 1.0 if truth["in"] == "b" else -1.0
        off = load_errors({name: sign * each["value"] for name, each in found["effects"][0]["change"].items()}, truth)
    own = [{each["name"] for each in answer["effects"]} for answer in answers]
    other = sorted(own[0] ^ own[1]) if own else []
    return {
        "seed": seed,
        **truth,
        "verdict": found["verdict"],
        "named": named,
        "side": side,
        "right": right,
        "beliefs": [each["probability"] for each in found["effects"]],
        "values": [each["change"] for each in found["effects"]],
        "load_off": off,
        "rival": other,
        "rival_right": rival and other == ([expected] if expected else []),
        "seconds": seconds,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--no-rival", action="store_true", help="poise compare alone")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/compare.json"))
    options = parser.parse_args()
    results = []
    for seed in track(range(options.first, options.first + options.pairs), "pairs"):
        with tempfile.TemporaryDirectory() as folder:
            results.append(one(seed, Path(folder), not options.no_rival))
    write_whole(options.output, json.dumps(results, indent=1).encode())
    table = Table("pairs", "right", "each by itself")
    for what, key in (("change", "change"), ("motion", "motion")):
        for name, count in sorted(Counter(each[key] for each in results).items()):
            mine = [each for each in results if each[key] == name]
            table.add_row(
                f"{what} {name}",
                f"{sum(e['right'] for e in mine)} of {count}",
                f"{sum(e['rival_right'] for e in mine)} of {count}",
            )
    off = np.array([each["load_off"] for each in results if each["load_off"] is not None]).reshape(-1, 2)
    if len(off):
        masses, centres = (f"{np.median(part):.1f}, {part.max():.1f}" for part in (100 * off[:, 0], 1e3 * off[:, 1]))
        table.add_row("mass of a load off in the middle, worst", f"{masses} %", "")
        table.add_row("its centre off in the middle, worst", f"{centres} mm", "")
    table.add_row(
        "CPU s, middle and most",
        f"{np.median([e['seconds'] for e in results]):.1f}, {max(e['seconds'] for e in results):.1f}",
        "",
    )
    Console().print(table)


if __name__ == "__main__":
    main()
