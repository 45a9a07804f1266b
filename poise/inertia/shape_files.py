"""Points, faces and labels from a file: STL, OBJ and PLY through trimesh, tables and PCD read here."""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.inertia.parameters import Array

MESHES, TABLES = (".stl", ".obj", ".ply"), (".xyz", ".txt", ".csv")
SUFFIXES = (*MESHES, *TABLES, ".npy", ".pcd")
LABELS = ("label", "labels", "part", "segment", "segmentation")
"""Names under which a cloud may say which part a point belongs to."""

MAX_BYTES, MAX_POINTS = 200_000_000, 2_000_000

Labels = NDArray[np.int64]


def read_shape(path: Path) -> tuple[Array, Labels, Labels | None]:
    """(P, 3) points, (F, 3) faces (none: a cloud), and the (P,) labels of a cloud, if it has any.

    Raises:
        InputError: FILE_UNREADABLE, UNSUPPORTED, FILE_CORRUPT.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(ErrorCode.UNSUPPORTED, f"{path}: the shape has to be one of {', '.join(SUFFIXES)}")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(ErrorCode.OBJECT_INVALID, f"{path}: larger than {MAX_BYTES // 1_000_000} MB; simplify it")
        points, faces, labels = _by_suffix(path, suffix)
    except InputError:
        raise
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    except Exception as error:  # loaders raise whatever a broken file provokes
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: cannot be read as a shape: {error}") from error
    if points.ndim != 2 or points.shape[1] != 3 or not 4 <= len(points) <= MAX_POINTS:
        raise InputError(
            ErrorCode.OBJECT_INVALID,
            f"{path}: points of shape {points.shape}; expected 4 to {MAX_POINTS} rows of x y z",
        )
    return points, faces, labels


def _by_suffix(path: Path, suffix: str) -> tuple[Array, Labels, Labels | None]:
    none = np.zeros((0, 3), dtype=np.int64)
    if suffix in MESHES:
        return _by_trimesh(path)
    if suffix == ".npy":
        table = np.load(path, allow_pickle=False)
    elif suffix == ".pcd":
        return _pcd(path)
    else:
        table = _table(path.read_text(errors="replace"))
    table = np.asarray(table, dtype=np.float64)
    return table[:, :3], none, None


def _by_trimesh(path: Path) -> tuple[Array, Labels, Labels | None]:
    loaded: Any = trimesh.load(path, process=False, skip_materials=True)
    if isinstance(loaded, trimesh.Scene):
        loaded = loaded.to_geometry()
    points = np.asarray(loaded.vertices, dtype=np.float64)
    faces = np.asarray(getattr(loaded, "faces", np.zeros((0, 3))), dtype=np.int64)
    columns = loaded.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
    names = getattr(getattr(columns, "dtype", None), "names", None) or (columns if isinstance(columns, dict) else ())
    for name in names:
        if str(name).lower() in LABELS and not len(faces):
            return points, faces, np.asarray(columns[name]).reshape(-1).astype(np.int64)
    return points, faces, None


def _table(text: str) -> Array:
    """Numbers in rows, apart by blanks or commas; a line that begins with anything else is a heading."""
    rows = [line.replace(",", " ").replace(";", " ").split() for line in text.splitlines()]
    return np.array(
        [[float(value) for value in row[:3]] for row in rows if row and row[0][0] not in "#/" and _number(row)]
    )


def _number(row: list[str]) -> bool:
    try:
        float(row[0])
    except ValueError:
        return False
    return True


def _pcd(path: Path) -> tuple[Array, Labels, Labels | None]:
    """Point Cloud Library's format, ascii or binary, not compressed."""
    raw = path.read_bytes()
    head: dict[str, list[str]] = {}
    place = 0
    while "DATA" not in head:
        end = raw.index(b"\n", place)
        words = raw[place:end].decode("ascii", "replace").split()
        place = end + 1
        if words:
            head[words[0]] = words[1:]
    names, count = head["FIELDS"], int(head["POINTS"][0])
    if head["DATA"] == ["ascii"]:
        table = np.array([line.split() for line in raw[place:].decode().splitlines()[:count]], dtype=np.float64)
        columns = {name: table[:, number] for number, name in enumerate(names)}
    elif head["DATA"] == ["binary"]:
        kinds = {"F": "f", "U": "u", "I": "i"}
        counts = head.get("COUNT", ["1"] * len(names))
        layout = [
            (name if name != "_" else f"_{number}", f"<{kinds[kind]}{size}", (int(many),))
            for number, (name, kind, size, many) in enumerate(
                zip(names, head["TYPE"], head["SIZE"], counts, strict=True)
            )
        ]
        data = np.frombuffer(raw, dtype=np.dtype(layout), count=count, offset=place)
        columns = {name: data[name][:, 0].astype(np.float64) for name in names if name != "_"}
    else:
        raise InputError(ErrorCode.UNSUPPORTED, f"{path}: PCD data {head['DATA']}: save it as ascii or binary")
    labels = next((columns[name].astype(np.int64) for name in columns if name.lower() in LABELS), None)
    points = np.stack([columns[name] for name in "xyz"], axis=1)
    return points, np.zeros((0, 3), dtype=np.int64), labels
