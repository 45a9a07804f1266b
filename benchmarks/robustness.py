"""How fast and how exact robustness, maps and accelerations are: figures of docs/robustness_results.md, by one command.

All models and baselines answer the same pushes in the same run. PyBullet is left out where it is not installed. Times
are of the processor: what a machine with nothing else to do takes, but for what others' use of its caches costs.
"""

import argparse
import importlib.util
import json
import multiprocessing
import resource
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from growth import wall as wall_with_half_bricks
from rich.console import Console
from rich.progress import track
from rich.table import Table
from robustness_truth import SCENES as TRUTHS

from poise.assembly import Analysis, Assembly, Box, Mesh, Push, RigidObject, acceleration_limits, assess, robustness_map
from poise.assembly.contact.surface import sample_surface
from poise.assembly.robustness.maps import RobustnessMap
from poise.assembly.robustness.registry import ROBUSTNESS_MODELS
from poise.geometry import Pose
from poise.types import Array

Row = dict[str, Any]
GRAVITY = np.array([0.0, 0.0, -9.81])
QUERY_GOALS = {"cube": 0.12, "stack3": 0.3, "table": 0.4}
MAP_GOALS = {"cube": 15, "stack3": 200, "table": 250, "wall10": 300, "wall10_halves": 300, "stack30": 4000, "bowl": 40}
# Pushes for models that take milliseconds or more for each; all others answer all.
FEW = {"coulomb": 20, "thesis": 200, "lp4": 40, "lp8": 40, "pybullet": 20}
SIZES = (2, 3, 5, 10, 20, 33)
CURVED = 9000


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


def wall(rows: int, bricks: int, count: int | None = None) -> Assembly:
    """Bricks in running bond, side by side and touching; only the first `count`, from below."""
    places = []
    for row in range(rows):
        number = bricks - row % 2
        places += [((i - (number - 1) / 2) * 0.2, 0.0, 0.05 + 0.1 * row) for i in range(number)]
    return on_floor(*(box(f"b{i}", (0.2, 0.1, 0.1), place) for i, place in enumerate(places[:count])))


def bowl() -> Assembly:
    """A hemispherical shell of about 9,000 vertices that stands on the facet at its bottom."""
    around = 64
    rings = CURVED // around // 2
    turn = 2 * np.pi * np.arange(around) / around
    rows = []
    for radius, angles in ((0.1, np.linspace(0.2, np.pi / 2, rings)), (0.09, np.linspace(np.pi / 2, 0.2, rings))):
        rows += [
            np.stack(
                [
                    radius * np.sin(a) * np.cos(turn),
                    radius * np.sin(a) * np.sin(turn),
                    np.full(around, -radius * np.cos(a)),
                ],
                axis=1,
            )
            for a in angles
        ]
    vertices = np.concatenate([*rows, [[0, 0, rows[0][0, 2]], [0, 0, rows[-1][0, 2]]]])
    vertices[:, 2] -= vertices[:, 2].min()
    k = np.arange(around)
    after = (k + 1) % around
    low = (np.arange(len(rows) - 1) * around)[:, None]
    quads = np.stack(np.broadcast_arrays(low + k, low + after, low + around + after, low + around + k), axis=-1)
    faces = [quads[..., [0, 1, 2]].reshape(-1, 3), quads[..., [0, 2, 3]].reshape(-1, 3)]
    last = (len(rows) - 1) * around
    faces.append(np.stack([after, k, np.full(around, len(vertices) - 2)], axis=1))
    faces.append(np.stack([last + k, last + after, np.full(around, len(vertices) - 1)], axis=1))
    mesh = Mesh(vertices, np.concatenate(faces))
    return on_floor(RigidObject("bowl", mesh, Pose(np.eye(3), np.zeros(3)), mass=1.0))


MAPPED: dict[str, Callable[[], Assembly]] = {
    "cube": lambda: stack(1),
    "stack3": lambda: stack(3),
    "table": table,
    "wall10": lambda: wall(4, 3),
    "wall10_halves": lambda: wall_with_half_bricks(10),
    "stack30": lambda: stack(30),
}


def timed(job: Callable[[], object], repeats: int) -> list[float]:
    """Processor times of some runs, ms, in ascending order."""
    return sorted(spent(job)[0] for _ in range(repeats))


