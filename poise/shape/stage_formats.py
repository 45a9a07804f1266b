"""Meshes of scene formats as arrays: glTF in one file (GLB) and USD. All meshes of a file are one, in the file's axes.

glTF is usually modelled with y upwards, USD with y or z; scenes have z upwards. Give the object's pose accordingly.
"""

import tempfile
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.shape.cloud_formats import corrupt
from poise.shape.mesh_formats import Arrays, fans
from poise.types import Array


def read_glb(content: bytes, name: str) -> Arrays:
    """The meshes of a glTF scene, m, each where its node has it."""
    import trimesh

    try:
        scene = trimesh.load_scene(BytesIO(content), file_type="glb")
        mesh = scene.to_mesh()
    except Exception as error:  # what trimesh raises depends on what is wrong
        raise corrupt(name, f"not read as GLB: {error}") from error
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def read_usd(suffix: str) -> Callable[[bytes, str], Arrays]:
    """The reader of one of the endings of USD (extra `usd`)."""

    def read(content: bytes, name: str) -> Arrays:
        try:
            from pxr import Usd
        except ImportError as error:
            what = f"{name}: USD files are read by usd-core, which is not installed: pip install 'poise[usd]'"
            raise InputError(ErrorCode.UNSUPPORTED, what) from error
        with tempfile.TemporaryDirectory() as folder:  # USD opens paths alone, and what a file names is not beside it
            path = Path(folder) / f"mesh{suffix}"
            path.write_bytes(content)
            try:
                return _joined(_meshes_of(Usd.Stage.Open(str(path)), name))
            except InputError:
                raise
            except Exception as error:  # from C++, of many kinds; their text may be no text
                raise corrupt(name, "not read as USD") from error

    return read


def _meshes_of(stage: Any, name: str) -> Iterator[Arrays]:
    """The meshes of a stage, m, in its axes."""
    from pxr import Gf, Usd, UsdGeom

    metres, cache = UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.XformCache()
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        points, counts = mesh.GetPointsAttr().Get() or [], mesh.GetFaceVertexCountsAttr().Get() or []
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
        if sum(counts) != len(corners):
            raise corrupt(name, f"{prim.GetPath()} has {len(corners)} corners, and its faces {sum(counts)}")
        matrix = np.array(Gf.Matrix4d(cache.GetLocalToWorldTransform(prim)))  # of row vectors
        placed = np.array(points, dtype=np.float64).reshape(-1, 3) @ matrix[:3, :3] + matrix[3, :3]
        triangles = fans([part.tolist() for part in np.split(corners, np.cumsum(counts)[:-1])], name)
        outside = mesh.GetOrientationAttr().Get() == "leftHanded"
        yield metres * placed, triangles[:, ::-1] if outside != (np.linalg.det(matrix[:3, :3]) < 0) else triangles


def _joined(meshes: Iterator[Arrays]) -> Arrays:
    vertices: list[Array] = [np.empty((0, 3))]
    triangles, count = [np.empty((0, 3), dtype=np.int64)], 0
    for points, corners in meshes:
        vertices.append(points)
        triangles.append(corners + count)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(triangles)


STAGE_READERS: dict[str, Callable[[bytes, str], Arrays]] = {
    ".glb": read_glb,
    **{suffix: read_usd(suffix) for suffix in (".usd", ".usda", ".usdc", ".usdz")},
}
