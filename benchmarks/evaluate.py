"""What `poise evaluate` costs: 1,000 recordings on one worker and on two, killed workers, overhead for a recording.

python benchmarks/evaluate.py [--quick]
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from poise.cli import run
from poise.recording import open_recording, rewrite_recording

ROOT = Path(__file__).resolve().parents[1]
BAG = ROOT / "bags" / "kuka_static_poses.mcap"
JOB = ("identify", "--method", "static")
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}


def make_fleet(folder: Path, count: int) -> None:
    """Recordings that differ: the committed one with 0.05 N and 1 mN m of noise of its own."""
    recording = open_recording(BAG)
    wrench = recording.wrench()
    for number in range(count):
        noise = np.random.default_rng(number).normal(size=wrench.wrench_in_sensor.shape) * ([0.05] * 3 + [0.001] * 3)
        noisy = replace(wrench, wrench_in_sensor=wrench.wrench_in_sensor + noise)
        rewrite_recording(recording, folder / f"run_{number:04}.mcap", {"wrench": noisy})


def children_cpu() -> float:
    """CPU s of all ended child processes and theirs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def workers_of(process: subprocess.Popen[bytes]) -> list[int]:
    """The processes that a process started."""
    try:  # each thread of it has children of its own
        lists = [path.read_text() for path in Path(f"/proc/{process.pid}/task").glob("*/children")]
    except OSError:  # it ended meanwhile
        return []
    return sorted(int(word) for words in lists for word in words.split())


def evaluated(fleet: Path, results: Path, workers: int, kill_every: float = 0.0) -> dict[str, Any]:
    """Run the command, optionally killing one of its workers again and again; wall and CPU s, and the answers."""
    before, start = children_cpu(), time.perf_counter()
    words = ["evaluate", JOB[0], str(fleet), *JOB[1:], "--workers", str(workers), "--results", str(results)]
    process = subprocess.Popen([sys.executable, "-m", "poise.cli", *words], stdout=subprocess.DEVNULL, env=ENVIRONMENT)
    kills = 0
    while process.poll() is None:
        time.sleep(kill_every or 0.05)
        running = workers_of(process)
        begun = (results / "journal.jsonl").exists() and (results / "journal.jsonl").read_bytes().count(b"\n") > 1
        if kill_every and begun and running:
            os.kill(running[kills % len(running)], signal.SIGKILL)
            kills += 1
    lines = [json.loads(line) for line in (results / "journal.jsonl").read_text().splitlines()[1:]]
    return {
        "wall": time.perf_counter() - start,
        "cpu": children_cpu() - before,
        "kills": kills,
        "lines": len(lines),
        "answers": {line["name"]: line["answer"] for line in lines},
        "errors": sum(line["error"] is not None for line in lines),
    }


def direct(fleet: Path) -> float:
    """CPU s of the same job in a loop in one process, as a script of one's own would do it."""
    program = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from benchmarks.evaluate import loop; loop(sys.argv[1])"
    before = children_cpu()
    subprocess.run([sys.executable, "-c", program, str(fleet)], check=True, stdout=subprocess.DEVNULL, env=ENVIRONMENT)
    return children_cpu() - before


def loop(fleet: str) -> None:
    """Weigh every recording of a folder, one after the other."""
    for path in sorted(Path(fleet).iterdir()):
        run([JOB[0], str(path), *JOB[1:], "--json", str(path.parent.parent / "answer.json")])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="100 recordings")
    parser.add_argument("--recordings", type=int, default=1000)
    parser.add_argument(
        "--rounds", type=int, default=1, help="runs of one and of two workers in turn; the median counts"
    )
    options = parser.parse_args()
    count = 100 if options.quick else options.recordings
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "fleet").mkdir()
        make_fleet(folder / "fleet", count)
        single = direct(folder / "fleet")
        ones, twos = [], []
        for turn in range(options.rounds):
            ones.append(evaluated(folder / "fleet", folder / f"one_{turn}", 1))
            twos.append(evaluated(folder / "fleet", folder / f"two_{turn}", 2))
        killed = evaluated(folder / "fleet", folder / "killed", 2, 8.0)
    one, two = ones[0], twos[0]
    ratios = [first["wall"] / second["wall"] for first, second in zip(ones, twos, strict=True)]
    print(f"{count} recordings, load of the machine {os.getloadavg()[1]:.1f}")
    print(f"a loop of one's own: {single:.1f} s of CPU, {1e3 * single / count:.1f} ms for a recording")
    for label, found in (("1 worker", one), ("2 workers", two)):
        print(f"{label}: {found['wall']:.1f} s, {found['cpu']:.1f} s of CPU, {found['errors']} errors")
    worst, middle, best = np.quantile(ratios, (0, 0.5, 1))
    print(f"2 workers against 1: {middle:.2f} x ({worst:.2f} to {best:.2f}); CPU {two['cpu'] / one['cpu']:.3f} x")
    print(f"overhead for a recording: {1e3 * (one['cpu'] - single) / count:.1f} ms of CPU, start and tables included")
    same = one["answers"] == two["answers"] == killed["answers"]
    print(
        f"{killed['kills']} workers killed: {killed['lines']} lines, {killed['errors']} errors; answers equal: {same}"
    )


if __name__ == "__main__":
    main()
