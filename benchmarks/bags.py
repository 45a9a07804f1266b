"""Benchmark of bags: how fast wrenches are read against other readers, and whether damage ever passes silently.

    python benchmarks/bags.py [--quick]

Prints tables and writes out/benchmarks/bags.json. Two minutes on one core; `--quick` takes ten seconds.
"""

import argparse
import json
import platform
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from rosbags.highlevel import AnyReader

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "test" / "recording")]

from bag_reference import judge, messages_before, write_sample  # noqa: E402  (the judge of the tests)

from poise.errors import InputError  # noqa: E402
from poise.recording import WrenchStream, open_recording, write_recording  # noqa: E402

COMPRESSIONS = ("none", "lz4", "zstd")
Reader = Callable[[Path], tuple[Any, Any]]


def read_with_poise(path: Path) -> tuple[Any, Any]:
    stream = open_recording(path, strict=True).wrench()
    return stream.stamps, stream.wrench_in_sensor


def read_with_mcap_ros2(path: Path) -> tuple[Any, Any]:
    from mcap_ros2.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return as_arrays([message for _, _, _, message in reader.iter_decoded_messages(topics=["wrench"])])


def read_with_rosbags(path: Path) -> tuple[Any, Any]:
    with AnyReader([path]) as reader:
        chosen = [connection for connection in reader.connections if connection.topic == "wrench"]
        messages = reader.messages(connections=chosen)
        return as_arrays([reader.deserialize(data, connection.msgtype) for connection, _, data in messages])


def as_arrays(messages: list[Any]) -> tuple[Any, Any]:
    """Give messages as the arrays that the others have to give too."""
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in messages]
    rows = [
        (
            *(getattr(message.wrench.force, axis) for axis in "xyz"),
            *(getattr(message.wrench.torque, axis) for axis in "xyz"),
        )
        for message in messages
    ]
    return np.array(stamps), np.array(rows)


READERS: dict[str, Reader] = {
    "poise": read_with_poise,
    "mcap_ros2": read_with_mcap_ros2,
    "rosbags": read_with_rosbags,
}


def measure_rates(folder: Path, samples: int, repeats: int, progress: Progress) -> list[dict[str, Any]]:
    """Time the readers in turn, so that a busy moment of the machine meets all of them."""
    rng = np.random.default_rng(0)
    wrench = WrenchStream(np.arange(samples) * 1_000_000, rng.normal(size=(samples, 6)).round(4), "ft_sensor")
    rows = []
    task = progress.add_task("reading rates", total=len(COMPRESSIONS) * repeats * len(READERS))
    for compression in COMPRESSIONS:
        path = folder / f"rate_{compression}.mcap"
        write_recording(path, {"wrench": wrench}, compression=compression)
        rates: dict[str, list[float]] = {name: [] for name in READERS}
        for _ in range(repeats):
            for name, read in READERS.items():
                start = time.perf_counter()
                stamps, values = read(path)
                rates[name].append(samples / (time.perf_counter() - start))
                if not (np.array_equal(stamps, wrench.stamps) and np.array_equal(values, wrench.wrench_in_sensor)):
                    raise SystemExit(f"{name} does not read what was written")
                progress.advance(task)
        for name, found in rates.items():
            quarters = statistics.quantiles(found, n=4)
            row = {"compression": compression, "reader": name, "median": statistics.median(found)}
            rows.append({**row, "quartiles": [quarters[0], quarters[2]], "repeats": repeats})
    return rows


def cut_bags(folder: Path, cuts: int, progress: Progress) -> list[dict[str, Any]]:
    """Cut bags anywhere and count the cuts after which an intact message is missing or a loss is not reported."""
    rows = []
    task = progress.add_task("truncation", total=len(COMPRESSIONS) * cuts)
    for compression in COMPRESSIONS:
        content = write_sample(folder / "whole.mcap", compression)
        path = folder / "cut.mcap"
        wrong = untold = recovered = 0
        for cut in np.random.default_rng(1).integers(8, len(content), cuts):
            path.write_bytes(content[:cut])
            try:
                recording = open_recording(path)
                found = Counter((message.log_time, message.data) for message in recording.messages())
                untold += not recording.losses
            except InputError:
                found = Counter()
            recovered += found.total()
            wrong += found != messages_before(content, int(cut))
            progress.advance(task)
        row = {"compression": compression, "cuts": cuts, "messages_recovered": recovered}
        rows.append({**row, "cuts_with_missing_messages": wrong, "untold": untold})
    return rows


