"""The final sets that were kept, one row each, and what was missed: `python -m benchmarks.kept_scores [--missed]`.

Scores lie in benchmarks/{foreign,concealed}/final, each with the commit that answered. Sets of 60 cases differ by
chance as much as versions do; the last row adds those that `--last` asks for.
"""

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

FOREIGN = {
    "686400cc": 239841,
    "08f47b9c": 771203,
    "cf7a7608": 660517,
    "bbadeed7": 805933,
    "371966e4": 911573,
    "ca313611": 720019,
    "e2bc702a": 845113,
    "ca42759f": 392817,
    "8f6e2844": 518263,
    "017a0de6": 735089,
    "f143c108": 482917,
    "823480a4": 904271,
    "ccaf3775": 318557,
    "e6200030": 586291,
    "9187f82e": 671903,
    "0717128f": 538201,
    "9411378c": 846359,
    "50f0ec6f": 275813,
    "52f2819b": 631549,
    "b30211a3": 720461,
    "bcd47b46": 845917,
    "e9cda751": 731209,
    "407392a3": 406183,
    "8db5d08f": 829157,
}
"""Commit and seeds of the foreign sets with today's rules of the score, the oldest first."""
CONCEALED = {
    "686400cc": 609594,
    "08f47b9c": 415327,
    "cf7a7608": 520946,
    "371966e4": 633871,
    "ca313611": 918533,
    "e2bc702a": 275041,
    "ca42759f": 861437,
    "8f6e2844": 147709,
    "017a0de6": 352867,
    "f143c108": 716053,
    "823480a4": 571938,
    "ccaf3775": 804223,
    "e6200030": 930617,
    "9187f82e": 462589,
    "0717128f": 283907,
    "9411378c": 519476,
    "50f0ec6f": 740261,
    "52f2819b": 397541,
    "b30211a3": 851203,
    "bcd47b46": 264197,
    "e9cda751": 618953,
    "407392a3": 487129,
    "8db5d08f": 935261,
}
"""The same of our own generator's."""

Case = dict[str, Any]


def cases(benchmark: str, commit: str) -> list[Case]:
    """The judged cases of a set: {kind, strength, truth, named, right, ...}."""
    path = Path(__file__).parent / benchmark / "final" / f"score_{commit}.json"
    return list(json.loads(path.read_text(encoding="utf-8"))["cases"])


def counted(chosen: Sequence[Case], right: bool = True) -> str:
    """How many are right, or wrong, of how many."""
    return f"{sum(bool(case['right']) == right for case in chosen)} of {len(chosen)}"


def row(name: str, found: Sequence[Case]) -> str:
    """One set as a line of Markdown."""

    def of(kinds: tuple[str, ...], strength: float | None = None) -> list[Case]:
        return [c for c in found if c["kind"] in kinds and strength in (None, c["strength"])]

    cells = [
        counted(of(("single",), 1.0)),
        counted(of(("single",), 0.3)),
        counted(of(("pair",))),
        counted(of(("healthy", "null", "decoy")), right=False),
        counted(of(("outside", "foreign"))),
    ]
    if all("stated" in case for case in found):
        sure = sum(any(belief > 0.5 and not true for belief, true in case["stated"]) for case in found)
        cells.append(f"{sum(case['extra'] for case in found)}, {sure} of {len(found)}")
    return f"| {name} | {' | '.join(cells)} |"


def table(benchmark: str, sets: dict[str, int], last: int) -> list[str]:
    """All sets, the newest first, and the sum of the last ones."""
    every = [(commit, seeds, cases(benchmark, commit)) for commit, seeds in reversed(sets.items())]
    heads = ["seeds (commit)", "effects at 1.0", "at 0.3", "pairs", "false alarms", "outside the library"]
    heads += ["false names: all, over 50 %"] * (benchmark == "foreign")
    lines = [f"| {' | '.join(heads)} |", "| --- |" + " --- |" * (len(heads) - 1)]
    lines += [row(f"{seeds} ({commit})", found) for commit, seeds, found in every]
    return [*lines, row(f"the last {min(last, len(every))}", [case for *_, found in every[:last] for case in found])]


def missed(benchmark: str, sets: dict[str, int], last: int) -> list[str]:
    """Single effects that were not named first, by strength: missed of how many."""
    found = [case for commit in list(sets)[-last:] for case in cases(benchmark, commit) if case["kind"] == "single"]
    lines = []
    for strength in (1.0, 0.3):
        chosen = [case for case in found if case["strength"] == strength]
        whole = Counter(case["truth"][0] for case in chosen)
        wrong = Counter(case["truth"][0] for case in chosen if not case["right"])
        listed = ", ".join(f"`{name}` {count} of {whole[name]}" for name, count in wrong.most_common())
        lines.append(f"Missed at {strength:g}: {listed}.")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--last", type=int, default=7, help="sets that the last row adds")
    parser.add_argument("--missed", action="store_true", help="which effects were not named first")
    arguments = parser.parse_args()
    for benchmark, sets in (("foreign", FOREIGN), ("concealed", CONCEALED)):
        print(benchmark, *table(benchmark, sets, arguments.last), sep="\n")
        if arguments.missed:
            print(*missed(benchmark, sets, arguments.last), sep="\n")
        print()


if __name__ == "__main__":
    main()
