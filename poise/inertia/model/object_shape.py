"""The door for the shape of a held object: a mesh or a cloud of points in, its parts in the sensor frame out."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.inertia.model.parts import SAME_DENSITY, Parts, cells_of, likeness_of_colours, surface_moments, upper_factor
from poise.inertia.model.spread_points import spread
from poise.types import Array, Indices

if TYPE_CHECKING:  # imported where they are used: few payloads come with a mesh
    import trimesh

    from poise.shape import Segmentation, Solid

_SAMPLED = 6000
"""Points on a surface that is not closed."""

_LARGEST, _SMALLEST = 3.0, 1e-3
"""m, of what a robot holds."""

PIECES = 8
"""That a shape of one piece is cut into, because it is not known to be of one material."""

_ALIKE_WITHIN = 3.0
"""Distance at which the densities of two pieces have a correlation of 1/e, over the largest between any two. Pieces of
one thing are rarely of many materials: with nothing in common, noise moved mass between them. Chosen on the objects of
one part among random ones with seeds 0 to 179 and 700 to 979."""

_CELLS = 4000

_MOST_BODIES = 100

_LOOSE_FACES = 0.05
"""Share of faces outside of closed surfaces from which on the surface counts as open."""

_MESH_ACCURACY, _UNCUT_ACCURACY, CLOUD_ACCURACY = 0.0007, 0.03, 0.01
"""Relative errors of lengths: a mesh whose bodies are its parts; one that was cut here; the best of clouds, in which
parts are cut a little off."""

WORST_ACCURACY, _BY_VOLUME = 0.08, 0.7 / 3
"""Relative error of lengths of the worst clouds, and the share of that of the volume that is one of all lengths. With
these, the deformations of 320 clouds of random objects and 56 of tools are as large as expected at all uncertainties of
the volume, up to 0.6 of it."""
_MOST_HOLLOW = 0.95
"""Share of a part that a hollow may take; more is a part of its own."""
_UNKNOWN_ACCURACY = 0.05
"""The same when nothing is known of how good a cloud is."""


@dataclass(frozen=True, eq=False)
class ObjectShape:
    """What is known of an object's shape.

    Args:
        parts: of it, in the frame asked for.
        accuracy: relative error of lengths (of a scan: of the thinnest), and of where the parts are cut.
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
        return replace(
            self, parts=self.parts.in_frame(scipy.spatial.transform.Rotation.from_quat(turn).as_matrix(), place)
        )


def cloud_accuracy(volume: float, volume_std: float) -> float:
    """Relative error of the thinnest lengths in a solid from a cloud: a share of its volume's, and what the best have.

    Args:
        volume, volume_std: m3, and one sigma of it; 0 when that is not known.
    """
    known = volume > 0 and 0 < volume_std < np.inf
    if not known:
        return _UNKNOWN_ACCURACY
    return float(min(np.hypot(CLOUD_ACCURACY, _BY_VOLUME * volume_std / volume), WORST_ACCURACY))


def load_object(path: Path, scale: float = 1.0) -> ObjectShape:
    """Read a mesh (STL, OBJ, PLY) or a cloud (PLY, XYZ, CSV, NPY, PCD), in m after scaling, in the file's own frame.

    Bodies of a mesh are taken for parts; a mesh of one body and a cloud are segmented. What has one part is cut into
    `PIECES`.

    Raises:
        InputError: what `read_triangles` and `read_cloud` raise, FILE_CORRUPT for a mesh without triangles,
            OBJECT_INVALID (flat, or not of the size of something held); naming the file and how to fix it.
    """
    from poise.shape import MESH_FORMATS, read_cloud, segment

    mesh = _read_mesh(path, scale) if path.suffix.lower() in MESH_FORMATS else None
    try:
        if mesh is None:
            cloud = read_cloud(path, scale)
            cut = partial(segment, normals=cloud.normals, seen=cloud.seen, doubt=cloud.doubt, air=cloud.air)
            return shape_of_cloud(cut(cloud.points, cloud.colours))
        _check_size(path, mesh[0])
        return _of_mesh(*mesh)
    except (scipy.spatial.QhullError, np.linalg.LinAlgError) as error:
        raise InputError(
            ErrorCode.OBJECT_INVALID, f"{path}: its points lie in a plane or on a line; give a solid shape"
        ) from error


