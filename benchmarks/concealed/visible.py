"""Evidence for each concealed effect that is tried alone: `python -m benchmarks.concealed.visible DIR DIR.seals.json`.

Calibration errors inside their tolerances may explain as much as a weak effect does: then no method that takes the
tolerances as bounds can name it. The tool is given the true effect as its whole library; a name needs 6 nats (readings
alone show `saturation`, and friction is selected by its error on other blocks).
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.concealed.run import ANSWERS
from benchmarks.concealed.score import read_json
from benchmarks.concealed.seals import open_seals
from poise.mismatch.answer import diagnose, effects_called
from poise.mismatch.reading import load_model, read_recording
from poise.recording import open_recording

NEEDED = 6.0
"""nats that a name needs."""


def evidence(folder: Path, case: str, names: Sequence[str]) -> float:
    """log evidence that the true effects win over the nominal model, when no other effect is tried."""
    model = load_model(folder / f"{case}.yaml")
    reading = read_recording(open_recording(folder / f"{case}.mcap"), model)
    found = diagnose(reading.recorded, reading.model, library=effects_called(names))
    won = [-math.inf]
    for each in found.examinations:
        nominal = each.search.fits[()].log_evidence
        won += [fit.log_evidence - nominal for key, fit in each.search.fits.items() if key and set(key) <= set(names)]
        won += [gain for (key, name), gain in each.search.gains.items() if not key and name in names]
    return max(won)


def named(folder: Path, case: str) -> str:
    """What the tool has answered, if it has."""
    answer: dict[str, Any] = read_json(folder / ANSWERS / f"{case}.json") or {}
    return ", ".join(each["name"] for each in answer.get("effects", [])) or str(answer.get("verdict", "-"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("seals", type=Path)
    parser.add_argument("--cases", nargs="+", default=[], help="of these alone")
    arguments = parser.parse_args()
    table = Table("case", "strength", "effect", "evidence, nats", "answer")
    counts = {1.0: [0, 0], 0.3: [0, 0]}
    for case, label in track(sorted(open_seals(arguments.folder, arguments.seals).items()), "effects tried alone"):
        if label["kind"] not in ("single", "twin") or (arguments.cases and case not in arguments.cases):
            continue
        truth = [each["name"] for each in label["effects"]]
        nats = evidence(arguments.folder, case, truth)
        answer = named(arguments.folder, case)
        table.add_row(case, f"{label['strength']:g}", ", ".join(truth), f"{nats:.1f}", answer)
        if label["kind"] == "single" and label["strength"] in counts:
            counts[label["strength"]][0] += nats >= NEEDED or answer.split(", ")[0] in truth
            counts[label["strength"]][1] += 1
    console = Console(width=110)
    console.print(table)
    for strength, (visible, cases) in counts.items():
        console.print(f"single effects at {strength:g} with {NEEDED:.0f} nats or more, or named: {visible} of {cases}")


if __name__ == "__main__":
    main()
