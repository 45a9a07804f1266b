"""`poise mismatch`: the physics that a recording shows and the simulation lacks."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.commands.mismatch_design import design_json, design_sentence, designed, write_design
from poise.commands.mismatch_export import (
    ExportModelOption,
    IntoOption,
    PayloadLinkOption,
    read_model_exports,
    write_model_exports,
)
from poise.commands.output import (
    BAG_HELP,
    JsonOption,
    add_scene,
    console,
    progress_bar,
    refuse_folder,
    warn,
    write_json,
)
from poise.files import write_whole
from poise.mismatch.answer import Diagnosis, DiscriminatingMotion, NamedEffect, Quantity, diagnose
from poise.mismatch.reading import NominalModel, ReadRecording, dump_model, joined, load_model, read_recording, spans
from poise.recording import open_recording
from poise.viewing import readable, rounded

_MISSED = 1.5
"""Held-out error over the error of the fits, from which the last recording is reported to differ from the others."""
_MISSED_SENTENCE = "{} deviates by more than that: effects in it alone are not searched; diagnose it separately."

_UNEXAMINED = (
    "No signal can be examined: there is no wrench, and no usable joint effort. The warnings say why, and what the "
    "motion shows."
)

_ModelOption = Annotated[
    Path | None,
    typer.Option(
        "--model",
        metavar="FILE",
        help="model.yaml: payload, tolerances, noise (default: the payload is identified from the recording).",
        show_default=False,
    ),
]


BagsArgument = Annotated[
    list[Path],
    typer.Argument(metavar="BAG...", help=f"{BAG_HELP} With several, the last is held out.", show_default=False),
]
_ReportOption = Annotated[
    Path | None,
    typer.Option("--report", metavar="DIR", help="Write an HTML report and a Rerun scene.", show_default=False),
]
SaveOption = Annotated[
    Path | None,
    typer.Option("--save", metavar="FILE", help="Write the model with the effects found.", show_default=False),
]
SeparateOption = Annotated[
    Path | None,
    typer.Option(
        "--separate",
        metavar="FILE",
        help="Design a motion that separates the effects that remain indistinguishable, and write it (YAML).",
        show_default=False,
    ),
]


SearchDeadlineOption = Annotated[
    float,
    typer.Option(
        "--deadline",
        metavar="SECONDS",
        min=0.1,
        help="Answer after about this time with the best result so far.",
        show_default=False,
    ),
]


def mismatch(
    bags: BagsArgument,
    model: _ModelOption = None,
    report: _ReportOption = None,
    save: SaveOption = None,
    separate: SeparateOption = None,
    export: ExportModelOption = None,
    into: IntoOption = None,
    payload_link: PayloadLinkOption = None,
    deadline: SearchDeadlineOption = math.inf,
    json_target: JsonOption = None,
) -> None:
    """Identify the physical effects that a recording shows and the simulation lacks.

    The recordings need joint_states, robot_description, and the wrench, joint efforts, or both (or the wrench and tf up
    to the sensor); odom and joint commands are used if present. The effects of a library compete by evidence; small
    calibration errors are always fitted. When no effect fits, the answer is `unknown`, with the state that the residual
    depends on.

    Example:  poise mismatch run.mcap --model model.yaml --json answer.json --report out --save augmented.yaml
    """
    refuse_folder(json_target, "--json")
    exports = read_model_exports(export, into)
    nominal = NominalModel() if model is None else load_model(model)
    readings = read_with_warnings(bags, nominal)
    recorded, last = joined([reading.recorded for reading in readings])
    if not (recorded.has("wrench") or recorded.has("effort")):
        write_json(json_target, _unexamined(readings))
        console(json_target).print(_UNEXAMINED)
        return
    with progress_bar("searching for effects") as progress:
        last_one = last if last.any() else None
        found = diagnose(recorded, readings[0].model, last_one, deadline=deadline, progress=progress)
    design = None if separate is None else designed(found, readings[0].robot)
    remarks = [note for reading in readings for note in reading.notes] + [design_sentence(design)] * bool(separate)
    written = [] if report is None else write_report(report, bags, remarks, found)
    written += _write_yaml(found, design, separate, save)
    times = spans([reading.recorded for reading in readings])
    recordings = [{"bag": str(bag), "start": a, "end": b} for bag, (a, b) in zip(bags, times, strict=True)]
    more = {"recordings": recordings, "designed_motion": design_json(design, separate)}
    write_json(json_target, as_json(found, readings) | more)
    people = console(json_target)
    print_answer(people, found)
    if separate is not None:
        people.print(design_sentence(design), soft_wrap=True)
    print_recordings(people, found, recordings)
    written += write_model_exports(exports, found, bags[0], nominal, payload_link)
    for path in written:
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def read_with_warnings(bags: list[Path], nominal: NominalModel) -> list[ReadRecording]:
    """As `read_all`; what is remarkable about a recording is a warning."""
    readings = read_all(bags, nominal)
    for reading, bag in zip(readings, bags, strict=True):
        for note in reading.notes:
            warn(f"{bag}: {note}")
    return readings


def _write_yaml(
    found: Diagnosis, design: DiscriminatingMotion | None, separate: Path | None, save: Path | None
) -> list[Path]:
    written = []
    if separate is not None and design is not None:
        written.append(write_design(separate, design))
    if save is not None:
        written.append(write_whole(save, dump_model(found.augmented).encode()))
    return written


def print_recordings(people: Console, found: Diagnosis, recordings: list[dict[str, Any]]) -> None:
    """The time span of each recording, and whether the last differs from the others."""
    if len(recordings) == 1:
        return
    for entry in recordings:
        people.print(f"From {entry['start']:.1f} s to {entry['end']:.1f} s: {escape(entry['bag'])}", soft_wrap=True)
    if found.main.proof.augmented > _MISSED * max(found.main.proof.floor, 1.0):
        people.print(_MISSED_SENTENCE.format(escape(recordings[-1]["bag"])), soft_wrap=True)


def read_all(bags: list[Path], nominal: NominalModel) -> list[ReadRecording]:
    """Every recording, read with the payload of the model or, without one, of the first recording.

    Raises:
        InputError: as `read_recording`.
    """
    first = read_recording(open_recording(bags[0]), nominal)
    return [first, *(read_recording(open_recording(bag), first.model) for bag in bags[1:])]


def write_report(folder: Path, bags: list[Path], notes: list[str], found: Diagnosis) -> list[Path]:
    """Write the HTML report, and the Rerun scene when rerun is installed.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    # Drawing libraries load slowly: they are imported on use.
    from poise.viewing import write_mismatch_report, write_mismatch_scene

    title = f"Mismatch of {', '.join(bag.name for bag in bags)}"
    written = [write_mismatch_report(folder, found, title, [str(bag) for bag in bags], notes=notes)]
    return add_scene(written, lambda: write_mismatch_scene(folder / "mismatch.rrd", found))


