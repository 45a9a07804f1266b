"""`poise identify --model`: a diagnosis put to use, its effects taken out of the recording before it is weighed."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from poise.commands.output import warn
from poise.recording import open_recording, rewrite_recording

if TYPE_CHECKING:  # imported where it is used: most recordings are weighed without a model
    from poise.mismatch.application import CompensatedWrench


@contextmanager
def without_effects(
    bag: Path, model: Path | None, sensor_frame: str | None, gravity: float | None, wrench_topic: str
) -> Iterator[tuple[Path, "CompensatedWrench | None"]]:
    """The recording with the wrench corrected, for as long as it is needed; the bag itself without a model.

    Sensor frame and gravity of the command line count before the model's.

    Raises:
        InputError: as `load_model` and `compensate`.
    """
    if model is None:
        yield bag, None
        return
    from poise.mismatch.application import compensate
    from poise.mismatch.reading import load_model

    recording, known = open_recording(bag), load_model(model)
    known = replace(known, sensor_frame=sensor_frame or known.sensor_frame, gravity=gravity or known.gravity)
    taken = compensate(recording, known)
    for note in taken.notes:
        warn(f"{bag}: {note}")
    with tempfile.TemporaryDirectory(prefix="poise-identify-") as folder:
        path = Path(folder) / f"{bag.stem}.mcap"
        rewrite_recording(recording, path, {wrench_topic: taken.wrench})
        yield path, taken


def compensation_fields(taken: "CompensatedWrench | None") -> dict[str, Any]:
    """For the answer."""
    content = None if taken is None else {"effects": list(taken.names), "left": taken.left, "rms": taken.size}
    return {"taken_out": content}


def say(people: Console, taken: "CompensatedWrench | None") -> None:
    """What was taken out, and what was not."""
    if taken is None:
        return
    force, torque = (float(np.linalg.norm(part)) for part in (taken.size[:3], taken.size[3:]))
    what = f"{', '.join(taken.names)} ({force:.2g} N and {torque:.2g} N m rms)" if taken.names else "nothing"
    kept = "".join(f"; {name} was left: {reason}" for name, reason in taken.left.items())
    people.print(f"taken out  {escape(what + kept)}", soft_wrap=True)
