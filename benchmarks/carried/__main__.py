"""Scenes on a base that drives, with one thing not as declared: `python -m benchmarks.carried [--cases 100] [--final]`.

`poise mismatch --scene` gets a recording and a scene file. A cause is visible when it changes what moves first, or when
by 0.1 s or more; object_pose always is. The scene as declared, simulated too, says so.
"""

import argparse
import contextlib
import io
import json
import math
import tempfile
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.carried.make import PLAIN, ROUGH, Case, Seen, World, as_declared, draw, scene_of, simulate, write
from poise.cli import run

FIRST_FINAL = 8500
"""The next final seeds, 8500 to 8599: not answered yet. Those below are development cases."""
TIME = 0.05
"""s within which the beginning of a motion is right."""


def answer(case: Case, folder: Path, world: World = PLAIN) -> tuple[dict[str, Any], Seen, bool, float]:
    """What the command says, what happened, whether the cause is visible, and s of CPU."""
    true, poses = simulate(case, world)
    nominal = simulate(as_declared(case), world)[0]
    visible = case.cause == "object_pose" or _differ(true, nominal)
    bag, scene, found = folder / "run.mcap", folder / "scene.yaml", folder / "answer.json"
    write(case, bag, poses, world)
    scene.write_text(yaml.safe_dump(scene_of(case)), encoding="utf-8")
    begin = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        status = run(["mismatch", str(bag), "--scene", str(scene), "--json", str(found)])
    seconds = time.process_time() - begin
    content = json.loads(found.read_text(encoding="utf-8")) if status == 0 else {"verdict": f"status {status}"}
    return content, true, visible, seconds


def keep(case: Case, folder: Path) -> None:
    """Write the recording and the scene file of a case."""
    folder.mkdir(parents=True, exist_ok=True)
    write(case, folder / "run.mcap", simulate(case)[1])
    (folder / "scene.yaml").write_text(
        yaml.safe_dump(scene_of(case), sort_keys=False, default_flow_style=None), encoding="utf-8"
    )


def _differ(a: Seen, b: Seen) -> bool:
    if math.isinf(a.time) or math.isinf(b.time):
        return math.isinf(a.time) != math.isinf(b.time)
    return (a.name, a.mode) != (b.name, b.mode) or abs(a.time - b.time) > 2 * TIME


def judged(case: Case, content: dict[str, Any], true: Seen, visible: bool) -> dict[str, bool]:
    """Which of the claims about a case hold; those that do not apply are left out."""
    effects = content.get("effects", [])
    seen = content.get("seen", [])
    found: dict[str, bool] = {}
    if true.name:
        found["what moved first, and how"] = bool(seen) and (seen[0]["object"], seen[0]["mode"]) == (
            true.name,
            true.mode,
        )
        found["when, within 50 ms"] = bool(seen) and abs(seen[0]["time"] - true.time) <= TIME
    else:
        found["nothing moves: nothing is seen"] = not seen
    if case.cause == "none":
        found["as declared: no cause"] = content["verdict"] == "none"
    elif not visible:
        found["hidden cause: no false one"] = not effects or effects[0]["name"] == case.cause
    else:
        right = bool(effects) and effects[0]["name"] == case.cause
        rivals = effects[0]["indistinguishable"] if effects else []
        found["visible cause: named first"] = right
        found[f"  {case.cause}"] = right
        found["visible cause: first, or among its rivals"] = right or any(one.startswith(case.cause) for one in rivals)
        found["visible cause: a false one, over 50 %, without it as rival"] = (
            bool(effects) and not right and effects[0]["belief"] > 0.5
            and not any(one.startswith(case.cause) for one in rivals)
        )  # fmt: skip
    return found


def main() -> None:
    """Print the table of docs/carried.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--final", action="store_true", help="seeds that are answered once, after the last change")
    parser.add_argument("--each", action="store_true", help="a line for each case")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="only write the recording and scene of the first seed")
    parser.add_argument("--declared", action="store_true", help="nothing is wrong in any scene")
    parser.add_argument("--rough", action="store_true", help="the world that breaks the assumptions of the tool")
    given = parser.parse_args()
    console = Console(width=150)
    first = FIRST_FINAL if given.final else given.first
    if given.keep is not None:
        keep(draw(first), given.keep)
        return
    counts: dict[str, list[bool]] = defaultdict(list)
    costs = []
    for seed in track(range(first, first + given.cases), "cases", console=Console(stderr=True)):
        case = draw(seed)
        if given.declared:
            case = replace(as_declared(case), cause="none", subject="")
        with tempfile.TemporaryDirectory() as folder:
            content, true, visible, seconds = answer(case, Path(folder), ROUGH if given.rough else PLAIN)
        costs.append(seconds)
        for name, holds in judged(case, content, true, visible).items():
            counts[name].append(holds)
        if given.each:
            named = [(e["name"], round(e["belief"], 2), e["value"]) for e in content.get("effects", [])]
            console.print(
                seed, case.cause, case.subject, round(case.value, 3), true, visible, content["verdict"], named
            )
    table = Table("claim", "holds", title="poise mismatch --scene", title_justify="left")
    for name in sorted(counts):
        table.add_row(name, f"{sum(counts[name])} of {len(counts[name])}")
    table.add_row("CPU s, middle and most", f"{sorted(costs)[len(costs) // 2]:.1f}, {max(costs):.1f}")
    console.print(table)


if __name__ == "__main__":
    main()
