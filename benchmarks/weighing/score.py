"""Hold the answers against the truth: `python -m benchmarks.weighing.score DIR`; also written to DIR/score.json."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.foreign.seals import unseal
from benchmarks.weighing.kinds import BY_NAME, KINDS
from benchmarks.weighing.run import answered

SIGMAS = 3.0
HIDDEN = 6.0
"""Sigmas of an ideal test below which no test can find the trouble in the recording."""
NO_CAUSE = "POOR_FIT"
"""The finding that says that something is wrong, but not what."""


@dataclass(frozen=True)
class Verdict:
    """One case judged.

    Args:
        case, kind, item, way, generator: of the label.
        status: of the command. findings: names, in order.
        mass_z, com_z: error over its one sigma; the largest of three for the centre of mass. NaN: no value.
        error: of the mass, relative.
        silent: an answer with status 0 and without a finding, beyond three sigma.
        named: the first cause is right. withheld: no number was given.
        repaired: relative error of the mass after --repair; NaN: none. repaired_z: over its one sigma.
        weighed: payloads of the recording, and how many of them have a segment within three sigma.
        visible: sigmas by which an ideal test would see that no payload explains the wrench; NaN: not computed.
        cpu: s.
    """

    case: str
    kind: str
    item: str
    way: str
    generator: str
    status: int
    findings: tuple[str, ...]
    mass_z: float
    com_z: float
    error: float
    silent: bool
    named: bool
    withheld: bool
    repaired: float
    repaired_z: float
    weighed: tuple[int, int]
    visible: float
    cpu: float

    @property
    def flagged(self) -> bool:
        """It does not look like a good answer."""
        return bool(self.findings) or self.status != 0

    @property
    def beyond(self) -> bool:
        """A number is given, and mass or centre of mass is beyond three sigma."""
        return bool(max(np.nan_to_num(self.mass_z), np.nan_to_num(self.com_z)) > SIGMAS)


def judge(case: str, label: dict[str, Any], outcome: dict[str, Any]) -> Verdict:
    """Hold what the command said against the truth."""
    answer = outcome.get("answer") or {}
    status = int(outcome["status"])
    names = [str(finding["name"]) for finding in answer.get("findings") or []]
    if status == 3 and not names:
        names = _refusal(str(outcome.get("message", "")))
    mass_z, com_z, error = _errors(answer, label)
    causes = [name for name in names if name != NO_CAUSE] or names
    accept = BY_NAME[label["kind"]].accept
    again = (outcome.get("repaired") or {}).get("answer") or {}
    if not any(finding["sentence"].startswith("repaired") for finding in again.get("findings") or []):
        again = {}  # no cause was certain: the answer is the one without --repair
    repaired_z, _, repaired = _errors(again, label)
    return Verdict(
        case=case,
        **{key: str(label[key]) for key in ("kind", "item", "way", "generator")},
        status=status,
        findings=tuple(names),
        mass_z=mass_z,
        com_z=com_z,
        error=error,
        silent=bool(status == 0 and not names and max(np.nan_to_num(mass_z), np.nan_to_num(com_z)) > SIGMAS),
        named=bool(causes) and causes[0] in accept,
        withheld=bool(np.isnan(mass_z)),
        repaired=repaired,
        repaired_z=repaired_z,
        weighed=_weighed(answer, label),
        visible=float(np.nan if label.get("visible") is None else label["visible"]),
        cpu=float(outcome.get("cpu", 0.0)),
    )


def _refusal(message: str) -> list[str]:
    """The code that a refusal in words stands for."""
    if "opposite" in message or "sign" in message:
        return ["NOT_CONSISTENT"]
    return ["NO_ANSWER"]


def _errors(answer: dict[str, Any], label: dict[str, Any]) -> tuple[float, float, float]:
    """Sigmas of mass and of the worst axis of the centre of mass, and the relative error of the mass."""
    mass, sigma = answer.get("mass"), answer.get("mass_std")
    if mass is None or sigma is None:
        return np.nan, np.nan, np.nan
    several = len(answer.get("segments") or []) > 1
    bodies = label["segments"] if several else [label]  # an answer that says that there are several is for one of them
    nearest = min(bodies, key=lambda body: abs(mass - body["mass"]))
    off = abs(mass - nearest["mass"])
    worst = [
        abs(c - true) / max(s, 1e-9)
        for c, true, s in zip(answer["com"], label["com"], answer["com_std"], strict=True)
        if c is not None and s is not None and nearest["mass"] == label["mass"]
    ]
    return off / max(sigma, 1e-9), max(worst, default=np.nan), off / nearest["mass"]


def _weighed(answer: dict[str, Any], label: dict[str, Any]) -> tuple[int, int]:
    """Payloads of a recording, and how many have a segment in their middle whose mass is within three sigma."""
    true = label.get("segments") or []
    right = 0
    for body in true:
        middle = label["start"] * 1e-9 + (body["start"] + body["end"]) / 2
        for found in answer.get("segments") or []:
            if found["start"] <= middle <= found["end"] and found["mass"] is not None:
                right += abs(found["mass"] - body["mass"]) <= SIGMAS * found["mass_std"]
                break
    return len(true), right


HEADS = (
    *("kind", "cases", "wrong, silent", "beyond 3 σ", "finding", "cause first", "withheld"),
    *("error", "repaired", "error repaired"),
)


def rows(verdicts: Sequence[Verdict]) -> list[tuple[str, ...]]:
    """The table of kinds, those with silent errors first."""
    groups = [[v for v in verdicts if v.kind == kind.name] for kind in KINDS]
    ranked = sorted((own for own in groups if own), key=lambda own: (-sum(v.silent for v in own), _misnamed(own)))
    return [_row(own[0].kind, own) for own in ranked]


def _misnamed(own: Sequence[Verdict]) -> int:
    """Findings whose first cause is right, less all: the kinds with the most wrong names come first."""
    return sum(v.named - 1 for v in own if v.flagged)


def _row(name: str, own: Sequence[Verdict]) -> tuple[str, ...]:
    flagged = [v for v in own if v.flagged]
    repaired = [v.repaired for v in own if np.isfinite(v.repaired)]
    return (
        name,
        str(len(own)),
        str(sum(v.silent for v in own)),
        str(sum(v.beyond for v in own)),
        str(len(flagged)),
        f"{sum(v.named for v in flagged)} of {len(flagged)}" if BY_NAME[name].accept else "-",
        str(sum(v.withheld for v in own)),
        _percent([v.error for v in own if np.isfinite(v.error)]),
        str(len(repaired)),
        _percent(repaired),
    )


def _percent(values: Sequence[float]) -> str:
    return f"{100 * float(np.median(values)):.2g} %" if len(values) else "-"


def summary(verdicts: Sequence[Verdict]) -> list[tuple[str, str]]:
    """What the goals ask for."""
    ill = [v for v in verdicts if v.kind != "healthy"]
    expected = [v for v in ill if BY_NAME[v.kind].accept and v.flagged]
    repaired = [v for v in ill if np.isfinite(v.repaired_z)]
    several = [v.weighed for v in ill if v.weighed[0] > 1]
    silent = [v for v in ill if v.silent]
    found = [
        ("trouble: wrong by over 3 sigma, no finding, exit 0", _share(len(silent), len(ill))),
        ("of these: the mass", _share(sum(v.mass_z > SIGMAS for v in silent), len(silent))),
        ("of these: no test can see it", _share(sum(v.visible < HIDDEN for v in silent), len(silent))),
        ("trouble: cause named first, of those with a finding", _share(sum(v.named for v in expected), len(expected))),
        ("trouble: after --repair beyond 3 sigma", _share(sum(v.repaired_z > SIGMAS for v in repaired), len(repaired))),
    ]
    payloads, weighed = (sum(pair[i] for pair in several) for i in range(2))
    found.append(("several payloads: each weighed within 3 sigma", _share(weighed, payloads)))
    for generator in ("robot", "tf"):
        own = [v for v in verdicts if v.kind == "healthy" and v.generator == generator]
        found += [
            (f"healthy, {generator}: a finding or no answer", _share(sum(v.flagged for v in own), len(own))),
            (f"healthy, {generator}: mass beyond 3 sigma", _share(sum(v.mass_z > SIGMAS for v in own), len(own))),
            (f"healthy, {generator}: centre of mass beyond", _share(sum(v.com_z > SIGMAS for v in own), len(own))),
            (f"healthy, {generator}: root mean square of mass z", _spread([v.mass_z for v in own])),
        ]
    cpu = [v.cpu for v in verdicts]
    return [*found, ("CPU of an answer, median and largest", f"{np.median(cpu):.1f} s, {max(cpu):.1f} s")]


def _share(hits: int, count: int) -> str:
    return f"{hits} of {count} ({100 * hits / count:.0f} %)" if count else "no cases"


def _spread(values: Sequence[float]) -> str:
    known = np.array(values)[np.isfinite(values)]
    return f"{np.sqrt(np.mean(known**2)):.2f}" if len(known) else "-"


def report(verdicts: Sequence[Verdict], before: Sequence[Verdict] = ()) -> str:
    """The tables as Markdown; with the summary of another version on the same cases."""
    now = summary(verdicts)
    lines = ["| what | cases |", "| --- | --- |"] + [f"| {what} | {value} |" for what, value in now]
    if before:
        pairs = zip(now, summary(before), strict=True)
        lines = ["| what | before | now |", "| --- | --- | --- |"]
        lines += [f"| {what} | {value_before} | {value} |" for (what, value), (_, value_before) in pairs]
    lines += ["", "| " + " | ".join(HEADS) + " |", "| --- |" + " --- |" * (len(HEADS) - 1)]
    lines += ["| " + " | ".join(row) + " |" for row in rows(verdicts)]
    return "\n".join(lines)


def judged(labels: dict[str, Any], outcomes: dict[str, Any]) -> list[Verdict]:
    """The cases that have an answer."""
    return [judge(case, label, outcomes[case]) for case, label in sorted(labels.items()) if case in outcomes]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", action="store_true", help="list each case")
    parser.add_argument("--before", type=Path, help="folder with the answers of another version to these cases")
    arguments = parser.parse_args()
    try:
        labels = unseal(arguments.folder)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    outcomes = answered(arguments.folder)
    verdicts = judged(labels, outcomes)
    if len(verdicts) < len(labels):
        print(f"{len(labels) - len(verdicts)} of {len(labels)} cases were not run and do not count.\n")
    if not verdicts:
        parser.error("no case has an answer: run them first")
    others = {} if arguments.before is None else answered(arguments.before)
    common = {case: outcome for case, outcome in others.items() if case in outcomes}
    print(report(verdicts, judged(labels, common)))
    for v in verdicts if arguments.cases else ():
        shape = f"{v.kind:20} {v.item:8} {v.way:12} {v.generator:6}"
        numbers = f"exit {v.status} z {v.mass_z:8.1f} com {v.com_z:8.1f} error {100 * v.error:6.1f} %"
        numbers += f" seen {v.visible:6.0f} {v.cpu:5.1f} s"
        print(f"{v.case} {'SILENT' if v.silent else '':6} {shape} {numbers} {', '.join(v.findings)}")
    content = {"summary": dict(summary(verdicts)), "cases": [asdict(v) for v in verdicts]}
    (arguments.folder / "score.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
