"""A poise_msgs/SegmentedObject as one rigid object of an assembly."""

import numpy as np

from poise.assembly import RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.scanning import columns_of, standing_mesh, united_surfaces
from poise.types import Array, Mask
from poise.world import assumed_weight, standing_object
from poise_msgs.msg import SegmentedObject


def scanned_object(message: SegmentedObject, pose: Pose) -> tuple[RigidObject, tuple[str, ...]]:
    """The union of the parts, standing flat, with a weight that is assumed; and notes to read it with.

    The frame of a can is in its centre, with z upwards; that of another object is the message's.

    Args:
        message: whose object frame has its origin on the support, and its z away from it.
        pose: of the object frame, in the assembly's.

    Raises:
        InputError: EMPTY without parts, NOT_FINITE, MESH_INVALID; as `columns_of` for a cloud that is damaged.
    """
    surfaces = []
    for part in message.parts:
        vertices = np.array([[corner.x, corner.y, corner.z] for corner in part.surface.vertices]).reshape(-1, 3)
        triangles = [face.vertex_indices for face in part.surface.triangles]
        surfaces.append((vertices, np.array(triangles, dtype=np.int64).reshape(-1, 3)))
        if not np.isfinite(vertices).all():
            raise InputError(ErrorCode.NOT_FINITE, f"segmented_object {message.id}: a vertex is not finite")
        if surfaces[-1][1].size and surfaces[-1][1].max() >= len(vertices):
            raise InputError(ErrorCode.MESH_INVALID, f"segmented_object {message.id}: a triangle has no such vertex")
    if not message.id or not sum(len(triangles) for _, triangles in surfaces):
        raise InputError(ErrorCode.EMPTY, f"segmented_object {message.id!r}: it has no parts or no id; scan it again")
    name = f"segmented_object {message.id}"
    mesh = standing_mesh(*united_surfaces(surfaces), name, *_cloud(message, name))
    return assumed_weight(standing_object(message.id, mesh, pose)), (*message.notes, *mesh.notes)


def _cloud(message: SegmentedObject, name: str) -> tuple[Array | None, Mask | None]:
    """The points (N, 3) m of a scan, and which of them were seen; None without the field that says it."""
    if not message.cloud.width:
        return None, None
    columns = columns_of(message.cloud, name)
    points = np.stack([columns[axis] for axis in "xyz"], axis=1).astype(np.float64)
    if not np.isfinite(points).all():
        raise InputError(ErrorCode.NOT_FINITE, f"{name}: a point of its cloud is not finite")
    return (points, columns["seen"] > 0) if "seen" in columns else (None, None)
