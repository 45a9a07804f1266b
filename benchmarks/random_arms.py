"""Diagnoses of random arms, each with its own joints, mounting, motion, clocks and noise.

python -m benchmarks.random_arms [--first SEED] [--count N]; seeds from 7000 to 7999 are for development.

Each arm is recorded twice along one motion: as declared, with all errors at the edges of their tolerances and a zero
of the sensor that swings instead of drifting along a line; and with friction by the law of LuGre, and rotors, in all
joints.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.interpolate import make_interp_spline

from benchmarks.foreign import bag
from benchmarks.foreign.honest import TOLERANCE, Honest, draw
from benchmarks.foreign.load import random_load
from benchmarks.foreign.motions import STEP, Reference
from benchmarks.foreign.noise import NOISES
from benchmarks.foreign.profiles import Profile
from benchmarks.foreign.recorder import Recorder
from benchmarks.foreign.robots import Array, Robot
from benchmarks.foreign.run import answer
from benchmarks.foreign.world import Scene, Track, rigid

DRY, OTHER = ("coulomb_friction", "stribeck_friction"), ("viscous_friction", "motor_inertia")
_MOUNTS = {"floor": "0 0 0", "ceiling": "3.141592653589793 0 0", "wall": "1.5707963267948966 0 0.4"}
_LIMIT = 300
"""s of CPU for one answer."""
_EDGE = 2
"""Steps at either end without an acceleration."""
console = Console(width=120)


def random_arm(folder: Path, rng: np.random.Generator, slides: float = 0.0) -> Robot:
    """An arm of two to seven joints about random axes, on the floor, the ceiling or a wall.

    Args:
        folder: of the URDF. rng: chance. slides: share of the joints that are prismatic.
    """
    count = int(rng.integers(2, 8))
    root = ElementTree.Element("robot", name="arm")
    ElementTree.SubElement(root, "link", name="base_link")
    parent, place, turn = "base_link", "0 0 0.1", _MOUNTS[str(rng.choice(list(_MOUNTS)))]
    axis = np.array([0.0, 0.0, 1.0])
    sliding = np.array([slides > 0 and rng.random() < slides for _ in range(count)])
    for number in range(1, count + 1):
        kind = "prismatic" if sliding[number - 1] else "revolute"
        joint = _joint(root, f"axis_{number}", parent, f"link_{number}", place, turn, kind)
        ElementTree.SubElement(joint, "axis", xyz=_text(axis * rng.choice([-1, 1])))
        ElementTree.SubElement(joint, "limit", lower="-2.9", upper="2.9", effort="200", velocity="3")
        length, mass = float(rng.uniform(0.08, 0.38)), float(rng.uniform(1.0, 6.0) * 0.85**number)
        size = np.array([0.09, 0.09, length])
        _link(root, f"link_{number}", mass, [*rng.uniform(-0.02, 0.02, 2), length / 2], size)
        parent, place, turn = f"link_{number}", f"0 0 {length!r}", _text(rng.choice([0, np.pi / 2, -np.pi / 2], 3))
        axis = np.eye(3)[[i for i in range(3) if not axis[i]][int(rng.integers(2))]]
    _joint(root, "mount", parent, "ft_sensor", place, f"0 0 {float(rng.uniform(-3, 3))!r}", "fixed")
    ElementTree.SubElement(root, "link", name="ft_sensor")
    file = folder / "arm.urdf"
    ElementTree.ElementTree(root).write(file)
    home = tuple(rng.uniform(-0.8, 0.8, count).tolist())
    usual = (0.1,) * count  # of the efforts: see `with_noise_of`
    names = tuple(f"axis_{number}" for number in range(1, count + 1))
    sizes = ((0.3, 0.8), (0.6, 1.0), (5e-6, 2e-5))
    reach, speed, encoder = (tuple(np.where(sliding, *pair).tolist()) for pair in sizes)
    return Robot(file, "ft_sensor", names, home, reach, speed, encoder, usual, (0.5, 3.0))


def _joint(
    root: ElementTree.Element, name: str, parent: str, child: str, place: str, turn: str, kind: str = "revolute"
) -> ElementTree.Element:
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    ElementTree.SubElement(joint, "origin", xyz=place, rpy=turn)
    return joint


def _link(root: ElementTree.Element, name: str, mass: float, middle: Sequence[float], size: Array) -> None:
    inertial = ElementTree.SubElement(ElementTree.SubElement(root, "link", name=name), "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_text(middle), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=repr(mass))
    moments = (mass / 12 * (size @ size - size**2)).tolist()
    zero = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    ElementTree.SubElement(
        inertial, "inertia", zero | dict(zip(("ixx", "iyy", "izz"), map(repr, moments), strict=True))
    )


def _text(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


def random_motion(robot: Robot, seconds: float, rng: np.random.Generator) -> Reference:
    """Between random points by quintic polynomials, with or without pauses; one joint at a time; or a smooth walk."""
    kind = str(rng.choice(["moves", "pauses", "one joint", "walk"]))
    home, reach, speed = np.array(robot.home), np.array(robot.reach), float(rng.uniform(0.5, 1.3))
    times, points = [0.0], [home]
    while times[-1] < seconds + 1.0:
        goal = home + reach * rng.uniform(-1, 1, len(home))
        if kind == "one joint":
            goal = np.where(np.arange(len(home)) == rng.integers(len(home)), goal, points[-1])
        times.append(times[-1] + max(0.6, 1.9 * float(np.abs(goal - points[-1]).max()) / speed))
        points.append(goal)
        if kind in ("pauses", "one joint"):
            times.append(times[-1] + float(rng.uniform(0.2, 1.2)))
            points.append(goal)
    at = np.arange(0.0, seconds, STEP)
    if kind == "walk":
        rest = [(1, np.zeros(len(home))), (2, np.zeros(len(home)))]
        course = make_interp_spline(times, points, k=5, bc_type=(rest, rest))
        return course(at), course(at, 1), course(at, 2)
    knots, where = np.array(times), np.array(points)
    i = np.searchsorted(knots, at, side="right") - 1
    span, change = (knots[i + 1] - knots[i])[:, None], where[i + 1] - where[i]
    s = (at - knots[i])[:, None] / span
    return (
        where[i] + change * s**3 * (10 - 15 * s + 6 * s**2),
        change * 30 * s**2 * (1 - s) ** 2 / span,
        change * 60 * s * (1 - s) * (1 - 2 * s) / span**2,
    )


def bristles(velocity: Array, size: Array, rng: np.random.Generator) -> Array:
    """(N, J) N m: friction by the law of LuGre with stiff bristles, damping, and a difference between the directions.

    Args:
        velocity: (N, J) rad/s, every STEP. size: (J,) N m, a large effort of each joint.
    """
    out = np.empty_like(velocity)
    for joint, speed in enumerate(velocity.T):
        dry, distance = size[joint] * rng.uniform(0.05, 0.3), rng.uniform(5e-4, 4e-3)
        uneven, more = 0.1 * rng.normal(), float(rng.choice([0.0, 0.3]))
        damping = size[joint] * rng.uniform(0.02, 0.3) / max(float(speed.std()), 0.05)
        bent = 0.0
        for row, v in enumerate(speed.tolist()):
            side = 1.0 if v > 0.0 else -1.0
            bent = side + (bent - side) * np.exp(-abs(v) * STEP / distance)
            slow = 1.0 + more * np.exp(-((v / 0.04) ** 2))
            out[row, joint] = dry * (1.0 + uneven * (bent > 0.0)) * slow * bent + damping * v
    return out


@dataclass(frozen=True, eq=False)
class SwingingZero(Honest):
    """A healthy machine whose sensor's zero swings inside the tolerance of its drift."""

    def sense(self, seconds: Array, wrench: Array) -> Array:
        passed = seconds / seconds[-1]
        curve = np.sin(1.6 * np.pi * passed) / 2 - (passed - 0.5)
        return np.asarray(super().sense(seconds, wrench) + np.outer(curve, self.drift))


