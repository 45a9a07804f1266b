"""The one door for meshes, from files, package:// URIs, bytes or messages: closed, outward and finite, or refused."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.files import is_inside, package_file
from poise.shape.mesh_formats import MAX_TRIANGLES
from poise.shape.mesh_repair import repair
from poise.shape.mesh_worker import MeshWorker
from poise.types import Array, Indices

_MAX_BYTES = 100_000_000
MESH_FORMATS = (".stl", ".obj", ".ply", ".glb", ".usd", ".usda", ".usdc", ".usdz")
_worker = MeshWorker()


@dataclass(frozen=True, eq=False)
class CheckedMesh:
    """A closed surface.

    Args:
        vertices: (V, 3) m, none twice.
        triangles: (T, 3) vertex numbers, counter-clockwise from outside.
        notes: repairs, one sentence each.
    """

    vertices: Array
    triangles: Indices
    notes: tuple[str, ...] = ()

    @property
    def volume(self) -> float:
        """m3."""
        return float(np.linalg.det(self.vertices[self.triangles]).sum() / 6)


def read_mesh(source: str | Path, folder: Path = Path(), scale: float = 1.0) -> CheckedMesh:
    """Read an STL, OBJ, PLY, GLB or USD file.

    Args:
        source: a path or package://NAME/path. A relative path may not leave `folder`.
        folder: of the file that names the source.
        scale: from the file's unit to m (0.001 for mm).

    Raises:
        InputError: FILE_UNREADABLE, UNSUPPORTED for other formats and URIs, and what `parse_mesh` raises.
    """
    content, suffix = _content(str(source), folder)
    return parse_mesh(content, suffix, str(source), scale)


def read_triangles(source: str | Path, folder: Path = Path(), scale: float = 1.0) -> tuple[Array, Indices]:
    """A file's vertices (V, 3) m and triangles (T, 3) as they are: not repaired, shells kept apart.

    Args:
        source, folder, scale: as for `read_mesh`.

    Raises:
        InputError: what `read_mesh` raises, except for surfaces that are not closed; there may be no triangle at all.
    """
    content, suffix = _content(str(source), folder)
    return _checked(*_worker.parse(content, suffix, str(source)), scale, str(source))


def parse_mesh(content: bytes, suffix: str, name: str = "mesh", scale: float = 1.0) -> CheckedMesh:
    """Read a mesh that is in memory; it is parsed in another process, with limits on its memory and time.

    Args:
        content: of a file.
        suffix: the file's ending, one of `MESH_FORMATS`.

    Raises:
        InputError: UNSUPPORTED for other formats, FILE_CORRUPT, and what `check_mesh` raises.
    """
    if suffix.lower() not in MESH_FORMATS:
        raise InputError(ErrorCode.UNSUPPORTED, f"{name}: expected a mesh in {', '.join(MESH_FORMATS)}")
    if len(content) > _MAX_BYTES:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: larger than {_MAX_BYTES // 1_000_000} MB; simplify it")
    return check_mesh(*_worker.parse(content, suffix.lower(), name), scale, name)


def _content(source: str, folder: Path) -> tuple[bytes, str]:
    """What a file holds, and its ending."""
    path = resolve(source, folder)
    if path.suffix.lower() not in MESH_FORMATS:
        raise InputError(ErrorCode.UNSUPPORTED, f"{source}: expected a mesh in {', '.join(MESH_FORMATS)}")
    try:
        if not path.is_file():
            raise InputError(
                ErrorCode.FILE_UNREADABLE, f"{path}: no such file; give a mesh in {', '.join(MESH_FORMATS)}"
            )
        size = path.stat().st_size
        if size > _MAX_BYTES:
            raise InputError(ErrorCode.MESH_INVALID, f"{path}: larger than {_MAX_BYTES // 1_000_000} MB; simplify it")
        return path.read_bytes(), path.suffix.lower()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{source}: {getattr(error, 'strerror', None) or error}") from error


def check_mesh(vertices: ArrayLike, triangles: ArrayLike, scale: float = 1.0, name: str = "mesh") -> CheckedMesh:
    """Check and repair the surface of one object (see `mesh_repair.repair`).

    Args:
        vertices: (V, 3).
        triangles: (T, 3) vertex numbers.
        scale: from the unit of the vertices to m.

    Raises:
        InputError: BAD_INPUT for a scale that is not a positive number, NOT_FINITE, and MESH_INVALID for what is no
            closed surface around a volume and cannot be made one.
    """
    points, corners = _checked(vertices, triangles, scale, name)
    if len(corners) < 4:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: {len(corners)} triangles, expected 4 to {MAX_TRIANGLES}")
    return CheckedMesh(*repair(points, corners, name))


def _checked(vertices: ArrayLike, triangles: ArrayLike, scale: float, name: str) -> tuple[Array, Indices]:
    """Vertices in m, all finite, and triangles whose vertices exist."""
    if not np.isfinite(scale) or scale <= 0:
        raise InputError(ErrorCode.BAD_INPUT, f"{name}: scale {scale:g} is not a positive number")
    points, corners = np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64)
    if points.ndim != 2 or corners.ndim != 2 or points.shape[1] != 3 or corners.shape[1] != 3:
        message = f"{name}: shapes {points.shape} and {corners.shape}, expected (V, 3) vertices and (T, 3) triangles"
        raise InputError(ErrorCode.MESH_INVALID, message)
    if len(corners) > MAX_TRIANGLES:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: {len(corners)} triangles, expected 4 to {MAX_TRIANGLES}")
    wrong = np.flatnonzero(np.any((corners < 0) | (corners >= len(points)), axis=1))
    if len(wrong):
        message = f"{name}: triangle {wrong[0]} names a vertex that does not exist; there are {len(points)}"
        raise InputError(ErrorCode.MESH_INVALID, message)
    with np.errstate(over="ignore"):
        points = points * scale
    wrong = np.flatnonzero(~np.all(np.isfinite(points), axis=1))
    if len(wrong):
        message = f"{name}: vertex {wrong[0]} is not finite; fix the mesh"
        raise InputError(ErrorCode.NOT_FINITE, message, vertex=int(wrong[0]))
    return points, corners


def resolve(source: str, folder: Path = Path()) -> Path:
    """The path that a source names.

    Raises:
        InputError: UNSUPPORTED for other schemes than package:// and for paths that leave their folder,
            FILE_UNREADABLE for a package that is not installed.
    """
    scheme, separator, _ = source.partition("://")
    if not separator:
        path = folder / source
        if not Path(source).is_absolute() and not is_inside(path, folder):
            raise InputError(ErrorCode.UNSUPPORTED, f"{source}: leaves the folder {folder}; copy the mesh into it")
        return path
    if scheme != "package":
        raise InputError(ErrorCode.UNSUPPORTED, f"{source}: {scheme}:// is not read; give a path or a package:// URI")
    return package_file(source)
