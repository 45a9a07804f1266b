"""USE, GCE and parts over several draws of points and noise, and how many boxes are cut.

python -m benchmarks.segmentation_draws [--first N] [--draws N] [--first-object SEED] [--objects N] [--boxes N]

Draws below 6, objects from 640 to 663 and boxes below 100 were used to choose costs; all are for development.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.random_objects import make_composite
from benchmarks.segmentation_truth import NOISE, load_clouds
from poise.errors import PoiseError
from poise.shape.metrics import global_consistency_error, undersegmentation_error
from poise.shape.segmentation import segment
from poise.types import Array, Indices

_BOXES = np.array([[0.08, 0.05, 0.03], [0.1, 0.03, 0.02], [0.06, 0.06, 0.06], [0.12, 0.08, 0.01]])
_BOX_POINTS, _COLOUR, _COLOUR_NOISE = 2000, (0.6, 0.4, 0.2), 0.03
MODES = (("colours", False, True), ("colours, 1 mm", True, True), ("none", False, False), ("none, 1 mm", True, False))
"""(name, whether the noise is 1 mm along each axis, whether there are colours)."""
console = Console(width=140)


@dataclass(frozen=True, eq=False)
class Labelled:
    """(N, 3) m, (N, 3) 0..1 and (N,) true parts, and the noise in m that is added where it is not 1 mm."""

    points: Array
    colours: Array
    labels: Indices
    noise: float


def scores(subjects: list[Labelled], draw: int, noisy: bool, coloured: bool) -> Array:
    """(4,) mean USE, GCE and number of parts in one draw (another order of the points, other noise); the refused.

    Refused clouds, such as those of a ruler as thin as the noise, are not in the means.
    """
    rows: list[list[float]] = []
    for number, one in enumerate(subjects):
        rng = np.random.default_rng([3000 + draw, number])
        order, errors = rng.permutation(len(one.points)), rng.normal(size=one.points.shape)
        points = one.points[order] + (1e-3 if noisy else one.noise) * errors
        try:
            found, truth = segment(points, one.colours[order] if coloured else None), one.labels[order]
        except PoiseError:
            continue
        measures = (undersegmentation_error, global_consistency_error)
        rows.append([*(measure(found.labels, truth) for measure in measures), found.n_parts])
    return np.append(np.mean(rows, axis=0), len(subjects) - len(rows))


def boxes(count: int) -> Iterator[tuple[Array, Array, Array]]:
    """(N, 3) m on a box or plate, (N, 3) errors of sigma 1, and (N, 3) colours of one noisy paint."""
    for number in range(count):
        rng = np.random.default_rng([4000, number])
        size = _BOXES[number % len(_BOXES)]
        areas = size.prod() / size
        axis = rng.choice(3, _BOX_POINTS, p=areas / areas.sum())
        points = rng.random((_BOX_POINTS, 3)) - 0.5
        points[np.arange(_BOX_POINTS), axis] = rng.choice([-0.5, 0.5], _BOX_POINTS)
        errors = rng.normal(size=points.shape)
        yield points * size, errors, np.clip(_COLOUR + _COLOUR_NOISE * rng.normal(size=points.shape), 0, 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0, help="the first draw")
    parser.add_argument("--draws", type=int, default=6, help="how many")
    parser.add_argument("--first-object", type=int, default=640, help="seed of the first random object")
    parser.add_argument("--objects", type=int, default=24, help="how many random objects")
    parser.add_argument("--boxes", type=int, default=100, help="how many boxes and plates")
    arguments = parser.parse_args()
    seeds = range(arguments.first_object, arguments.first_object + arguments.objects)
    sets = {
        "tools": [Labelled(one.points, one.colours, one.labels, 0.0) for one in load_clouds()],
        "random": [Labelled(one.points, one.colours, one.labels, NOISE) for one in map(make_composite, seeds)],
    }
    made = Table(title="means over the objects, and their standard error over the draws", title_justify="left")
    for heading in ("objects", "colours, noise", "USE", "GCE", "parts", "refused"):
        made.add_column(heading)
    for name, subjects in sets.items():
        for mode, noisy, coloured in MODES if subjects else ():
            draws = range(arguments.first, arguments.first + arguments.draws)
            found = np.array([scores(subjects, draw, noisy, coloured) for draw in draws])
            use, gce, parts, refused = found.mean(axis=0)
            off = found.std(axis=0, ddof=1) / np.sqrt(len(found)) if len(found) > 1 else np.zeros(4)
            made.add_row(
                name, mode, f"{use:.3f} ± {off[0]:.3f}", f"{gce:.3f} ± {off[1]:.3f}", f"{parts:.1f}", f"{refused:.1f}"
            )
    console.print(made)
    cut = np.zeros(3, dtype=int)
    for points, errors, colours in boxes(arguments.boxes):
        clouds = ((NOISE, None), (1e-3, None), (NOISE, colours))
        cut += [segment(points + noise * errors, paint).n_parts > 1 for noise, paint in clouds]
    console.print(f"boxes that are cut, of {arguments.boxes}: {cut[0]}; at 1 mm {cut[1]}; of one paint {cut[2]}")


if __name__ == "__main__":
    main()
