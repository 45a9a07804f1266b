"""The answer of `poise mismatch`: as JSON, and in sentences and tables."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.commands.output import add_scene
from poise.mismatch.answer import Diagnosis, NamedEffect, Quantity, SignalDiagnosis
from poise.mismatch.effects import numbered_joints
from poise.mismatch.reading import ReadRecording
from poise.viewing import readable, rounded

_MISSED = 1.5
"""Held-out error over the error of the fits, from which the last recording is reported to differ from the others."""
_MISSED_SENTENCE = "{} deviates by more than that: effects in it alone are not searched; diagnose it separately."
UNEXAMINED = (
    "No signal can be examined: there is no wrench, and no usable joint effort. The warnings say why, and what the "
    "motion shows."
)


def as_json(found: Diagnosis, readings: list[ReadRecording]) -> dict[str, Any]:
    """The fields of the contract and further ones; seconds count from the first wrench sample."""
    proof, rest, unknown = found.main.proof, found.main.residual_test, found.unknown
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
        "unknown": unknown and unknown_json(unknown.sentence, unknown.depends_on, unknown.candidates),
        "fit": {
            "noise_floor": proof.floor,
            "holdout": {"nominal": proof.as_given, "calibrated": proof.nominal, "augmented": proof.augmented},
            "whiteness": rest.whiteness,
            "nrmse": _nrmse(found),
            "at_rest": found.at_rest,
        },
        "calibration": [asdict(small) for each in found.examinations for small in each.calibration],
        "complete": found.complete,
        "unproven": found.unproven,
        "untestable": found.untestable,
        "seconds": found.seconds,
    } | _of_input(readings)


def unknown_json(
    sentence: str, depends_on: Sequence[str] = (), candidates: Sequence[tuple[str, float]] = ()
) -> dict[str, Any]:
    """What no name explains: see `UnknownPhysics`."""
    chances = [{"name": name, "probability": chance} for name, chance in candidates]
    return {"depends_on": list(depends_on), "sentence": sentence, "candidates": chances}


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


def unexamined_json(readings: list[ReadRecording]) -> dict[str, Any]:
    """The answer about recordings without a usable wrench or effort: the findings about the input."""
    return {
        "verdict": "unknown",
        "effects": [],
        "where": [],
        "unknown": {"depends_on": [], "sentence": UNEXAMINED},
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
    proof, joints = found.main.proof, numbered_joints(found.main.problem.recorded)
    if found.verdict == "none":
        people.print("The recording and the simulation agree within the tolerances: no effect is named.")
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
        people.print(_table(finding, joints))
    if found.unknown is not None:
        people.print(escape(readable(found.unknown.sentence, 500)), soft_wrap=True)
    people.print(
        f"Held-out error, in units of the noise: {proof.as_given:.2f} for the model as given, {proof.nominal:.2f}"
        f" calibrated within the tolerances, {proof.augmented:.2f} with the effects found.",
        soft_wrap=True,
    )
    for clock in (small for each in found.examinations for small in each.calibration if small.group == "clock_offset"):
        value, sigma = rounded(1e3 * clock.value, 1e3 * clock.std)
        what = "joint efforts are" if clock.name == "efforts" else "wrench's clock is"
        people.print(f"Inside its tolerance: the {what} {value} ± {sigma} ms late against the motion.")
    limits = [_at_limit(each, joints) for each in found.examinations if any(one.at_limit for one in each.calibration)]
    if limits:
        people.print(f"At the limit of their tolerances, which is no finding: {'; '.join(limits)}.", soft_wrap=True)
    if found.rest_sentence:
        people.print(escape(found.rest_sentence), soft_wrap=True)
    if not found.complete:
        people.print("The deadline ended the search: this is the best answer so far.")
    for name, lacking in found.unproven.items():
        people.print(f"Not named, since it has no proof: {escape(name)} ({lacking}).", soft_wrap=True)
    if found.untestable:
        people.print(f"Not tested here: {escape(_by_reason(found.untestable))}.", soft_wrap=True)


def _at_limit(each: SignalDiagnosis, joints: Mapping[int, str]) -> str:
    """The calibration errors of one signal that a fit holds at their limits, by group."""
    groups: dict[str, list[str]] = {}
    for small in each.calibration:
        if small.at_limit:
            groups.setdefault(small.group, []).append(_with_joint(small.name, joints))
    signal = "wrench" if each.problem.signal == "wrench" else "joint efforts"
    return f"{signal}: " + ", ".join(f"{group} {' '.join(names)}" for group, names in groups.items())


def _by_reason(untestable: Mapping[str, str]) -> str:
    """The effects that were not tested, with the reason that they share."""
    reasons: dict[str, list[str]] = {}
    for name, why in sorted(untestable.items()):
        reasons.setdefault(why, []).append(name)
    return "; ".join(f"{', '.join(names)} ({why})" for why, names in reasons.items())


def _with_joint(name: str, joints: Mapping[int, str]) -> str:
    """The name of a parameter, with that of its joint where it ends with the joint's number."""
    number = name.rpartition("_")[2]
    return f"{name} ({joints[int(number)]})" if number.isdigit() and int(number) in joints else name


def _table(finding: NamedEffect, joints: Mapping[int, str]) -> Table:
    table = Table("", "value", "one sigma", "unit", title=finding.effect.name, title_justify="left")
    for name, number in finding.parameters.items():
        value, sigma = rounded(number.value, number.std)
        table.add_row(escape(_with_joint(name, joints)), value, sigma, number.unit)
    return table


def print_recordings(people: Console, found: Diagnosis, recordings: list[dict[str, Any]]) -> None:
    """The time span of each recording, and whether the last differs from the others."""
    if len(recordings) == 1:
        return
    for entry in recordings:
        people.print(f"From {entry['start']:.1f} s to {entry['end']:.1f} s: {escape(entry['bag'])}", soft_wrap=True)
    if found.main.proof.augmented > _MISSED * max(found.main.proof.floor, 1.0):
        people.print(_MISSED_SENTENCE.format(escape(recordings[-1]["bag"])), soft_wrap=True)


def print_written(people: Console, written: list[Path]) -> None:
    """The files, one a line."""
    for path in written:
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def write_report(
    folder: Path, bags: list[Path], notes: list[str], found: Diagnosis, what: str = "Mismatch of"
) -> list[Path]:
    """Write the HTML report, and the Rerun scene when rerun is installed.

    Args:
        folder: made when missing.
        bags: recordings. notes: on them. found: the answer. what: the beginning of the title.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    # Drawing libraries load slowly: they are imported on use.
    from poise.viewing import write_mismatch_report, write_mismatch_scene

    title = f"{what} {', '.join(bag.name for bag in bags)}"
    written = [write_mismatch_report(folder, found, title, [str(bag) for bag in bags], notes=notes)]
    return add_scene(written, lambda: write_mismatch_scene(folder / "mismatch.rrd", found))
