"""Where a tolerance ends: one calibration error at multiples of its edge, on recordings of the foreign generator.

    python -m benchmarks.tolerances            # 12 errors, 5 sizes, 3 rigs: about twenty minutes
    python -m benchmarks.tolerances --quick    # one rig, two sizes, 10 s of motion: about two minutes

All errors but one are zero. Up to the edge the answer must be `none`. Beyond it a name or `unknown` is a finding; other
tolerances together may still explain the error. Prints a table and writes out/benchmarks/tolerances.json. Exits with 1
when an error inside its tolerance is a finding.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.foreign.case import Case, draw_rig, model_of
from benchmarks.foreign.fault import direction
from benchmarks.foreign.honest import CLOCK_EDGE, Honest
from benchmarks.foreign.profiles import BY_NAME
from benchmarks.foreign.recorder import Recorder
from benchmarks.foreign.robots import Array
from benchmarks.foreign.run import answer
from benchmarks.foreign.strength import Rig
from poise.files import write_whole

RIGS = ("fr3_fast", "xarm7_teaching", "ur10_smoothed")
FACTORS = (0.5, 0.95, 1.5, 2.0, 4.0)
SECONDS, LIMIT = 20.0, 300
"""s of motion, and s of CPU for one answer."""
SEED = 51907
LEVER = 0.1
"""m, between the tolerances of force and torque."""
NAMES = (
    "payload: mass",
    "payload: centre of mass",
    "payload: inertia",
    "sensor_bias: force",
    "sensor_bias: torque",
    "bias_drift",
    "sensor_gain: axes",
    "sensor_gain: across forces",
    "sensor_gain: force to torque",
    "sensor_rotation",
    "joint_offset",
    "clock_offset",
)


def edges(honest: Honest, rng: np.random.Generator) -> dict[str, tuple[str, Array | float]]:
    """Each error at the edge of its tolerance: the field of `Honest`, and its value."""

    def sign(*shape: int) -> Array:
        return np.asarray(rng.choice([-1.0, 1.0], shape))

    entries = 0.01 * sign(6, 6)
    forces, lever = np.zeros((6, 6)), np.zeros((6, 6))
    forces[:3, :3] = (entries * (1.0 - np.eye(6)))[:3, :3]
    lever[3:, :3] = LEVER * entries[3:, :3]
    made = (
        ("mass", 0.01),
        ("com", 0.002 * direction(rng)),
        ("inertia", 0.1),
        ("bias", np.repeat([0.4, 0.0], 3) * sign(6)),
        ("bias", np.repeat([0.0, 0.025], 3) * sign(6)),
        ("drift", np.repeat([0.12, 0.008], 3) * sign(6)),
        ("gain", entries * np.eye(6)),
        ("gain", forces),
        ("gain", lever),
        ("rotation", 0.004 * direction(rng)),
        ("zeros", 0.001 * sign(len(honest.zeros))),
        ("late", CLOCK_EDGE),
    )
    return dict(zip(NAMES, made, strict=True))


def make(name: str, rig_name: str, factor: float, seconds: float) -> Case:
    """A recording with one error at a multiple of its edge."""
    scene, errors, recorder = (np.random.default_rng([SEED, i]) for i in range(3))
    profile = BY_NAME[rig_name]
    rig, _ = draw_rig(profile, scene, np.random.default_rng(SEED), seconds)
    field, value = edges(rig.honest, errors)[name]
    honest = replace(perfect(rig.honest), **{field: factor * value})
    true = replace(rig.declared, load=honest.load(rig.declared.load))
    rig = Rig(profile, rig.declared, true, honest)
    return Case(Recorder(profile, true, honest, (), recorder).record(rig.run(())), model_of(rig), {})


def perfect(like: Honest) -> Honest:
    """A rig of the same robot without errors."""
    none = np.zeros
    whole = dict.fromkeys(like.links, 1.0)
    return Honest(
        0.0, none(3), 0.0, none((6, 6)), none(3), none(6), none(6), none(like.zeros.shape), none(2), whole, 0.0
    )


def finding(case: Case) -> str:
    """What the tool finds: the names, `unknown` or `none`."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "case"
        case.write(folder)
        said = answer(folder, LIMIT)
    content = said["answer"]
    if content is None:
        raise RuntimeError(said["message"])
    return " + ".join(effect["name"] for effect in content["effects"]) or str(content["verdict"])


def main() -> int:
    """Answer all recordings; 0 when no error inside its tolerance is a finding."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one rig, two sizes, 10 s of motion")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/tolerances.json"))
    options = parser.parse_args()
    rigs, factors = (RIGS[:1], FACTORS[1:4:2]) if options.quick else (RIGS, FACTORS)
    seconds = 10.0 if options.quick else SECONDS
    found = {
        name: {str(factor): [finding(make(name, rig, factor, seconds)) for rig in rigs] for factor in factors}
        for name in track(NAMES, "errors", console=Console(stderr=True))
    }
    table = Table("error", *(f"{factor:g} x" for factor in factors))
    for name, row in found.items():
        table.add_row(name, *(", ".join(each) for each in row.values()))
    Console().print(table)
    write_whole(options.output, json.dumps(found, indent=1).encode())
    inside = [said for row in found.values() for factor, each in row.items() if float(factor) <= 1.0 for said in each]
    return int(any(said != "none" for said in inside))


if __name__ == "__main__":
    sys.exit(main())
