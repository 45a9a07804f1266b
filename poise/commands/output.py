"""Output of commands: strict JSON, written whole or not at all, and tables for people."""

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from poise.errors import ErrorCode, InputError
from poise.files import write_whole

STDOUT = "-"
PAGE_WIDTH = 120
JsonOption = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE", help="Write the answer as JSON; - for stdout.", show_default=False),
]
SearchDeadlineOption = Annotated[
    float,
    typer.Option(
        "--deadline",
        metavar="SECONDS",
        min=0.1,
        help="Answer after about this time with the best result so far.",
        show_default=False,
    ),
]
BAG_HELP = "A recording: .mcap, .db3, rosbag2 folder, ROS 1 .bag, or a table with columns.yaml."


def console(json_target: str | None) -> Console:
    """The console for text: stdout, or stderr when stdout has the JSON."""
    people = Console(stderr=json_target == STDOUT, highlight=False)
    if not people.is_terminal:
        people.width = max(people.width, PAGE_WIDTH)  # a file has no edge to wrap at
    return people


def warn(message: str) -> None:
    """Print one line on stderr that qualifies the answer."""
    print(f"poise: warning: {message}", file=sys.stderr)


@contextmanager
def progress_bar(words: str) -> Iterator[Callable[[float], None]]:
    """A progress bar on stderr while a job runs on a terminal; call it with the completed share, 0 to 1."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as progress:
        task = progress.add_task(words, total=1.0)
        yield lambda share: progress.update(task, completed=share)


def to_json(value: Any) -> Any:
    """The nearest thing that strict JSON can hold: arrays become lists, NaN and infinity become null."""
    if isinstance(value, dict):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return to_json(value.tolist())
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    return value


def write_json(target: str | None, content: dict[str, Any]) -> None:
    """Write to a file (through a temporary one), to stdout when the target is `-`, or nowhere when it is None.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    if target is None:
        return
    text = json.dumps(to_json(content), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        if target == STDOUT:
            sys.stdout.write(text)
            sys.stdout.flush()
        elif Path(target).exists() and not Path(target).is_file():  # a device or a pipe is written to, not replaced
            Path(target).write_text(text, encoding="utf-8")
        else:
            write_whole(Path(target), text.encode())
    except BrokenPipeError:
        raise
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNWRITABLE, f"cannot write the JSON to {target}: {error.strerror}") from error


def refuse_folder(target: str | None, option: str) -> None:
    """Refuse a folder as the target of a file before anything is computed.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    if target is not None and target != STDOUT and Path(target).is_dir():
        raise InputError(ErrorCode.FILE_UNWRITABLE, f"{option} {target} is a folder: give the name of a file")


def refuse_folders(targets: Mapping[str, Path | str | None]) -> None:
    """The same for several options.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    for option, target in targets.items():
        refuse_folder(None if target is None else str(target), option)


def number_for_json(value: float) -> float | str:
    """JSON has no infinity: the contract writes it as a word."""
    return float(value) if math.isfinite(value) else "inf" if value > 0 else "-inf"


def finding_json(code: ErrorCode, sentence: str, evidence: Mapping[str, float]) -> dict[str, Any]:
    """A finding as the contract writes it."""
    return {"code": int(code), "name": code.name, "sentence": sentence, "evidence": dict(evidence)}


def add_scene(written: list[Path], write: Callable[[], Path]) -> list[Path]:
    """The written files, with a Rerun scene if rerun is installed; otherwise warn that it is missing.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    try:
        return [*written, write()]
    except InputError as error:
        if error.code is not ErrorCode.UNSUPPORTED:
            raise
        warn(error.message)
        return written
