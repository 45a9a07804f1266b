"""Recordings of wrong drivers: units, signs, axes, clocks, frozen readings, joints of another order.

python -m benchmarks.broken_inputs [--seed-set healthy_dev] [--rigs N]; --quick: two rigs

Healthy recordings of `benchmarks.foreign` with a wrench are each broken in every way. What the tool says is right when
its message, a note or an effect says what was done, and no other effect is named.
Prints a table and writes out/benchmarks/broken_inputs.json. Exits with 1 when a broken input is a false name.
"""

import argparse
import json
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.foreign.bag import Joints, Streams, Wrenches
from benchmarks.foreign.case import Case, make_case
from benchmarks.foreign.plan import SEEDS, plans
from benchmarks.foreign.robots import Array
from benchmarks.foreign.run import answer
from poise.files import write_whole

Break = Callable[[Streams, Wrenches], Streams]
OUTCOMES = ("right", "unknown", "silent", "false name", "error")
LIMIT = 300
"""s of CPU for one answer."""
console = Console(width=120)


def _wrench(change: Callable[[Array], Array]) -> Break:
    return lambda streams, wrench: replace(streams, wrench=replace(wrench, values=change(wrench.values.copy())))


def _through(matrix: Array) -> Break:
    return _wrench(lambda values: values @ matrix.T)


def _factors(*factors: float) -> Break:
    return _through(np.diag(np.array(factors)))


def _turned(axis: int, degrees: float) -> Break:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[a, a] = turn[b, b] = cosine
    turn[a, b], turn[b, a] = -sine, sine
    return _through(np.kron(np.eye(2), turn))


def _late(seconds: float) -> Break:
    shift = round(1e9 * seconds)
    return lambda streams, wrench: replace(streams, wrench=replace(wrench, stamps=wrench.stamps + shift))


def _frozen(values: Array) -> Array:
    first = len(values) // 3
    values[first : first + len(values) // 4] = values[first]
    return values


def _repeated(values: Array) -> Array:
    return np.asarray(values[np.arange(len(values)) // 5 * 5])


def _dead(values: Array) -> Array:
    values[:, 2] = 1e-6 * values[::-1, 2]
    return values


def _tared(values: Array) -> Array:
    return np.asarray(values - values[:20].mean(axis=0))


def _clipped(values: Array) -> Array:
    most = np.quantile(np.abs(values), 0.9, axis=0)
    return np.clip(values, -most, most)


def _joints(change: Callable[[Array], Array]) -> Break:
    def broken(streams: Streams, wrench: Wrenches) -> Streams:
        joints: Joints = streams.joints
        moved = {name: change(getattr(joints, name)) for name in ("position", "velocity")}
        return replace(streams, wrench=wrench, joints=replace(joints, **moved))

    return broken


def _reversed_joint(values: Array) -> Array:
    return values * np.where(np.arange(values.shape[1]) == values.shape[1] - 2, -1.0, 1.0)


def _in_other_order(streams: Streams, wrench: Wrenches) -> Streams:
    return replace(streams, wrench=wrench, names=(*streams.names[-1:], *streams.names[:-1]))


BREAKS: dict[str, tuple[Break, str, str]] = {
    "opposite sign": (_factors(*[-1.0] * 6), "opposite sign", ""),
    "opposite torque": (_factors(*[1.0] * 3, *[-1.0] * 3), "torque has the opposite sign", ""),
    "one force negative": (_factors(1, 1, -1, 1, 1, 1), "fz alone|z axis is mirrored", ""),
    "one torque negative": (_factors(1, 1, 1, -1, 1, 1), "tx alone", ""),
    "left-handed": (_factors(1, -1, 1, 1, -1, 1), "y axis is mirrored", ""),
    "torque first": (_wrench(lambda values: np.roll(values, 3, axis=1)), "torque comes first", ""),
    "kgf": (_through(np.eye(6) / 9.80665), "in kgf", ""),
    "lbf, lbf in": (_factors(*[1 / 4.4482216] * 3, *[8.8507457] * 3), "in lbf.*lbf in", ""),
    "N cm": (_factors(*[1.0] * 3, *[100.0] * 3), "in N cm", ""),
    "dead force": (
        _wrench(_dead),
        "fz does not respond",
        "",
    ),
    "turned 30 degrees": (_turned(2, 30.0), "", "sensor_rotation"),
    "turned 180 degrees": (_turned(0, 180.0), "", "sensor_rotation"),
    "1 s late": (_late(1.0), r"stamps are (0\.9|1\.0). s late", ""),
    "0.1 s early": (_late(-0.1), "", "clock_offset"),
    "frozen": (_wrench(_frozen), "repeats one reading", ""),
    "repeated": (_wrench(_repeated), "repeats each measured wrench 5 times", ""),
    "tared with the load": (_wrench(_tared), "", "sensor_bias"),
    "clipped": (_wrench(_clipped), "", "saturation"),
    "joint reversed": (_joints(_reversed_joint), "opposite direction|its range in the description", ""),
    "joints in other order": (_in_other_order, "in the order|its range in the description", ""),
}
"""What is done, the words that say so, and the effect that is so."""


def rigs(seed_set: str, count: int) -> Iterator[Case]:
    """Healthy recordings with a wrench of robots with at least six joints."""
    made = (make_case(plan) for plan in plans(seed_set, 40 * count) if plan.kind == "healthy")
    fit = (case for case in made if case.streams.wrench is not None and len(case.streams.names) >= 6)
    return islice(fit, count)


def outcome(case: Case, kind: str) -> tuple[str, str]:
    """What the tool says of a broken recording, and its names or words."""
    change, words, effect = BREAKS[kind]
    if case.streams.wrench is None:
        raise ValueError("the rig has no wrench")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "case"
        replace(case, streams=change(case.streams, case.streams.wrench)).write(folder)
        said = answer(folder, LIMIT)
    content = said["answer"]
    if content is None:
        right = bool(words) and re.search(words, said["message"], re.DOTALL) is not None
        return ("right" if right else "error"), said["message"][-200:]
    names = [each["name"] for each in content["effects"]]
    if set(names) - {effect}:
        return "false name", " + ".join(names)
    notes = " ".join(content["notes"])
    if effect in names or (words and re.search(words, notes) and content["verdict"] == "none"):
        return "right", effect or notes[-200:]
    return ("unknown" if content["verdict"] == "unknown" else "silent"), content["verdict"]


def main() -> int:
    """Break and answer; 0 without a false name."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed-set", choices=sorted(SEEDS), default="healthy_dev")
    parser.add_argument("--rigs", type=int, default=5, help="recordings, each broken in every way")
    parser.add_argument("--quick", action="store_true", help="two recordings")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/broken_inputs.json"))
    options = parser.parse_args()
    cases = list(rigs(options.seed_set, 2 if options.quick else options.rigs))
    found = {
        kind: [outcome(case, kind) for case in cases]
        for kind in track(BREAKS, description="broken inputs", console=console)
    }
    table = Table("input", *OUTCOMES, "names")
    for kind, said in found.items():
        count = Counter(result for result, _ in said)
        wrong = sorted({what for result, what in said if result == "false name"})
        table.add_row(kind, *(str(count[each]) for each in OUTCOMES), "; ".join(wrong))
    total = Counter(result for said in found.values() for result, _ in said)
    table.add_row("sum", *(str(total[each]) for each in OUTCOMES), "", style="bold")
    console.print(table)
    write_whole(options.output, json.dumps(found, indent=1).encode())
    return int(total["false name"] > 0)


if __name__ == "__main__":
    raise SystemExit(main())
