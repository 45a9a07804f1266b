"""Time against vertices and objects, and five objects in a row: `python -m benchmarks.placement.growth [--quick]`.

Bowls of 500 to 40,000 vertices carry a cube (thesis Fig. 5.12), piles of up to 50 cubes another, and of the ten glued
objects five at a time find an order and places (section 5.7). Seconds are of the processor, from a fresh scene:
contacts, map and search. Results go to out/benchmarks/placement_growth.json.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.placement.scenes import FRICTION, GLUED, bowl, box, glued, scene
from poise.assembly import Analysis, Assembly, RigidObject
from poise.baselines.placement.engine import holds
from poise.errors import NoAnswerError
from poise.files import write_whole
from poise.placement import Options, plan_placement, plan_sequence
from poise.placement.planner import SUPPORT_PLACES
from poise.placement.supports import find_supports

VERTICES = (500, 1000, 2000, 5000, 10_000, 20_000, 40_000)
OBJECTS = (2, 5, 10, 20, 30, 40, 50)
SEQUENCES, LENGTH = 10, 5
FIRST_SEED = 20_000
console = Console()
Row = dict[str, float]


def on_floor(*items: RigidObject) -> Assembly:
    return Assembly((scene("cube").objects[0], *items), friction=FRICTION)


def piles(count: int) -> Assembly:
    """Cubes in piles of two, side by side."""
    items = []
    for number in range(count):
        pile, level = divmod(number, 2)
        x, y = 0.16 * (pile % 5 - 2), 0.16 * (pile // 5 - 2)
        items.append(box(f"cube_{number}", (0.1, 0.1, 0.1), (x, y, 0.05 + 0.1 * level)))
    return on_floor(*items)


def timed(assembly: Assembly, item: RigidObject, seed: int) -> Row:
    """ms of one placement, and of the contacts and the map in it; from objects whose shapes were never used."""
    start = time.process_time()
    analysis = Analysis.of(assembly)
    analysis.require_stable()
    ready = time.process_time()
    find_supports(analysis, "objects", "limit", SUPPORT_PLACES, 0.2, np.random.default_rng(seed))
    mapped = time.process_time()
    try:
        plan_placement(analysis, item, Options(on="objects"), seed)
    except NoAnswerError as error:
        console.print(f"seed {seed}: {error}")
        return {"contacts": np.nan, "map": np.nan, "plan": np.nan}
    planned = time.process_time()
    # The plan makes its own map again: that one is what counts.
    return {
        "contacts": 1e3 * (ready - start),
        "map": 1e3 * (mapped - ready),
        "plan": 1e3 * (planned - mapped),
    }


def against_vertices(runs: int, sizes: tuple[int, ...]) -> list[Row]:
    rows = []
    for size in track(sizes, "vertices", console=console):
        for seed in range(runs):
            there = bowl(size)
            row = timed(
                on_floor(there),
                box("placed", (0.04, 0.04, 0.04), (0, 0, 0)),
                FIRST_SEED + seed,
            )
            rows.append({"vertices": len(there.shape.polyhedron.vertices)} | row)
    return rows


def against_objects(runs: int, sizes: tuple[int, ...]) -> list[Row]:
    rows = []
    for size in track(sizes, "objects", console=console):
        for seed in range(runs):
            item = box("placed", (0.1, 0.1, 0.1), (0, 0, 0))
            rows.append({"objects": size} | timed(piles(size), item, FIRST_SEED + seed))
    return rows


def sequences(count: int) -> list[Row]:
    """Five of the ten objects, put on the floor and on each other."""
    rows = []
    for number in track(range(count), "sequences", console=console):
        rng = np.random.default_rng(FIRST_SEED + number)
        names = rng.choice(list(GLUED), size=LENGTH, replace=False).tolist()
        start = time.process_time()
        try:
            found = plan_sequence(
                on_floor(),
                [glued(name) for name in names],
                Options(),
                FIRST_SEED + number,
            )
            placed, moved = len(found.placements), holds(found.analysis.assembly)
        except NoAnswerError as error:
            placed, moved = len(error.data.get("placed", [])), np.nan
        rows.append({"placed": placed, "seconds": time.process_time() - start, "moved": moved})
    return rows


def grouped(rows: list[Row], of: str) -> dict[float, list[Row]]:
    groups: dict[float, list[Row]] = {}
    for row in rows:
        groups.setdefault(row[of], []).append(row)
    return groups


def exponent(rows: list[Row], of: str, what: str) -> float:
    """p of time ~ size^p over the upper half of the sizes, where fixed costs no longer count."""
    groups = list(grouped(rows, of).items())[-4:]
    sizes = np.log([size for size, _ in groups])
    times = np.log([np.nanmean([row[what] for row in some]) for _, some in groups])
    return float(np.polyfit(sizes, times, 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--quick",
        action="store_true",
        help="one run of the three smallest, one sequence",
    )
    parser.add_argument("--runs", type=int, default=5, help="of each size")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks/placement_growth.json"))
    arguments = parser.parse_args()
    runs, few = (1, 3) if arguments.quick else (arguments.runs, None)
    found = {
        "vertices": against_vertices(runs, VERTICES[:few]),
        "objects": against_objects(runs, OBJECTS[:few]),
        "sequences": sequences(1 if arguments.quick else SEQUENCES),
    }
    for of in ("vertices", "objects"):
        for size, rows in grouped(found[of], of).items():
            means = {what: np.nanmean([row[what] for row in rows]) for what in ("contacts", "map", "plan")}
            console.print(f"{of} {size:6.0f}: " + ", ".join(f"{what} {ms:.0f} ms" for what, ms in means.items()))
        console.print(f"{of}: plan grows with the power {exponent(found[of], of, 'plan'):.2f}")
    placed = sum(int(row["placed"]) for row in found["sequences"])
    still = sum(row["moved"] < 1e-3 for row in found["sequences"])
    seconds = np.mean([row["seconds"] for row in found["sequences"]])
    console.print(
        f"sequences: {placed} of {LENGTH * len(found['sequences'])} placed, {seconds:.2f} s each, {still} hold"
    )
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    plain = {
        key: [{k: None if not np.isfinite(v) else v for k, v in row.items()} for row in rows]
        for key, rows in found.items()
    }
    write_whole(arguments.out, json.dumps(plain, indent=0).encode())


if __name__ == "__main__":
    main()
