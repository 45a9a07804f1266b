"""`poise compare`: what changed between recordings of one robot."""

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.commands.mismatch_answer import as_json, print_written, write_report
from poise.commands.output import (
    JsonOption,
    SearchDeadlineOption,
    console,
    progress_bar,
    refuse_folder,
    warn,
    write_json,
)
from poise.errors import ErrorCode, InputError, PoiseError
from poise.mismatch.answer import Quantity
from poise.mismatch.comparing import Change, Comparison, History, history, other_joints
from poise.mismatch.comparing import compare as compare_recordings
from poise.mismatch.reading import NominalModel, ReadRecording, load_model, read_joint_names, read_recording
from poise.recording import Recording, find_recordings, open_recording
from poise.simulation.models import SimulatorModel
from poise.viewing import rounded

_MOST = 50
"""Recordings that are compared at once."""
_FOLDER_OF_ONE = ("metadata.yaml", "columns.yaml")

_FirstArgument = Annotated[
    Path, typer.Argument(metavar="A", help="Recording before, in any format of mismatch, or a folder of recordings.")
]
_SecondArgument = Annotated[Path, typer.Argument(metavar="B", help="Recording after, or a folder of recordings.")]
_ModelOption = Annotated[
    Path | None,
    typer.Option(
        "--model",
        metavar="FILE",
        help="model.yaml, MJCF or SDF of the robot in both (default: the payload is identified from A).",
        show_default=False,
    ),
]
_ReportOption = Annotated[
    Path | None,
    typer.Option("--report", metavar="DIR", help="Write an HTML report of the difference.", show_default=False),
]
JointsOption = Annotated[
    str | None,
    typer.Option(
        "--joints",
        metavar="B=A,...",
        help="Joints that B calls otherwise, with the names that A has.",
        show_default=False,
    ),
]


def compare(
    a: _FirstArgument,
    b: _SecondArgument,
    model: _ModelOption = None,
    joints: JointsOption = None,
    report: _ReportOption = None,
    deadline: SearchDeadlineOption = math.inf,
    json_target: JsonOption = None,
) -> None:
    """Identify what changed from one recording of a robot to another, or from several to several.

    The motions are matched by themselves: B may start elsewhere, run at another speed, or pause. At the same postures,
    what the model lacks in both recordings cancels. Different motions are compared through the model: what A lacks
    becomes part of it. Of folders, every recording is compared with the earliest of A, and the answer says when each
    change appeared.

    Example:  poise compare before.mcap after.mcap --model model.yaml --json answer.json
    """
    refuse_folder(json_target, "--json")
    nominal = NominalModel() if model is None else load_model(model)
    called = read_joint_names(joints)
    befores, afters = recordings_at(a), recordings_at(b)
    if len(befores) + len(afters) > 2:
        if report is not None:
            raise InputError(ErrorCode.BAD_INPUT, "--report is of two recordings: give files, not folders")
        _compare_several(befores, afters, nominal, called, json_target)
        return
    readings = read_alike([*befores, *afters], nominal, {1: called})
    before, after = (reading.recorded for reading in readings)
    with progress_bar("comparing") as progress:
        found = compare_recordings(before, after, readings[0].model, deadline=deadline, progress=progress)
    chosen = readings[1 if found.side == "b" else 0]
    notes = [*found.notes, *(change.sentence for change in found.changes)]
    written = [] if report is None else write_report(report, [a, b], notes, found.diagnosis, "What changed:")
    write_json(json_target, comparison_json(found, chosen))
    people = console(json_target)
    print_comparison(people, found)
    print_written(people, written)


def recordings_at(path: Path) -> list[Path]:
    """The recordings that a path stands for: itself, or those in a folder that is no recording.

    Raises:
        InputError: as `find_recordings`; BAD_INPUT for more than are compared at once.
    """
    if not path.is_dir() or any((path / name).exists() for name in _FOLDER_OF_ONE):
        return [path]
    found = find_recordings(path)
    if len(found) > _MOST:
        raise InputError(ErrorCode.BAD_INPUT, f"{path} holds {len(found)} recordings, more than {_MOST}: compare fewer")
    return found


def read_alike(bags: list[Path], nominal: NominalModel, called: Mapping[int, Mapping[str, str]]) -> list[ReadRecording]:
    """Every recording with the robot and the payload of the first one; what is remarkable is a warning.

    Args:
        bags: of one robot.
        nominal: of all; without a robot, the description of the first recording that has one is that of all.
        called: by the number of a bag, other names of its joints.

    Raises:
        InputError: as `read_recording`.
    """
    recordings = [open_recording(bag) for bag in bags]
    model = with_description(nominal, recordings)
    readings: list[ReadRecording] = []
    for number, (bag, recording) in enumerate(zip(bags, recordings, strict=True)):
        try:
            read = read_recording(recording, readings[0].model if readings else model, called.get(number))
        except PoiseError as error:
            raise _of_other_joints(error, recording, readings, called.get(number, {})) from error
        readings.append(read)
        for note in read.notes:
            warn(f"{bag}: {note}")
    return readings