def spent(job: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time, ms, and what the job returns."""
    start = time.process_time()
    found = job()
    return 1e3 * (time.process_time() - start), found


def surface_pushes(analysis: Analysis, count: int) -> list[Push]:
    surface, objects = sample_surface(analysis.structure, count), analysis.assembly.objects
    rows = zip(surface.place.tolist(), surface.points, surface.directions, strict=True)
    return [Push(objects[place].id, point, direction) for place, point, direction in rows]


def true_robustness(scene: str, analysis: Analysis, pushes: Iterable[Push]) -> Array:
    """(Q,) N by benchmarks/robustness_truth.py."""
    bodies = [item.id for item in analysis.assembly.objects if not item.fixed]
    truth = TRUTHS[scene]
    return np.array(
        [truth.robustness(bodies.index(p.object), np.asarray(p.point), np.asarray(p.direction)) for p in pushes]
    )


def queries(quick: bool) -> list[Row]:
    """Table 4.1: time per push on the surface and error of each model, on its three scenes."""
    rows: list[Row] = []
    for scene in ("cube", "stack3", "table"):
        analysis = Analysis.of(MAPPED[scene]())
        pushes = surface_pushes(analysis, 100 if quick else 1000)
        judged = pushes[:: max(1, len(pushes) // (20 if quick else 100))]
        truth = true_robustness(scene, analysis, track(judged, f"truth of {scene}"))
        for model in ROBUSTNESS_MODELS.names():
            if model == "pybullet" and importlib.util.find_spec("pybullet") is None:
                continue
            rows.append({"scene": scene, "model": model, **_one_model(analysis, pushes, judged, truth, model, quick)})
    return rows


def _one_model(
    analysis: Analysis, pushes: list[Push], judged: list[Push], truth: Array, model: str, quick: bool
) -> Row:
    few = min(FEW.get(model, len(pushes)), 12 if quick and model in FEW else len(pushes))
    asked = pushes[:: max(1, len(pushes) // few)]
    assess(analysis, pushes[:2], model)
    repeats = 1 if quick else 2 if model in FEW else 5
    times = [t / len(asked) for t in timed(lambda: assess(analysis, asked, model), repeats)]
    step = max(1, len(judged) // few)
    found = np.array([result.robustness for result in assess(analysis, judged[::step], model).results])
    true = truth[::step]
    both = np.isfinite(found) & np.isfinite(true)
    error = np.abs(found[both] / true[both] - 1) if both.any() else np.zeros(1)
    unmovable = np.isinf(true)
    return {
        "ms": times[0],
        "ms_slowest_run": times[-1],
        "error_mean": float(error.mean()),
        "error_max": float(error.max()),
        "unmovable_called_movable": float(np.isfinite(found[unmovable]).mean()) if unmovable.any() else None,
        "movable_called_unmovable": float(np.isinf(found[~unmovable]).mean()) if (~unmovable).any() else None,
        "judged": len(found),
    }


def comparisons(rows: list[Row]) -> list[Row]:
    """How many times faster, and more exact, the default is than each baseline in this run."""
    results = []
    for row in rows:
        if row["model"] in ("thesis", "approx", "lp4", "lp8", "pybullet"):
            ours = next(r for r in rows if r["scene"] == row["scene"] and r["model"] == "default")
            results.append(
                {
                    "scene": row["scene"],
                    "baseline": row["model"],
                    "times_faster": row["ms"] / ours["ms"],
                    "times_more_exact": row["error_mean"] / max(ours["error_mean"], 1e-9),
                }
            )
    return results


def maps(quick: bool) -> list[Row]:
    """Time of a whole map of 10,000 points certified to 3 %."""
    rows: list[Row] = []
    for scene, make in MAPPED.items():
        for model in ("limit", "default"):
            robustness_map(Analysis.of(make()), 50, model=model)
            runs = []
            for _ in range(1 if quick else 5):
                analysis = Analysis.of(make())
                analysis.stability()
                points = 1000 if quick else 10_000
                runs.append(spent(lambda a=analysis, n=points, m=model: robustness_map(a, n, model=m)))
            rows.append({"scene": scene, "model": model, "goal_ms": MAP_GOALS[scene], **_map_row(runs)})
    return rows


def _map_row(runs: list[tuple[float, RobustnessMap]]) -> Row:
    runs = sorted(runs, key=lambda run: run[0])
    found = runs[0][1]
    return {
        "points": len(found.lower),
        "ms": runs[0][0],
        "ms_slowest_run": runs[-1][0],
        "solves": found.solves,
        "certified": found.complete,
    }


def curved(quick: bool) -> list[Row]:
    """A map of a bowl at its vertices, and how far its upper bound is from solving each point."""
    analysis = Analysis.of(bowl())
    analysis.stability()
    surface = sample_surface(analysis.structure, 1000 if quick else CURVED)
    rows: list[Row] = []
    for model in ("patch", "default"):
        robustness_map(analysis, 50, model=model)
        runs = [spent(lambda m=model: robustness_map(analysis, surface, model=m)) for _ in range(1 if quick else 5)]
        picked = np.arange(0, len(surface.points), max(1, len(surface.points) // 200))
        pushes = [Push("bowl", surface.points[i], surface.directions[i]) for i in picked]
        exact = np.array([result.robustness for result in assess(analysis, pushes, model).results])
        found = runs[0][1].upper[picked]
        both = np.isfinite(exact) & np.isfinite(found)
        error = float(np.abs(found[both] / exact[both] - 1).mean())
        rows.append(
            {"scene": "bowl", "model": model, "goal_ms": MAP_GOALS["bowl"], **_map_row(runs), "error_mean": error}
        )
    return rows


def sizes(quick: bool) -> list[Row]:
    """Stacks and walls of 2 to 33 bodies: making ready, a push, a map of 1000 points; and the thesis' model."""
    rows: list[Row] = []
    for kind, make in (("stack", stack), ("wall", lambda n: wall(12, 4, n))):
        for count in track(SIZES[:3] if quick else SIZES, f"{kind}s"):
            assembly = make(count)
            ready, analysis = spent(lambda a=assembly: _made_ready(a))
            pushes = surface_pushes(analysis, 50)
            assess(analysis, pushes[:2])
            mapped, _ = spent(lambda a=analysis: robustness_map(a, 1000))
            few = pushes[::10]
            thesis, found = spent(lambda a=analysis, p=few: assess(a, p, "thesis", deadline=1.0 if quick else 10.0))
            rows.append(
                {
                    "scene": f"{kind}{count}",
                    "ready_ms": ready,
                    "query_ms": timed(lambda a=analysis, p=pushes: assess(a, p), 1 if quick else 3)[0] / len(pushes),
                    "map_ms": mapped,
                    "thesis_ms": thesis / len(few),
                    "thesis_complete": found.complete,
                }
            )
    return rows


def _made_ready(assembly: Assembly) -> Analysis:
    analysis = Analysis.of(assembly)
    analysis.stability()
    return analysis


def coupled(quick: bool) -> list[Row]:
    """Where elastic contacts are asked: ten pushes on a wall, and maps of 600 points; processor times of one run."""
    analysis = _made_ready(wall(12, 4, 10 if quick else 44))
    pushes = surface_pushes(analysis, 200)
    few = [pushes[i] for i in np.random.default_rng(1).choice(200, 10, replace=False)]
    rows: list[Row] = [{"scene": f"wall{len(analysis.assembly.objects) - 1}", "what": "10 pushes"}]
    rows[0]["ms"] = spent(lambda: assess(analysis, few))[0]
    for scene, make in {"table": table, "wall10": lambda: wall(4, 3)}.items():
        ready = _made_ready(make())
        row: Row = {"scene": scene, "what": "map of 600 points"}
        rows.append(row | {"ms": spent(lambda a=ready: robustness_map(a, 100 if quick else 600, 0.05))[0]})
    return rows


def accelerations(quick: bool) -> list[Row]:
    """Every direction of a stack of ten."""
    analysis = Analysis.of(stack(10))
    analysis.stability()
    times = timed(lambda: acceleration_limits(analysis, 360, turning=False), 2 if quick else 5)
    return [{"scene": "stack10", "directions": 360, "ms": times[0], "ms_slowest_run": times[-1], "goal_ms": 20}]


def memory(quick: bool) -> list[Row]:
    """Peak memory of a process that maps 100,000 points of 35 bodies: whole rows, which stand."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return [pool.apply(_mapped_memory, (2000 if quick else 100_000,))]


def _mapped_memory(points: int) -> Row:
    found = robustness_map(Analysis.of(wall(12, 4, 35)), points, deadline=120.0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"scene": "wall35", "points": len(found.lower), "certified": found.complete, "peak_MB": peak, "goal_MB": 500}


SECTIONS: dict[str, Callable[[bool], list[Row]]] = {
    "queries": queries,
    "maps": maps,
    "curved": curved,
    "sizes": sizes,
    "coupled": coupled,
    "accelerations": accelerations,
    "memory": memory,
}


def show(title: str, rows: list[Row]) -> None:
    shown = Table(*rows[0], title=title)
    for row in rows:
        shown.add_row(*(f"{value:.3g}" if isinstance(value, float) else str(value) for value in row.values()))
    Console(width=160).print(shown)


def main() -> None:
    """Measure, print tables, and write them as JSON when asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer points and runs")
    parser.add_argument("--only", choices=SECTIONS, action="append", help="these parts alone")
    parser.add_argument("--json", type=Path, help="write the figures here")
    options = parser.parse_args()
    figures: dict[str, list[Row]] = {}
    for name in options.only or SECTIONS:
        figures[name] = SECTIONS[name](options.quick)
        show(name, figures[name])
        if name == "queries":
            figures["comparisons"] = comparisons(figures[name])
            show("comparisons", figures["comparisons"])
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
