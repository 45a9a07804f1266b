"""Meshes that worlds name: by path, package://, model:// and file://."""

import os
from pathlib import Path

import numpy as np

from poise.assembly import Mesh
from poise.errors import ErrorCode, InputError
from poise.files import package_file
from poise.shape import check_mesh, read_triangles
from poise.types import Array

_SEARCHED = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH")


def found_file(uri: str, folder: Path) -> Path:
    """The path that a URI names: in Gazebo's paths, the file's folder or the one above it for model://NAME/path.

    Raises:
        InputError: FILE_UNREADABLE when it is not found, with the places; UNSUPPORTED for other schemes.
    """
    scheme, separator, rest = uri.partition("://")
    if not separator:
        return folder / uri
    if scheme == "file":
        return Path(rest) if rest.startswith("/") else folder / rest
    if scheme == "package":
        return package_file(uri)
    if scheme != "model":
        what = f"{uri}: is not read from {scheme}://; download it and name the file"
        raise InputError(ErrorCode.UNSUPPORTED, what)
    listed = [place for name in _SEARCHED for place in os.environ.get(name, "").split(os.pathsep) if place]
    places = [folder, folder.parent, *map(Path, listed)]
    for place in places:
        if (place / rest).exists():
            return place / rest
    where = ", ".join(map(str, places))
    raise InputError(ErrorCode.FILE_UNREADABLE, f"{uri}: not in {where}; add its folder to {_SEARCHED[0]}")


def scaled_mesh(uri: str, folder: Path, scale: Array) -> Mesh:
    """A mesh file as a shape, with a factor for each axis.

    Raises:
        InputError: as `found_file` and `poise.shape.read_mesh`.
    """
    vertices, triangles = read_triangles(str(found_file(uri, folder).absolute()))
    if np.prod(scale) < 0:
        triangles = triangles[:, ::-1]
    checked = check_mesh(vertices * scale, triangles, name=uri)
    return Mesh(checked.vertices, checked.triangles, notes=checked.notes)
