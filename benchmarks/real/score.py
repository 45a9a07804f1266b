"""Run `poise mismatch` on real recordings and compare it with published values: `python -m benchmarks.real.score OUT`.

OUT is what benchmarks.real.make wrote. The tool runs in an empty folder with the recording alone; the sealed file is
opened after it has answered. Beside it stands least squares with the true structure.
"""

import argparse
import json
import shutil
import tempfile
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


@dataclass(frozen=True)
class Answer:
    """What the tool said of one recording.

    Args:
        verdict: as in its JSON; "refused" when it gave no answer.
        named: belief by effect.
        errors: held-out error of the nominal model, with calibration, and with the effects; empty where no signal was
            examined.
        seconds: wall time.
        complaint: the last line on stderr, when it gave no answer.
    """

    verdict: str
    named: dict[str, float]
    errors: dict[str, float]
    seconds: float
    complaint: str


def ask(recording: Path) -> Answer:
    """Run the tool in an empty folder where the recording has no name of its own."""
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        shutil.copy(recording, place / RECORDING)
        seconds, status, complaint = run_tool(place, ["mismatch", RECORDING, "--json", "answer.json"])
        if status != 0:
            lines = complaint.strip().splitlines() or [f"exit status {status}"]
            return Answer("refused", {}, {}, seconds, lines[-1])
        content = json.loads((place / "answer.json").read_text())
    named = {effect["name"]: float(effect["probability"]) for effect in content["effects"]}
    return Answer(str(content["verdict"]), named, (content["fit"] or {}).get("holdout", {}), seconds, "")


def baseline(rig: Rig, folder: Path) -> Fit | None:
    """Least squares with the true structure; None where none is published."""
    if rig.structure is None:
        return None
    second = folder / VALIDATION
    validation = open_recording(second) if second.exists() else None
    return fit(open_recording(folder / RECORDING), rig.structure, validation)


def judged(answer: Answer, effects: list[str]) -> str:
    """Which effects were named rightly, wrongly, or not at all."""
    if answer.verdict == "refused":
        return f"refused: {answer.complaint.removeprefix('poise: ').partition(':')[0]}"
    parts = [
        f"{name} {100 * belief:.0f} %{'' if name in effects else ' (false)'}" for name, belief in answer.named.items()
    ]
    missed = [name for name in effects if name not in answer.named]
    return "; ".join([*(parts or ["nothing named"]), *([f"missed {', '.join(missed)}"] if missed else [])])


def deviations(found: Fit, values: dict[str, float]) -> str:
    """How far the fitted values are from the published ones, %, in the middle and at worst."""
    if not values:
        return "-"
    errors = {name: 100 * abs(found.values[name] / value - 1) for name, value in values.items()}
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
    answers = {} if arguments.baseline else {rig.name: ask(arguments.folder / rig.name / RECORDING) for rig in rigs}
    published: dict[str, Any] = yaml.safe_load(SEALED.read_text())
    table = Table()
    for heading in (
        "rig",
        "held-out error: nominal, answer",
        "named (belief)",
        "least squares: NRMSE, moving, nominal",
        "off",
    ):
        table.add_column(heading)
    kept = {}
    for rig in rigs:
        answer, found, sealed = answers.get(rig.name), baseline(rig, arguments.folder / rig.name), published[rig.name]
        said = "-" if answer is None else judged(answer, sealed["effects"])
        errors = answer.errors if answer else {}
        shown = f"{errors['nominal']:.3g}, {errors['augmented']:.3g}" if errors else "-"
        squares = (
            "-"
            if found is None
            else ", ".join(f"{part.mean():.3f}" for part in (found.nrmse, found.moving, found.nominal))
        )
        table.add_row(rig.title, shown, said, squares, "-" if found is None else deviations(found, sealed["values"]))
        kept[rig.name] = {
            "verdict": answer.verdict if answer else None,
            "named": answer.named if answer else {},
            "errors": errors,
            "least_squares": None if found is None else {"nrmse": found.nrmse.tolist(), "values": found.values},
        }
    (arguments.folder / ANSWERS).write_text(json.dumps(kept, indent=1))
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
