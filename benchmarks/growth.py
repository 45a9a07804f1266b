"""How cost grows with the number of bodies: pushes, limits, maps and disassembly of walls, pallets, shelves and tables.

Processor times of one thread. `python benchmarks/growth.py --only wall --sizes 10 48`
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from poise.assembly import (
    Analysis,
    Assembly,
    Box,
    Push,
    RigidObject,
    acceleration_limits,
    assess,
    plan_disassembly,
    robustness_map,
)
from poise.assembly.contact.surface import sample_surface
from poise.errors import PoiseError
from poise.geometry import Pose

GRAVITY = np.array([0.0, 0.0, -9.81])
Row = dict[str, Any]


def box(name: str, size: tuple[float, float, float], place: tuple[float, float, float]) -> RigidObject:
    return RigidObject(name, Box(size), Pose(np.eye(3), np.array(place)), mass=1000 * size[0] * size[1] * size[2])


def on_floor(boxes: list[RigidObject]) -> Assembly:
    floor = RigidObject("floor", Box((100.0, 100.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    return Assembly((floor, *boxes), GRAVITY, 0.5)


def wall(count: int) -> Assembly:
    """Bricks in running bond with half bricks at the ends, about twice as long as high, side by side and touching."""
    rows = max(2, round(0.8 * np.sqrt(count)))
    along = max(1, round((count / rows) - 0.5))
    boxes: list[RigidObject] = []
    while len(boxes) < count:
        row = len(boxes) and round(boxes[-1].pose.translation[2] * 10 + 0.5)
        ends = [0.1, *[0.2] * (along - 1), 0.1] if row % 2 else [0.2] * along
        lefts = np.cumsum([0.0, *ends[:-1]]) - 0.1 * along
        for left, length in zip(lefts.tolist(), ends, strict=True):
            boxes.append(box(f"b{len(boxes)}", (length, 0.1, 0.1), (left + length / 2, 0.0, 0.05 + 0.1 * row)))
    return on_floor(boxes[:count])


def pallet(count: int) -> Assembly:
    """Cartons of 0.3 by 0.2 m in eight layers that are turned in turn, so that each bridges those below."""
    columns, rows = {1: (1, 1), 2: (2, 1), 3: (2, 2)}.get(max(1, min(3, count // 60 + 1)), (2, 2))
    length, width = 0.6 * columns, 0.6 * rows
    boxes: list[RigidObject] = []
    layer = 0
    while len(boxes) < count:
        x, y = (0.3, 0.2) if layer % 2 == 0 else (0.2, 0.3)
        for i in range(round(length / x)):
            for j in range(round(width / y)):
                place = (i + 0.5) * x - length / 2, (j + 0.5) * y - width / 2, 0.1 + 0.2 * layer
                boxes.append(box(f"c{len(boxes)}", (x, y, 0.2), place))
        layer += 1
    return on_floor(boxes[:count])


def shelf(count: int) -> Assembly:
    """Fixed boards that carry rows of six touching boxes with three on top each."""
    boxes, boards = [], []
    for number in range(-(-count // 9)):
        base = 0.5 * number + 0.5
        boards.append(
            RigidObject(
                f"board{number}", Box((1.0, 0.4, 0.02)), Pose(np.eye(3), np.array([0, 0, base - 0.01])), fixed=True
            )
        )
        low = [((i - 2.5) * 0.15, 0.0, base + 0.1) for i in range(6)]
        top = [((i - 1) * 0.3, 0.0, base + 0.25) for i in range(3)]
        boxes += [box(f"s{number}_{i}", (0.15, 0.2, 0.2), place) for i, place in enumerate(low)]
        boxes += [box(f"s{number}_{6 + i}", (0.25, 0.2, 0.1), place) for i, place in enumerate(top)]
    return Assembly((*boards, *boxes[:count]), GRAVITY, 0.5)


def tables(count: int) -> Assembly:
    """Slabs on two legs each, one on the other's slab, three high."""
    boxes = []
    for number in range(-(-count // 3)):
        x, base = 2.5 * (number // 3 - count // 18), 1.2 * (number % 3)
        boxes += [
            box(f"left{number}", (0.2, 1.0, 1.0), (x - 0.9, 0.0, base + 0.5)),
            box(f"right{number}", (0.2, 1.0, 1.0), (x + 0.9, 0.0, base + 0.5)),
            box(f"slab{number}", (2.0, 1.0, 0.2), (x, 0.0, base + 1.1)),
        ]
    return on_floor(boxes[: 3 * (-(-count // 3))])


KINDS: dict[str, Callable[[int], Assembly]] = {"wall": wall, "pallet": pallet, "shelf": shelf, "tables": tables}
SIZES = {
    "wall": (10, 48, 102, 200, 500),
    "pallet": (50, 100, 200),
    "shelf": (9, 54, 198, 495),
    "tables": (3, 48, 198, 495),
}


@dataclass(frozen=True)
class Effort:
    """How much is asked of each scene.

    Args:
        pushes: asked one by one after the first.
        directions: of limits.
        points: of a map.
        deadline: s, of each question (wall clock).
        jobs: which of push, limits, map, disassembly.
        uneven: masses are random, within 20 % of those of the scene, so that nothing is mirrored.
    """

    pushes: int = 20
    directions: int = 72
    points: int = 10_000
    deadline: float = 60.0
    jobs: tuple[str, ...] = ("push", "limits", "map", "disassembly")
    uneven: bool = False


def spent(job: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time, ms, and what the job returns."""
    start = time.process_time()
    try:
        found = job()
    except PoiseError as error:
        found = error
    return 1e3 * (time.process_time() - start), found


def uneven(assembly: Assembly, seed: int) -> Assembly:
    """The same scene with random masses, within 20 %."""
    factors = np.random.default_rng([seed, 2]).uniform(0.8, 1.2, len(assembly.objects)).tolist()
    made = [
        item if item.fixed else replace(item, mass=factor * item.mass)
        for item, factor in zip(assembly.objects, factors, strict=True)
    ]
    return replace(assembly, objects=tuple(made))


def random_pushes(analysis: Analysis, count: int, rng: np.random.Generator) -> list[Push]:
    """Pushes at random places of the surface, inwards and at up to 45 degrees to that."""
    surface, objects = sample_surface(analysis.structure, 40 * count), analysis.assembly.objects
    rows = rng.choice(len(surface.points), count, replace=False)
    directions = surface.directions[rows] + 0.5 * rng.normal(size=(count, 3))
    return [
        Push(objects[surface.place[row]].id, surface.points[row], direction)
        for row, direction in zip(rows.tolist(), directions, strict=True)
    ]


def measured(kind: str, count: int, effort: Effort, seed: int) -> Row:
    """One scene: processor times in ms, and whether each answer is whole."""
    assembly = uneven(KINDS[kind](count), seed) if effort.uneven else KINDS[kind](count)
    row: Row = {"scene": f"{kind}{count}"}
    row["ready"], analysis = spent(lambda: Analysis.of(assembly))
    row["stands"], _ = spent(lambda: analysis.stability())
    if "push" in effort.jobs:
        row |= _pushes(analysis, effort, seed)
    if "limits" in effort.jobs:
        row["limits"], found = spent(
            lambda: acceleration_limits(analysis, effort.directions, effort.deadline, turning=False)
        )
        row["limits_whole"] = getattr(found, "complete", False)
        row["limits_doubtful"] = int(np.sum(getattr(found, "doubtful", [])))
        row["limits_mean"] = float(np.mean(getattr(found, "limits", [np.nan])))
    if "map" in effort.jobs:
        row["map"], found = spent(lambda: robustness_map(analysis, effort.points, deadline=effort.deadline))
        row["map_whole"] = getattr(found, "complete", False)
    if "disassembly" in effort.jobs:
        row["disassembly"], found = spent(lambda: plan_disassembly(assembly, deadline=effort.deadline))
        row["disassembly_whole"] = all(getattr(found, "safe", [False]))
    return row


def _pushes(analysis: Analysis, effort: Effort, seed: int) -> Row:
    pushes = random_pushes(analysis, effort.pushes + 1, np.random.default_rng([seed, 1]))
    first, _ = spent(lambda: assess(analysis, pushes[:1]))
    times, whole, start = [], [], time.monotonic()
    for push in pushes[1:]:
        if time.monotonic() - start > effort.deadline:
            break
        each, found = spent(lambda push=push: assess(analysis, [push], deadline=effort.deadline))
        times.append(each)
        whole.append(found.complete and not found.results[0].doubtful)
    return {
        "first_push": first,
        "push_median": float(np.median(times)),
        "push_worst": float(np.max(times)),
        "pushes_whole": f"{sum(whole)} of {len(pushes) - 1}",
    }


def show(row: Row) -> None:
    cells = (f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}" for key, value in row.items())
    print(" | ".join(cells), flush=True)


def main() -> None:
    """Measure, print and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=KINDS, action="append", help="these kinds alone")
    parser.add_argument("--sizes", type=int, nargs="+", help="numbers of bodies")
    parser.add_argument("--jobs", nargs="+", default=list(Effort.jobs), choices=Effort.jobs)
    parser.add_argument("--pushes", type=int, default=20)
    parser.add_argument("--directions", type=int, default=72)
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--deadline", type=float, default=60.0, help="s, of each question")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--uneven", action="store_true", help="random masses: nothing is mirrored")
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    effort = Effort(given.pushes, given.directions, given.points, given.deadline, tuple(given.jobs), given.uneven)
    rows = []
    for kind in given.only or KINDS:
        for count in given.sizes or SIZES[kind]:
            rows.append(measured(kind, count, effort, given.seed))
            show(rows[-1])
    if given.json:
        given.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
