"""Twelve random objects into a tote: `python -m benchmarks.placement.packing [--quick]`.

Poise and two rivals on heightmaps pack the same objects, in totes of boxes alone and in mixed ones. Each step of each
packing runs for two seconds in MuJoCo. Seconds are of the processor. `--develop` uses the seeds that the planner was
developed on. Results go to out/benchmarks/packing.json.
"""

import argparse
import json
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.placement.heightmaps import RIVALS, pack_on_heightmap
from benchmarks.placement.totes import DEVELOPMENT, FINAL, WORLDS, container, objects, tote
from benchmarks.placement.trial import STILL
from poise.assembly import RigidObject
from poise.baselines.placement.engine import holds
from poise.errors import NoAnswerError
from poise.files import write_whole
from poise.placement.packing import pack

POISE = "poise"
MINIMISED = 5
"""Totes of each world for heightmap minimisation, which builds towers, unless --whole."""
PACKERS = (POISE, *RIVALS)


@dataclass(frozen=True)
class PackedTote:
    """One tote, packed by one planner.

    Args:
        world, seed, packer: which.
        packed, wanted: objects.
        seconds: of the processor, to plan.
        height: m, of the load over the floor of the tote.
        utilisation: volume of the objects relative to that of the tote up to this height.
        moved: m, the farthest that a corner moves in MuJoCo in two seconds, at the worst step up to the first that
            does not hold; infinite when something fell.
        steps: after which nothing had moved by 1 mm.
    """

    world: str
    seed: int
    packer: str
    packed: int
    wanted: int
    seconds: float
    height: float
    utilisation: float
    moved: float
    steps: int

    @property
    def stable(self) -> bool:
        """All objects are in the tote, and it held after each."""
        return self.packed == self.wanted == self.steps


def pack_tote(job: tuple[str, int, str, int]) -> PackedTote:
    world, seed, packer, count = job
    items, start = objects(world, seed, count), time.process_time()
    if packer == POISE:
        try:
            placed: Sequence[RigidObject] = [one.item for one in pack(tote(), items, seed=seed).placements]
        except NoAnswerError:
            placed = []
    else:
        placed = pack_on_heightmap(packer, container(), items)
    seconds = time.process_time() - start
    room = container()
    height = max((float(item.vertices[:, 2].max()) for item in placed), default=room.floor) - room.floor
    volume = sum(item.shape.volume for item in placed)
    used = volume / room.volume(room.floor + height) if placed else 0.0
    moved, steps = _held(placed)
    return PackedTote(world, seed, packer, len(placed), count, seconds, height, used, moved, steps)


def _held(placed: Sequence[RigidObject]) -> tuple[float, int]:
    """m moved at the worst step, and steps up to the first that does not hold."""
    assembly, worst = tote(), 0.0
    for number, item in enumerate(placed):
        assembly = assembly.with_object(item)
        worst = max(worst, holds(assembly))
        if worst >= STILL:
            return worst, number
    return worst, len(placed)


def table(totes: Sequence[PackedTote]) -> Table:
    """For each world and packer; heights are compared tote by tote."""
    found = Table(title="12 random objects into a tote of 0.4 x 0.3 m")
    for name in ("world", "packer", "all packed", "height m (90 %)", "height / DBLF's", "not above DBLF's"):
        found.add_column(name, justify="right")
    for name in ("utilisation", "stable at every step", "worst mm", "CPU s (longest)"):
        found.add_column(name, justify="right")
    for world in WORLDS:
        reference = {t.seed: t for t in totes if (t.world, t.packer) == (world, RIVALS[0])}
        for packer in PACKERS:
            rows = [t for t in totes if (t.world, t.packer) == (world, packer)]
            if rows:
                found.add_row(world, packer, *_cells(rows, reference))
        found.add_section()
    return found


def _cells(rows: Sequence[PackedTote], reference: dict[int, PackedTote]) -> list[str]:
    pairs = [(t.height, reference[t.seed].height) for t in rows if t.seed in reference and t.packed == t.wanted]
    ratios = np.array([mine / theirs for mine, theirs in pairs])
    heights, seconds = np.array([t.height for t in rows]), np.array([t.seconds for t in rows])
    still = [t.moved for t in rows if t.stable]
    return [
        f"{sum(t.packed == t.wanted for t in rows)} of {len(rows)}",
        f"{np.median(heights):.3f} ({np.quantile(heights, 0.9):.3f})",
        f"{np.median(ratios):.2f} ({ratios.min():.2f} to {ratios.max():.2f})" if len(ratios) else "-",
        f"{int(np.sum(ratios <= 1 + 1e-6))} of {len(rows)}",
        f"{np.median([t.utilisation for t in rows]):.0%}",
        f"{sum(t.stable for t in rows)} of {len(rows)}",
        f"{1e3 * max(still):.2g}" if still else "-",
        f"{np.median(seconds):.1f} ({seconds.max():.1f})",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one tote of each world, four objects, development seeds")
    parser.add_argument("--develop", action="store_true", help="development seeds")
    parser.add_argument("--first", type=int, help="first seed, instead of the final ones'")
    parser.add_argument("--totes", type=int, default=25, help="of each world")
    parser.add_argument("--whole", action="store_true", help=f"as many for {RIVALS[1]} (else {MINIMISED})")
    parser.add_argument("--world", action="append", choices=WORLDS, help="again for both")
    parser.add_argument("--packer", action="append", choices=PACKERS, help="again for more")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks/packing.json"))
    arguments = parser.parse_args()
    first = DEVELOPMENT if arguments.develop or arguments.quick else FINAL
    first = first if arguments.first is None else arguments.first
    totes, count = (1, 4) if arguments.quick else (arguments.totes, 12)
    worlds, packers = arguments.world or WORLDS, arguments.packer or PACKERS
    jobs = [
        (world, first + k, packer, count)
        for k in range(totes)
        for world in worlds
        for packer in packers
        if packer != RIVALS[1] or arguments.whole or k < MINIMISED
    ]
    found: list[PackedTote] = []
    with ProcessPoolExecutor(arguments.workers, get_context("spawn")) as pool:
        for packed in pool.map(pack_tote, jobs):
            found.append(packed)
            content = [asdict(one) | {"moved": one.moved if np.isfinite(one.moved) else None} for one in found]
            arguments.out.parent.mkdir(parents=True, exist_ok=True)
            write_whole(arguments.out, json.dumps(content, indent=0).encode())
    Console(width=170).print(table(found))


if __name__ == "__main__":
    main()
