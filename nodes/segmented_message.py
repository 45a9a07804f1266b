"""A scanned and segmented object as poise_msgs/SegmentedObject, and where its frame is as a transform."""

from dataclasses import replace
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, TransformStamped
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh, MeshTriangle

from poise.inertia.model import InertialParameters, parts_of_solid
from poise.nodes.clouds import point_cloud
from poise.nodes.estimate_message import inertia_message, time_message
from poise.scanning import Scan
from poise.shape import Segmentation, part_surface
from poise_msgs.msg import Part, SegmentedObject

_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4"), ("label", "<u4"), ("seen", "u1")])


def segmented_message(
    name: str, frame: str, stamp: int, scanned: Scan, found: Segmentation, parts: Any, notes: tuple[str, ...]
) -> SegmentedObject:
    """Build the message.

    Args:
        name: of the object.
        frame: of the object; its origin is `scanned.foot`, its axes are those of the robot's base.
        stamp: ns.
        scanned: the cloud, in the base.
        found: its parts.
        parts: (T,) part of each tetrahedron that is published; each a union of those of `found`.
        notes: what to read it with.
    """
    spread = found.solid.volume_std
    message = SegmentedObject(id=name, volume=float(found.solid.volume), volume_std=spread)
    message.header.stamp, message.header.frame_id = time_message(stamp), frame
    whole = np.zeros(found.n_parts, dtype=np.int64)
    whole[found.tetrahedron_labels] = parts
    message.cloud = _cloud(message.header, scanned, whole[found.labels])
    shapes = parts_of_solid(found.solid, parts).in_frame(np.eye(3), -scanned.foot)
    for number, (phi, volume) in enumerate(zip(shapes.unit_phi.T, shapes.volumes, strict=True)):
        vertices, triangles = part_surface(found.solid, parts, number)
        part = Part(label=number, volume=float(volume), surface=_mesh(vertices - scanned.foot, triangles))
        part.volume_std = float(spread * volume / found.solid.volume)
        part.unit_inertia = inertia_message(replace(InertialParameters.from_phi(phi), mass=1.0))
        message.parts.append(part)
    message.notes = list(notes)
    return message


def object_transform(base: str, frame: str, stamp: int, scanned: Scan) -> TransformStamped:
    """Where the object's frame is."""
    transform = TransformStamped(child_frame_id=frame)
    transform.header.stamp, transform.header.frame_id = time_message(stamp), base
    shift = transform.transform.translation
    shift.x, shift.y, shift.z = scanned.foot.tolist()
    return transform


def _cloud(header: Any, scanned: Scan, labels: Any) -> PointCloud2:
    rows = np.zeros(len(scanned.points), _POINT)
    for axis, column in zip("xyz", (scanned.points - scanned.foot).T, strict=True):
        rows[axis] = column
    if scanned.colours is not None:
        red, green, blue = np.round(255 * np.clip(scanned.colours, 0, 1)).astype(np.uint32).T
        rows["rgb"] = red << 16 | green << 8 | blue
    rows["label"], rows["seen"] = labels, scanned.seen
    return point_cloud(header, rows, packed=("rgb",))


def _mesh(vertices: Any, triangles: Any) -> Mesh:
    corners = [Point(x=x, y=y, z=z) for x, y, z in vertices.tolist()]
    return Mesh(vertices=corners, triangles=[MeshTriangle(vertex_indices=row) for row in triangles.astype(np.uint32)])