def as_json(found: Diagnosis, readings: list[ReadRecording]) -> dict[str, Any]:
    """The fields of the contract and further ones; seconds count from the first wrench sample."""
    proof, rest = found.main.proof, found.main.residual_test
    unknown = found.unknown
    return {
        "verdict": found.verdict,
        "effects": [_effect(finding) for finding in found.findings],
        "where": [
            {
                "start": window.start,
                "end": window.end,
                "kind": window.kind,
                "channels": window.channels,
                "band_hz": window.band_hz,
                "depends_on": window.depends_on,
                "share": window.share,
            }
            for each in found.examinations
            for window in each.windows
        ]
        if found.verdict != "none"
        else [],
        "unknown": None if unknown is None else {"depends_on": unknown.depends_on, "sentence": unknown.sentence},
        "fit": {
            "noise_floor": proof.floor,
            "holdout": {"nominal": proof.as_given, "calibrated": proof.nominal, "augmented": proof.augmented},
            "whiteness": rest.whiteness,
            "nrmse": _nrmse(found),
        },
        "calibration": [asdict(small) for each in found.examinations for small in each.calibration],
        "complete": found.complete,
        "unproven": found.unproven,
        "untestable": found.untestable,
        "seconds": found.seconds,
    } | _of_input(readings)


def _nrmse(found: Diagnosis) -> dict[str, dict[str, float]]:
    """Error of each joint's effort over the effort itself; empty without efforts.

    Of the nominal model as given and of the fit with the effects, on all samples; and of a fit without the held-out
    samples, on these.
    """
    errors = {}
    for each in found.examinations:
        effort = each.problem.recorded.effort
        if each.problem.signal == "effort" and effort is not None:
            nominal, augmented = each.nrmse.tolist()
            parts = zip(effort.names, nominal, augmented, each.proof.nrmse[1].tolist(), strict=True)
            errors = {name: {"nominal": a, "augmented": b, "held_out": c} for name, a, b, c in parts}
    return errors


