"""Diagnoses of the foreign effects on random robots, each with its own axes, mounting, motion, clocks and noise.

python -m benchmarks.random_effects [--first SEED] [--count N] [--keep DIR]; 7000 to 7999 are for development.
python -m benchmarks.random_effects --known        # those that once had a false name; exits with 1 if one has again

MuJoCo integrates each robot under its controller. In turn of eight: nothing is wrong; one effect of the library at
strength 1.0 and at 0.3, three times each; one effect outside the library. Errors are at the edges of their tolerances.
"""

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.foreign.case import Case, case_of
from benchmarks.foreign.honest import draw
from benchmarks.foreign.load import random_load
from benchmarks.foreign.motions import MOTIONS, Reference
from benchmarks.foreign.outside import OUTSIDE
from benchmarks.foreign.plan import LIBRARY, Plan, applicable
from benchmarks.foreign.profiles import Profile
from benchmarks.foreign.recorder import DRIVER_DELAY
from benchmarks.foreign.robots import Robot
from benchmarks.foreign.run import answer
from benchmarks.foreign.score import calibration_error, judge, table
from benchmarks.foreign.strength import Rig
from benchmarks.foreign.world import Scene, rigid
from benchmarks.random_arms import inner, large_efforts, profile_of, random_arm, random_motion, with_noise_of

TURNS = (("healthy", 0.0), *(("single", 1.0), ("single", 0.3)) * 3, ("outside", 1.0))
"""Kinds and strengths of successive seeds."""
KNOWN = {
    7026: "base_motion",  # filtered efforts, which looked like damping; the motion is too weak
    7027: "base_tilt",  # efforts alone under coloured noise
    7046: "slosh",  # joint states at 500 Hz that arrive in bursts
    7227: "cable",  # efforts alone, in which a contact without proof kept it away
    7269: "backlash",  # shakes other joints more than its own
    7291: "coulomb_friction",  # whose law of reversal is no other friction
    7310: "flexible_mode",  # efforts alone
    7525: "coulomb_friction",  # stick-slip, whose noisy acceleration a spring would smooth
    7530: "load_dependent_friction",  # reverses along a path, as Coulomb friction did alone
    9141: "stribeck_friction",  # a tight spot took the place of the Coulomb friction that both contain
}
"""Effects of seeds for which false names were corrected."""
TOO_WEAK = {7026}
"""Of these, seeds whose effect is not found."""
_LIMIT = 300
"""s of CPU for one answer."""
_SLIDES = 0.15
"""Share of the joints that are slides."""
console = Console(width=160)


def random_profile(rng: np.random.Generator) -> Profile:
    """How a robot is recorded: with a wrench, with efforts or with both, filtered or not, with losses."""
    wrench, effort = ((True, True), (True, False), (False, True))[int(rng.integers(3))]
    filtering = str(rng.choice(["none", "driver", "offline"], p=[0.7, 0.15, 0.15]))
    made = replace(profile_of(rng), wrench=wrench, effort=effort, filtering=filtering)
    if filtering == "offline":  # steps that are coarser than a smoothed noise are a fault
        noise, effort_noise = ("white" if each == "quantised" else each for each in (made.noise, made.effort_noise))
        made = replace(made, noise=noise, effort_noise=effort_noise)
    return replace(
        made,
        skew=float(rng.uniform(-40.0, 40.0)),
        lost=float(rng.choice([0.0, 0.02])),
        clock="steady" if filtering == "offline" else str(rng.choice(["steady", "jitter", "late"])),
    )


def random_rig(seed: int, folder: Path) -> Rig:
    """A robot with its load, motion and recorder, before any effect."""
    rng = np.random.default_rng([seed, 4713])
    robot, seconds = random_arm(folder, rng, _SLIDES), float(rng.uniform(15.0, 40.0))
    load, profile = random_load(*robot.payload, rng), random_profile(rng)
    motions: dict[str, Callable[[Robot, float, np.random.Generator], Reference]] = {"random": random_motion, **MOTIONS}
    motion = motions[str(rng.choice(list(motions)))](robot, seconds, rng)
    declared = Scene(robot, load, motion)
    _, effort = rigid(declared, motion[0], np.zeros((len(motion[0]), 3)), inner(motion))
    declared = replace(declared, robot=with_noise_of(robot, large_efforts(effort)))
    honest = draw(declared, rng, DRIVER_DELAY if profile.filtering == "driver" else 0.0, profile.skew * 1e-6)
    stiffness = float(rng.uniform(25.0, 50.0))
    true = replace(declared, load=honest.load(load), link_gain=honest.links, tilt=honest.gravity(), stiffness=stiffness)
    return Rig(profile, declared, true, honest)


def random_case(seed: int, folder: Path) -> Case:
    """The recording of a seed, with its label."""
    rig = random_rig(seed, folder)
    kind, strength = TURNS[seed % len(TURNS)]
    pool = OUTSIDE if kind == "outside" else LIBRARY
    fitting = [fault.name for fault in pool if applicable(rig.profile, rig.declared.robot, fault)]
    for_order, for_fault, for_recorder = (np.random.default_rng([seed, number]) for number in (4714, 4715, 4716))
    order = for_order.permutation(fitting) if kind != "healthy" else ()
    plan = Plan((seed, 0), kind, "random", tuple(str(name) for name in order), strength)
    return case_of(rig, plan, "random", for_fault, for_recorder)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=7000, help="seed of the first robot")
    parser.add_argument("--count", type=int, default=24, help="number of robots")
    parser.add_argument("--keep", type=Path, help="folder that keeps recordings, labels and answers")
    parser.add_argument("--known", action="store_true", help="the robots that once had a false name")
    arguments = parser.parse_args()
    seeds = list(KNOWN) if arguments.known else range(arguments.first, arguments.first + arguments.count)
    verdicts = []
    for seed in track(seeds, description="robots"):
        with tempfile.TemporaryDirectory() as folder:
            case, made = Path(folder) / "case", random_case(seed, Path(folder))
            made.write(case)
            given = answer(case, _LIMIT)
            if arguments.keep is not None:
                shutil.copytree(case, arguments.keep / str(seed), dirs_exist_ok=True)
                kept = json.dumps({"label": made.label, **given}, indent=1, default=str)
                (arguments.keep / f"{seed}.json").write_text(kept, encoding="utf-8")
        verdict = judge(str(seed), made.label, given)
        verdicts.append(verdict)
        said = ", ".join(f"{name} {100 * p:.0f} %" for name, (p, _) in zip(verdict.named, verdict.stated, strict=True))
        mark = "  " if verdict.right and not verdict.extra else "* "
        true = ", ".join(f"{name} {verdict.strength:g}" for name in verdict.truth) or "-"
        console.print(f"{mark}{seed} {verdict.kind} {true}: {verdict.verdict or given['message']}: {said or '-'}")
    for row in table(verdicts):
        console.print(f"{row.what}: {row.text()}")
    stated = [pair for verdict in verdicts for pair in verdict.stated]
    console.print(f"expected calibration error: {calibration_error(stated):.2f} of {len(stated)} names")
    if arguments.known and any(verdict.extra for verdict in verdicts):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
