"""`poise mismatch BAG --scene SCENE`: what a scene on a base that moves has wrong."""

import math
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.assembly import load_scene
from poise.commands.mismatch_answer import print_written
from poise.commands.output import console, progress_bar, warn, write_json
from poise.mismatch.carried import (
    CarriedAnswer,
    CarriedEffect,
    CarriedMotion,
    CarriedRecording,
    examine_carried,
    read_carried,
)
from poise.recording import open_recording


def answer_scene(
    bag: Path, scene: Path, carrier: str, deadline: float, picture: Path | None, json_target: str | None
) -> None:
    """Print and write the answer about a recording of a scene on a base that moves.

    Raises:
        PoiseError: as `examined_scene` and `write_scene_picture`.
    """
    recording, found = examined_scene(bag, scene, carrier, deadline)
    written = [] if picture is None else [write_scene_picture(picture, recording, found)]
    write_json(json_target, scene_json(found, bag, scene))
    people = console(json_target)
    print_scene(people, found)
    print_written(people, written)


def examined_scene(
    bag: Path, scene: Path, carrier: str, deadline: float = math.inf
) -> tuple[CarriedRecording, CarriedAnswer]:
    """A recording of a scene on a base that moves, and what it says against the scene file.

    Raises:
        PoiseError: as `load_scene`, `read_carried` and `examine_carried`.
    """
    declared = load_scene(scene)
    recording = read_carried(open_recording(bag), declared, carrier)
    with progress_bar("trying causes") as progress:
        return recording, examine_carried(recording, declared, deadline, progress)


def write_scene_picture(path: Path, recording: CarriedRecording, found: CarriedAnswer) -> Path:
    """Draw the load over time and how far the objects moved, by the file's ending (PNG, SVG, PDF).

    Raises:
        InputError: UNSUPPORTED for another ending, FILE_UNWRITABLE.
    """
    from poise.viewing import carried_panels, write_picture  # drawing libraries load slowly: only now

    return write_picture(carried_panels(recording, found), path)


def scene_json(found: CarriedAnswer, bag: Path, scene: Path) -> dict[str, Any]:
    """The answer as `write_json` takes it, which makes numbers that are not finite null."""
    return {
        "verdict": found.verdict,
        "effects": [_effect(one) for one in found.effects],
        "seen": [_motion(one) for one in found.seen],
        "predicted": None if found.predicted is None else _motion(found.predicted),
        "largest_load": found.most,
        "as_declared": found.declared,
        "notes": list(found.notes),
        "recordings": [{"bag": str(bag), "start": float(found.seconds[0]), "end": float(found.seconds[-1])}],
        "scene": str(scene),
    }


def _effect(effect: CarriedEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "objects": list(effect.objects),
        "belief": effect.belief,
        "parameter": effect.parameter,
        "value": effect.value,
        "std": effect.deviation,
        "unit": effect.unit,
        "bound": effect.bound,
        "indistinguishable": list(effect.indistinguishable),
        "sentence": effect.sentence,
    }


def _motion(motion: CarriedMotion) -> dict[str, Any]:
    return {
        "object": motion.object,
        "mode": motion.mode,
        "time": motion.time,
        "std": motion.deviation,
        "moved": motion.moved,
        "tilted": motion.tilted,
    }


def print_scene(people: Console, found: CarriedAnswer) -> None:
    """What moved, what the scene predicts, and what it has wrong."""
    for note in found.notes:
        warn(note)
    table = Table("", "object", "moves by", "begins at, s", title="What moves first", title_justify="left")
    first = found.seen[0] if found.seen else None
    for label, motion in (("recorded", first), ("predicted", found.predicted)):
        if motion is None:
            table.add_row(label, "nothing", "", "")
        else:
            spread = f" +- {motion.deviation:.2f}" if motion.deviation else ""
            table.add_row(label, escape(motion.object), f"a {motion.mode}", f"{motion.time:.2f}{spread}")
    people.print(table)
    people.print(f"The largest load of the scene as declared is {found.most:.2f}; from 1 on something moves.")
    if found.verdict == "none":
        people.print(f"The scene file explains the recording (probability {found.declared:.0%}).")
    for effect in found.effects:
        rivals = f" It may also be {', '.join(effect.indistinguishable)}." if effect.indistinguishable else ""
        people.print(f"{effect.belief:.0%}: {escape(effect.sentence)}.{escape(rivals)}", soft_wrap=True)
    if found.verdict == "unknown":
        people.print("What happened fits neither the scene file nor any cause that is tried.")
