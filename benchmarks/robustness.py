"""How fast and how exact robustness, maps and accelerations are: every figure of docs/robustness.md, by one command."""

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from poise.assembly import (
    Analysis,
    Assembly,
    Box,
    Pose,
    Push,
    RigidObject,
    acceleration_limits,
    assess,
    robustness_map,
    sample_surface,
)

GRAVITY = np.array([0.0, 0.0, -9.81])
GOALS = {"query": {"cube": 0.12, "stack3": 0.3, "table": 0.4}}
MAP_GOALS = {"cube": 80, "stack3": 200, "table": 250, "wall10": 3000, "stack30": 4000}


def box(name: str, size: tuple[float, float, float], position: tuple[float, float, float]) -> RigidObject:
    return RigidObject(name, Box(size), Pose(np.eye(3), np.array(position)), mass=1.0)


def on_floor(*objects: RigidObject) -> Assembly:
    floor = RigidObject("floor", Box((20.0, 20.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    return Assembly((floor, *objects), GRAVITY, 0.5)


def stack(count: int) -> Assembly:
    return on_floor(*(box(f"c{i}", (1.0, 1.0, 1.0), (0.0, 0.0, 0.5 + i)) for i in range(count)))


def table() -> Assembly:
    legs = [box(name, (0.2, 1.0, 1.0), (x, 0.0, 0.5)) for name, x in (("left", -0.9), ("right", 0.9))]
    return on_floor(*legs, box("slab", (2.0, 1.0, 0.2), (0.0, 0.0, 1.1)))


def wall(rows: int, bricks: int) -> Assembly:
    objects = []
    for row in range(rows):
        count = bricks - row % 2
        for i in range(count):
            place = ((i - (count - 1) / 2) * 0.2, 0.0, 0.05 + 0.1 * row)
            objects.append(box(f"b{row}_{i}", (0.2, 0.1, 0.1), place))
    return on_floor(*objects)


SCENES: dict[str, Callable[[], Assembly]] = {
    "cube": lambda: stack(1),
    "stack3": lambda: stack(3),
    "table": table,
    "wall10": lambda: wall(4, 3),
    "stack30": lambda: stack(30),
}


def fastest(job: Callable[[], object], repeats: int) -> float:
    """Least wall-clock time of some runs, s: what the machine can do when others leave it alone."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        job()
        times.append(time.perf_counter() - start)
    return min(times)


def surface_pushes(analysis: Analysis, count: int) -> list[Push]:
    surface, objects = sample_surface(analysis.structure, count), analysis.assembly.objects
    rows = zip(surface.place.tolist(), surface.points, surface.directions, strict=True)
    return [Push(objects[place].id, point, direction) for place, point, direction in rows]


def queries(quick: bool) -> list[dict[str, object]]:
    """Mean time of single pushes on the surface, ms, and how far each model is from `coulomb` on a few of them."""
    results: list[dict[str, object]] = []
    for name in ("cube", "stack3", "table"):
        analysis = Analysis.of(SCENES[name]())
        pushes = surface_pushes(analysis, 200 if quick else 1000)
        few = pushes[:: max(1, len(pushes) // 12)]
        elastic = np.array([result.robustness for result in assess(analysis, few, "coulomb").results])
        for model in ("limit", "patch", "default"):
            assess(analysis, pushes[:2], model)
            seconds = fastest(lambda a=analysis, p=pushes, m=model: assess(a, p, m), 1 if quick else 3)
            found = np.array([result.robustness for result in assess(analysis, few, model).results])
            finite = np.isfinite(found) & np.isfinite(elastic)
            difference = float(np.mean(np.abs(found[finite] / elastic[finite] - 1))) if finite.any() else 0.0
            results.append(
                {
                    "scene": name,
                    "model": model,
                    "ms": 1e3 * seconds / len(pushes),
                    "goal_ms": GOALS["query"][name],
                    "mean_difference_from_coulomb": difference,
                }
            )
    return results


def maps(quick: bool) -> list[dict[str, object]]:
    """Time of a whole map of 10,000 points certified to 3 %, ms."""
    results: list[dict[str, object]] = []
    for name, make in SCENES.items():
        for model in ("limit", "default"):
            robustness_map(Analysis.of(make()), 50, model=model)
            runs = []
            for _ in range(1 if quick else 3):
                analysis = Analysis.of(make())
                analysis.stability()
                runs.append(robustness_map(analysis, 2000 if quick else 10_000, model=model))
            best = min(runs, key=lambda run: run.seconds)
            results.append(
                {
                    "scene": name,
                    "model": model,
                    "points": len(best.lower),
                    "ms": 1e3 * best.seconds,
                    "goal_ms": MAP_GOALS[name],
                    "solves": best.solves,
                    "certified": best.complete,
                }
            )
    return results


def accelerations(quick: bool) -> dict[str, object]:
    """Time of every direction of a stack of ten, ms."""
    analysis = Analysis.of(stack(10))
    analysis.stability()
    seconds = fastest(lambda: acceleration_limits(analysis, 360, turning=False), 2 if quick else 5)
    return {"scene": "stack10", "directions": 360, "ms": 1e3 * seconds, "goal_ms": 20}


def main() -> None:
    """Measure, print a table, and write it as JSON when asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer points and runs")
    parser.add_argument("--json", type=Path, help="write the figures here")
    options = parser.parse_args()
    figures = {
        "queries": queries(options.quick),
        "maps": maps(options.quick),
        "acceleration": accelerations(options.quick),
    }
    for row in [*figures["queries"], *figures["maps"], figures["acceleration"]]:
        print(
            "  ".join(
                f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}" for key, value in row.items()
            )
        )
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    sys.exit(0)


if __name__ == "__main__":
    main()