def profile_of(rng: np.random.Generator) -> Profile:
    """How the arm is recorded."""
    families = sorted(NOISES)
    return Profile(
        "random",
        "random",
        effort=True,
        wrench_rate=float(rng.choice([62.5, 100.0, 125.0, 250.0])),
        joint_rate=float(rng.choice([100.0, 250.0, 500.0])),
        noise=str(rng.choice(families)),
        force=float(rng.uniform(0.05, 0.2)),
        effort_noise=str(rng.choice(families)),
        encoder=float(rng.choice([0.5, 1.5])),
        bits=int(rng.choice([0, 16, 18])),
        velocity=str(rng.choice(["measured", "filtered", "absent"])),
        clock=str(rng.choice(["steady", "jitter"])),
    )


@dataclass(frozen=True, eq=False)
class Recording:
    """An arm and a motion of it, before anything acts that its model lacks.

    Args:
        declared: load and tolerances of the model. true: robot and load as they are.
        honest: errors inside the tolerances.
        track: what happened. acceleration: (N, J).
        size: (J,) N m, a large effort of each joint.
    """

    declared: Scene
    true: Scene
    profile: Profile
    honest: Honest
    track: Track
    acceleration: Array
    size: Array
    rng: np.random.Generator

    def save(self, case: Path, track: Track, honest: Honest, seed: Sequence[int]) -> None:
        """Write the recording of a track, and the model."""
        case.mkdir()
        recorder = Recorder(self.profile, self.true, honest, (), np.random.default_rng(seed))
        bag.write(recorder.record(track), case / "recording.mcap")
        load, frame = self.declared.load.whole, self.true.robot.frame
        model = {"sensor_frame": frame, "payload": load.document(), "tolerance": TOLERANCE}
        (case / "model.yaml").write_text(yaml.safe_dump(model))


