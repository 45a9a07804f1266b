"""Volumes and moments of solids from clouds with noise: how far off, and whether the stated uncertainty covers it.

python -m benchmarks.solids [--worlds ...] [--noise MM ...] [--points N ...] [--families ...] [--objects N] [--final]
    [--denser RATIO [--close]]
"""

import argparse
import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.closed_shapes import FAMILIES, FIRST_FINAL_SEED, WORLDS, ClosedShape, public, tools
from poise.errors import PoiseError
from poise.shape import segment, tetrahedron_moments

console = Console(width=150)
_FIRST_FINAL_PUBLIC = 800
_SAME = 0.1
_HEADINGS = (
    "clouds", "refused", "off, middle %", "bias %", "within 15 %", "worst", "stated +- %", "beyond 2 sigma", "rms z",
    "centre %", "inertia %", "parts", "s",
)  # fmt: skip


@dataclass(frozen=True)
class Record:
    """One cloud; ratios to the truth.

    Args:
        volume, std: found volume and its one sigma, over the true volume; NaN when refused.
        middle: m that the centre of the volume is off, over the radius of gyration.
        inertia: trace of the second moments about the centre per volume, over the true one.
        message: why it was refused.
    """

    world: str
    shape: str
    family: str
    noise: float
    points: int
    volume: float
    std: float
    middle: float
    inertia: float
    parts: int
    seconds: float
    message: str = ""

    @property
    def score(self) -> float:
        """Standard deviations that the truth is away."""
        return (self.volume - 1) / self.std


def shapes(world: str, count: int, final: bool) -> list[ClosedShape]:
    """Development or final objects of a world."""
    if world == "tools":
        return tools()[:count]
    pybullet = world in ("public", "seams")
    first = (_FIRST_FINAL_PUBLIC if pybullet else FIRST_FINAL_SEED) if final else 0
    numbers = filter(_filled, range(first, 1000)) if pybullet else itertools.count(first)
    made = (WORLDS[world](number) for number in numbers)
    return list(itertools.islice((shape for shape in made if len(shape.triangles)), count))  # a blob may be empty


def _filled(number: int) -> bool:
    """Whether what the outside of one of PyBullet's objects encloses is its volume: some are shells, open by cracks."""
    shape = public(number)
    return abs(shape.filled.volume / shape.volume - 1) < _SAME


def measure(
    world: str, shape: ClosedShape, family: str, noise: float, points: int, seed: int = 0, **density: Any
) -> Record:
    """Reconstruct one cloud."""
    rng = np.random.default_rng([seed, points, round(1e6 * noise), len(family), *shape.name.encode()])
    cloud = shape.cloud(rng, points, family, noise, **density)
    known = world, shape.name, family, noise, points
    start = time.process_time()
    try:
        found = segment(cloud)
    except PoiseError as error:
        return Record(*known, *[np.nan] * 4, 0, time.process_time() - start, error.message)
    seconds = time.process_time() - start
    moments = tetrahedron_moments(found.solid.vertices[found.solid.tetrahedra]).sum(axis=0)
    (volume, middle, spread), (true_volume, true_middle, true_spread) = (about(m) for m in (moments, shape.moments))
    return Record(
        *known,
        volume / true_volume,
        found.solid.volume_std / true_volume,
        float(np.linalg.norm(middle - true_middle)) / np.sqrt(true_spread),
        spread / true_spread,
        found.n_parts,
        seconds,
    )


def about(moments: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Volume m3, centre (3,) m, and mean square distance from it, m2, of a (4, 4) pseudo-inertia."""
    volume = float(moments[3, 3])
    middle = moments[:3, 3] / volume
    return volume, middle, float(np.trace(moments[:3, :3])) / volume - float(middle @ middle)


def measured(
    worlds: list[str],
    families: list[str],
    noises: list[float],
    points: list[int],
    objects: int,
    final: bool,
    **density: Any,
) -> Iterator[Record]:
    """All combinations; without noise there is one family."""
    for world in worlds:
        for shape in shapes(world, objects, final):
            for noise in noises:
                for family in families if noise > 0 else families[:1]:
                    for count in points:
                        yield measure(world, shape, family, noise, count, **density)


def table(records: list[Record], keys: tuple[str, ...]) -> Table:
    """A row per combination of some fields."""
    made = Table(title="volumes", title_justify="left")
    for heading in (*keys, *_HEADINGS):
        made.add_column(heading, justify="right")
    groups: dict[tuple[str, ...], list[Record]] = {}
    for one in records:
        groups.setdefault(tuple(str(getattr(one, key)) for key in keys), []).append(one)
    for group, rows in groups.items():
        made.add_row(*group, *_summary(rows))
    made.add_section()
    made.add_row(*["all"] * len(keys), *_summary(records))
    return made


def _summary(rows: list[Record]) -> list[str]:
    good = [row for row in rows if np.isfinite(row.volume)]
    if not good:
        return [str(len(rows)), str(len(rows))] + ["-"] * 11
    ratio = np.array([row.volume for row in good])
    score = np.array([row.score for row in good])
    return [
        str(len(rows)),
        str(len(rows) - len(good)),
        f"{100 * np.median(np.abs(ratio - 1)):.1f}",
        f"{100 * (np.median(ratio) - 1):+.1f}",
        f"{np.mean(np.abs(ratio - 1) < 0.15):.0%}",
        f"{ratio[np.argmax(np.abs(ratio - 1))]:.2f}",
        f"{100 * np.median([row.std for row in good]):.1f}",
        f"{np.mean(np.abs(score) > 2):.0%}",
        f"{np.sqrt(np.mean(np.minimum(score**2, 1e4))):.2f}",
        f"{100 * np.median([row.middle for row in good]):.1f}",
        f"{100 * np.median([row.inertia - 1 for row in good]):+.1f}",
        f"{np.mean([row.parts for row in good]):.1f}",
        f"{np.median([row.seconds for row in good]):.2f}",
    ]


def main() -> None:
    """Print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", nargs="+", default=["tools", *WORLDS], choices=["tools", *WORLDS])
    parser.add_argument("--families", nargs="+", default=["white"], choices=list(FAMILIES))
    parser.add_argument("--noise", nargs="+", type=float, default=[0, 1, 2, 3], help="mm")
    parser.add_argument("--points", nargs="+", type=int, default=[500, 2000, 10_000])
    parser.add_argument("--objects", type=int, default=8, help="per world")
    parser.add_argument("--denser", type=float, default=1.0, help="how many times denser one end is than the other")
    parser.add_argument("--close", action="store_true", help="a ball of 3 cm, instead of an end")
    parser.add_argument("--final", action="store_true", help="objects that nothing was chosen on")
    parser.add_argument("--by", nargs="+", default=["world", "noise"])
    parser.add_argument("--each", action="store_true", help="print every cloud")
    chosen = parser.parse_args()
    noises = [1e-3 * value for value in chosen.noise]
    sizes = chosen.points, chosen.objects, chosen.final
    density = {"denser": chosen.denser, "close": chosen.close}
    records = list(measured(chosen.worlds, chosen.families, noises, *sizes, **density))
    if chosen.each:
        for one in records:
            console.print(
                f"{one.shape:22} {one.family:10} {1e3 * one.noise:.0f} mm {one.points:6} {one.volume:.3f}"
                f" ± {one.std:.3f}  centre {one.middle:.3f} inertia {one.inertia:.3f} parts {one.parts}"
                f" {one.message[:60]}"
            )
    console.print(table(records, tuple(chosen.by)))


if __name__ == "__main__":
    main()