def _of_input(readings: list[ReadRecording]) -> dict[str, Any]:
    return {
        "notes": [note for reading in readings for note in reading.notes],
        "input_findings": [asdict(finding) for reading in readings for finding in reading.findings],
    }


def _unexamined(readings: list[ReadRecording]) -> dict[str, Any]:
    """The answer about recordings without a usable wrench or effort: the findings about the input."""
    return {
        "verdict": "unknown",
        "effects": [],
        "where": [],
        "unknown": {"depends_on": [], "sentence": _UNEXAMINED},
        "fit": None,
        "calibration": [],
        "untestable": {},
        "seconds": 0.0,
    } | _of_input(readings)


def _effect(finding: NamedEffect) -> dict[str, Any]:
    def quantity(number: Quantity) -> dict[str, Any]:
        return {"value": number.value, "std": number.std, "unit": number.unit}

    return {
        "name": finding.effect.name,
        "probability": finding.belief.probability,
        "proof": None if finding.proof is None else asdict(finding.proof),
        "basis": None if finding.belief.basis is None else asdict(finding.belief.basis),
        "parameters": {name: quantity(number) for name, number in finding.parameters.items()},
        "windows": finding.windows,
        "sentence": finding.sentence,
        "rivals": [{"name": name, "probability": chance} for name, chance in finding.belief.rivals],
        "indistinguishable_from": finding.belief.alike,
        "varies_with": finding.belief.varies_with,
        "separating_motion": finding.effect.separating_motion,
    }


def print_answer(people: Console, found: Diagnosis) -> None:
    """The verdict in sentences, the parameters as a table, and the proof."""
    proof = found.main.proof
    if found.verdict == "none":
        people.print(f"The recording and the simulation agree within the tolerances ({100 * found.probability:.1f} %).")
    for finding in found.findings:
        people.print(f"{escape(finding.sentence)} ({100 * finding.belief.probability:.1f} %)", soft_wrap=True)
        if finding.belief.varies_with:
            state = finding.belief.varies_with.replace("_", " ")
            people.print(f"  It would have to vary with {state}: another cause may resemble it.", soft_wrap=True)
        if finding.belief.alike:
            people.print(
                f"  Indistinguishable from {', '.join(finding.belief.alike)} in this recording; "
                f"a motion that separates them: {escape(finding.effect.separating_motion)}",
                soft_wrap=True,
            )
        people.print(_table(finding))
    if found.unknown is not None:
        people.print(escape(readable(found.unknown.sentence, 500)), soft_wrap=True)
    people.print(
        f"Held-out error, in units of the noise: {proof.as_given:.2f} for the model as given, {proof.nominal:.2f}"
        f" calibrated within the tolerances, {proof.augmented:.2f} with the effects found.",
        soft_wrap=True,
    )
    clock = next(
        (small for each in found.examinations for small in each.calibration if small.group == "clock_offset"), None
    )
    if clock is not None:
        value, sigma = rounded(1e3 * clock.value, 1e3 * clock.std)
        people.print(f"Inside its tolerance: the wrench's clock is {value} ± {sigma} ms late against the motion's.")
    limits = [
        f"{small.group} {small.name}" for each in found.examinations for small in each.calibration if small.at_limit
    ]
    if limits:
        people.print(f"At the limit of their tolerances: {', '.join(limits)}.", soft_wrap=True)
    if not found.complete:
        people.print("The deadline ended the search: this is the best answer so far.")
    for name, lacking in found.unproven.items():
        people.print(f"Not named, since it has no proof: {escape(name)} ({lacking}).", soft_wrap=True)
    if found.untestable:
        people.print(f"Not tested here: {escape(', '.join(sorted(found.untestable)))}.", soft_wrap=True)


def _table(finding: NamedEffect) -> Table:
    table = Table("", "value", "one sigma", "unit", title=finding.effect.name, title_justify="left")
    for name, number in finding.parameters.items():
        value, sigma = rounded(number.value, number.std)
        table.add_row(name, value, sigma, number.unit)
    return table
