"""The one door for meshes, from files, package:// URIs, bytes or messages: closed, outward and finite, or refused."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.shape.mesh_formats import MAX_TRIANGLES
from poise.shape.mesh_repair import repair
from poise.shape.mesh_worker import MeshWorker
from poise.shape.solid import Array, Indices

MAX_BYTES = 100_000_000
FORMATS = (".stl", ".obj", ".ply")
_worker = MeshWorker()


@dataclass(frozen=True, eq=False)
class CheckedMesh:
    """A closed surface.

    Args:
        vertices: (V, 3) m, none twice.
        triangles: (T, 3) vertex numbers, counter-clockwise from outside.
        notes: what was mended, one sentence each.
    """

    vertices: Array
    triangles: Indices
    notes: tuple[str, ...] = ()


def read_mesh(source: str | Path, folder: Path = Path(), scale: float = 1.0) -> CheckedMesh:
    """Read an STL, OBJ or PLY file.

    Args:
        source: a path or package://NAME/path. A relative path may not leave `folder`.
        folder: of the file that names the source.
        scale: from the file's unit to m (0.001 for mm).

    Raises:
        InputError: FILE_UNREADABLE, UNSUPPORTED for other formats and URIs, and what `parse_mesh` raises.
    """
    path = resolve(str(source), folder)
    if path.suffix.lower() not in FORMATS:
        raise InputError(ErrorCode.UNSUPPORTED, f"{source}: expected a mesh in {', '.join(FORMATS)}")
    try:
        if not path.is_file():
            raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: no such file; give a mesh in {', '.join(FORMATS)}")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(ErrorCode.MESH_INVALID, f"{path}: larger than {MAX_BYTES // 1_000_000} MB; simplify it")
        content = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{source}: {getattr(error, 'strerror', None) or error}") from error
    return parse_mesh(content, path.suffix, str(source), scale)


def parse_mesh(content: bytes, suffix: str, name: str = "mesh", scale: float = 1.0) -> CheckedMesh:
    """Read a mesh that is in memory; it is parsed in another process, with limits on its memory and time.

    Args:
        content: of a file.
        suffix: the file's ending, `.stl`, `.obj` or `.ply`.

    Raises:
        InputError: UNSUPPORTED for other formats, FILE_CORRUPT, and what `check_mesh` raises.
    """
    if suffix.lower() not in FORMATS:
        raise InputError(ErrorCode.UNSUPPORTED, f"{name}: expected a mesh in {', '.join(FORMATS)}")
    if len(content) > MAX_BYTES:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: larger than {MAX_BYTES // 1_000_000} MB; simplify it")
    return check_mesh(*_worker.parse(content, suffix.lower(), name), scale, name)


def check_mesh(vertices: ArrayLike, triangles: ArrayLike, scale: float = 1.0, name: str = "mesh") -> CheckedMesh:
    """Check and mend the surface of one object (see `mesh_repair.repair`).

    Args:
        vertices: (V, 3).
        triangles: (T, 3) vertex numbers.
        scale: from the unit of the vertices to m.

    Raises:
        InputError: BAD_INPUT for a scale that is no positive number, NOT_FINITE, and MESH_INVALID for what is no
            closed surface around a volume and cannot be made one.
    """
    if not np.isfinite(scale) or scale <= 0:
        raise InputError(ErrorCode.BAD_INPUT, f"{name}: scale {scale:g} is not a positive number")
    points, corners = np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64)
    if points.ndim != 2 or corners.ndim != 2 or points.shape[1] != 3 or corners.shape[1] != 3:
        message = f"{name}: shapes {points.shape} and {corners.shape}, expected (V, 3) vertices and (T, 3) triangles"
        raise InputError(ErrorCode.MESH_INVALID, message)
    if not 4 <= len(corners) <= MAX_TRIANGLES:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: {len(corners)} triangles, expected 4 to {MAX_TRIANGLES}")
    if corners.min() < 0 or corners.max() >= len(points):
        wrong = int(np.flatnonzero(np.any((corners < 0) | (corners >= len(points)), axis=1))[0])
        message = f"{name}: triangle {wrong} names a vertex that does not exist; there are {len(points)}"
        raise InputError(ErrorCode.MESH_INVALID, message)
    with np.errstate(over="ignore"):
        points = points * scale
    if not np.all(np.isfinite(points)):
        wrong = int(np.flatnonzero(~np.all(np.isfinite(points), axis=1))[0])
        raise InputError(ErrorCode.NOT_FINITE, f"{name}: vertex {wrong} is not finite; mend the mesh", vertex=wrong)
    return CheckedMesh(*repair(points, corners, name))


def resolve(source: str, folder: Path = Path()) -> Path:
    """The path that a source names.

    Raises:
        InputError: UNSUPPORTED for other schemes than package:// and for paths that leave their folder,
            FILE_UNREADABLE for a package that is not installed.
    """
    scheme, separator, rest = source.partition("://")
    if not separator:
        path = folder / source
        if not Path(source).is_absolute() and not _is_inside(path, folder):
            raise InputError(ErrorCode.UNSUPPORTED, f"{source}: leaves the folder {folder}; copy the mesh into it")
        return path
    if scheme != "package":
        raise InputError(ErrorCode.UNSUPPORTED, f"{source}: {scheme}:// is not read; give a path or a package:// URI")
    package, _, inside = rest.partition("/")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        shares = Path(prefix) / "share"
        if prefix and package and _is_inside(shares / package, shares) and (shares / package).is_dir():
            path = shares / package / inside
            if not _is_inside(path, shares / package):
                raise InputError(ErrorCode.UNSUPPORTED, f"{source}: leaves the package's share folder")
            return path
    raise InputError(ErrorCode.FILE_UNREADABLE, f"{source}: no package {package!r} on AMENT_PREFIX_PATH")


def _is_inside(path: Path, folder: Path) -> bool:
    """Whether a path stays below a folder by its words; links are the owner's business (colcon makes many)."""
    return Path(os.path.normpath(path.absolute())).is_relative_to(os.path.normpath(folder.absolute()))
