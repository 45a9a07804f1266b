"""The world in a file: written whole or not at all, and refused when a byte of it has changed."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from poise.assembly import Assembly, Box, Cylinder, FrictionPair, Mesh, RigidObject, Sphere
from poise.assembly.scene import ROLLING, read_object, scene_content
from poise.errors import ErrorCode, InputError, PoiseError
from poise.files import write_whole
from poise.world.world import KnownObject, WeightSource, Whereabouts, World

_FORMAT = "poise world 1"
_MAX_BYTES = 200_000_000
_NOT_VERIFIED = "it was in the hand before a restart; whether it still is, was not verified"


def save_world(world: World, path: Path) -> None:
    """Write a file that `load_world` reads back.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    content = json.dumps(_content(world), allow_nan=False)
    digest = hashlib.sha256(content.encode()).hexdigest()
    write_whole(path, f"{_FORMAT}\n{digest}\n{content}\n".encode())


def load_world(path: Path) -> World:
    """Read a world; what was held is held, with a note that this was not verified.

    Raises:
        InputError: FILE_UNREADABLE; FILE_CORRUPT when it is damaged.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise _damaged(path, "it is larger than a world")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    head, _, rest = data.partition(b"\n")
    digest, _, body = rest.partition(b"\n")
    if head != _FORMAT.encode():
        raise _damaged(path, f"it does not begin with {_FORMAT!r}")
    if hashlib.sha256(body.removesuffix(b"\n")).hexdigest().encode() != digest:
        raise _damaged(path, "its checksum is wrong")
    try:
        return _read(json.loads(body))
    except (ValueError, KeyError, TypeError, PoiseError) as error:
        raise _damaged(path, str(error)) from error


def _damaged(path: Path, why: str) -> InputError:
    return InputError(
        ErrorCode.FILE_CORRUPT, f"{path}: {why}; move the file away, and set the assembly again", path=str(path)
    )


def _content(world: World) -> dict[str, Any]:
    return {
        "frame": world.frame,
        "version": world.version,
        "gravity": np.asarray(world.gravity).tolist(),
        "friction": world.friction,
        "pairs": [[*pair.objects, pair.coefficient, pair.deviation, pair.rolling] for pair in world.pairs],
        "rolling": world.rolling,
        "friction_deviation": world.friction_deviation,
        "newest": [world.newest_event, world.newest_scan],
        "objects": [
            {
                "object": _object(known.item),
                "frame": known.frame,
                "where": int(known.where),
                "source": int(known.source),
                "changed": known.changed,
                "lifted": known.lifted,
                "notes": known.notes,
            }
            for known in world.objects.values()
        ],
    }


def _object(item: RigidObject) -> dict[str, Any]:
    """The entry of a scene file; a mesh is written in full."""
    shape = item.shape
    if isinstance(shape, Box | Cylinder | Sphere):
        return _entry(item)
    if not isinstance(shape, Mesh):
        raise InputError(ErrorCode.UNSUPPORTED, f"object {item.id}: a shape of this kind has no place in a file")
    entry = _entry(replace(item, shape=Box((1.0, 1.0, 1.0))))
    del entry["box"]
    mesh = {"vertices": shape.vertices.tolist(), "triangles": shape.triangles.tolist(), "source": shape.source}
    return entry | {"mesh": mesh | {"scale": shape.scale, "notes": shape.notes}}


def _entry(item: RigidObject) -> dict[str, Any]:
    fixed = RigidObject("support", Box((1.0, 1.0, 1.0)), item.pose, fixed=True)
    entry: dict[str, Any] = scene_content(Assembly((item, fixed)))["objects"][0]
    return entry


def _read(content: dict[str, Any]) -> World:
    objects = {}
    for entry in content["objects"]:
        given = dict(entry["object"])
        if "mesh" in given:
            mesh = given["mesh"]
            given["mesh"] = Mesh(
                np.array(mesh["vertices"], dtype=np.float64),
                np.array(mesh["triangles"], dtype=np.int64),
                mesh["source"],
                mesh["scale"],
                tuple(mesh["notes"]),
            )
        item, where, notes = read_object(given), Whereabouts(entry["where"]), tuple(entry["notes"])
        if where is Whereabouts.HELD:
            notes = (*(note for note in notes if note != _NOT_VERIFIED), _NOT_VERIFIED)
        lifted = None if entry["lifted"] is None else (float(entry["lifted"][0]), float(entry["lifted"][1]))
        objects[item.id] = KnownObject(
            item, entry["frame"], where, WeightSource(entry["source"]), entry["changed"], lifted, notes
        )
    newest_event, newest_scan = content["newest"]
    return World(
        content["frame"],
        content["version"],
        objects,
        np.array(content["gravity"], dtype=np.float64),
        content["friction"],
        tuple(FrictionPair((first, second), *rest) for first, second, *rest in content["pairs"]),
        newest_event,
        newest_scan,
        content.get("rolling", ROLLING),
        content.get("friction_deviation", 0.0),
    )
