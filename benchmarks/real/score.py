"""Run `poise mismatch` on real recordings and compare it with published values: `python -m benchmarks.real.score OUT`.

OUT is what benchmarks.real.make wrote. The tool runs in an empty folder with the recording alone; the sealed file is
opened after it has answered. Beside it stands least squares with the true structure.
"""

import argparse
import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from benchmarks.concealed.run import run_tool
from benchmarks.real.least_squares import Fit, fit
from benchmarks.real.rigs import RECORDING, RIGS, VALIDATION, Rig
from poise.recording import open_recording

SEALED = Path(__file__).with_name("sealed") / "published.yaml"
ANSWERS = "answers.json"
_PUBLISHED = {
    "viscous_friction": ("damping", "viscous"),
    "coulomb_friction": ("torque", "coulomb"),
    "motor_inertia": ("inertia", "rotor"),
}
_COUPLED = {"inertia": "rotor", "damping": "viscous", "friction": "coulomb"}


@dataclass(frozen=True)
class Answer:
    """What the tool said of one recording.

    Args:
        verdict: as in its JSON; "refused" when it gave no answer.
        named: belief by effect.
        errors: held-out error of the nominal model, with calibration, and with the effects; empty without an answer.
        nrmse: of each joint's effort: nominal and augmented on all samples, held_out on those that the fit did not see.
        parameters: value by effect and parameter.
        seconds: wall time.
        complaint: what it said of the recording itself, or the last line on stderr when it gave no answer.
    """

    verdict: str
    named: dict[str, float]
    errors: dict[str, float]
    nrmse: dict[str, dict[str, float]]
    parameters: dict[str, dict[str, float]]
    seconds: float
    complaint: str


def ask(folder: Path) -> Answer:
    """Run the tool in an empty folder where the recordings have no names of their own; a validation run comes last."""
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        bags = [name for name in (RECORDING, VALIDATION) if (folder / name).exists()]
        for name in bags:
            shutil.copy(folder / name, place / name)
        seconds, status, complaint = run_tool(place, ["mismatch", *bags, "--json", "answer.json"])
        if not (place / "answer.json").exists():
            lines = complaint.strip().splitlines() or [f"exit status {status}"]
            return Answer("refused", {}, {}, {}, {}, seconds, lines[-1])
        content = json.loads((place / "answer.json").read_text())
    fit, effects = content["fit"] or {}, content["effects"]
    named = {effect["name"]: float(effect["probability"]) for effect in effects}
    values = {
        effect["name"]: {name: float(entry["value"]) for name, entry in effect["parameters"].items()}
        for effect in effects
    }
    said = "; ".join(finding["sentence"] for finding in content["input_findings"])
    errors, nrmse = fit.get("holdout", {}), fit.get("nrmse", {})
    return Answer(str(content["verdict"]), named, errors, nrmse, values, seconds, said)


def baseline(rig: Rig, folder: Path) -> Fit | None:
    """Least squares with the true structure; None where none is published."""
    if rig.structure is None:
        return None
    second = folder / VALIDATION
    validation = open_recording(second) if second.exists() else None
    return fit(open_recording(folder / RECORDING), rig.structure, validation)


def judged(answer: Answer, effects: list[str], accepts: Sequence[str] = ()) -> str:
    """Which effects were named rightly, wrongly, or not at all; what the makers' model also contains is not wrong."""
    if answer.verdict == "refused":
        return f"refused: {answer.complaint.removeprefix('poise: ').partition(':')[0]}"
    known = {*effects, *accepts}
    parts = [
        f"{name} {100 * belief:.0f} %{'' if name in known else ' (false)'}" for name, belief in answer.named.items()
    ]
    missed = [name for name in effects if name not in answer.named]
    said = [answer.complaint] if answer.complaint else []
    return "; ".join([*(parts or ["nothing named"]), *([f"missed {', '.join(missed)}"] if missed else []), *said])


def values_of(answer: Answer) -> dict[str, float]:
    """The values of an answer by the names of the sealed file."""
    found = {
        f"{known}_{parameter.rpartition('_')[2]}": value
        for effect, (stem, known) in _PUBLISHED.items()
        for parameter, value in answer.parameters.get(effect, {}).items()
        if parameter.startswith(stem)
    }
    coupling = answer.parameters.get("joint_coupling", {})
    if coupling:
        pair = "_".join(f"{number:.0f}" for number in sorted((coupling["driving"], coupling["driven"])))
        found |= {f"coupled_{known}_{pair}": coupling[name] for name, known in _COUPLED.items()}
    return found


def deviations(found: dict[str, float], values: dict[str, float]) -> str:
    """How far the values found are from the published ones, %, in the middle and at worst."""
    errors = {name: 100 * abs(found[name] / value - 1) for name, value in values.items() if name in found}
    if not errors:
        return "-"
    worst = max(errors, key=lambda name: errors[name])
    return f"{np.median(list(errors.values())):.1f} %, {worst} {errors[worst]:.0f} %"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--baseline", action="store_true", help="least squares alone")
    arguments = parser.parse_args()
    rigs = [rig for rig in RIGS if (arguments.folder / rig.name / RECORDING).exists()]
    if not rigs:
        parser.error(f"{arguments.folder} has no recordings: make them first with benchmarks.real.make")
    answers = {} if arguments.baseline else {rig.name: ask(arguments.folder / rig.name) for rig in rigs}
    published: dict[str, Any] = yaml.safe_load(SEALED.read_text())
    table = Table()
    for heading in (
        "rig",
        "held-out error: nominal, answer",
        "named (belief)",
        "NRMSE: nominal, answer, held out",
        "off",
        "least squares: NRMSE, moving, nominal",
        "off",
    ):
        table.add_column(heading)
    kept = {}
    for rig in rigs:
        answer, found, sealed = answers.get(rig.name), baseline(rig, arguments.folder / rig.name), published[rig.name]
        said = "-" if answer is None else judged(answer, sealed["effects"], sealed.get("accepts", ()))
        errors = answer.errors if answer else {}
        shown = f"{errors['nominal']:.3g}, {errors['augmented']:.3g}" if errors else "-"
        squares = (
            "-"
            if found is None
            else ", ".join(f"{part.mean():.3f}" for part in (found.nrmse, found.moving, found.nominal))
        )
        nrmse = answer.nrmse if answer else {}
        means = [
            float(np.mean([joint[kind] for joint in nrmse.values()])) for kind in ("nominal", "augmented") if nrmse
        ]
        off = deviations(values_of(answer), sealed["values"]) if answer else "-"
        known = "-" if found is None else deviations(found.values, sealed["values"])
        table.add_row(rig.title, shown, said, ", ".join(f"{mean:.3f}" for mean in means) or "-", off, squares, known)
        kept[rig.name] = {
            "verdict": answer.verdict if answer else None,
            "named": answer.named if answer else {},
            "errors": errors,
            "nrmse": nrmse,
            "parameters": answer.parameters if answer else {},
            "seconds": answer.seconds if answer else None,
            "least_squares": None if found is None else {"nrmse": found.nrmse.tolist(), "values": found.values},
        }
    (arguments.folder / ANSWERS).write_text(json.dumps(kept, indent=1))
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
