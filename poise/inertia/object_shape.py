"""The door for the shape of a held object: a mesh or a cloud of points in, its parts in the sensor frame out."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import QhullError, cKDTree
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.inertia.parameters import Array
from poise.inertia.parts import Parts, cells_of, surface_moments
from poise.inertia.pmd import spread
from poise.shape.clouds import read_cloud
from poise.shape.segmentation import segment

MESHES = (".stl", ".obj")
"""Are always surfaces; a PLY file may be a cloud."""

MAX_BYTES = 200_000_000

SAMPLED = 6000
"""Points on a surface that is not closed."""

LARGEST, SMALLEST = 3.0, 1e-3
"""m, of what a robot holds."""

PIECES = 8
"""That a shape of one piece is cut into, because nobody knows whether it is of one material."""

CELLS = 4000

MOST_BODIES = 100

LOOSE_FACES = 0.05
"""Share of faces outside of closed surfaces from which on the surface counts as open."""

MESH_ACCURACY, UNCUT_ACCURACY, CLOUD_ACCURACY = 0.0007, 0.03, 0.05
"""Relative errors of lengths: a mesh whose bodies are its parts; one that was cut here; a cloud."""


@dataclass(frozen=True, eq=False)
class ObjectShape:
    """What is known of an object's shape.

    Args:
        parts: of it, in the frame asked for.
        accuracy: relative error of lengths, and of where the parts are cut.
        words: how it came about, for people.
    """

    parts: Parts
    accuracy: float
    words: str

    def placed(self, position: ArrayLike, quaternion: ArrayLike) -> "ObjectShape":
        """The same seen from a frame in which the object's own is at a position (3,) m, turned by (4,) x y z w.

        Raises:
            InputError: BAD_INPUT when that is no pose.
        """
        turn, place = np.asarray(quaternion, dtype=np.float64), np.asarray(position, dtype=np.float64)
        finite = np.isfinite(np.concatenate([turn, place])).all()
        if not finite or abs(np.linalg.norm(turn) - 1) > 1e-2:
            raise InputError(
                ErrorCode.BAD_INPUT, f"object pose {[*place, *turn]}: give x y z in m and a unit quaternion x y z w"
            )
        return replace(self, parts=self.parts.in_frame(Rotation.from_quat(turn).as_matrix(), place))


def load_object(path: Path, scale: float = 1.0) -> ObjectShape:
    """Read a mesh (STL, OBJ, PLY) or a cloud (PLY, XYZ, CSV, NPY, PCD), in m after scaling, in the file's own frame.

    Bodies of a mesh are taken for parts, and a cloud is segmented. What has one part is cut into `PIECES`.

    Raises:
        InputError: FILE_UNREADABLE, UNSUPPORTED, FILE_CORRUPT, NOT_FINITE, OBJECT_INVALID (flat, or not of the size of
            something held), or as `read_cloud`; naming the file and the mend.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(ErrorCode.BAD_INPUT, f"object scale {scale}: it must be positive")
    mesh = _read_mesh(path) if path.suffix.lower() in (*MESHES, ".ply") else None
    try:
        if mesh is None:
            cloud = read_cloud(path, scale)
            return _of_cloud(cloud.points, cloud.colours)
        mesh.vertices = mesh.vertices * scale
        _check_size(path, mesh)
        return _of_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    except (QhullError, np.linalg.LinAlgError) as error:
        raise InputError(
            ErrorCode.OBJECT_INVALID, f"{path}: its points lie in a plane or on a line; give a solid shape"
        ) from error


