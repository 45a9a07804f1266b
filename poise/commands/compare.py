"""`poise compare`: what changed between two recordings of one robot."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from poise.commands.mismatch import SearchDeadlineOption, as_json, read_with_warnings
from poise.commands.output import JsonOption, console, progress_bar, refuse_folder, write_json
from poise.mismatch.answer import Quantity
from poise.mismatch.comparing import Change, Comparison
from poise.mismatch.comparing import compare as compare_recordings
from poise.mismatch.reading import NominalModel, ReadRecording, load_model
from poise.viewing import rounded

_FirstArgument = Annotated[Path, typer.Argument(metavar="A", help="Recording before: any format of mismatch.")]
_SecondArgument = Annotated[Path, typer.Argument(metavar="B", help="Recording after.")]
_ModelOption = Annotated[
    Path | None,
    typer.Option(
        "--model",
        metavar="FILE",
        help="model.yaml of the robot in both (default: the payload is identified from A).",
        show_default=False,
    ),
]


def compare(
    a: _FirstArgument,
    b: _SecondArgument,
    model: _ModelOption = None,
    deadline: SearchDeadlineOption = math.inf,
    json_target: JsonOption = None,
) -> None:
    """Identify what changed from one recording of a robot to another.

    The motions are matched by themselves: B may start elsewhere, run at another speed, or pause. At the same postures,
    what the model lacks in both recordings cancels. Different motions are refused.

    Example:  poise compare before.mcap after.mcap --model model.yaml --json answer.json
    """
    refuse_folder(json_target, "--json")
    nominal = NominalModel() if model is None else load_model(model)
    readings = read_with_warnings([a, b], nominal)
    before, after = (reading.recorded for reading in readings)
    with progress_bar("comparing") as progress:
        found = compare_recordings(before, after, readings[0].model, deadline=deadline, progress=progress)
    chosen = readings[1 if found.side == "b" else 0]
    write_json(json_target, _as_json(found, chosen))
    people = console(json_target)
    for note in found.notes:
        people.print(escape(note[0].upper() + note[1:] + "."), soft_wrap=True)
    if found.verdict == "none":
        people.print("Nothing changed by more than the tolerances.")
    for change in found.changes:
        people.print(f"{escape(change.sentence)} ({100 * change.finding.belief.probability:.1f} %)", soft_wrap=True)
        people.print(_table(change))
    if found.diagnosis.unknown is not None:
        people.print(f"Something else changed: {escape(found.diagnosis.unknown.sentence)}", soft_wrap=True)
    proof = found.diagnosis.main.proof
    people.print(
        f"Held-out difference, in units of the noise: {proof.nominal:.2f}, and {proof.augmented:.2f} with the changes.",
        soft_wrap=True,
    )


def _as_json(found: Comparison, reading: ReadRecording) -> dict[str, Any]:
    """The fields of a diagnosis of the recording that was read, and those of a comparison."""
    content, matched = as_json(found.diagnosis, [reading]), found.alignment
    by_name = {change.finding.effect.name: change for change in found.changes}
    effects = [effect for effect in content["effects"] if effect["name"] in by_name]
    for effect in effects:
        change = by_name[effect["name"]]
        effect["present_in"] = change.present_in
        effect["more_in"] = change.more_in
        effect["change"] = {name: asdict(number) for name, number in change.change.items()}
        effect["in_a"] = {name: asdict(number) for name, number in change.before.items()}
    return content | {
        "verdict": found.verdict,
        "effects": effects,
        "alignment": {"share": matched.share, "rate": matched.rate, "notes": list(found.notes)},
        "seconds": found.seconds,
    }


def _table(change: Change) -> Table:
    title = change.finding.effect.name
    table = Table("", "change", "one sigma", "in A", "unit", title=title, title_justify="left")
    for name, number in change.change.items():
        value, sigma = rounded(number.value, number.std)
        before: Quantity | None = change.before.get(name)
        table.add_row(name, value, sigma, "" if before is None else f"{before.value:.4g}", number.unit)
    return table
