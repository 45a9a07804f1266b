"""`poise mismatch REAL --against SIM`: the recording of a simulator is what the nominal model would have measured."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.commands.compare import comparison_json, print_comparison, read_alike, with_description
from poise.commands.mismatch_answer import unknown_json
from poise.commands.output import progress_bar, warn
from poise.errors import ErrorCode, InputError
from poise.mismatch.comparing import Comparison, Located, compare, located
from poise.mismatch.reading import (
    InputFinding,
    NominalModel,
    ReadRecording,
    bare_motion,
    holds,
    recorded_streams,
    tracking,
)
from poise.recording import Recording, open_recording

A_IS_THE_SIMULATION = "A is the simulator's recording, B the robot's."


def examined_against(
    bag: Path, simulated: Path, nominal: NominalModel, called: Mapping[str, str], deadline: float = math.inf
) -> tuple[dict[str, Any], Comparison | Located, list[ReadRecording]]:
    """A recording held against a simulator's.

    Where one of the recordings or the model describes the robot, the differences are named; else they are located.

    Args:
        bag: of the robot.
        simulated: of the simulator, of the same motion or, with a description, of another one.
        nominal: the model of the robot; may be empty.
        called: joints that the simulator calls otherwise, with the robot's names.
        deadline: s after which the search ends with its best answer so far.

    Returns:
        The answer as JSON, what was found, and what was read: the simulator's recording, then the robot's; nothing
        where there is no description.

    Raises:
        PoiseError: as `compare` and `located`.
    """
    recordings = [open_recording(path) for path in (simulated, bag)]
    known = with_description(nominal, recordings[::-1])
    if known.urdf is None and known.simulator is None and not holds(recordings[1], "tf"):
        found, motion = _without_model(recordings, called)
        return _located_json(found, motion) | {"against": str(simulated)}, found, []
    readings = read_alike([simulated, bag], known, {0: called})
    with progress_bar("comparing") as progress:
        compared = compare(
            readings[0].recorded, readings[1].recorded, readings[0].model, deadline=deadline, progress=progress
        )
    content = comparison_json(compared, readings[1 if compared.side == "b" else 0])
    delays = [_delays(reading.findings) for reading in readings]
    return content | {"against": str(simulated), "motion": _motion(*delays)}, compared, readings


def _without_model(
    recordings: list[Recording], called: Mapping[str, str]
) -> tuple[Located, dict[str, dict[str, float | None]]]:
    """What differs by the signals alone; how late the joints follow their commands in both."""
    motions, delays = [], []
    for recording, names in zip(recordings, (called, {}), strict=True):
        streams = recorded_streams(recording, recording.wrench() if holds(recording, "wrench") else None, names)
        if not holds(recording, "joint_states"):
            raise InputError(ErrorCode.TOPIC_MISSING, f"{recording.path} has no joint_states: record them too")
        states = recording.joint_states()
        joints = streams.joint_states(tuple(names.get(name, name) for name in states.names))
        motion = bare_motion(streams, joints)
        motions.append(motion)
        track = motion.joints
        followed = None
        if motion.commands is not None and track is not None:
            followed = tracking(motion.commands, track.names, motion.seconds, track.position)
        delays.append(_delays(() if followed is None else (followed,)))
        for sentence in recording.clocks.values():
            warn(f"{recording.path}: {sentence}")
    simulated, real = motions
    return located(real, simulated), _motion(*delays)


def _delays(findings: tuple[InputFinding, ...]) -> dict[str, float]:
    """s by which each joint follows its commands."""
    followed = next((each for each in findings if each.kind == "command_tracking"), None)
    return {} if followed is None else dict(zip(followed.joints, followed.values, strict=True))


def _motion(simulated: Mapping[str, float], real: Mapping[str, float]) -> dict[str, dict[str, float | None]]:
    """How late each joint follows its commands, s, in both."""
    names = dict.fromkeys([*real, *simulated])
    return {name: {"recording": real.get(name), "simulation": simulated.get(name)} for name in names}


def _located_json(found: Located, motion: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of `poise mismatch`, without names."""
    differing = found.differing
    return {
        "verdict": "unknown" if differing else "none",
        "effects": [],
        "where": [
            {
                "start": start,
                "end": end,
                "kind": "difference",
                "channels": [each.name],
                "depends_on": [state for state, _ in each.goes_with],
            }
            for each in differing
            for start, end in each.windows
        ],
        "unknown": unknown_json(" ".join(each.sentence for each in differing)) if differing else None,
        "channels": [asdict(each) | {"differs": each.differs} for each in found.channels],
        "alignment": {"share": found.alignment.share, "rate": found.alignment.rate, "notes": list(found.notes)},
        "motion": dict(motion),
    }


def print_against(
    people: Console, found: Comparison | Located, motion: Mapping[str, Mapping[str, float | None]]
) -> None:
    """What differs, and how the joints follow their commands in both."""
    if isinstance(found, Comparison):
        people.print(A_IS_THE_SIMULATION)
        print_comparison(people, found)
    else:
        for note in found.notes:
            warn(note)
        for each in found.differing:
            people.print(escape(each.sentence), soft_wrap=True)
        if not found.differing:
            people.print("The recordings differ by no more than noise and 1 % of the readings.")
        else:
            people.print("With --model, or a robot_description in a bag, the differences are named.")
    late = {name: both for name, both in motion.items() if None not in both.values()}
    if late:
        table = Table(
            "joint", "recording, ms", "simulation, ms", title="Late behind the commands", title_justify="left"
        )
        for name, both in late.items():
            table.add_row(escape(name), *(f"{1e3 * (both[key] or 0.0):.1f}" for key in ("recording", "simulation")))
        people.print(table)
