"""Recordings of wrong drivers (units, signs, axes, clocks, frozen readings), and tables with wrong mappings.

python -m benchmarks.broken_inputs [wrench|efforts|joints|tables|models|descriptions ...]
    [--seed-set healthy_dev] [--rigs N]
--quick: one rig

Healthy recordings of `benchmarks.foreign` are each broken in every way. What the tool says is right when its message, a
note, an effect or its sentence says what was done, and no other effect is named.
Prints a table and writes out/benchmarks/broken_inputs.json. Exits with 1 when a broken input is a false name.
"""

import argparse
import json
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.broken_inputs import descriptions, efforts, joints, models, tables, wrenches
from benchmarks.broken_inputs.way import Way, Written
from benchmarks.foreign.case import Case, make_case
from benchmarks.foreign.plan import SEEDS, plans
from benchmarks.foreign.run import RECORDING, answer
from poise.files import write_whole

OUTCOMES = ("right", "unknown", "silent", "false name", "error")
LIMIT = 300
"""s of CPU for one answer."""
GROUPS: dict[str, tuple[dict[str, Way], Callable[[Case], bool]]] = {
    "wrench": (wrenches.WAYS, lambda case: case.streams.wrench is not None and len(case.streams.names) >= 6),
    "efforts": (efforts.WAYS, lambda case: case.streams.joints.effort.size > 0 and len(case.streams.names) > 1),
    "joints": (joints.WAYS, lambda case: len(case.streams.names) > 1),
    "tables": (tables.WAYS, lambda case: len(case.streams.names) > 1),
    "models": (models.WAYS, lambda case: len(case.streams.names) > 1),
    "descriptions": (descriptions.WAYS, lambda case: len(case.streams.names) > 1),
}
"""What is broken, in which ways, and of which recordings."""
console = Console(width=120)


def rigs(seed_set: str, count: int, fit: Callable[[Case], bool]) -> Iterator[Case]:
    """Healthy recordings that can be broken."""
    made = (make_case(plan) for plan in plans(seed_set, 40 * count) if plan.kind == "healthy")
    return islice((case for case in made if fit(case)), count)


def outcome(broken: Written, way: Way) -> tuple[str, str]:
    """What the tool says of a recording that is broken, and its names or words."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "case"
        broken.write(folder)
        said = answer(folder, LIMIT, RECORDING if (folder / RECORDING).exists() else tables.RECORDING)
    content = said["answer"]
    if content is None:
        right = bool(way.words) and re.search(way.words, said["message"], re.DOTALL) is not None
        return ("right" if right else "error"), said["message"][-300:]
    said_so = {each["name"] for each in content["effects"] if way.words and re.search(way.words, each["sentence"])}
    names = [each["name"] for each in content["effects"]]
    if set(names) - {way.effect} - said_so:
        return "false name", " + ".join(names)
    notes = " ".join([*content["notes"], *(each["sentence"] for each in content["input_findings"])])
    healthy = content["verdict"] == "none"
    if way.effect in names or said_so or (way.words and re.search(way.words, notes)) or (healthy and way.harmless):
        return "right", way.effect or notes[-300:]
    return ("silent" if healthy else "unknown"), notes[-300:]


def main() -> int:
    """Break and answer; 0 without a false name."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", choices=GROUPS, help="what is broken; none: everything")
    parser.add_argument("--seed-set", choices=sorted(SEEDS), default="healthy_dev")
    parser.add_argument("--rigs", type=int, default=5, help="recordings, each broken in every way")
    parser.add_argument("--quick", action="store_true", help="one recording")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/broken_inputs.json"))
    options = parser.parse_args()
    found: dict[str, dict[str, list[tuple[str, str]]]] = {}
    total: Counter[str] = Counter()
    for group in options.groups or GROUPS:
        ways, fit = GROUPS[group]
        cases = list(rigs(options.seed_set, 1 if options.quick else options.rigs, fit))
        found[group] = {
            name: [outcome(broken, way) for case in cases if (broken := way.broken(case)) is not None]
            for name, way in track(ways.items(), description=f"broken {group}", console=console)
        }
        total += _show(group, found[group])
    write_whole(options.output, json.dumps(found, indent=1).encode())
    return int(total["false name"] > 0)


def _show(group: str, found: dict[str, list[tuple[str, str]]]) -> Counter[str]:
    table = Table(group, *OUTCOMES, "names")
    for name, said in found.items():
        count = Counter(result for result, _ in said)
        wrong = sorted({what for result, what in said if result == "false name"})
        table.add_row(name, *(str(count[each]) for each in OUTCOMES), "; ".join(wrong))
    total = Counter(result for said in found.values() for result, _ in said)
    table.add_row("sum", *(str(total[each]) for each in OUTCOMES), "", style="bold")
    console.print(table)
    return total


if __name__ == "__main__":
    raise SystemExit(main())
