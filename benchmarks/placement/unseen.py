"""Placements in scenes of `unseen_scenes`, checked in MuJoCo: `python -m benchmarks.placement.unseen --scenes 5`.

Counts, for each kind of scene: placements found, those that hold (no corner moves by 1 mm in two seconds), and CPU
seconds with the analysis of the scene. A scene counts only if the object held in its place in MuJoCo, and if Poise says
that the scene stands. Of impossible scenes every answer is an error.
"""

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.placement.trial import STILL
from benchmarks.placement.unseen_scenes import IMPOSSIBLE, KINDS, Task
from poise.assembly import Analysis, Assembly, RigidObject
from poise.baselines.placement.engine import Engine, holds
from poise.errors import PoiseError
from poise.placement import PLACEMENT_PLANNERS

DEVELOPMENT, FINAL = 0, 60_000
"""First seeds."""
DEEP = 1.5e-3
"""m: what Poise takes as touching (its tolerance); deeper is overlap."""
console = Console(width=150)


@dataclass(frozen=True)
class Answer:
    """What came of one task.

    Args:
        task: what was asked.
        seconds: CPU, with the analysis of the scene.
        moved: m in MuJoCo; None without a placement.
        why: the error's text without a placement.
        cause: for a program.
    """

    task: Task
    seconds: float
    moved: float | None
    why: str = ""
    cause: str = ""


def tasks(kinds: list[str], first: int, count: int, possible: bool = True) -> Iterator[Task | str]:
    """Tasks of every kind in turn; text where a scene does not count."""
    for seed in range(first, first + count):
        for kind in kinds:
            rng = np.random.default_rng([seed, list(KINDS).index(kind), int(possible)])
            task = KINDS[kind](rng, seed, possible)
            yield task if (why := _unfit(task)) is None else f"{kind} {seed}: {why}"


def _unfit(task: Task) -> str | None:
    """Why a task does not count."""
    if task.possible and holds(_with(task.assembly, task.item)) >= STILL:
        return "the object does not hold in its place"
    if holds(task.assembly) >= STILL:
        return "the scene does not hold without the object"
    try:
        Analysis.of(task.assembly).require_stable()
    except PoiseError as error:
        return f"refused by Poise: {error}"
    return None


def _with(assembly: Assembly, item: RigidObject) -> Assembly:
    return replace(assembly, objects=(*assembly.objects, item))


def answer(task: Task, planner: str, deadline: float | None) -> Answer:
    """Plan and check one placement."""
    options, start = replace(task.options, deadline=deadline), time.process_time()
    try:
        found = PLACEMENT_PLANNERS.find(planner).plan(task.assembly, task.item, options, task.seed, None)
    except PoiseError as error:
        cause = str(error.data.get("cause", error.code.name))
        return Answer(task, time.process_time() - start, None, str(error), cause)
    seconds = time.process_time() - start
    there = _with(task.assembly, found.item)
    if _depth(there, found.item.id) > DEEP:
        return Answer(task, seconds, float("inf"), "overlaps in MuJoCo")
    return Answer(task, seconds, holds(there))


def _depth(assembly: Assembly, name: str) -> float:
    """m by which an object is in others, in MuJoCo."""
    engine = Engine(assembly, 1e-3)
    body, bodies, data = engine.model.body(name).id, engine.model.geom_bodyid, engine.data
    depths = [-c.dist for c in data.contact if body in (bodies[c.geom1], bodies[c.geom2])]
    return max(depths, default=0.0)


def table(answers: list[Answer]) -> Table:
    """Found, held and CPU seconds, by kind."""
    rows = Table(title="Placements in unseen scenes")
    for name in ("scene", "tasks", "found", "hold", "s median", "s 90 %", "s longest", "not found"):
        rows.add_column(name, justify="right")
    kinds = list(dict.fromkeys(a.task.kind for a in answers))
    for kind in (*kinds, "all"):
        of = [a for a in answers if kind in (a.task.kind, "all")]
        found = [a for a in of if a.moved is not None]
        held = sum(a.moved is not None and a.moved < STILL for a in found)
        times = np.quantile([a.seconds for a in of], [0.5, 0.9, 1.0])
        causes = Counter(a.cause for a in of if a.moved is None)
        why = ", ".join(f"{count} {cause}" for cause, count in causes.most_common())
        rows.add_row(kind, str(len(of)), str(len(found)), str(held), *(f"{t:.2f}" for t in times), why)
    return rows


def main() -> None:
    """Ask, check and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=5, help="of each kind")
    parser.add_argument("--first", type=int, default=DEVELOPMENT, help=f"seed; final figures start at {FINAL}")
    parser.add_argument("--kind", action="append", choices=list(KINDS), help="again for more; default: all")
    parser.add_argument("--impossible", action="store_true", help="scenes without a place: every answer is an error")
    parser.add_argument("--planner", default="poise")
    parser.add_argument("--deadline", type=float, help="s for each placement; default: none")
    given = parser.parse_args()
    kinds = given.kind or list(IMPOSSIBLE if given.impossible else KINDS)
    answers = []
    for task in tasks(kinds, given.first, given.scenes, not given.impossible):
        if isinstance(task, str):
            console.print(task, highlight=False)
            continue
        one = answer(task, given.planner, given.deadline)
        answers.append(one)
        if given.impossible or one.moved is None or one.moved >= STILL:
            how = one.why if one.moved is None else f"found, moves {1e3 * one.moved:.1f} mm {one.why}"
            console.print(f"{task.kind} {task.seed}: {how} ({one.seconds:.2f} s)", highlight=False)
    console.print(table(answers))


if __name__ == "__main__":
    main()
