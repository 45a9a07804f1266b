"""The door for mesh files of a scene: STL, OBJ or PLY by path or package:// URI, checked before use."""

import os
from pathlib import Path

import numpy as np

from poise.assembly.shapes import Mesh
from poise.errors import ErrorCode, InputError

MAX_BYTES = 100_000_000
MAX_TRIANGLES = 2_000_000
FORMATS = {".stl", ".obj", ".ply"}


def load_mesh(source: str, folder: Path = Path(), scale: float = 1.0) -> Mesh:
    """Read a closed mesh, in m after scaling.

    Args:
        source: a path (relative ones are inside `folder`) or package://NAME/path.
        folder: of the scene file.
        scale: factor from the file's unit to m (0.001 for mm).

    Raises:
        InputError: FILE_UNREADABLE, UNSUPPORTED, MESH_INVALID or NOT_FINITE, naming the file.
    """
    if not np.isfinite(scale) or scale <= 0:
        raise InputError(ErrorCode.BAD_INPUT, f"{source}: scale {scale:g} is not a positive number")
    import trimesh  # a second of start-up for every node and command that reads no mesh

    path = _path(source, folder)
    if path.suffix.lower() not in FORMATS:
        raise InputError(ErrorCode.UNSUPPORTED, f"{source}: expected an STL, OBJ or PLY file")
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(ErrorCode.MESH_INVALID, f"{path}: larger than {MAX_BYTES // 1_000_000} MB; simplify it")
        loaded = trimesh.load_mesh(path, process=False, skip_materials=True)
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    except InputError:
        raise
    except Exception as error:  # trimesh's loaders raise whatever a broken file provokes
        raise InputError(ErrorCode.MESH_INVALID, f"{path}: cannot be read as a mesh: {error}") from error
    vertices, triangles = np.array(loaded.vertices, dtype=np.float64), np.array(loaded.faces, dtype=np.int64)
    if not 4 <= len(triangles) <= MAX_TRIANGLES:
        raise InputError(ErrorCode.MESH_INVALID, f"{path}: {len(triangles)} triangles, expected 4 to {MAX_TRIANGLES}")
    if not np.all(np.isfinite(vertices)):
        raise InputError(ErrorCode.NOT_FINITE, f"{path}: a vertex is not finite")
    return Mesh(vertices * scale, triangles, source=source, scale=scale)


def _path(source: str, folder: Path) -> Path:
    scheme, separator, rest = source.partition("://")
    if not separator:
        return folder / source
    if scheme != "package":
        raise InputError(ErrorCode.UNSUPPORTED, f"{source}: {scheme}:// is not read; give a path or a package:// URI")
    package, _, inside = rest.partition("/")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        share = (Path(prefix) / "share" / package).resolve()
        if prefix and package and share.is_dir():
            path = (share / inside).resolve()
            if not path.is_relative_to(share):
                raise InputError(ErrorCode.UNSUPPORTED, f"{source}: leaves the package's share folder")
            return path
    raise InputError(ErrorCode.FILE_UNREADABLE, f"{source}: no package {package} on AMENT_PREFIX_PATH")