def _read_mesh(path: Path, scale: float) -> tuple[Array, NDArray[np.int64]] | None:
    """The surface in a file, as it is; None for a PLY file without faces."""
    from poise.shape import read_triangles

    cloud = path.suffix.lower() == ".ply"
    try:
        vertices, triangles = read_triangles(path.absolute(), scale=scale)
    except InputError as error:
        if cloud and error.code is ErrorCode.UNSUPPORTED:
            return None
        raise
    if len(triangles):
        return vertices, triangles
    if cloud:
        return None
    raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: holds no triangles")


def _check_size(path: Path, vertices: Array) -> None:
    size = float(np.ptp(vertices, axis=0).max())
    if not _SMALLEST < size < _LARGEST:
        raise InputError(
            ErrorCode.OBJECT_INVALID,
            f"{path}: the object is {size:.3g} m long, which no hand holds; if the file is in millimetres,"
            " give --object-scale 0.001",
            size=size,
        )


def _of_mesh(vertices: Array, faces: NDArray[np.int64]) -> ObjectShape:
    import trimesh

    for merge in (False, True):  # bodies that touch share vertices when merged; in an STL file nothing does before
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        if merge:
            mesh.merge_vertices()
        number = _bodies(mesh)
        if number.max() >= _MOST_BODIES:
            continue
        bodies = [trimesh.Trimesh(mesh.vertices, mesh.faces[number == body]) for body in range(number.max() + 1)]
        if sum(len(body.faces) for body in bodies if not body.is_watertight) <= _LOOSE_FACES * len(mesh.faces):
            return _of_bodies(mesh, [body for body in bodies if body.is_watertight and abs(body.volume) > 0])
    points = trimesh.sample.sample_surface(mesh, _SAMPLED, seed=0)[0]
    from poise.shape import segment

    shape = shape_of_cloud(segment(np.asarray(points)))
    return replace(shape, words=f"a surface that is not closed: {shape.words}")


def _bodies(mesh: "trimesh.Trimesh") -> NDArray[np.int32]:
    """(F,) which body each face belongs to."""
    pairs = mesh.face_adjacency
    graph = scipy.sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(len(mesh.faces), len(mesh.faces)))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1])


def _of_bodies(mesh: "trimesh.Trimesh", bodies: "list[trimesh.Trimesh]") -> ObjectShape:
    """Closed surfaces: parts when there are several, none of them inside out, which would be a cavity."""
    if len(bodies) == 1 or len({np.sign(body.volume) for body in bodies}) > 1:
        return _cut(bodies[0] if len(bodies) == 1 else mesh)
    moments = [np.sign(body.volume) * surface_moments(body.vertices[body.faces]) for body in bodies]
    parts = Parts.from_moments(moments, np.arange(len(bodies)), mesh.vertices)
    return ObjectShape(parts, _MESH_ACCURACY, f"{len(bodies)} closed surfaces, taken for the parts")


def _cut(body: "trimesh.Trimesh") -> ObjectShape:
    """A closed surface: cut as points on it are, or in pieces of about one size where they are not."""
    import trimesh

    body = body.copy()
    if body.volume < 0:
        body.invert()
    points = np.asarray(trimesh.sample.sample_surface(body, _SAMPLED, seed=0)[0])
    from poise.shape import independent_parts, segment

    try:
        found = segment(points)
        places, labels = found.solid.centroids, independent_parts(found)
    except InputError:  # no solid can be made of them
        labels = np.zeros(1, dtype=np.int64)
    words, whole = f"closed surface, segmented into {labels.max() + 1} parts", labels.max() == 0
    if whole:
        corners = np.asarray(body.vertices[body.faces])
        places = spread(cells_of(corners, (abs(body.volume) / _CELLS) ** (1 / 3))[0], PIECES)
        labels, words = np.arange(len(places)), f"closed surface, cut into {PIECES} pieces"
    parts = Parts.from_surface(body.vertices, body.faces, places, labels, _CELLS)
    return ObjectShape(_alike(parts, len(parts)) if whole else parts, _UNCUT_ACCURACY, words)


