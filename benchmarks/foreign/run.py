"""Let the tool answer each case in an empty folder: `python -m benchmarks.foreign.run DIR`; answers in DIR/answers."""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from rich.progress import track

ANSWERS = "answers"
RECORDING = "recording.mcap"
COMMAND = ("--model", "model.yaml", "--json", "answer.json")
ENVIRONMENT = ("PATH", "HOME", "LANG", "LD_LIBRARY_PATH", "VIRTUAL_ENV", "PYTHONPATH")
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def answer(case: Path, limit: int, recording: str = RECORDING) -> dict[str, Any]:
    """What the tool says of a case: {status, cpu, message, answer}; status below 0 when it is stopped."""
    with tempfile.TemporaryDirectory() as scratch:
        for file in case.iterdir():
            shutil.copy(file, scratch)
        environment = {key: os.environ[key] for key in ENVIRONMENT if key in os.environ} | THREADS
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "poise.cli", "mismatch", recording, *COMMAND]
        done = subprocess.run(
            command,
            cwd=scratch,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (limit, limit)),
        )
        status = done.returncode
        message = done.stderr if status >= 0 else f"ended by signal {-status}; the limit is {limit} s of CPU"
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found = Path(scratch) / "answer.json"
        content = json.loads(found.read_text(encoding="utf-8")) if status in (0, 3) and found.is_file() else None
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"status": status, "cpu": round(cpu, 2), "message": message.strip()[-600:], "answer": content}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--limit", type=int, default=300, help="s of CPU for one case")
    parser.add_argument("--again", action="store_true", help="also cases that have an answer")
    parser.add_argument("--quick", action="store_true", help="the first three cases alone")
    arguments = parser.parse_args()
    cases = sorted(arguments.folder.glob("case_*"))[: 3 if arguments.quick else None]
    if not cases:
        parser.error(f"{arguments.folder} has no case_*: make them first")
    answers = arguments.folder / ANSWERS
    answers.mkdir(exist_ok=True)
    due = [case for case in cases if arguments.again or not (answers / f"{case.name}.json").is_file()]
    for case in track(due, description="poise mismatch"):
        text = json.dumps(answer(case, arguments.limit), indent=1)
        (answers / f"{case.name}.json").write_text(text + "\n", encoding="utf-8")
    print(f"{len(due)} cases answered; the answers are in {answers}")


if __name__ == "__main__":
    main()
