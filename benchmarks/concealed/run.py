"""Let the tool judge the bags: `python -m benchmarks.concealed.run DIR`; the answers go to DIR/answers."""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

ANSWERS = "answers"
TIMES = "times.json"
KEPT = ("PATH", "HOME", "LANG", "LD_LIBRARY_PATH", "VIRTUAL_ENV", "PYTHONPATH")
"""What of the environment reaches the tool: enough to start, and nothing about the case."""

LIMIT = 600.0  # s, of one case, on a machine that does other things too


@dataclass(frozen=True)
class Outcome:
    """How one run of the tool went."""

    case: str
    seconds: float
    status: int
    complaint: str


def judge(bag: Path, answers: Path) -> Outcome:
    """Run `poise mismatch` on one bag, in an empty folder where the bag has no name of its own."""
    name = bag.stem
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        shutil.copy(bag, place / "recording.mcap")
        shutil.copy(bag.with_suffix(".yaml"), place / "model.yaml")
        arguments = ["mismatch", "recording.mcap", "--model", "model.yaml", "--json", "answer.json"]
        seconds, status, complaint = run_tool(place, arguments)
        if status == 0 and (place / "answer.json").is_file():
            shutil.move(place / "answer.json", answers / f"{name}.json")
    return Outcome(name, seconds, status, complaint)


def run_tool(place: Path, arguments: list[str]) -> tuple[float, int, str]:
    """Run `poise` in a folder: seconds, exit status (-1 when it exceeds LIMIT), and the end of its stderr."""
    begin = time.monotonic()
    try:
        ended = subprocess.run(
            [_tool(), *arguments],
            cwd=place,
            env=_environment(),
            capture_output=True,
            text=True,
            timeout=LIMIT,
            check=False,
        )
        status, complaint = ended.returncode, ended.stderr[-2000:]
    except subprocess.TimeoutExpired:
        status, complaint = -1, f"no answer within {LIMIT:g} s"
    return time.monotonic() - begin, status, complaint


def _tool() -> str:
    """The command beside this Python, as a user of this environment would run it."""
    beside = Path(sys.executable).with_name("poise")
    found = str(beside) if beside.is_file() else shutil.which("poise")
    if found is None:
        raise SystemExit("there is no command `poise` in this environment: install the package first")
    return found


def _environment() -> dict[str, str]:
    one_core = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    return {name: os.environ[name] for name in KEPT if name in os.environ} | one_core


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--again", action="store_true", help="also bags that have an answer already")
    arguments = parser.parse_args()
    folder: Path = arguments.folder
    answers = folder / ANSWERS
    answers.mkdir(exist_ok=True)
    times_file = answers / TIMES
    times = json.loads(times_file.read_text()) if times_file.is_file() else {}
    bags = sorted(folder.glob("case_*.mcap"))
    if not bags:
        parser.error(f"there are no case_*.mcap in {folder}: make them first")
    due = [bag for bag in bags if arguments.again or not (answers / f"{bag.stem}.json").is_file()]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    failed: list[Outcome] = []
    with Progress(*columns) as progress, ThreadPoolExecutor(arguments.processes) as pool:
        pending = [pool.submit(judge, bag, answers) for bag in due]
        for future in progress.track(as_completed(pending), len(pending), description="poise mismatch"):
            outcome = future.result()
            times[outcome.case] = {"seconds": round(outcome.seconds, 3), "status": outcome.status}
            if outcome.status != 0:
                failed.append(outcome)
            times_file.write_text(json.dumps(times, indent=1, sort_keys=True) + "\n")
    for outcome in failed:
        print(f"{outcome.case}: exit {outcome.status}: {outcome.complaint.strip().splitlines()[-1:]}", file=sys.stderr)
    print(f"{len(due) - len(failed)} of {len(due)} bags answered; answers in {answers}")


if __name__ == "__main__":
    main()
