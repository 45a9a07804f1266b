"""`poise simulate`: the simulation with the effects of a diagnosis, along a recorded or a planned motion."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.commands.output import console, refuse_folder, write_json
from poise.errors import ErrorCode, InputError
from poise.mismatch.application import SimulatedRun, run_planned, run_recorded
from poise.mismatch.reading import NominalModel, absent, complete_values, effect_of, load_model, read_recording
from poise.mismatch.recorded import WRENCH_CHANNELS
from poise.recording import open_recording, rewrite_recording, write_recording
from poise.robot import RobotModel, chains, find_urdf, parse_urdf, read_urdf
from poise.simulation import read_trajectory

_PLANNED = (".csv", ".yaml", ".yml")


def simulate(
    model: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL", help="model.yaml: payload, noise, and the effects that --save added.", show_default=False
        ),
    ],
    motion: Annotated[
        Path,
        typer.Option(
            "--motion",
            metavar="FILE",
            help="A recording whose motion is repeated, or a trajectory (.csv, .yaml; see docs/fake_robots.md).",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The .mcap to write.", show_default=False)],
    urdf: Annotated[
        Path | None,
        typer.Option("--urdf", help="Of a motion: URDF, fr3, xarm7, ur5e, ur10e, ridgeback_ur10.", show_default=False),
    ] = None,
    noise: Annotated[
        bool, typer.Option("--noise", help="Add the model's noise to the wrench, 0.1 N m to efforts.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the noise.")] = 0,
    json_target: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE", help="Write a summary as JSON; - for stdout.", show_default=False),
    ] = None,
) -> None:
    """Simulate the sensor and the joints along a motion and write a recording.

    With a model that `poise mismatch --save` wrote, the effects that were found act: the simulated recording is what
    the diagnosis expects, and its comparison with the plain model finds them again. In a recording the wrench and
    measured joint efforts are replaced; all other topics are unchanged. Along a trajectory, wrench (100 Hz), joint
    states with efforts (125 Hz) and robot_description are written.

    Example:  poise simulate augmented.yaml --motion run.mcap --out expected.mcap --json -

    Example:  poise simulate model.yaml --motion excite.yaml --urdf ridgeback_ur10 --noise --out simulated.mcap
    """
    refuse_folder(json_target, "--json")
    known = load_model(model)
    rng = np.random.default_rng(seed) if noise else None
    run = _planned if motion.suffix in _PLANNED else _recorded
    made = run(known, motion, out, urdf, rng)
    content = summary(made, known, out, noise)
    write_json(json_target, content)
    print_summary(console(json_target), content)


def _recorded(
    known: NominalModel, motion: Path, out: Path, urdf: Path | None, rng: np.random.Generator | None
) -> SimulatedRun:
    if urdf is not None:
        raise InputError(ErrorCode.BAD_INPUT, "--urdf is for a trajectory; for a recording put `urdf:` into the model")
    recording = open_recording(motion)
    reading = read_recording(recording, known)
    joints = None if reading.recorded.effort is None else recording.joint_states()
    made = run_recorded(reading.recorded, joints, reading.model, rng)
    rewrite_recording(recording, out, made.streams)
    return made


def _planned(
    known: NominalModel, motion: Path, out: Path, urdf: Path | None, rng: np.random.Generator | None
) -> SimulatedRun:
    source = urdf or known.urdf
    if source is None:
        raise InputError(ErrorCode.BAD_INPUT, f"the trajectory {motion} needs a robot: give --urdf, or urdf: in MODEL")
    robot = RobotModel.from_file(source, known.sensor_frame or _last_frame(source))
    made = run_planned(robot, read_trajectory(motion, robot), known, rng)
    write_recording(out, made.streams, robot_description=read_urdf(find_urdf(source)), metadata=_metadata(known))
    return made


def _last_frame(source: Path) -> str:
    """The sensor's frame, or the last link of a robot without a sensor."""
    text = read_urdf(find_urdf(source))
    return "ft_sensor" if "ft_sensor" in parse_urdf(text).links else chains(text)[0][0]


def _metadata(known: NominalModel) -> dict[str, dict[str, str]]:
    return {} if known.gravity is None else {"poise": {"gravity": repr(known.gravity)}}


def summary(made: SimulatedRun, known: NominalModel, out: Path, noisy: bool) -> dict[str, Any]:
    """The summary of what was written, in SI units; sizes are of an effect's whole response."""
    recorded = made.recorded
    effects = []
    for component in known.effects:
        effect = effect_of(component)
        why = absent(effect, made.nominal, events=True, values=component.values)
        values = component.values if why else complete_values(effect, made.nominal, component.values)
        response = np.zeros((1, 6)) if why else effect.simulate(made.nominal, values)
        largest = np.abs(response).max(axis=0)
        on_joints = effect.signal == "effort"
        sizes = {
            "force": 0.0 if on_joints else float(largest[:3].max()),
            "torque": 0.0 if on_joints else float(largest[3:].max()),
            "effort": float(largest.max()) if on_joints else 0.0,
        }
        effects.append(
            {
                "name": effect.name,
                "acts": not why,
                "reason": why,
                "signal": effect.signal,
                "largest": sizes,
            }
        )
    frame, wrench = ("", None) if made.wrench is None else (made.wrench.frame_id, made.wrench.wrench_in_sensor)
    return {
        "out": str(out),
        "duration": recorded.duration,
        "wrenches": 0 if wrench is None else len(wrench),
        "frame_id": frame,
        "mass": float(recorded.phi[0]),
        "noise": noisy,
        "efforts": [] if recorded.effort is None else list(recorded.effort.names),
        "rms": {}
        if wrench is None
        else dict(zip(WRENCH_CHANNELS, np.sqrt((wrench**2).mean(axis=0)).tolist(), strict=True)),
        "effects": effects,
    }


def print_summary(people: Console, content: dict[str, Any]) -> None:
    """The effects that acted, and what was written."""
    table = Table("effect of the model", "largest force, N", "torque, N m", "joint effort, N m (N)", "")
    for entry in content["effects"]:
        sizes = [f"{size:.3g}" if entry["acts"] and size else "" for size in entry["largest"].values()]
        table.add_row(entry["name"], *sizes, escape(entry["reason"]))
    if content["effects"]:
        people.print(table)
    people.print(
        f"written: {escape(content['out'])} ({content['wrenches']} wrenches, {content['duration']:.1f} s)",
        soft_wrap=True,
    )
