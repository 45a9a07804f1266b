"""How many parts things of one and two colours have, and whether noise, sampling, encoding or light changes that.

python -m benchmarks.part_counts [--first SEED] [--count N]; seeds from 6000 to 6999 are for development.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.sweep_objects import Thing, thing
from poise.errors import PoiseError
from poise.shape import segment
from poise.types import Array

_POINTS, _COLOUR_NOISE = 2500, 0.03
_SUN, _AMBIENT = np.array([0.5, 0.3, 0.8]), 0.65
_STEPS = 16
"""Of the chroma of colours that a coarse JPEG encoded."""
console = Console(width=140)


@dataclass(frozen=True)
class Case:
    """How a thing is measured.

    Args:
        name: in the table.
        noise: m, one sigma of the points along each axis.
        draw: number of the sampling.
        encoded: chroma in `_STEPS` steps.
        lit: under a distant light.
    """

    name: str
    noise: float = 5e-4
    draw: int = 0
    encoded: bool = False
    lit: bool = False


CASES = (
    Case("0.5 mm"),
    Case("other points", draw=1),
    Case("1 mm", noise=1e-3),
    Case("chroma in 16 steps", encoded=True),
    Case("lit", lit=True),
)


def cloud(made: Thing, seed: int, case: Case) -> tuple[Array, Array]:
    """(N, 3) m points on all of the surface, also inner faces, and (N, 3) colours."""
    rng = np.random.default_rng([seed, case.draw, 77])
    corners = made.corners
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1)
    drawn = rng.choice(len(areas), _POINTS, p=areas / areas.sum())
    points = np.einsum("mk,mki->mi", rng.dirichlet(np.ones(3), _POINTS), corners[drawn])
    points = points + case.noise * rng.normal(size=points.shape)
    colours = made.colours[drawn]
    if case.lit:
        facing = across[drawn] @ _SUN / areas[drawn]
        colours = colours * (_AMBIENT + (1 - _AMBIENT) * np.clip(facing, 0, 1))[:, None]
    colours = np.clip(colours + _COLOUR_NOISE * rng.normal(size=colours.shape), 0, 1)
    if case.encoded:
        grey = colours.mean(axis=1, keepdims=True)
        colours = np.clip(grey + np.round((colours - grey) * _STEPS) / _STEPS, 0, 1)
    return points, colours


def counts(seed: int) -> tuple[str, int, list[int]]:
    """The name of a thing, its colours, and its parts in each case; 0 where it is refused."""
    made, found = thing(seed), []
    for case in CASES:
        try:
            found.append(segment(*cloud(made, seed, case)).n_parts)
        except PoiseError:
            found.append(0)
    return made.name, len(np.unique(made.colours, axis=0)), found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=6000, help="seed of the first thing")
    parser.add_argument("--count", type=int, default=40, help="how many things")
    arguments = parser.parse_args()
    rows = [counts(seed) for seed in range(arguments.first, arguments.first + arguments.count)]
    for name, paints, found in rows:
        console.print(f"{name:28} {paints} {found}", highlight=False)
    made = Table(title="parts: mean; from the colours to two more; within one of the first case")
    for heading in ("colours", "things", *(case.name for case in CASES)):
        made.add_column(heading, justify="right")
    for paints in (1, 2):
        own = np.array([found for _, colours, found in rows if colours == paints and min(found)]).reshape(
            -1, len(CASES)
        )
        near, same = (own >= paints) & (own <= paints + 2), np.abs(own - own[:, :1]) <= 1
        cells = zip(own.mean(axis=0), near.sum(axis=0), same.sum(axis=0), strict=True)
        made.add_row(str(paints), str(len(own)), *(f"{mean:.1f}; {close}; {alike}" for mean, close, alike in cells))
    console.print(made)


if __name__ == "__main__":
    main()
