"""The HTML report of a loop: what each object weighs, how the stack stands, what the base used, and each step."""

import math
import shlex
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from poise.assembly import Analysis, acceleration_limits
from poise.errors import PoiseError
from poise.files import write_whole
from poise.viewing.assembly_figures import graph_panel, limits_panel
from poise.viewing.canvas import Panel
from poise.viewing.page import Finding, drawn, making, render_page
from poise.viewing.wording import readable

LOOP_COLUMNS = ("object", "outcome", "mass, kg", "true", "off, %", "com off, mm", "within 3 sigma", "stack, N")
"""Of the table of objects."""
_SECONDS = 20.0
"""s for the limits of the stack."""


def loop_rows(content: dict[str, Any]) -> list[list[str]]:
    """The table of objects of a loop's content (loop.json), as text."""
    rows = []
    for each in content["objects"]:
        cells = ["", "", "", "", ""]
        if "mass" in each:
            cells[0] = f"{each['mass']:.4f} ± {each['mass_std']:.4f}"
        if "true_mass" in each:
            errors = f"{100 * each['mass_error']:+.2f}", f"{1e3 * each['com_error']:.2f}"
            cells[1:] = [f"{each['true_mass']:.4f}", *errors, "yes" if each["within"] else "no"]
        strength = each["robustness"]
        cells.append("" if strength is None or not math.isfinite(strength) else f"{strength:.3g}")
        rows.append([readable(each["id"]), each["outcome"], *cells])
    return rows


def loop_sentences(content: dict[str, Any]) -> list[str]:
    """What else there is to say of a loop: what was left out, how it was carried, the time."""
    said = [f"{each['id']}: {each['why']}" for each in content["objects"] if each["why"]]
    if (carried := content["carried"]) is not None:
        moved = "" if carried["moved"] is None else f"; objects moved on it by at most {1e3 * carried['moved']:.2f} mm"
        said.append(
            f"carried {carried['distance']:.2f} m in {carried['seconds']:.1f} s with at most {carried['used']:.0%} of"
            f" the limit of {carried['limit']:.3g} m/s2{moved}"
        )
    if content["restarts"]:
        said.append("started again: " + ", ".join(f"{name} {count} x" for name, count in content["restarts"].items()))
    said.append(f"{content['seconds']:.0f} s in all, {content['planning']:.1f} s of them planning")
    return said


def write_loop_report(
    directory: Path,
    content: dict[str, Any],
    stack: Analysis | None,
    *,
    command: str | None = None,
    now: datetime | None = None,
) -> Path:
    """Write `report.html`; the file is self-contained and loads nothing from the network.

    Args:
        directory: made when missing.
        content: of loop.json.
        stack: what stands at the end; None: nothing does.
        command: that made it; default: this process's command line.
        now: date shown; default: the current time.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    command = shlex.join(sys.argv) if command is None else command
    done = sum(each["outcome"] == "placed" and "mass" in each for each in content["objects"])
    page = render_page(
        "loop.html.j2",
        title=f"{done} of {content['wanted']} objects weighed and placed",
        kicker="Loop",
        verdict="complete" if content["complete"] else "not complete",
        sentence=readable(content["sentence"] or _outcome(content), 1000),
        findings=[Finding("note", readable(text, 1000)) for text in loop_sentences(content)],
        columns=LOOP_COLUMNS,
        rows=loop_rows(content),
        panels=drawn(_panels(stack)),
        steps=[each | {"result": readable(_result(each), 1000)} for each in content["steps"]],
        provenance=[("World", content.get("world", "")), *making(command, now or datetime.now(UTC))],
        data=content,
        data_id="loop",
    )
    return write_whole(Path(directory) / "report.html", page.encode("utf-8"))


def _outcome(content: dict[str, Any]) -> str:
    if not content["complete"]:
        return "Not all objects were weighed and placed; the notes and the steps say why."
    return "Scanned, picked, weighed, placed" + (" and carried." if content["carried"] else "; not carried.")


def _result(step: dict[str, Any]) -> str:
    return "done" if step["code"] == 0 else f"{step['name']}: {step['sentence']}"


def _panels(stack: Analysis | None) -> list[Panel]:
    if stack is None or not stack.structure.movable:
        return []
    try:
        return [graph_panel(stack), limits_panel(acceleration_limits(stack, 72, _SECONDS))]
    except PoiseError:  # the table says why
        return [graph_panel(stack)]
