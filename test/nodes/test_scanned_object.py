"""A SegmentedObject as a rigid object: with its cloud, of few facets; a damaged cloud is refused."""

import numpy as np
import pytest

from poise.assembly import Box, Cylinder, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.nodes.clouds import point_cloud
from poise.nodes.loop_scan import as_scan
from poise.nodes.scanned_object import scanned_object
from poise_msgs.msg import SegmentedObject

pytestmark = pytest.mark.ros
SIZE = np.array([0.06, 0.05, 0.08])


def rough_box(noise: float) -> SegmentedObject:
    """A box whose surface is rough, and whose cloud is not."""
    rng = np.random.default_rng(3)
    message, _ = as_scan(RigidObject("box", Box((*SIZE.tolist(),)), Pose.identity(), mass=1.0), "box", "world")
    mesh = message.parts[0].surface
    for corner in mesh.vertices:
        corner.x, corner.y = corner.x + rng.normal(scale=noise), corner.y + rng.normal(scale=noise)
    points = rng.uniform(-0.5, 0.5, (9000, 3))
    rows = np.arange(len(points))
    axis = rows % 3
    points[rows, axis] = np.sign(points[rows, axis]) / 2
    points = (points + np.array([0, 0, 0.5])) * SIZE
    records = np.zeros(len(points), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("seen", "u1")])
    records["x"], records["y"], records["z"] = points.T
    records["seen"] = points[:, 2] > 0
    message.cloud = point_cloud(message.header, records)
    return message


def test_the_cloud_of_a_scan_makes_its_facets_flat() -> None:
    item, _ = scanned_object(rough_box(1e-3), Pose.identity())
    assert len(item.shape.polyhedron.normals) == 6
    assert item.shape.volume == pytest.approx(np.prod(SIZE), rel=0.01)
    np.testing.assert_allclose(item.shape.centroid, [0, 0, SIZE[2] / 2], atol=2e-4)


def test_a_scanned_can_is_a_cylinder_whose_frame_is_in_its_centre() -> None:
    radius, height, there = 0.03, 0.08, Pose(np.eye(3), np.array([0.4, 0.1, 0.2]))
    can = RigidObject("can", Cylinder(radius, height), Pose.identity(), mass=1.0)
    message, _ = as_scan(can, "can", "world")
    rng = np.random.default_rng(3)
    turns, heights = rng.uniform(0, 2 * np.pi, 9000), rng.uniform(0, height, 9000)
    out = np.full(9000, radius)
    out[:2000], heights[:2000] = radius * np.sqrt(rng.uniform(0, 1, 2000)), height
    records = np.zeros(9000, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("seen", "u1")])
    records["x"], records["y"], records["z"], records["seen"] = out * np.cos(turns), out * np.sin(turns), heights, 1
    message.cloud = point_cloud(message.header, records)
    item, _ = scanned_object(message, there)
    assert isinstance(item.shape, Cylinder)
    np.testing.assert_allclose([item.shape.radius, item.shape.length], [radius, height], atol=1e-4)
    np.testing.assert_allclose(item.pose.translation, [0.4, 0.1, 0.24], atol=1e-4)


def test_a_cloud_without_the_field_seen_is_not_used_and_a_damaged_one_is_refused() -> None:
    message = rough_box(0.0)
    message.cloud.fields = message.cloud.fields[:3]
    assert scanned_object(message, Pose.identity())[0].shape.volume == pytest.approx(np.prod(SIZE), rel=0.01)
    message.cloud.data = message.cloud.data[:100]
    with pytest.raises(InputError) as caught:
        scanned_object(message, Pose.identity())
    assert caught.value.code == ErrorCode.TYPE_MISMATCH
    broken = rough_box(0.0)
    broken.cloud.data[:4] = type(broken.cloud.data)("B", np.float32(np.nan).tobytes())
    with pytest.raises(InputError) as caught:
        scanned_object(broken, Pose.identity())
    assert caught.value.code == ErrorCode.NOT_FINITE