def _of_other_joints(
    error: PoiseError, recording: Recording, readings: list[ReadRecording], called: Mapping[str, str]
) -> PoiseError:
    """The error of a recording that has not the joints of the first one, with those that look alike."""
    if error.code is not ErrorCode.JOINT_MISSING or not readings or readings[0].joints is None:
        return error
    try:
        names = recording.joint_states().names
    except PoiseError:
        return error
    return other_joints(tuple(called.get(name, name) for name in names), readings[0].joints.names)


def with_description(nominal: NominalModel, recordings: list[Recording]) -> NominalModel:
    """The model with a robot: its own, or the first robot_description of the recordings."""
    if nominal.urdf is not None or nominal.simulator is not None:
        return nominal
    texts = {}
    for recording in recordings:
        try:
            texts[recording.path] = recording.robot_description()
        except InputError as error:
            if error.code is not ErrorCode.ROBOT_DESCRIPTION_MISSING:
                raise
    if not texts:
        return nominal
    first = next(iter(texts))
    if others := [str(path) for path, text in texts.items() if text.strip() != texts[first].strip()]:
        warn(f"the robot_description of {', '.join(others)} differs from that of {first}, which is used for all")
    return replace(nominal, simulator=SimulatorModel(first, "urdf", texts[first]))


def comparison_json(found: Comparison, reading: ReadRecording) -> dict[str, Any]:
    """The fields of a diagnosis of the recording that was read, and those of a comparison."""
    content, matched = as_json(found.diagnosis, [reading]), found.alignment
    by_name = {change.finding.effect.name: change for change in found.changes}
    effects = [effect for effect in content["effects"] if effect["name"] in by_name]
    for effect in effects:
        effect.update(_change_json(by_name[effect["name"]]))
    return content | {
        "verdict": found.verdict,
        "effects": effects,
        "alignment": {"share": matched.share, "rate": matched.rate, "notes": list(found.notes)},
        "seconds": found.seconds,
    }


def _change_json(change: Change) -> dict[str, Any]:
    return {
        "present_in": change.present_in,
        "more_in": change.more_in,
        "change": {name: asdict(number) for name, number in change.change.items()},
        "in_a": {name: asdict(number) for name, number in change.before.items()},
    }


def print_comparison(people: Console, found: Comparison) -> None:
    """The changes in sentences, with tables, and the proof."""
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


def _table(change: Change) -> Table:
    title = change.finding.effect.name
    table = Table("", "change", "one sigma", "in A", "unit", title=title, title_justify="left")
    for name, number in change.change.items():
        value, sigma = rounded(number.value, number.std)
        before: Quantity | None = change.before.get(name)
        table.add_row(name, value, sigma, "" if before is None else f"{before.value:.4g}", number.unit)
    return table


def _compare_several(
    befores: list[Path], afters: list[Path], nominal: NominalModel, called: Mapping[str, str], json_target: str | None
) -> None:
    """Every recording against the earliest of the first group."""
    bags = [*befores, *afters]
    names = dict.fromkeys(range(len(befores), len(bags)), called)
    readings = read_alike(bags, nominal, names)
    with progress_bar("comparing") as progress:
        found = history([each.recorded for each in readings], len(befores), readings[0].model, progress)
    write_json(json_target, _history_json(found, bags, readings))
    people = console(json_target)
    people.print(f"Against {escape(str(bags[found.reference]))}:", soft_wrap=True)
    for entry in found.entries:
        said = ", ".join(entry.names) or entry.comparison.verdict
        people.print(f"  {'after' if entry.after else 'before'}  {escape(str(bags[entry.index]))}: {said}")
    for each in found.appearances:
        lasting = "and stays" if each.lasting else f"and is in {len(each.shown)} recordings"
        doubt = "; recordings before the change have it, too" if each.in_before else ""
        people.print(f"{each.name} appears in {escape(str(bags[each.first]))} {lasting}{doubt}.", soft_wrap=True)
    if not found.appearances:
        people.print("Nothing changed by more than the tolerances.")


def _history_json(found: History, bags: list[Path], readings: list[ReadRecording]) -> dict[str, Any]:
    entries = []
    for entry in found.entries:
        chosen = readings[entry.index if entry.comparison.side == "b" else found.reference]
        place = {"bag": str(bags[entry.index]), "group": "after" if entry.after else "before"}
        entries.append(place | comparison_json(entry.comparison, chosen))
    appeared = [
        {
            "name": each.name,
            "first": str(bags[each.first]),
            "shown_in": [str(bags[index]) for index in each.shown],
            "lasting": each.lasting,
            "in_before": each.in_before,
        }
        for each in found.appearances
    ]
    return {"reference": str(bags[found.reference]), "recordings": entries, "appeared": appeared}