def random_recording(seed: int, folder: Path) -> Recording:
    """An arm with its load, motion and recorder."""
    rng = np.random.default_rng([seed, 4711])
    robot, seconds = random_arm(folder, rng), float(rng.uniform(15.0, 40.0))
    load, motion = random_load(*robot.payload, rng), random_motion(robot, seconds, rng)
    declared = Scene(robot, load, motion)
    profile = profile_of(rng)
    honest = SwingingZero(**vars(draw(declared, rng, skew=profile.skew * 1e-6)))
    true = Scene(robot, honest.load(load), motion, None, honest.links, honest.gravity())
    rows = inner(motion)
    wrench, effort = rigid(true, motion[0], np.zeros((len(motion[0]), 3)), rows)
    position, velocity, acceleration = (part[rows] for part in motion)
    size = large_efforts(effort)
    true = replace(true, robot=with_noise_of(robot, size))
    free = np.zeros((len(rows), 3))
    places = np.zeros((len(rows), 3)), np.tile(np.eye(3), (len(rows), 1, 1))
    made = Track(rows * STEP, position, velocity, effort, free, free, wrench, np.zeros(len(rows)), *places)
    return Recording(declared, true, profile, honest, made, acceleration, size, rng)


def large_efforts(effort: Array) -> Array:
    """(J,) N m or N, a large effort of each joint along a motion (N, J)."""
    spread = effort.std(axis=0)
    return np.asarray(np.maximum(spread, 0.1 * spread.max()) + 0.1)


def with_noise_of(robot: Robot, size: Array) -> Robot:
    """The robot whose efforts have a noise that fits large ones (J,)."""
    return replace(robot, effort=tuple((0.015 * size).tolist()))


def inner(motion: Reference) -> NDArray[np.int64]:
    """(n,) steps with an acceleration."""
    return np.arange(_EDGE, len(motion[0]) - _EDGE)


def recorded(seed: int, folder: Path) -> tuple[Path, Path]:
    """The folders of the two recordings of an arm: as declared, and with friction and rotors."""
    arm = random_recording(seed, folder)
    made, size, rng = arm.track, arm.size, arm.rng
    rotors = size * rng.uniform(0.02, 0.3, len(size)) / np.maximum(arm.acceleration.std(axis=0), 0.2)
    loaded = made.effort + bristles(made.velocity, size, rng) + rotors * arm.acceleration
    cases = folder / "declared", folder / "friction"
    for number, (case, effort) in enumerate(zip(cases, (made.effort, loaded), strict=True)):
        arm.save(case, replace(made, effort=effort), arm.honest, [seed, number])
    return cases


@dataclass
class Counts:
    """What the answers said."""

    none: int = 0
    dry: int = 0
    others: int = 0
    false: int = 0
    errors: list[float] = field(default_factory=list)

    def add(self, healthy: dict[str, Any], loaded: dict[str, Any]) -> None:
        """The answers of one arm."""
        self.none += healthy["verdict"] == "none"
        names = {effect["name"] for effect in loaded["effects"]}
        self.dry += bool(names & set(DRY))
        self.others += names >= set(OTHER) or "stribeck_friction" in names
        self.false += bool(names - {*DRY, *OTHER})
        self.errors.append(float(loaded["fit"]["holdout"]["augmented"]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=7000, help="seed of the first arm")
    parser.add_argument("--count", type=int, default=20, help="number of arms")
    arguments = parser.parse_args()
    counts = Counts()
    for seed in track(range(arguments.first, arguments.first + arguments.count), description="arms"):
        with tempfile.TemporaryDirectory() as folder:
            answers = [answer(case, _LIMIT) for case in recorded(seed, Path(folder))]
        healthy, loaded = (each["answer"] for each in answers)
        if healthy is None or loaded is None:
            console.print(f"{seed}: {[each['message'] for each in answers]}")
            continue
        counts.add(healthy, loaded)
        said = [f"{effect['name']} {100 * effect['probability']:.0f} %" for effect in loaded["effects"]]
        console.print(f"{seed}: {healthy['verdict']}; {loaded['verdict']}: {', '.join(said)}")
    table = Table("result", "arms")
    total = len(counts.errors)
    table.add_row("as declared: verdict none", f"{counts.none} of {total}")
    table.add_row("friction: dry friction named", f"{counts.dry} of {total}")
    table.add_row("damping and rotors named", f"{counts.others} of {total}")
    table.add_row("another name", f"{counts.false} of {total}")
    spread = np.quantile(counts.errors, [0.5, 0.1, 0.9]) if counts.errors else np.full(3, np.nan)
    table.add_row("held-out error with friction: middle; 80 %", f"{spread[0]:.2f}; {spread[1]:.2f} to {spread[2]:.2f}")
    console.print(table)


if __name__ == "__main__":
    main()