def _alike(parts: Parts, count: int) -> Parts:
    """The first parts as pieces of one thing: the nearer to each other, the more likely of one density."""
    places = parts.unit_phi[1:4, :count].T
    apart = scipy.spatial.distance.cdist(places, places)
    likeness = np.eye(len(parts))
    likeness[:count, :count] = SAME_DENSITY * np.exp(-apart / (_ALIKE_WITHIN * max(apart.max(), 1e-12)))
    np.fill_diagonal(likeness, 1.0)
    return replace(parts, likeness=likeness)


def parts_of_solid(solid: "Solid", labels: ArrayLike | None = None) -> Parts:
    """Parts of a solid, in its frame: (T,) part of each tetrahedron (one part when None); inside-out ones take away."""
    from poise.shape import tetrahedron_moments

    moments = tetrahedron_moments(solid.vertices[solid.tetrahedra])
    return Parts.from_moments(moments, np.zeros(len(moments)) if labels is None else labels, solid.vertices)


def parts_of_segmentation(found: "Segmentation") -> Parts:
    """All parts that were found, with what their colours say about their densities.

    Where colours say nothing, at most four of them whose masses a sensor at rest can distinguish.
    """
    from poise.shape import independent_parts

    likeness = None if found.part_colours is None else likeness_of_colours(found.part_colours)
    labels = independent_parts(found) if likeness is None else found.tetrahedron_labels
    parts = _parts(found, labels)
    if likeness is not None and len(parts) > len(likeness):  # what fills the hollow is like nothing else
        likeness = np.pad(likeness, (0, 1))
        likeness[-1, -1] = 1.0
    return replace(parts, likeness=likeness)


def shape_of_cloud(found: "Segmentation") -> ObjectShape:
    """Parts of a solid from a cloud; one part is cut into `PIECES`, and space that may be hollow is a part, too."""
    accuracy = cloud_accuracy(found.solid.volume, found.solid.volume_std)
    words = f"{len(found.labels)} points with {1e3 * found.noise:.1f} mm of noise"
    hollow = "" if found.volume_if_hollow is None else ", of which the space that no view saw may be hollow"
    if found.n_parts > 1:
        parts = parts_of_segmentation(found)
        return ObjectShape(parts, accuracy, f"{words}, segmented into {len(parts)} parts{hollow}")
    solid = found.solid
    which = scipy.spatial.cKDTree(spread(solid.centroids, PIECES)).query(solid.centroids)[1]
    parts = _alike(_parts(found, which), int(which.max()) + 1)
    return ObjectShape(parts, accuracy, f"{words} of one part, cut into {PIECES} pieces{hollow}")


def _parts(found: "Segmentation", labels: Indices) -> Parts:
    """Parts by (T,) labels 0..P-1; space that may be hollow is one more, since its mass may be zero."""
    solid, hollow = found.solid, found.hollow
    if found.volume_if_hollow is None or hollow is None:
        return parts_of_solid(solid, labels)
    from poise.shape import tetrahedron_moments

    exact, count = tetrahedron_moments(solid.vertices[solid.tetrahedra]), int(labels.max()) + 1
    places = np.pad(hollow.samples, ((0, 0), (0, 1)), constant_values=1.0)
    samples, inside = places[:, :, None] * places[:, None, :], labels[hollow.owners]
    moments, part = [np.zeros((0, 4, 4))], [np.zeros(0, np.int64)]
    for number in range(count):
        own, whole = inside == number, exact[labels == number].sum(axis=0)
        empty = hollow.empty[own]
        if not 0 < np.mean(empty) < _MOST_HOLLOW or np.linalg.eigvalsh(whole).min() <= 0:
            moments, part = [*moments, whole[None]], [*part, np.array([number])]  # one without walls is free anyway
            continue
        stretch = upper_factor(whole) @ np.linalg.inv(upper_factor(samples[own].sum(axis=0)))
        moments.append(stretch @ samples[own] @ stretch.T)
        part.append(np.where(empty, count, number))
    return Parts.from_moments(np.concatenate(moments), np.concatenate(part), solid.vertices)
