"""`poise rollout`: MuJoCo models run freely under what was recorded, before and after a change."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from poise.commands.output import BAG_HELP, JsonOption, console, refuse_folder, warn, write_json
from poise.errors import ErrorCode, InputError
from poise.mismatch.application import recorded_run
from poise.recording import open_recording
from poise.simulation.rollout import (
    FreeArm,
    FreeRun,
    InputKind,
    RecordedRun,
    RolloutOptions,
    rolled_out,
    share_removed,
)

_HELD = 0.3
"""Share at the end of a recording that `poise mismatch` holds out from its fits."""
_LONGEST = 120.0


def rollout(
    models: Annotated[
        list[Path],
        typer.Argument(metavar="MODEL...", help="MuJoCo models (MJCF), the one before first.", show_default=False),
    ],
    commands: Annotated[Path, typer.Option("--commands", metavar="BAG", help=BAG_HELP, show_default=False)],
    inputs: Annotated[
        str,
        typer.Option(
            help="What drives the joints: commands (of actuators), efforts, or auto: commands where there are."
        ),
    ] = "auto",
    windows: Annotated[str, typer.Option("--windows", metavar="S,S,...", help="Lengths of windows, s.")] = "0.1,1,10",
    count: Annotated[int, typer.Option("--count", min=1, max=1000, help="Windows of each length, at most.")] = 40,
    held_out: Annotated[
        float, typer.Option("--held-out", min=0.01, max=1.0, help="Share at the end that the windows are from.")
    ] = _HELD,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Write an HTML report.", show_default=False)
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Run MuJoCo models freely from recorded states, and compare their motion and wrench with the recording.

    Each window starts from the recorded positions and velocities; from then on the model gets the recorded commands
    alone, or the joint efforts. The windows are from the part of the recording that `poise mismatch` holds out.

    Example:  poise rollout robot.xml robot_found.xml --commands run.mcap --report out
    """
    begin = time.perf_counter()
    refuse_folder(json_target, "--json")
    run = recorded_run(open_recording(commands))
    last = float(run.seconds[-1])
    since = max(last - held_out * (last - float(run.seconds[0])), float(run.seconds[0]))
    options = RolloutOptions(_lengths(windows), count, since, last)
    runs = [rolled_out(FreeArm(model, run, _kind(inputs)), options) for model in models]
    _check_joints(runs)
    _say(runs, run, options)
    content = _as_json(runs, commands, options) | {"seconds": time.perf_counter() - begin}
    written = [] if report is None else [_report(report, runs, commands, content)]
    write_json(json_target, content)
    people = console(json_target)
    people.print(_table(runs))
    for horizon, share in _removed(runs).items():
        people.print(f"Over {horizon:g} s, {100 * share:.0f} % of the error of the motion is gone.")
    for path in written:
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def _kind(text: str) -> InputKind:
    kinds: dict[str, InputKind] = {"auto": "auto", "commands": "commands", "efforts": "efforts"}
    if text in kinds:
        return kinds[text]
    raise InputError(ErrorCode.BAD_INPUT, f"--inputs {text}: use auto, commands or efforts")


def _lengths(text: str) -> tuple[float, ...]:
    try:
        found = sorted({float(part) for part in text.split(",")})
    except ValueError:
        found = []
    if not found or not all(0.0 < each <= _LONGEST for each in found):
        raise InputError(ErrorCode.BAD_INPUT, f"--windows {text}: give lengths in s, 0 to {_LONGEST:g}, with commas")
    return tuple(found)


def _check_joints(runs: Sequence[FreeRun]) -> None:
    for other in runs[1:]:
        if other.arm.joints != runs[0].arm.joints:
            lacking = sorted(set(runs[0].arm.joints) ^ set(other.arm.joints))
            what = f"{runs[0].arm.path} and {other.arm.path} differ in the joints {', '.join(lacking)}"
            raise InputError(ErrorCode.BAD_INPUT, f"{what}: give two versions of one model")


def _say(runs: Sequence[FreeRun], run: RecordedRun, options: RolloutOptions) -> None:
    """What qualifies the answer."""
    for note in dict.fromkeys(note for each in runs for note in each.arm.notes):
        warn(note)
    if lost := [name for name in run.names if name not in runs[0].arm.joints]:
        warn(f"the model has no joint {', '.join(lost)}: not compared")
    if missing := [h for h in options.horizons if h not in [each.horizon for each in runs[0].horizons]]:
        lengths = ", ".join(f"{h:g}" for h in missing)
        warn(f"no window of {lengths} s fits into the {options.end - options.begin:.1f} s that are held out")


def _removed(runs: Sequence[FreeRun]) -> dict[float, float]:
    return share_removed(runs[0].horizons, runs[-1].horizons) if len(runs) > 1 else {}


def _as_json(runs: Sequence[FreeRun], bag: Path, options: RolloutOptions) -> dict[str, Any]:
    return {
        "commands": str(bag),
        "start": options.begin,
        "end": options.end,
        "joints": list(runs[0].arm.joints),
        "models": [
            {
                "model": str(run.arm.path),
                "inputs": run.arm.driven,
                "notes": run.arm.notes,
                "windows": [
                    {
                        "length": each.horizon,
                        "count": len(each.starts),
                        "diverged": each.diverged,
                        "error": each.mean,
                        "joints": dict(zip(run.arm.joints, each.by_joint.tolist(), strict=True)),
                        "force": float(np.mean(each.wrench[:, 0])),
                        "torque": float(np.mean(each.wrench[:, 1])),
                    }
                    for each in run.horizons
                ],
            }
            for run in runs
        ],
        "removed": {f"{horizon:g}": share for horizon, share in _removed(runs).items()},
    }


def _table(runs: Sequence[FreeRun]) -> Table:
    from poise.viewing import rollout_rows  # drawing libraries load slowly

    title = "Error of the motion (rms, rad or m) and of the wrench (N, N m), mean over the windows"
    table = Table("window", "", *(escape(run.arm.path.name) for run in runs), title=title, title_justify="left")
    for row in rollout_rows(runs):
        table.add_row(*row)
    return table


def _report(folder: Path, runs: Sequence[FreeRun], bag: Path, content: dict[str, Any]) -> Path:
    from poise.viewing import write_rollout_report

    return write_rollout_report(folder, runs, str(bag), content)
