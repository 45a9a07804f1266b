"""Files of worlds by their endings and first bytes, in and out."""

import importlib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

from poise.assembly import Assembly, Mesh, RigidObject, load_scene, write_scene
from poise.errors import ErrorCode, InputError
from poise.files import write_whole
from poise.registry import entries_of
from poise.worlds.assembling import assembled
from poise.worlds.base import WorldFormat
from poise.worlds.mesh_beside import stl_bytes, stl_name

_MAX_BYTES = 100_000_000
_HEAD = 65536
_SCENE_SUFFIXES = (".yaml", ".yml")


@cache
def world_formats() -> tuple[WorldFormat, ...]:
    """The registry: every format, one file of this folder each."""
    path = importlib.import_module(__package__ or "").__path__
    return entries_of("poise.worlds", path, WorldFormat)  # type: ignore[type-abstract]


def format_of(path: Path) -> WorldFormat | None:
    """The format of a file; None for a scene file of Poise.

    Raises:
        InputError: FILE_UNREADABLE; UNSUPPORTED for a file of no known format.
    """
    suffix = path.suffix.lower()
    known = [each for each in world_formats() if suffix in each.suffixes]
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: larger than {_MAX_BYTES // 1_000_000} MB")
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    for each in known:
        if each.recognises(head):
            return each
    if known and suffix not in _SCENE_SUFFIXES:
        kinds = " or ".join(each.description for each in known)
        raise InputError(ErrorCode.UNSUPPORTED, f"{path}: expected {kinds}")
    return None


def read_world(
    path: str | Path,
    masses: Mapping[str, float] | None = None,
    friction: float | None = None,
    floor: float | None = None,
) -> tuple[Assembly, tuple[str, ...]]:
    """Read a world of another program, or a scene file.

    Args:
        path: MJCF, SDFormat, URDF, a planning scene of MoveIt, or a scene file.
        masses: kg, by name; they replace those of the file.
        friction: Coulomb coefficient of all pairs; None: that of the file.
        floor: m, height of a fixed floor that is added; None: none.

    Returns:
        The assembly, and what was assumed or left out, one sentence each.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, UNSUPPORTED, or what is wrong with which body; BAD_INPUT for masses,
            friction or a floor beside a scene file, which has its own.
    """
    path = Path(path)
    kind = format_of(path)
    if kind is not None:
        return assembled(kind.read(path), masses, friction, floor)
    if masses or friction is not None or floor is not None:
        what = f"{path} is a scene file: give masses, friction and the floor in it"
        raise InputError(ErrorCode.BAD_INPUT, what)
    return load_scene(path), ()


def write_world(assembly: Assembly, path: str | Path) -> tuple[str, ...]:
    """Write a world of the format of the path's ending; return what it cannot express, one sentence each.

    Of formats that share an ending with scene files (.yaml), a scene file is written; see `save_scene`.

    Raises:
        InputError: FILE_UNWRITABLE; UNSUPPORTED for an ending that no format writes.
    """
    path = Path(path)
    if path.suffix.lower() in _SCENE_SUFFIXES:
        save_scene(assembly, path)
        return ()
    for kind in world_formats():
        if path.suffix.lower() in kind.suffixes:
            content, lost = kind.written(assembly, path)
            write_whole(path, content)
            return lost
    endings = [suffix for kind in world_formats() for suffix in kind.suffixes if suffix not in _SCENE_SUFFIXES]
    known = ", ".join(endings)
    raise InputError(
        ErrorCode.UNSUPPORTED, f"{path}: no format has this ending; known are {known}, and .yaml for scenes"
    )


def save_scene(assembly: Assembly, path: str | Path) -> None:
    """Write a scene file, and beside it every mesh that has no file of its own.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    path = Path(path)
    objects = tuple(_with_file(item, path) for item in assembly.objects)
    write_scene(replace(assembly, objects=objects), path)


def _with_file(item: RigidObject, path: Path) -> RigidObject:
    shape = item.shape
    if not isinstance(shape, Mesh) or shape.source:
        return item
    name = stl_name(path.stem, item.id)
    write_whole(path.parent / name, stl_bytes(shape))
    return replace(item, shape=replace(shape, source=name))