def judge_peer(read: Callable[[Path], Counter[Any]], path: Path, truth: Counter[Any]) -> str:
    """Say what another reader notices: an error, or silence with the same or other messages."""
    try:
        return "same" if read(path) == truth else "silent"
    except Exception:
        return "error"


def raw_with_mcap(path: Path) -> Counter[Any]:
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages()
        return Counter((message.log_time, channel.topic, message.data) for _, channel, message in messages)


def raw_with_rosbags(path: Path) -> Counter[Any]:
    with AnyReader([path]) as reader:
        return Counter((stamp, connection.topic, bytes(data)) for connection, stamp, data in reader.messages())


def flip_bits(folder: Path, flips: int, progress: Progress) -> list[dict[str, Any]]:
    """Flip one bit at a time, anywhere, and count what our reader and (a tenth of the flips) others notice."""
    rows = []
    peers = {"mcap": raw_with_mcap, "rosbags": raw_with_rosbags}
    task = progress.add_task("bit flips", total=len(COMPRESSIONS) * flips)
    for compression in COMPRESSIONS:
        content = write_sample(folder / "whole.mcap", compression)
        path = folder / "flipped.mcap"
        truth = Counter(open_recording(folder / "whole.mcap", strict=True).messages())
        verdicts: dict[str, Counter[str]] = {name: Counter() for name in ("poise", *peers)}
        for number, bit in enumerate(np.random.default_rng(2).integers(0, 8 * len(content), flips)):
            damaged = bytearray(content)
            damaged[bit // 8] ^= 1 << (bit % 8)
            path.write_bytes(damaged)
            verdicts["poise"][judge(path, truth)] += 1
            for name, read in peers.items():
                if number % 10 == 0:
                    verdicts[name][judge_peer(read, path, truth)] += 1
            progress.advance(task)
        for name, found in verdicts.items():
            counts = {verdict: found[verdict] for verdict in ("loss", "error", "same", "silent")}
            rows.append({"compression": compression, "reader": name, "flips": found.total(), **counts})
    return rows


def show(console: Console, title: str, rows: list[dict[str, Any]]) -> None:
    table = Table(title=title, title_justify="left")
    for name in rows[0]:
        table.add_column(name.replace("_", " "), justify="left" if isinstance(rows[0][name], str) else "right")
    for row in rows:
        table.add_row(*(as_text(value) for value in row.values()))
    console.print(table)


def as_text(value: Any) -> str:
    if isinstance(value, list):
        return " to ".join(as_text(part) for part in value)
    return f"{value:,.0f}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)


def main() -> None:
    parser = argparse.ArgumentParser(description="Benchmark of bags: reading rates, truncation, bit flips.")
    parser.add_argument("--quick", action="store_true", help="a tenth of everything")
    quick = parser.parse_args().quick
    console = Console()
    with tempfile.TemporaryDirectory() as name, Progress(console=console) as progress:
        folder = Path(name)
        rates = measure_rates(folder, 10_000 if quick else 50_000, 3 if quick else 7, progress)
        cuts = cut_bags(folder, 20 if quick else 200, progress)
        flips = flip_bits(folder, 50 if quick else 1000, progress)
    show(console, "Decoded WrenchStamped a second, from opening the file to arrays (checksums checked)", rates)
    show(console, "Truncated bags", cuts)
    show(console, "Bags with one flipped bit: what is noticed (others: their defaults)", flips)
    machine = {"python": platform.python_version(), "machine": platform.machine(), "system": platform.platform()}
    versions = {package: version(package) for package in ("mcap", "mcap-ros2-support", "rosbags", "numpy")}
    results = {"quick": quick, **machine, "versions": versions, "rates": rates, "truncation": cuts, "flips": flips}
    target = ROOT / "out" / "benchmarks" / "bags.json"
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = target.with_suffix(".tmp")
    draft.write_text(json.dumps(results, indent=2))
    draft.replace(target)
    console.print(f"written to {target}")


if __name__ == "__main__":
    main()
