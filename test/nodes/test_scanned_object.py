"""A SegmentedObject as a rigid object: with its cloud, of few facets; a damaged cloud is refused."""

import numpy as np
import pytest

from poise.assembly import Box, RigidObject
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
