"""Recordings of cameras as they are: each way to record a small scene is read, and gives the same object."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import BRICK, box, brick_views, views_of
from scipy.spatial.transform import Rotation
from test_cloud_frames import cloud_of

from poise.errors import ErrorCode, InputError
from poise.fake_robots.compressing import compressed_bytes, depth_png, depth_rvl, picture_bytes
from poise.fake_robots.rasteriser import Scene
from poise.fake_robots.sweep_bag import header_of_image, image_bytes, info_bytes
from poise.geometry import Pose
from poise.recording import (
    CLOUD,
    COMPRESSED,
    IMAGE,
    INFO,
    PoseStream,
    RecordingWriter,
    encode_stream,
    open_recording,
    typestore,
)
from poise.scanning import Camera, ScanOptions, SweepOptions, read_sweep, scan_sweep
from poise.scanning.painting import painted

OPTICAL = "camera_color_optical_frame"
BODY = box(BRICK, (0.0, 0.0, 0.025), (0.8, 0.2, 0.1))
VOLUME = float(np.prod(BRICK))
WHERE, HOW = SweepOptions(), ScanOptions()


def millimetres(view):
    return np.round(view.frame.depth * 1e3).astype(np.uint16)


def raw_depth(view):
    return IMAGE, image_bytes(view.frame.stamp, OPTICAL, millimetres(view), "16UC1")


def in_steps(size):
    """16 bits in another unit, m."""
    return lambda view: (
        IMAGE,
        image_bytes(view.frame.stamp, OPTICAL, np.round(view.frame.depth / size).astype(np.uint16), "16UC1"),
    )


def float_depth(view):
    metres = np.where(view.frame.depth > 0, view.frame.depth, np.nan).astype(np.float32)
    return IMAGE, image_bytes(view.frame.stamp, OPTICAL, metres, "32FC1")


def png_depth(view):
    data = depth_png(millimetres(view))
    return COMPRESSED, compressed_bytes(view.frame.stamp, OPTICAL, "16UC1; compressedDepth png", data)


def rvl_depth(view):
    data = depth_rvl(millimetres(view))
    return COMPRESSED, compressed_bytes(view.frame.stamp, OPTICAL, "16UC1; compressedDepth rvl", data)


def inverse_depth(view):
    scale, offset = 100.0 * 101.0, -100.0
    depth = view.frame.depth
    steps = np.where(depth > 0, np.round(scale / np.maximum(depth, 1e-3) + offset), 0).clip(0, 65535).astype(np.uint16)
    data = depth_png(steps, (scale, offset))
    return COMPRESSED, compressed_bytes(view.frame.stamp, OPTICAL, "32FC1; compressedDepth", data)


def cloud_depth(view):
    make = typestore().types
    cloud = cloud_of(view.frame)
    fields = [make["sensor_msgs/msg/PointField"](one.name, one.offset, one.datatype, 1) for one in cloud.fields]
    data = np.frombuffer(cloud.data, np.uint8)
    header = header_of_image(view.frame.stamp, OPTICAL)
    message = make[CLOUD](
        header, cloud.height, cloud.width, fields, False, cloud.point_step, cloud.point_step * cloud.width, data, False
    )
    return CLOUD, bytes(typestore().serialize_cdr(message, CLOUD))


def raw_colour(encoding="rgb8"):
    def encode(view):
        pixels = view.frame.colours[..., ::-1] if encoding == "bgr8" else view.frame.colours
        return IMAGE, image_bytes(
            view.frame.stamp, OPTICAL, pixels[..., 0] if encoding == "mono8" else pixels, encoding
        )

    return encode


def jpeg_colour(view):
    data = picture_bytes(view.frame.colours, "JPEG", quality=90)
    return COMPRESSED, compressed_bytes(view.frame.stamp, OPTICAL, "rgb8; jpeg compressed bgr8", data)


def record(path, views, depth=raw_depth, colour=None, parent="turntable", posed=None):
    """A bag of views whose poses are tf, at the stamps of `posed`."""
    topics = {"camera/depth/image": depth, "camera/color/image": colour}
    messages = []
    for view in views:
        stamp = view.frame.stamp
        messages += [(stamp, name, *encode(view)) for name, encode in topics.items() if encode]
        messages.append((stamp, "camera/depth/camera_info", INFO, info_bytes(stamp, OPTICAL, view.frame.camera)))
    if parent:
        rotation = np.array([view.rotation_world_camera for view in views])
        places = np.array([view.translation_world_camera for view in views])
        stamps = np.array([view.frame.stamp for view in posed or views])
        stream = PoseStream(stamps, rotation, places, parent, OPTICAL)
        messages += [(stamp, "tf", "tf2_msgs/msg/TFMessage", data) for stamp, data in encode_stream("tf", stream)]
    with RecordingWriter(path) as writer:
        for name, kind in {message[1]: message[2] for message in messages}.items():
            writer.add_topic(name, kind)
        for stamp, name, _, data in sorted(messages, key=lambda message: message[0]):
            writer.write(name, stamp, data)
    return path


def scanned(path, where=WHERE, how=HOW):
    """The sweep and the scan of a bag."""
    sweep = read_sweep(open_recording(path), where)
    return sweep, scan_sweep(sweep, how)


def refusal(path, where=WHERE, how=HOW):
    with pytest.raises(InputError) as caught:
        scanned(path, where, how)
    return caught.value


def is_brick(found, off=6e-3, share=0.12):
    np.testing.assert_allclose(np.sort(np.ptp(found.points, axis=0)), np.sort(BRICK), atol=off)
    assert found.segmented().solid.volume == pytest.approx(VOLUME, rel=share)


@pytest.mark.parametrize(
    "depth", [raw_depth, float_depth, png_depth, rvl_depth, inverse_depth, cloud_depth], ids=lambda one: one.__name__
)
def test_each_kind_of_depth_gives_the_brick(tmp_path, depth):
    sweep, found = scanned(record(tmp_path / "depth.mcap", brick_views(), depth))
    assert sweep.base == "turntable"
    assert any("tf" in note for note in sweep.notes)
    is_brick(found)


@pytest.mark.parametrize(
    "colour",
    [raw_colour(), raw_colour("bgr8"), jpeg_colour, raw_colour("mono8")],
    ids=["rgb8", "bgr8", "jpeg", "mono8"],
)
def test_each_kind_of_colour_is_read(tmp_path, colour):
    bag = record(tmp_path / "colour.mcap", brick_views()[:2], colour=colour)
    for view, true in zip(read_sweep(open_recording(bag), SweepOptions()).views, brick_views(), strict=False):
        wanted = true.frame.colours.astype(int)
        if colour(true)[0] == IMAGE and b"mono8" in colour(true)[1]:
            wanted = np.repeat(wanted[..., :1], 3, axis=2)
        assert np.median(np.abs(view.frame.colours - wanted)) <= 2


def test_colours_that_are_not_read_are_left_out_and_said(tmp_path):
    """As of a webcam's driver: depth is enough for a solid."""

    def yuv(view):
        return IMAGE, image_bytes(view.frame.stamp, OPTICAL, view.frame.colours[..., :2], "yuv422_yuy2")

    sweep = read_sweep(open_recording(record(tmp_path / "yuv.mcap", brick_views()[:3], colour=yuv)), SweepOptions())
    assert all(view.frame.colours is None for view in sweep.views)
    assert any("yuv422_yuy2" in note and "left out" in note for note in sweep.notes)


