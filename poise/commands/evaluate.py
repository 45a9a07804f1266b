"""`poise evaluate`: the same job over every recording in a folder."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from poise.commands.identify import (
    GravityOption,
    MaxForceOption,
    MaxTorqueOption,
    MethodOption,
    SensorFrameOption,
    UrdfOption,
    WrenchTopicOption,
    as_json,
    weigher,
)
from poise.commands.identify_causes import Known, RepairOption, Weigh, no_answer_json, weighed_with_causes
from poise.commands.output import JsonOption, console, refuse_folder, write_json
from poise.errors import PoiseError
from poise.inertia.estimators import DEFAULT_METHOD
from poise.recording import find_recordings, skipped_entries
from poise.viewing import readable, rounded


def evaluate(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="Folder of recordings: bag files, rosbag2 folders.", show_default=False),
    ],
    method: MethodOption = DEFAULT_METHOD,
    sensor_frame: SensorFrameOption = None,
    urdf: UrdfOption = None,
    gravity: GravityOption = None,
    wrench_topic: WrenchTopicOption = "wrench",
    max_force: MaxForceOption = np.inf,
    max_torque: MaxTorqueOption = np.inf,
    repair: RepairOption = False,
    json_target: JsonOption = None,
) -> int:
    """Identify the payload of every recording in a folder and compare the results.

    Each is weighed as by `poise identify`. One without numbers does not stop the others; the exit status is then that
    of the worst.

    Example:  poise evaluate bags --json payloads.json
    """
    refuse_folder(json_target, "--json")
    bags = find_recordings(folder)
    known = (sensor_frame, gravity, wrench_topic)
    weigh = weigher(urdf, method, known, (max_force, max_torque), {"keep_history": False})
    status = 0
    results: list[dict[str, Any]] = []
    for bag in bags:
        result, failure = _result(weigh, bag, known, repair)
        results.append(result)
        if failure is not None:
            status = max(status, failure.exit_status)
            result["error"] = {"code": int(failure.code), "name": failure.code.name, "message": failure.message}
    skipped = skipped_entries(folder, bags)
    write_json(json_target, {"recordings": results, "skipped": skipped})
    people = console(json_target)
    people.print(_table(results))
    if skipped:
        people.print(
            f"skipped, because they are no recordings: {escape(readable(', '.join(skipped), 500))}", soft_wrap=True
        )
    return status


def _result(weigh: Weigh, bag: Path, known: Known, repair: bool) -> tuple[dict[str, Any], PoiseError | None]:
    """The JSON of one recording, and the reason why there are no numbers."""
    try:
        weighed = weighed_with_causes(weigh, bag, known, repair)
    except PoiseError as error:
        return {"bag": str(bag)}, error
    if weighed.answer is None:
        return no_answer_json(bag, weighed), weighed.failure
    return as_json(bag, weighed.recording, weighed.answer), weighed.failure


def _table(results: list[dict[str, Any]]) -> Table:
    table = Table()
    for heading in ("recording", "method", "mass kg", "centre of mass mm", "residual N, mN m", "samples", "findings"):
        words = heading in ("recording", "method", "findings")
        table.add_column(heading, justify="left" if words else "right")
    for result in results:
        name = escape(readable(Path(result["bag"]).name))
        found = ", ".join(finding["name"].lower() for finding in result.get("findings", ()))
        if "error" in result:
            table.add_row(name, "", "-", "", "", "", found or result["error"]["name"].lower(), style="red")
            continue
        mass, sigma = rounded(result["mass"], result["mass_std"])
        com = ", ".join(
            rounded(1e3 * value, 1e3 * spread)[0] if np.isfinite(value) else "-"
            for value, spread in zip(result["com"], result["com_std"], strict=True)
        )
        residual = f"{result['residual_force']:.3f}, {1e3 * result['residual_torque']:.1f}"
        table.add_row(name, result["method"], f"{mass} ± {sigma}", com, residual, str(result["n_samples"]), found)
    return table
