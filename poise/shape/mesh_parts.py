"""Parts of what a file holds: a cloud of points, or a closed mesh, whose volume is exact."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from poise.shape.clouds import Cloud
from poise.shape.grouping import linked
from poise.shape.meshes import CheckedMesh
from poise.shape.segmentation import DEFAULT_SEGMENTATION, Segmentation, SegmentationOptions, segment
from poise.types import Array

_PARTS_OFF = 0.1
"""Of a mesh's volume, by which the solid in which its parts were found may be off without a note."""


def segment_surface(
    cloud: Cloud,
    mesh: CheckedMesh | None,
    options: SegmentationOptions = DEFAULT_SEGMENTATION,
    colours: Array | None = None,
) -> Segmentation:
    """Cut what `read_surface` read into parts; the parts of a mesh share its volume.

    Args:
        cloud, mesh: as read.
        options: how; the points of a mesh have no noise.
        colours: (N, 3) 0..1 of the points; None: they do not count.

    Raises:
        InputError: as `segment`.
    """
    how = options if mesh is None else replace(options, noise=0.0)
    found = segment(
        cloud.points, colours, how, normals=cloud.normals, seen=cloud.seen, doubt=cloud.doubt, air=cloud.air
    )
    return found if mesh is None else _of_mesh(mesh, found)


def _of_mesh(mesh: CheckedMesh, found: Segmentation) -> Segmentation:
    """With the exact volume, the part of each triangle, and notes of its own: those on points do not hold for it."""
    nearest = cKDTree(found.solid.vertices).query(mesh.vertices[mesh.triangles].mean(axis=1))[1]
    labels = np.zeros(len(found.solid.vertices), dtype=np.int64)
    labels[found.solid.tetrahedra] = found.tetrahedron_labels[:, None]
    return replace(found, mesh_volume=mesh.volume, triangle_labels=labels[nearest], notes=_notes(mesh, found))


def _notes(mesh: CheckedMesh, found: Segmentation) -> tuple[str, ...]:
    corners, ends = mesh.vertices[mesh.triangles], mesh.triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    number = linked(len(mesh.vertices), ends)[mesh.triangles[:, 0]]
    signed = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    bodies = int(np.count_nonzero(np.bincount(number, signed) > 0))  # cavities are negative
    notes = []
    if bodies > 1:
        notes.append(f"the mesh has {bodies} bodies that do not touch; if they are several objects, give one")
    off = found.solid.volume / mesh.volume - 1
    if abs(off) > _PARTS_OFF:
        notes.append(
            f"parts were found on a solid that is {abs(off):.0%} {'larger' if off > 0 else 'smaller'} than the mesh,"
            " and share its volume: each of them may be as far off"
        )
    return tuple(notes)
