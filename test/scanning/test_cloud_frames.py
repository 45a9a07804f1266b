"""PointCloud2 as frames: an organised cloud gives its own camera back, others one of its kind; what is refused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import SMALL, brick_views

from poise.errors import ErrorCode, InputError
from poise.scanning import ScanOptions, scan
from poise.scanning.cloud_frames import frame_of_cloud

KIND = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")]
CODES = {"<f4": 7, "<u4": 6}


def cloud_of(frame, organised=True, scale=1.0):
    """The message of a frame, as a driver makes it."""
    depth = np.where(frame.depth > 0, frame.depth, np.nan)
    rows = np.zeros(depth.shape, KIND)
    rows["x"], rows["y"], rows["z"] = (scale * depth * ray for ray in (*frame.camera.rays, 1.0))
    red, green, blue = np.moveaxis(frame.colours.astype(np.uint32), -1, 0)
    rows["rgb"] = red << 16 | green << 8 | blue
    if not organised:
        rows = rows[np.isfinite(rows["z"])].reshape(1, -1)
    fields = [SimpleNamespace(name=name, offset=4 * i, datatype=CODES[kind]) for i, (name, kind) in enumerate(KIND)]
    header = SimpleNamespace(frame_id="optical", stamp=SimpleNamespace(sec=1, nanosec=5))
    return SimpleNamespace(
        header=header, height=rows.shape[0], width=rows.shape[1], fields=fields, point_step=16, is_bigendian=False,
        data=rows.tobytes(),
    )  # fmt: skip


def test_an_organised_cloud_is_its_depth_image():
    frame = brick_views()[0].frame
    found = frame_of_cloud(cloud_of(frame))
    assert found.stamp == 1_000_000_005
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(found.camera, name) == pytest.approx(getattr(SMALL, name), abs=0.01)
    np.testing.assert_allclose(found.depth, frame.depth, atol=1e-6)
    np.testing.assert_array_equal(found.colours[frame.depth > 0], frame.colours[frame.depth > 0])


@pytest.mark.parametrize("organised", [True, False])
def test_clouds_are_scanned_like_images(organised):
    views = [replace(view, frame=frame_of_cloud(cloud_of(view.frame, organised))) for view in brick_views()]
    found, images = scan(views, ScanOptions(complete=False)), scan(brick_views(), ScanOptions(complete=False))
    np.testing.assert_allclose(found.points.min(axis=0), images.points.min(axis=0), atol=2e-3)
    np.testing.assert_allclose(found.points.max(axis=0), images.points.max(axis=0), atol=2e-3)
    np.testing.assert_allclose(found.colours.mean(axis=0), images.colours.mean(axis=0), atol=0.03)


def refusal(message):
    with pytest.raises(InputError) as caught:
        frame_of_cloud(message)
    return caught.value


def test_clouds_that_cannot_be_used_are_refused():
    frame = brick_views()[0].frame
    assert "millimetres" in refusal(cloud_of(frame, scale=1000.0)).message
    empty = cloud_of(replace(frame, depth=np.zeros_like(frame.depth)))
    assert refusal(empty).code == ErrorCode.EMPTY
    short = cloud_of(frame)
    short.data = short.data[:1000]
    assert refusal(short).code == ErrorCode.TYPE_MISMATCH
    nameless = cloud_of(frame)
    nameless.fields = nameless.fields[3:]
    assert "x, y, z" in refusal(nameless).message
    body = cloud_of(frame)  # x forwards, as in a body frame
    body.fields = [SimpleNamespace(**vars(field)) for field in body.fields]
    for field, name in zip(body.fields, ("y", "z", "x", "rgb"), strict=True):
        field.name = name
    assert refusal(body).code == ErrorCode.FRAME_UNKNOWN
