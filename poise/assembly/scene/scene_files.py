"""Scene files: YAML in, an `Assembly` out, and back."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from poise.assembly.scene.mesh_files import load_mesh
from poise.assembly.scene.scene import ROLLING, Assembly, FrictionPair, RigidObject, check_density
from poise.assembly.scene.shapes import Box, Cylinder, Mesh, Shape, Sphere
from poise.errors import ErrorCode, InputError
from poise.files import write_whole, yaml_documents
from poise.geometry import STANDARD_GRAVITY, Pose
from poise.ranges import check_range
from poise.types import Array

_MAX_BYTES = 16_000_000
_UPPER = np.triu_indices(3)

_TEXT_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+|[-+]\.\d+")
"""Numbers that YAML 1.1 takes for text: 1e-6, -.05, -.5e-3."""

_SCENE_KEYS = {
    "gravity",
    "friction",
    "friction_deviation",
    "rolling",
    "objects",
    "friction_pairs",
    "pose_std",
    "mass_std",
}
_SHAPE_KEYS = {"box", "cylinder", "sphere", "mesh", "scale"}
_OBJECT_KEYS = _SHAPE_KEYS | {
    "id",
    "fixed",
    "pose",
    "mass",
    "com",
    "inertia",
    "covariance",
    "pose_std",
    "pose_covariance",
}
_STD_KEYS = {"position", "rotation_deg"}
_PAIR_KEYS = {"objects", "coefficient", "deviation", "rolling"}


def load_scene(path: str | Path) -> Assembly:
    """Read a scene file (its format is in docs/robustness.md). Meshes are looked for beside it.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, or what is wrong with which entry.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(
                ErrorCode.FILE_CORRUPT, f"{path}: larger than {_MAX_BYTES // 1_000_000} MB; is it a scene?"
            )
        content = _only(yaml_documents(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: not YAML: {reason}") from error
    return read_scene(content, folder=path.parent)


def _only(documents: Iterator[Any]) -> Any:
    """The one document of a file; None for an empty one."""
    content = next(documents, None)
    if next(documents, None) is not None:
        raise yaml.YAMLError("it has several documents (---); a scene is one")
    return content


def read_scene(content: Any, folder: Path = Path()) -> Assembly:
    """Turn the parsed content of a scene file into an assembly; meshes are relative to the folder."""
    scene = _mapping(content, "scene", _SCENE_KEYS)
    objects = _list(scene.get("objects"), "objects")
    pairs = _list(scene.get("friction_pairs", []), "friction_pairs")
    friction = scene.get("friction", 0.5)
    items = tuple(read_object(entry, folder, f"objects[{i}]") for i, entry in enumerate(objects))
    if "pose_std" in scene:
        items = with_pose_covariance(items, _pose_std(scene["pose_std"], "pose_std"))
    if "mass_std" in scene:
        items = with_mass_std(items, _number(scene["mass_std"], "mass_std"))
    return Assembly(
        objects=items,
        gravity=_numbers(scene.get("gravity", [0, 0, -STANDARD_GRAVITY]), 3, "gravity"),
        friction=None if friction is None else _number(friction, "friction"),
        rolling=_number(scene.get("rolling", ROLLING), "rolling"),
        friction_pairs=tuple(_pair(entry, f"friction_pairs[{i}]") for i, entry in enumerate(pairs)),
        friction_deviation=_number(scene.get("friction_deviation", 0.0), "friction_deviation"),
    )


def read_object(content: Any, folder: Path = Path(), where: str = "object") -> RigidObject:
    """Turn one entry of `objects` into a rigid object. Without a pose it lies at the origin.

    In place of a file name, `mesh` may be a `Mesh`: messages carry them in full.
    """
    entry = _mapping(content, where, _OBJECT_KEYS)
    name = entry.get("id")
    if not isinstance(name, str) or not name:
        raise InputError(ErrorCode.OBJECT_INVALID, f"{where}: id {name!r} is not a name")
    where = f"object {name}"
    fixed = entry.get("fixed", False)
    if not isinstance(fixed, bool):
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: fixed is {fixed!r}, expected true or false")
    if not fixed and "mass" not in entry:
        raise InputError(ErrorCode.OBJECT_INVALID, f"{where}: has no mass; give it, or mark the object as fixed")
    inertia = None
    if "inertia" in entry:
        inertia = np.empty((3, 3))
        inertia[_UPPER] = _numbers(entry["inertia"], 6, f"{where}: inertia")
        inertia.T[_UPPER] = inertia[_UPPER]
    covariance = entry.get("covariance")
    item = RigidObject(
        id=name,
        shape=_shape(entry, folder, where),
        pose=_pose(entry.get("pose", [0, 0, 0, 0, 0, 0, 1]), where),
        fixed=fixed,
        mass=_number(entry.get("mass", 0.0), f"{where}: mass"),
        com=_numbers(entry["com"], 3, f"{where}: com") if "com" in entry else None,
        inertia=inertia,
        covariance=None if covariance is None else _square(covariance, 10, f"{where}: covariance"),
        pose_covariance=_pose_covariance(entry, where),
    )
    check_density(item)
    return item


def with_pose_covariance(items: Iterable[RigidObject], covariance: Array) -> tuple[RigidObject, ...]:
    """Objects whose poses are uncertain by a (6, 6) covariance, unless they are fixed or have one of their own."""
    return tuple(
        item if item.fixed or item.pose_covariance is not None else replace(item, pose_covariance=covariance)
        for item in items
    )


def with_mass_std(items: Iterable[RigidObject], share: float) -> tuple[RigidObject, ...]:
    """Objects whose masses are known to a share of them, one sigma, unless they are fixed or have a covariance.

    How a mass is spread in its object is taken as known.

    Raises:
        InputError: BAD_INPUT for a share below 0 or above 1, NOT_FINITE.
    """
    check_range("mass_std", share)
    if share == 0:
        return tuple(items)
    return tuple(
        item if item.fixed or item.covariance is not None else replace(item, covariance=_of_mass(item, share))
        for item in items
    )


def _of_mass(item: RigidObject, share: float) -> Array:
    """(10, 10) covariance of (m, m c, I about the object frame's origin) where only the mass is not known."""
    com = item.pose.undo(item.com_in_world)
    about_com = item.pose.rotation.T @ item.inertia_in_world @ item.pose.rotation
    about_origin = about_com + item.mass * (com @ com * np.eye(3) - np.outer(com, com))
    moments = np.concatenate([[item.mass], item.mass * com, about_origin[_UPPER]])
    return np.outer(share * moments, share * moments)


def pose_covariance_of(position: float, rotation: float) -> Array:
    """(6, 6) of independent errors of a pose: of each coordinate, m, and about each axis, rad, one sigma each."""
    return np.diag(np.repeat([position, rotation], 3) ** 2.0)


def write_scene(assembly: Assembly, path: str | Path) -> None:
    """Write a scene file that `load_scene` reads back; whole or not at all.

    Raises:
        InputError: FILE_UNWRITABLE; UNSUPPORTED for a mesh that has no file.
    """
    text = yaml.safe_dump(scene_content(assembly), sort_keys=False, default_flow_style=None)
    write_whole(Path(path), text.encode())


def scene_content(assembly: Assembly) -> dict[str, Any]:
    """The content of a scene file, as plain lists and numbers."""
    content: dict[str, Any] = {
        "gravity": np.asarray(assembly.gravity).tolist(),
        "friction": None if assembly.friction is None else float(assembly.friction),
        "objects": [_object_content(item) for item in assembly.objects],
    }
    if assembly.rolling != ROLLING:
        content["rolling"] = float(assembly.rolling)
    if assembly.friction_deviation:
        content["friction_deviation"] = float(assembly.friction_deviation)
    if assembly.friction_pairs:
        content["friction_pairs"] = [
            {"objects": list(p.objects), "coefficient": float(p.coefficient)}
            | ({"deviation": float(p.deviation)} if p.deviation else {})
            | ({} if p.rolling is None else {"rolling": float(p.rolling)})
            for p in assembly.friction_pairs
        ]
    return content


def _object_content(item: RigidObject) -> dict[str, Any]:
    content: dict[str, Any] = {"id": item.id}
    if item.fixed:
        content["fixed"] = True
    shape = item.shape
    if isinstance(shape, Box):
        content["box"] = [float(value) for value in shape.size]
    elif isinstance(shape, Cylinder):
        content["cylinder"] = [float(shape.radius), float(shape.length)]
    elif isinstance(shape, Sphere):
        content["sphere"] = float(shape.radius)
    elif isinstance(shape, Mesh) and shape.source:
        content |= {"mesh": shape.source, "scale": float(shape.scale)}
    else:
        raise InputError(
            ErrorCode.UNSUPPORTED, f"object {item.id}: its mesh has no file, so a scene file cannot name it"
        )
    content["pose"] = item.pose.vector.tolist()
    if not item.fixed:
        content["mass"] = float(item.mass)
    if item.com is not None:
        content["com"] = np.asarray(item.com).tolist()
    if item.inertia is not None:
        content["inertia"] = np.asarray(item.inertia)[_UPPER].tolist()
    if item.covariance is not None:
        content["covariance"] = np.ravel(item.covariance).tolist()
    if item.pose_covariance is not None:
        content["pose_covariance"] = np.ravel(item.pose_covariance).tolist()
    return content


def _shape(entry: Mapping[str, Any], folder: Path, where: str) -> Shape:
    kinds = [kind for kind in ("box", "cylinder", "sphere", "mesh") if kind in entry]
    if len(kinds) != 1:
        found = " and ".join(kinds) or "none"
        raise InputError(
            ErrorCode.OBJECT_INVALID, f"{where}: give one of box, cylinder, sphere or mesh (found {found})"
        )
    if kinds[0] == "mesh":
        if isinstance(entry["mesh"], Mesh):
            return entry["mesh"]
        if not isinstance(entry["mesh"], str):
            raise InputError(ErrorCode.BAD_INPUT, f"{where}: mesh is {entry['mesh']!r}, expected a file name")
        return load_mesh(entry["mesh"], folder, _number(entry.get("scale", 1.0), f"{where}: scale"))
    if kinds[0] == "sphere":
        radius = entry["sphere"]
        # A list of one number, as boxes and cylinders have lists, is the radius, too.
        given = radius if isinstance(radius, list) else [radius]
        return Sphere(float(_numbers(given, 1, f"{where}: sphere")[0]))
    sizes = _numbers(entry[kinds[0]], 3 if kinds[0] == "box" else 2, f"{where}: {kinds[0]}")
    return Box(tuple(sizes.tolist())) if kinds[0] == "box" else Cylinder(*sizes.tolist())


def _pose(value: Any, where: str) -> Pose:
    numbers = _numbers(value, 7, f"{where}: pose")
    length = float(np.linalg.norm(numbers[3:]))
    if abs(length - 1) > 1e-3:
        raise InputError(
            ErrorCode.BAD_INPUT, f"{where}: the quaternion of its pose (x y z w) has length {length:.4g}, expected 1"
        )
    return Pose.from_vector(numbers)


def _pose_covariance(entry: Mapping[str, Any], where: str) -> Array | None:
    """(6, 6) of an object's `pose_std` or `pose_covariance`; None when it has neither."""
    if "pose_std" in entry and "pose_covariance" in entry:
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: give pose_std or pose_covariance, not both")
    if "pose_std" in entry:
        return _pose_std(entry["pose_std"], f"{where}: pose_std")
    if "pose_covariance" in entry:
        return _square(entry["pose_covariance"], 6, f"{where}: pose_covariance")
    return None


def _pose_std(content: Any, where: str) -> Array:
    entry = _mapping(content, where, _STD_KEYS)
    position, degrees = (_number(entry.get(key, 0.0), f"{where}: {key}") for key in ("position", "rotation_deg"))
    check_range("position of pose_std", position, f"{where}: ")
    check_range("rotation_deg of pose_std", degrees, f"{where}: ")
    return pose_covariance_of(position, np.radians(degrees))


def _pair(content: Any, where: str) -> FrictionPair:
    entry = _mapping(content, where, _PAIR_KEYS)
    names = entry.get("objects")
    if not isinstance(names, Sequence) or len(names) != 2 or not all(isinstance(name, str) for name in names):
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: objects is {names!r}, expected two ids")
    return FrictionPair(
        (names[0], names[1]),
        _number(entry.get("coefficient"), f"{where}: coefficient"),
        _number(entry.get("deviation", 0.0), f"{where}: deviation"),
        _number(entry["rolling"], f"{where}: rolling") if "rolling" in entry else None,
    )


def _mapping(value: Any, where: str, keys: set[str]) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: expected named entries, found {type(value).__name__}")
    strange = [str(key) for key in value if key not in keys]
    if strange:
        raise InputError(
            ErrorCode.BAD_INPUT, f"{where}: unknown entry {strange[0]}; known are {', '.join(sorted(keys))}"
        )
    return value


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: expected a list, found {type(value).__name__}")
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, str) and _TEXT_NUMBER.fullmatch(value):
        return float(value)
    # bool is an int in Python, never a quantity here.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: expected a number, found {value!r}")
    return float(value)


def _numbers(value: Any, count: int, where: str) -> Array:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != count:
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: expected {count} numbers, found {value!r:.80}")
    numbers = np.array([_number(entry, where) for entry in value])
    if not np.all(np.isfinite(numbers)):
        raise InputError(ErrorCode.NOT_FINITE, f"{where}: {value} has an entry that is not finite")
    return numbers


def _square(value: Any, size: int, where: str) -> Array:
    """(n, n) from n rows, or from all numbers in one list."""
    rows = isinstance(value, list) and len(value) == size and all(isinstance(row, list) for row in value)
    if rows:
        return np.array([_numbers(row, size, f"{where}, row {i}") for i, row in enumerate(value)])
    return _numbers(value, size * size, where).reshape(size, size)
