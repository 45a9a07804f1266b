"""Open the labels and score the answers: `python -m benchmarks.foreign.score DIR`; also written to DIR/score.json."""

import argparse
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.foreign.profiles import PROFILES
from benchmarks.foreign.run import ANSWERS
from benchmarks.foreign.seals import unseal

Z = 1.96
"""Of a 95 % interval."""
BINS = 10


@dataclass(frozen=True)
class Verdict:
    """One case judged.

    Args:
        case, kind, profile, strength, truth: of the label; truth holds the names of its effects.
        answered: the tool gave an answer. verdict, named: its verdict and names, the likeliest first.
        right: healthy: `none`; single: named first; pair: both named; outside: `unknown`, `mixed` or an accepted name.
        extra: it names what is not there. stated: (probability, is it true) of each name.
        worse: the error on held-out data is larger with the answer than with payload, bias and clocks alone fitted.
        cpu: s.
    """

    case: str
    kind: str
    profile: str
    strength: float
    truth: tuple[str, ...]
    answered: bool
    verdict: str
    named: tuple[str, ...]
    right: bool
    extra: bool
    stated: tuple[tuple[float, bool], ...]
    worse: bool
    cpu: float


def judge(case: str, label: dict[str, Any], outcome: dict[str, Any]) -> Verdict:
    """Hold what the tool said against the label; a case without an answer is not right."""
    answer = outcome.get("answer") or {}
    effects = answer.get("effects") or []
    named, verdict = tuple(str(effect["name"]) for effect in effects), str(answer.get("verdict", ""))
    truth = tuple(effect["name"] for effect in label["effects"])
    true = {*truth, *(name for effect in label["effects"] for name in effect["accept"])}
    right = {
        "healthy": verdict == "none",
        "single": bool(named) and named[0] in true,
        "pair": set(truth) <= set(named),
        "outside": verdict in ("unknown", "mixed") or bool(set(named) & true),
    }[label["kind"]]
    errors = (answer.get("fit") or {}).get("holdout") or {}
    without = errors.get("calibrated", errors.get("nominal", np.inf))
    worse = errors.get("augmented", 0.0) > without * 1.001
    return Verdict(
        case=case,
        kind=label["kind"],
        profile=label["profile"],
        strength=label["strength"],
        truth=truth,
        answered=bool(answer),
        verdict=verdict,
        named=named,
        right=bool(answer) and right,
        extra=bool(set(named) - true),
        stated=tuple((float(effect["probability"]), effect["name"] in true) for effect in effects),
        worse=bool(worse),
        cpu=float(outcome.get("cpu", 0.0)),
    )


