"""Every node under every fault: what must hold, whether it held, and the table of docs/reliability.md.

    python -m benchmarks.chaos                         # the table, about 20 minutes
    python -m benchmarks.chaos --quick                 # three nodes, four faults
    python -m benchmarks.chaos --node ft_driver --fault "kill -9, restart" --repeats 50
    python -m benchmarks.chaos --page docs/reliability.md

Exits with 1 when a row does not hold. Writes out/benchmarks/chaos.json.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.chaos.faults import FAULTS, Bench
from benchmarks.chaos.handling import HANDLING
from benchmarks.chaos.observer import Observer, TooLateError
from benchmarks.chaos.processes import TRANSPORT, NodeProgram
from benchmarks.chaos.subjects import ESTIMATING, Subject

SUBJECTS = ESTIMATING | HANDLING
_QUICK = (("ft_driver", "robustness_server"), ("stopped 2 s", "bad messages", "slow reader", "wrong parameters"))
_START = "<!-- table: python -m benchmarks.chaos --page -->"
_END = "<!-- end of the table -->"
_ATTEMPT = 5.0
"""s for an answer before it is asked for again."""
_PATIENCE = 60.0


@dataclass(frozen=True)
class Row:
    """One node under one fault.

    Args:
        node, fault: names.
        held: alive or restarted, answers right again, no false answer, no traceback, clean end.
        seconds: from the end of the fault to the next right answer.
        why: what did not hold, and notes.
    """

    node: str
    fault: str
    held: bool
    seconds: float
    why: str


def right_again(subject: Subject, observer: Observer) -> float:
    """s until the next right answer.

    Raises:
        TooLateError: when none comes.
    """
    begun, before = time.monotonic(), subject.right
    while subject.right == before:
        if time.monotonic() - begun > _PATIENCE:
            raise TooLateError(f"a right answer of {subject.node}")
        if subject.stream:
            observer.rest(0.02)
            continue
        try:
            subject.ask(observer, _ATTEMPT)
        except TooLateError:
            continue
    return time.monotonic() - begun


def trial(name: str, faults: list[str], domain: int) -> list[Row]:
    """Start a node, do all this to it in order, and stop it."""
    rows = []
    observer = Observer(domain)
    subject = SUBJECTS[name]()
    with subject.open, tempfile.TemporaryDirectory() as folder:
        program = NodeProgram(subject.node, subject.parameters(), Path(folder), domain)
        companions = [NodeProgram(other, values, Path(folder), domain) for other, values in subject.companions.items()]
        bench = Bench(subject, program, companions, observer)
        subject.connect(observer)
        try:
            for one in bench.everything():
                one.start()
            right_again(subject, observer)
            for fault in faults:
                rows.append(_row(bench, name, fault))
        finally:
            status = program.stop()
            for one in companions:
                one.stop()
            observer.close()
        if status != 0:
            rows.append(
                Row(name, "Ctrl-C at the end", False, 0.0, f"exit status {status}: {program.output.strip()[-200:]}")
            )
    return rows


def _row(bench: Bench, name: str, fault: str) -> Row:
    subject, program = bench.subject, bench.program
    false, tracebacks = len(subject.false), program.output.count("Traceback")
    bench.notes.clear()
    why, seconds = "", float("nan")
    try:
        FAULTS[fault](bench)
        seconds = right_again(subject, bench.observer)
    except TooLateError as late:
        why = f"did not come: {late}"
    if not program.is_running:
        why += f" the node ended: {program.output.strip().splitlines()[-1:]}"
        program.start()
    if program.output.count("Traceback") > tracebacks:
        why += " a traceback"
    why += "; ".join(f" {number} x {text}" for text, number in Counter(subject.false[false:]).most_common(2))
    return Row(name, fault, not why, seconds, why.strip() or "; ".join(bench.notes))


def table_of(rows: list[Row]) -> str:
    """Markdown: one line for each node, one column for each fault, s to the next right answer."""
    faults = [fault for fault in FAULTS if any(row.fault == fault for row in rows)]
    lines = [f"| node | {' | '.join(faults)} |", "| --- " * (len(faults) + 1) + "|"]
    for name in dict.fromkeys(row.node for row in rows):
        cells = [_cell([row for row in rows if (row.node, row.fault) == (name, fault)]) for fault in faults]
        lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(rows: list[Row]) -> str:
    if not rows:
        return "–"
    held = sum(row.held for row in rows)
    worst = max((row.seconds for row in rows if row.held), default=float("nan"))
    count = "" if len(rows) == 1 else f"{held} of {len(rows)}, "
    return f"{count}{worst:.1f} s" if held == len(rows) else f"**failed**: {next(r.why for r in rows if not r.held)}"


def write_page(page: Path, rows: list[Row]) -> None:
    """Replace the table of the page."""
    text = page.read_text()
    before, _, rest = text.partition(_START)
    _, _, behind = rest.partition(_END)
    page.write_text(f"{before}{_START}\n{table_of(rows)}\n{_END}{behind}")


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--node", action="append", choices=list(SUBJECTS), help="only this one; may be repeated")
    parser.add_argument("--fault", action="append", choices=list(FAULTS), help="only this one; may be repeated")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--domain", type=int, default=77)
    parser.add_argument("--page", type=Path, help="page whose table is replaced")
    parser.add_argument("--quick", action="store_true", help="a few nodes and faults")
    arguments = parser.parse_args()
    nodes = arguments.node or (list(_QUICK[0]) if arguments.quick else list(SUBJECTS))
    faults = arguments.fault or (list(_QUICK[1]) if arguments.quick else list(FAULTS))
    os.environ.update(TRANSPORT)
    console, rows = Console(), list[Row]()
    for name in nodes:
        try:
            found = trial(name, faults * arguments.repeats, arguments.domain)
        except TooLateError as late:
            found = [Row(name, "start", False, 0.0, f"did not come: {late}")]
        for row in found:
            console.print(
                f"{row.node}, {row.fault}: {'held' if row.held else 'FAILED'}, {row.seconds:.1f} s; {row.why}"
            )
        rows += found
    table = Table("node", "held", "of")
    for name in nodes:
        mine = [row for row in rows if row.node == name]
        table.add_row(name, str(sum(row.held for row in mine)), str(len(mine)))
    console.print(table)
    result = Path("out/benchmarks/chaos.json")
    result.parent.mkdir(parents=True, exist_ok=True)
    result.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    if arguments.page:
        write_page(arguments.page, rows)
    sys.exit(not all(row.held for row in rows))
