"""A closed mesh as the cloud of points on its surface, so that it is cut into parts as a scan is."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.shape.clouds import Cloud, check_cloud, read_cloud
from poise.shape.meshes import MESH_FORMATS, CheckedMesh, read_mesh
from poise.types import Array

_POINTS = 6000


def read_surface(path: Path, scale: float = 1.0) -> tuple[Cloud, CheckedMesh | None]:
    """A cloud, or points on a mesh and the mesh itself: STL, OBJ, and PLY with faces.

    Args:
        path: of the file; its ending says what it is.
        scale: from the file's unit to m.

    Raises:
        InputError: as `read_mesh` and `read_cloud`. The vertices of a PLY file whose surface is not closed are a cloud.
    """
    suffix = path.suffix.lower()
    if suffix not in MESH_FORMATS:
        return read_cloud(path, scale), None
    try:
        mesh = read_mesh(path.absolute(), scale=scale)
    except InputError as error:
        if suffix != ".ply" or error.code not in (ErrorCode.MESH_INVALID, ErrorCode.UNSUPPORTED):
            raise
        return read_cloud(path, scale), None
    points, normals = points_on(mesh)
    return replace(check_cloud(points, None, 1.0, str(path), mesh.notes), normals=normals), mesh


def points_on(mesh: CheckedMesh, count: int = _POINTS) -> tuple[Array, Array]:
    """(count, 3) m on a mesh, as many per area everywhere, and the outward unit normals there."""
    rng = np.random.default_rng(0)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    doubled = np.linalg.norm(across, axis=1)
    edges = np.cumsum(doubled)
    # One point in each of equal shares of the area: more even than points drawn at random.
    chosen = np.searchsorted(edges, (np.arange(count) + rng.random(count)) / count * edges[-1]).clip(0, len(edges) - 1)
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
    return points, across[chosen] / np.maximum(doubled[chosen], 1e-30)[:, None]
