"""The door for the shape of a held object: a mesh or a cloud of points in, its parts in the sensor frame out."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError, cKDTree
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.inertia.parameters import Array
from poise.inertia.parts import Parts, cells_of, surface_moments
from poise.inertia.pmd import spread
from poise.inertia.shape_files import read_shape

ENOUGH_POINTS = 6000
"""Of a denser cloud, that many are used, evenly spread."""

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

    Bodies of a mesh are taken for parts. One body, or a cloud without labels, is cut into `PIECES` of about one size.

    Raises:
        InputError: FILE_UNREADABLE, UNSUPPORTED, FILE_CORRUPT, NOT_FINITE, OBJECT_INVALID (too few points, flat, or not
            of the size of something held), naming the file and the mend.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(ErrorCode.BAD_INPUT, f"object scale {scale}: it must be positive")
    points, faces, labels = read_shape(path)
    points = points * scale
    if not np.isfinite(points).all():
        raise InputError(ErrorCode.NOT_FINITE, f"{path}: a point is not finite; clean it")
    size = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if not SMALLEST < size < LARGEST:
        raise InputError(
            ErrorCode.OBJECT_INVALID,
            f"{path}: the object is {size:.3g} m long, which no hand holds; if the file is in millimetres,"
            " give --object-scale 0.001",
            size=size,
        )
    try:
        return _of_mesh(points, faces) if len(faces) else _of_cloud(points, labels)
    except (QhullError, np.linalg.LinAlgError) as error:
        raise InputError(
            ErrorCode.OBJECT_INVALID, f"{path}: its points lie in a plane or on a line; give a solid shape"
        ) from error
    except InputError as error:
        raise InputError(error.code, f"{path}: {error.message}", **error.data) from error


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
    points = trimesh.sample.sample_surface(mesh, ENOUGH_POINTS, seed=0)[0]
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


def _of_cloud(points: Array, labels: NDArray[np.int64] | None) -> ObjectShape:
    if len(points) > ENOUGH_POINTS:
        some = np.unique(np.linspace(0, len(points) - 1, ENOUGH_POINTS).astype(np.int64))
        points, labels = points[some], None if labels is None else labels[some]
    if len(points) < 4:
        raise InputError(ErrorCode.OBJECT_INVALID, f"{len(points)} points make no solid; scan more of it")
    tetrahedra = carved(points)
    centres = points[tetrahedra].mean(axis=1)
    if labels is None or len(np.unique(labels)) == 1:
        seeds = spread(centres, PIECES)
        which = cKDTree(seeds).query(centres)[1]
        words = f"{len(points)} points, carved and cut into {PIECES} pieces"
    else:
        which = labels[cKDTree(points).query(centres)[1]]
        words = f"{len(points)} points, carved; {len(np.unique(labels))} parts as labelled"
    return ObjectShape(Parts.from_tetrahedra(points, tetrahedra, which), CLOUD_ACCURACY, words)


def carved(points: Array) -> NDArray[np.int64]:
    """(T, 4) tetrahedra of the solid whose surface was sampled at (P, 3): what a ball cannot reach from outside.

    Of the Delaunay tetrahedra of all points, those are taken away that a ball reaches without passing between points
    of the surface (sculpting, Boissonnat 1984; the radius as for alpha shapes, Edelsbrunner and Mücke 1994). When that
    takes away everything, the convex hull is left.
    """
    mesh = Delaunay(points)
    radius = 1.5 * float(np.percentile(cKDTree(points).query(points, k=min(7, len(points)))[0][:, -1], 90))
    outside = len(mesh.simplices)
    first, second = [], []
    for opposite in range(4):
        face = points[np.delete(mesh.simplices, opposite, axis=1)]
        open_face = _circumradius(face) > radius
        neighbour = mesh.neighbors[:, opposite]
        first.append(np.flatnonzero(open_face))
        second.append(np.where(neighbour[open_face] < 0, outside, neighbour[open_face]))
    rows, columns = np.concatenate(first), np.concatenate(second)
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(outside + 1, outside + 1))
    group = connected_components(graph, directed=False)[1]
    kept = group[:-1] != group[-1]
    solid = mesh.simplices[kept] if kept.any() else mesh.simplices
    edges = points[solid[:, 1:]] - points[solid[:, :1]]
    volume = np.abs(np.linalg.det(edges))
    return np.asarray(solid[volume > 1e-12 * volume.max()], dtype=np.int64)


def _circumradius(faces: Array) -> Array:
    """(F,) m, of triangles (F, 3, 3); infinite when they have no area."""
    a, b, c = (np.linalg.norm(faces[:, i] - faces[:, i - 1], axis=1) for i in range(3))
    area = np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(area > 0, a * b * c / (2 * area), np.inf))