@pytest.mark.parametrize("unit", [1e-4, 2e-4, 2.5e-4])
def test_an_unstated_unit_is_guessed_and_said(tmp_path, unit):
    bag = record(tmp_path / "unit.mcap", brick_views(), in_steps(unit))
    sweep, found = scanned(bag)
    (note,) = [note for note in sweep.notes if "unit" in note]
    assert f"{1e3 * unit:g} mm" in note
    assert "--depth-unit" in note
    is_brick(found)
    given, _ = scanned(bag, SweepOptions(unit=unit))
    assert not any("unit" in note for note in given.notes)


def test_a_unit_that_nothing_shows_is_asked_for(tmp_path):
    error = refusal(record(tmp_path / "one.mcap", brick_views()[:1], in_steps(1e-5)))
    assert error.code == ErrorCode.BAD_INPUT
    assert "--depth-unit" in error.message


@pytest.mark.parametrize("count", [5, 6, 8])
def test_a_turntable_of_few_views_is_scanned(tmp_path, count):
    views = brick_views()[:: len(brick_views()) // count][:count]
    _, found = scanned(record(tmp_path / "few.mcap", views))
    is_brick(found, off=1e-2, share=0.2)


def test_a_camera_that_stands_still_is_told_to_look_behind_the_object(tmp_path):
    error = refusal(record(tmp_path / "still.mcap", brick_views()[:1]))
    assert error.code == ErrorCode.SCAN_INCOMPLETE
    assert "shadow" in error.message


def test_the_base_of_tf_can_be_named(tmp_path):
    sweep, _ = scanned(record(tmp_path / "base.mcap", brick_views()), SweepOptions(poses="tf", base="turntable"))
    assert sweep.base == "turntable"
    error = refusal(record(tmp_path / "else.mcap", brick_views()), SweepOptions(poses="tf", base="nowhere"))
    assert error.code in (ErrorCode.FRAME_UNKNOWN, ErrorCode.EMPTY)
    error = refusal(record(tmp_path / "no_tf.mcap", brick_views(), parent=""), SweepOptions(poses="tf"))
    assert error.code == ErrorCode.FRAME_UNKNOWN


def test_unaligned_colours_are_looked_up_in_their_camera():
    view = brick_views()[0]
    lens = Camera(400, 300, 380.0, 380.0, 199.5, 149.5)
    twice = view.frame.colours.repeat(2, axis=0).repeat(2, axis=1)
    found = painted(view.frame.depth, view.frame.camera, twice, lens, Pose.identity())
    known = view.frame.depth > 0
    assert np.mean(np.abs(found[known].astype(int) - view.frame.colours[known]).max(axis=1) < 10) > 0.97
    assert not found[~known].any()


def test_colours_of_another_size_are_looked_up_or_left_out(tmp_path):
    def twice(frame):
        return lambda view: (
            IMAGE,
            image_bytes(view.frame.stamp, frame, view.frame.colours.repeat(2, axis=0).repeat(2, axis=1), "rgb8"),
        )

    bag = record(tmp_path / "apart.mcap", brick_views()[:3], colour=twice("another_frame"))
    sweep = read_sweep(open_recording(bag), SweepOptions())
    assert all(view.frame.colours is None for view in sweep.views)
    assert any("left out" in note and "tf_static" in note for note in sweep.notes)


def test_a_bent_lens_is_straightened(tmp_path):
    camera = brick_views()[0].frame.camera
    bent = replace(camera, distortion=(0.08, -0.1, 0.001, -0.001, 0.0))
    views = views_of(Scene((BODY,)), camera=bent, count=12)
    assert bent.distortion  # rendered with it
    is_brick(scan_sweep(read_sweep(open_recording(record(tmp_path / "bent.mcap", views)), SweepOptions())))


def test_only_the_region_is_scanned(tmp_path):
    bodies = BODY, box((0.1, 0.1, 0.08), (0.22, 0.0, 0.04), (0.1, 0.6, 0.1))
    bag = record(tmp_path / "two.mcap", views_of(Scene(bodies), target=(0.1, 0.0, 0.02)))
    _, found = scanned(bag, how=ScanOptions(region=(0.0, 0.0, 0.0, 0.2, 0.2, 0.2)))
    is_brick(found)
    _, other = scanned(bag, how=ScanOptions(region=(0.22, 0.0, 0.0, 0.16, 0.2, 0.2)))
    assert np.ptp(other.points, axis=0) == pytest.approx([0.1, 0.1, 0.08], abs=1e-2)
    error = refusal(bag, how=ScanOptions(region=(3.0, 0.0, 0.0, 0.2, 0.2, 0.2)))
    assert error.code == ErrorCode.EMPTY
    assert "region" in error.message


def test_a_covered_lens_is_left_out(tmp_path):
    views = [
        replace(view, frame=replace(view.frame, depth=np.zeros_like(view.frame.depth))) if 4 <= number < 8 else view
        for number, view in enumerate(brick_views())
    ]
    sweep, found = scanned(record(tmp_path / "hand.mcap", views))
    assert any("4 of 24 frames" in note and "covered" in note for note in sweep.notes)
    is_brick(found)


def test_an_empty_table_is_refused(tmp_path):
    error = refusal(record(tmp_path / "empty.mcap", views_of(Scene(()), count=6)))
    assert error.code in (ErrorCode.EMPTY, ErrorCode.SCAN_INCOMPLETE)


def test_a_wrong_hand_eye_transform_is_corrected_and_said(tmp_path):
    tilt = Rotation.from_euler("x", 5, degrees=True).as_matrix()
    off = [replace(view, rotation_world_camera=view.rotation_world_camera @ tilt) for view in brick_views()]
    found = scanned(record(tmp_path / "off.mcap", off))[1]
    is_brick(found)
    assert "turned by 5.0 deg" in "; ".join(found.notes)
    assert "--delay" not in "; ".join(found.notes)


def test_a_hand_eye_transform_that_is_far_off_is_refused_by_what_would_cure_it(tmp_path):
    tilt = Rotation.from_euler("x", 8, degrees=True).as_matrix()
    off = [replace(view, rotation_world_camera=view.rotation_world_camera @ tilt) for view in brick_views()]
    error = refusal(record(tmp_path / "off.mcap", off))
    assert error.code == ErrorCode.SCAN_INCOMPLETE
    assert "turned by 8" in error.message
    assert "--delay" not in error.message


def test_late_images_are_corrected_and_their_delay_is_said(tmp_path):
    late = [replace(view, frame=replace(view.frame, stamp=view.frame.stamp + 150_000_000)) for view in brick_views()]
    bag = record(tmp_path / "late.mcap", late, posed=brick_views())
    found = scanned(bag)[1]
    is_brick(found)
    assert "--delay 0.150" in "; ".join(found.notes)
    assert "--delay" not in "; ".join(scanned(bag, SweepOptions(delay=0.15))[1].notes)


@pytest.mark.parametrize(("shift", "refused"), [((0.1, 0.0), True), ((0.02, 0.01), False)])
def test_an_object_that_was_moved_is_told(tmp_path, shift, refused):
    elsewhere = Scene((box(BRICK, (*shift, 0.025), (0.8, 0.2, 0.1)),))
    bag = record(tmp_path / "moved.mcap", [*brick_views()[:12], *views_of(elsewhere)[12:]])
    said = refusal(bag).message if refused else "; ".join(scanned(bag)[1].notes)
    assert "the object moved" in said
    assert "--delay" not in said
