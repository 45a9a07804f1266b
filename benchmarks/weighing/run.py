"""Let `poise identify` answer each case: `python -m benchmarks.weighing.run DIR`; one line a case in DIR/answers.jsonl.

The command runs in this process, so that a case does not pay for the imports; it sees the recording alone.
"""

import argparse
import contextlib
import io
import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.progress import track

from poise.cli import run as poise

ANSWERS = "answers.jsonl"


@contextlib.contextmanager
def _empty_folder(case: Path) -> Iterator[Path]:
    """A working folder with the recording alone."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as scratch:
        shutil.copy(case / "recording.mcap", scratch)
        os.chdir(scratch)
        try:
            yield Path(scratch)
        finally:
            os.chdir(before)


def answer(case: Path, *more: str) -> dict[str, Any]:
    """What the command says of a case: {case, status, cpu, message, answer}; `more` are further arguments."""
    given = (case / "arguments.txt").read_text(encoding="utf-8").split()
    printed, complaints = io.StringIO(), io.StringIO()
    with _empty_folder(case.resolve()) as folder:
        began = time.process_time()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(complaints):
            status = poise(["identify", "recording.mcap", "--json", "answer.json", *given, *more])
        cpu = time.process_time() - began
        found = folder / "answer.json"
        content = json.loads(found.read_text(encoding="utf-8")) if found.is_file() else None
    message = complaints.getvalue().strip()[-600:]
    return {"case": case.name, "status": status, "cpu": round(cpu, 2), "message": message, "answer": _short(content)}


def _short(content: dict[str, Any] | None) -> dict[str, Any] | None:
    """Without the list of rejected spans, which is long: samples by reason."""
    if content is None:
        return None
    counts: dict[str, int] = {}
    for span in content.get("rejected") or []:
        counts[span["reason"]] = counts.get(span["reason"], 0) + span["samples"]
    return content | {"rejected": counts}


def answered(folder: Path) -> dict[str, dict[str, Any]]:
    """The answers so far, by case."""
    file = folder / ANSWERS
    if not file.is_file():
        return {}
    lines = file.read_text(encoding="utf-8").splitlines()
    return {entry["case"]: entry for entry in map(json.loads, lines)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--again", action="store_true", help="also cases that have an answer")
    parser.add_argument("--repair", action="store_true", help="a second run with --repair where there is a finding")
    parser.add_argument("--every", type=int, default=1, help="each n-th case alone")
    arguments = parser.parse_args()
    cases = sorted(arguments.folder.glob("case_*"))[:: arguments.every]
    if not cases:
        parser.error(f"{arguments.folder} has no case_*: make them first")
    if arguments.again:
        (arguments.folder / ANSWERS).unlink(missing_ok=True)
    known = answered(arguments.folder)
    due = [case for case in cases if case.name not in known]
    for case in track(due, description="poise identify"):
        entry = answer(case)
        if arguments.repair and (entry["status"] == 3 or (entry["answer"] or {}).get("findings")):
            entry["repaired"] = answer(case, "--repair")
        with (arguments.folder / ANSWERS).open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry) + "\n")
    print(f"{len(due)} cases answered; the answers are in {arguments.folder / ANSWERS}")


if __name__ == "__main__":
    main()
