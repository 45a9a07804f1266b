"""The drives that `poise mismatch` fitted, for people and as JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Table

from poise.commands.mismatch_export import PreparedExports
from poise.simulation.rollout import DRIVE_UNITS, DriveEstimate
from poise.viewing import rounded


def drives_json(drives: Sequence[DriveEstimate], planned: PreparedExports) -> dict[str, Any]:
    """`drives` and `exports` of the answer; errors are of free runs of one second, or efforts, outside the fit."""
    return {
        "drives": [
            {
                "joint": each.joint,
                "parameters": {
                    name: asdict(value) | {"unit": DRIVE_UNITS[name]} for name, value in each.values.items()
                },
                "held_out": {"nominal": each.before, "fitted": each.after, "unit": each.unit},
                "kept": each.kept,
            }
            for each in drives
        ],
        "exports": planned.as_json(),
    }


def print_drives(people: Console, drives: Sequence[DriveEstimate]) -> None:
    """A table of the fitted values, with those of the model in brackets."""
    if not drives:
        return
    what = "efforts" if drives[0].unit == "N m" else "free runs of 1 s"
    title = f"Drives: value ± one sigma (of the model); error of {what} that the fit did not see"
    names = list(drives[0].values)
    units = (f"{name}, {DRIVE_UNITS[name]}" for name in names)
    table = Table("joint", *units, f"error, {drives[0].unit}: model", "fitted", title=title, title_justify="left")
    for each in drives:
        cells = []
        for name in names:
            value = each.values[name]
            number, sigma = rounded(value.value, value.std)
            cells.append(f"{number} ± {sigma} ({value.before:.3g})")
        table.add_row(
            each.joint, *cells, f"{each.before:.2g}", f"{each.after:.2g}" + ("" if each.kept else ", not kept")
        )
    people.print(table)