def _read_mesh(path: Path) -> trimesh.Trimesh | None:
    """The surface in a file; None for a PLY file without faces."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(ErrorCode.OBJECT_INVALID, f"{path}: larger than {MAX_BYTES // 1_000_000} MB; simplify it")
        loaded = trimesh.load(path, process=False, skip_materials=True)
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_geometry()
    except InputError:
        raise
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    except Exception as error:  # loaders raise whatever a broken file provokes
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: cannot be read as a shape: {error}") from error
    if not isinstance(loaded, trimesh.Trimesh) or not len(loaded.faces):
        if path.suffix.lower() == ".ply":
            return None
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: holds no triangles")
    return loaded


def _check_size(path: Path, mesh: trimesh.Trimesh) -> None:
    if not np.isfinite(mesh.vertices).all():
        raise InputError(ErrorCode.NOT_FINITE, f"{path}: a vertex is not finite; clean the mesh")
    size = float(np.ptp(mesh.vertices, axis=0).max())
    if not SMALLEST < size < LARGEST:
        raise InputError(
            ErrorCode.OBJECT_INVALID,
            f"{path}: the object is {size:.3g} m long, which no hand holds; if the file is in millimetres,"
            " give --object-scale 0.001",
            size=size,
        )


def _of_mesh(vertices: Array, faces: NDArray[np.int64]) -> ObjectShape:
    for merge in (False, True):  # bodies that touch share vertices when merged; in an STL file nothing does before
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        if merge:
            mesh.merge_vertices()
        number = _bodies(mesh)
        if number.max() >= MOST_BODIES:
            continue
        bodies = [trimesh.Trimesh(mesh.vertices, mesh.faces[number == body]) for body in range(number.max() + 1)]
        if sum(len(body.faces) for body in bodies if not body.is_watertight) <= LOOSE_FACES * len(mesh.faces):
            return _of_bodies(mesh, [body for body in bodies if body.is_watertight and abs(body.volume) > 0])
    points = trimesh.sample.sample_surface(mesh, SAMPLED, seed=0)[0]
    shape = _of_cloud(np.asarray(points), None)
    return replace(shape, words=f"a surface that is not closed: {shape.words}")


def _bodies(mesh: trimesh.Trimesh) -> NDArray[np.int32]:
    """(F,) which body each face belongs to."""
    pairs = mesh.face_adjacency
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(mesh.faces), len(mesh.faces)))
    return np.asarray(connected_components(graph, directed=False)[1])


def _of_bodies(mesh: trimesh.Trimesh, bodies: list[trimesh.Trimesh]) -> ObjectShape:
    """Closed surfaces: parts when there are several, none of them inside out, which would be a cavity."""
    if len(bodies) == 1 or len({np.sign(body.volume) for body in bodies}) > 1:
        whole = bodies[0] if len(bodies) == 1 else mesh
        return ObjectShape(_cut(whole), UNCUT_ACCURACY, f"closed surface, cut into {PIECES} pieces")
    moments = [np.sign(body.volume) * surface_moments(body.vertices[body.faces]) for body in bodies]
    parts = Parts.from_moments(moments, np.arange(len(bodies)), mesh.vertices)
    return ObjectShape(parts, MESH_ACCURACY, f"{len(bodies)} closed surfaces, taken for the parts")


def _cut(body: trimesh.Trimesh) -> Parts:
    """A closed surface in pieces of about one size."""
    body = body.copy()
    if body.volume < 0:
        body.invert()
    corners = np.asarray(body.vertices[body.faces])
    centres, _ = cells_of(corners, (abs(body.volume) / CELLS) ** (1 / 3))
    seeds = spread(centres, PIECES)
    return Parts.from_surface(body.vertices, body.faces, seeds, np.arange(len(seeds)), CELLS)


def _of_cloud(points: Array, colours: Array | None) -> ObjectShape:
    found = segment(points, colours)
    solid, which = found.solid, found.tetrahedron_labels
    words = f"{len(points)} points, segmented into {found.n_parts} parts"
    if found.n_parts == 1:
        seeds = spread(solid.centroids, PIECES)
        which = cKDTree(seeds).query(solid.centroids)[1]
        words = f"{len(points)} points of one part, cut into {PIECES} pieces"
    return ObjectShape(Parts.from_tetrahedra(solid.vertices, solid.tetrahedra, which), CLOUD_ACCURACY, words)