def wilson(hits: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a rate (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    rate, extra = hits / count, Z**2 / count
    middle = (rate + extra / 2) / (1 + extra)
    half = Z / (1 + extra) * np.sqrt(rate * (1 - rate) / count + extra / (4 * count))
    return float(middle - half), float(middle + half)


def calibration_error(stated: Sequence[tuple[float, bool]]) -> float:
    """Expected calibration error of stated probabilities in ten equal bins; NaN without any."""
    if not stated:
        return float("nan")
    belief, true = np.array([p for p, _ in stated]), np.array([t for _, t in stated])
    place = np.minimum((belief * BINS).astype(int), BINS - 1)
    gaps = [abs(belief[place == b].mean() - true[place == b].mean()) * np.sum(place == b) for b in np.unique(place)]
    return float(sum(gaps) / len(belief))


@dataclass(frozen=True)
class Row:
    """A rate with its interval."""

    what: str
    hits: int
    count: int

    def text(self) -> str:
        """`3 of 9, 33 % (12 to 65)`."""
        if not self.count:
            return "no cases"
        low, high = wilson(self.hits, self.count)
        rate = 100 * self.hits / self.count
        return f"{self.hits} of {self.count}, {rate:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def table(verdicts: Iterable[Verdict]) -> list[Row]:
    """The rates, failures first."""
    every = list(verdicts)

    def rate(what: str, among: Callable[[Verdict], bool], hit: Callable[[Verdict], bool]) -> Row:
        chosen = [v for v in every if among(v)]
        return Row(what, sum(map(hit, chosen)), len(chosen))

    def of(kind: str, strength: float) -> Callable[[Verdict], bool]:
        return lambda v: v.kind == kind and v.strength == strength

    return [
        rate("no answer", lambda v: True, lambda v: not v.answered),
        rate("healthy: false alarm, of those answered", lambda v: v.kind == "healthy" and v.answered, _not_right),
        rate("a name too many, of those answered", lambda v: v.answered, lambda v: v.extra),
        rate("a false name with a belief over 50 %, of those answered", lambda v: v.answered, _convinced_and_wrong),
        rate("held-out error worse with the answer, of those answered", lambda v: v.answered, lambda v: v.worse),
        rate("one effect at 1.0: named first", of("single", 1.0), lambda v: v.right),
        rate("one effect at 0.3: named first", of("single", 0.3), lambda v: v.right),
        rate("two effects: both named", of("pair", 1.0), lambda v: v.right),
        rate("outside the library: unknown or mixed", lambda v: v.kind == "outside", lambda v: v.right),
    ]


def _not_right(verdict: Verdict) -> bool:
    return not verdict.right


def _convinced_and_wrong(verdict: Verdict) -> bool:
    return any(belief > 0.5 and not true for belief, true in verdict.stated)


def by_profile(verdicts: Sequence[Verdict]) -> list[tuple[str, str, str, str, str]]:
    """Name, no answer, false alarms, named first, outside flagged: no profile has been used to tune for another."""
    rows = []
    for profile in PROFILES:
        own = [v for v in verdicts if v.profile == profile.name]
        healthy = [v for v in own if v.kind == "healthy" and v.answered]
        single, outside = ([v for v in own if v.kind == kind] for kind in ("single", "outside"))
        cells = (
            (sum(not v.answered for v in own), len(own)),
            (sum(not v.right for v in healthy), len(healthy)),
            *((sum(v.right for v in group), len(group)) for group in (single, outside)),
        )
        rows.append((profile.name, *(f"{hits} of {count}" if count else "-" for hits, count in cells)))
    return [row for row in rows if len(row) == 5]


def without_each_profile(verdicts: Sequence[Verdict]) -> list[tuple[str, str, str, str, str]]:
    """Name of the profile left out; false alarms, named first, a name too many and calibration error of all others."""
    rows = []
    for profile in PROFILES:
        rest = [v for v in verdicts if v.profile != profile.name and v.answered]
        healthy, single = ([v for v in rest if v.kind == kind] for kind in ("healthy", "single"))
        counts = (
            (sum(not v.right for v in healthy), len(healthy)),
            (sum(v.right for v in single), len(single)),
            (sum(v.extra for v in rest), len(rest)),
        )
        cells = [f"{100 * hits / count:.0f} % of {count}" if count else "-" for hits, count in counts]
        error = calibration_error([pair for v in rest for pair in v.stated])
        rows.append((profile.name, cells[0], cells[1], cells[2], f"{error:.2f}"))
    return rows


def report(verdicts: Sequence[Verdict]) -> str:
    """The tables as Markdown."""
    lines = ["| what | cases, rate (95 % interval) |", "| --- | --- |"]
    lines += [f"| {row.what} | {row.text()} |" for row in table(verdicts)]
    stated = [pair for v in verdicts for pair in v.stated]
    cpu = sorted(v.cpu for v in verdicts if v.answered) or [0.0]
    lines.append(f"| expected calibration error | {calibration_error(stated):.2f} of {len(stated)} names |")
    lines.append(f"| CPU of an answer: median, largest | {np.median(cpu):.1f} s, {cpu[-1]:.1f} s |")
    lines += ["", "| profile | no answer | false alarms | named first | outside flagged |", "| --- |" + " --- |" * 4]
    lines += ["| " + " | ".join(row) + " |" for row in by_profile(verdicts)]
    heads = ("left out", "false alarms", "named first", "a name too many", "calibration error")
    lines += ["", "| " + " | ".join(heads) + " |", "| --- |" + " --- |" * 4]
    lines += ["| " + " | ".join(row) + " |" for row in without_each_profile(verdicts)]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", action="store_true", help="list each case")
    arguments = parser.parse_args()
    try:
        labels = unseal(arguments.folder)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    verdicts = []
    for case, label in sorted(labels.items()):
        found = arguments.folder / ANSWERS / f"{case}.json"
        if found.is_file():
            verdicts.append(judge(case, label, json.loads(found.read_text(encoding="utf-8"))))
    if len(verdicts) < len(labels):
        print(f"{len(labels) - len(verdicts)} of {len(labels)} cases were not run and do not count.\n")
    print(report(verdicts))
    for v in verdicts if arguments.cases else ():
        names = ", ".join(v.named) or "-"
        print(f"{v.case} {v.profile} {v.kind} {v.strength:g} {', '.join(v.truth) or '-'}: {v.verdict or '-'}: {names}")
    content = {"table": [asdict(row) for row in table(verdicts)], "cases": [asdict(v) for v in verdicts]}
    (arguments.folder / "score.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
