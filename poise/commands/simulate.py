"""`poise simulate`: running an augmented simulation along a recorded motion."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from poise.mismatch.model import load_model
from poise.mismatch.reading import read_world
from poise.mismatch.running import expected_wrench
from poise.recording import PoseStream, Stream, open_recording, write_recording


def simulate(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL", help="model.yaml, as --save writes it.", show_default=False)
    ],
    motion: Annotated[
        Path, typer.Option("--motion", metavar="BAG", help="Recording whose motion is run again.", show_default=False)
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Recording to write.", show_default=False)],
    noise: Annotated[bool, typer.Option("--noise", help="Add the model's noise to the wrench.")] = False,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the noise.")] = 0,
) -> None:
    """Run the augmented simulation along a recorded motion: the wrench that the model expects, as a recording.

    Example:  poise simulate augmented.yaml --motion run.mcap --out expected.mcap
    """
    nominal = load_model(model)
    recording = open_recording(motion)
    reading = read_world(recording, nominal)
    wrench = expected_wrench(reading, np.random.default_rng(seed) if noise else None)
    streams: dict[str, Stream | list[PoseStream]] = {"wrench": wrench}
    has = {topic.strip("/").rpartition("/")[2] for topic in recording.topics}
    if "joint_states" in has:
        streams["joint_states"] = recording.joint_states()
    if "odom" in has:
        streams["odom"] = recording.odometry()
    description = recording.robot_description() if "robot_description" in has else None
    write_recording(out, streams, robot_description=description)
    print(f"written: {out} ({len(wrench)} wrenches)")
