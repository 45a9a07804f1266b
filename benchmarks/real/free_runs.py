"""Free runs on real recordings, before and after the export: `python -m benchmarks.real.free_runs --data DATA`.

- SO-101 (commands and states at 50 Hz, efforts without sign): the nominal model is the URDF with the drives of the
  arm's public MJCF (kp 998.22, kv 2.731, 2.94 N m; damping 0.6, friction 0.052, rotor 0.028). Drives are fitted to one
  motion, and the exported file runs under the commands of that motion's last 30 % and of the other motions.
- UR10 (efforts, no commands): the nominal model is the URDF. The exported file runs under the efforts of the last 30 %
  of the recording and of the validation run.
"""

import argparse
import json
import os
import re
import shutil
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.real.make import DATA
from benchmarks.real.rigs import EXAMPLES, convert_ur10
from poise.cli import run
from poise.files import write_whole

FITTED, OTHERS = "friction_gravity", ("multisine", "pick_place", "chirp_sweep")
SERVO = {"kp": 998.22, "kv": 2.731}
LIMIT, DAMPING, FRICTION, ROTOR = 2.94, 0.6, 0.052, 0.028


def as_mjcf(urdf: Path, target: Path, servos: bool) -> None:
    """The URDF as MJCF without shapes; with the servos of the SO-101."""
    shapes = r"<(visual|collision)\b.*?</\1>|<(visual|collision)\b[^>]*/>"
    spec = mujoco.MjSpec.from_string(re.sub(shapes, "", urdf.read_text(), flags=re.DOTALL))
    spec.compiler.fusestatic = False
    spec.option.timestep = 0.002 if servos else 0.001
    for joint in spec.joints if servos else ():
        joint.damping = [DAMPING, 0.0, 0.0] if np.ndim(joint.damping) else DAMPING
        joint.frictionloss, joint.armature = FRICTION, ROTOR
        drive = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.set_to_position(**SERVO)
        drive.forcerange, drive.forcelimited = [-LIMIT, LIMIT], 1
    spec.compile()
    target.write_text(spec.to_xml())


def asked(words: list[str], answer: Path) -> dict[str, Any]:
    """The JSON of a command that ends well."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        status = run([*words, "--json", str(answer)])
    if status:
        raise SystemExit(f"{' '.join(words)} ended with {status}")
    content: dict[str, Any] = json.loads(answer.read_text())
    return content


def free_runs(model: Path, found: Path, bag: str, held: str, answer: Path) -> list[tuple[float, float, float]]:
    """(length, error before, error after), s and rad, of every length."""
    rolled = asked(["rollout", str(model), str(found), "--commands", bag, "--held-out", held], answer)
    before, after = (each["windows"] for each in rolled["models"])
    return [(one["length"], one["error"], other["error"]) for one, other in zip(before, after, strict=True)]


def so101(data: Path, out: Path) -> dict[str, list[tuple[float, float, float]]]:
    """SO-101: by motion."""
    urdf = data / "so101" / "so101_new_calib.urdf"
    as_mjcf(urdf, out / "so101.xml", servos=True)
    for motion in (FITTED, *OTHERS):
        place = out / motion
        shutil.copytree(data / "so101" / motion, place, dirs_exist_ok=True, copy_function=shutil.copyfile)
        shutil.copyfile(urdf, place / urdf.name)
        shutil.copyfile(EXAMPLES / "so101.yaml", place / "columns.yaml")
    model, found = out / "so101.xml", out / "so101_found.xml"
    words = ["mismatch", str(out / FITTED), "--model", str(model), "--export", f"mjcf:{found}", "--into", str(model)]
    asked(words, out / "so101.json")
    motions = {FITTED: "0.3"} | dict.fromkeys(OTHERS, "1.0")
    return {name: free_runs(model, found, str(out / name), held, out / "r.json") for name, held in motions.items()}


def ur10(data: Path, out: Path) -> dict[str, list[tuple[float, float, float]]]:
    """UR10: by recording."""
    convert_ur10(data, out)
    model, found = out / "ur10.xml", out / "ur10_found.xml"
    as_mjcf(data / "ur10_unisa" / "ur10_robot.urdf", model, servos=False)
    bag = str(out / "recording.mcap")
    words = ["mismatch", bag, "--model", str(model), "--export", f"mjcf:{found}", "--into", str(model)]
    asked(words, out / "ur10.json")
    bags = {"recording": "0.3", "validation": "1.0"}
    return {n: free_runs(model, found, str(out / f"{n}.mcap"), held, out / "r.json") for n, held in bags.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = os.environ.get(DATA)
    parser.add_argument("--data", type=Path, default=Path(default) if default else None, help=f"default: ${DATA}")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/free_runs"))
    options = parser.parse_args()
    if options.data is None:
        parser.error(f"give --data, or set {DATA}")
    options.output.mkdir(parents=True, exist_ok=True)
    results = {"SO-101": so101(options.data, options.output), "UR10": ur10(options.data, options.output)}
    write_whole(options.output / "results.json", json.dumps(results, indent=1).encode())
    table = Table("rig", "motion", "windows, s", "error before, rad", "after", "ratio")
    for rig, motions in results.items():
        for motion, rows in motions.items():
            for length, before, after in rows:
                ratio = f"{after / before:.2f}"
                table.add_row(rig, motion, f"{length:g}", f"{before:.4f}", f"{after:.4f}", ratio)
    Console().print(table)


if __name__ == "__main__":
    main()
