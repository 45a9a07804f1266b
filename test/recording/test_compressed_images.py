"""sensor_msgs/CompressedImage: what image_transport writes is read, and damaged bytes are refused."""

import zlib
from types import SimpleNamespace

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.fake_robots.compressing import depth_png, depth_rvl, picture_bytes
from poise.recording import encoding_of, image_of


def depths():
    """Millimetres with holes, steps and a slope."""
    rng = np.random.default_rng(3)
    steps = (600 + 0.5 * np.arange(90)[None] + 40 * (np.arange(70)[:, None] > 30)).astype(np.uint16)
    steps = (steps + rng.integers(0, 3, steps.shape)).astype(np.uint16)
    steps[rng.random(steps.shape) < 0.1] = 0
    steps[20:40, 50:] = 0
    return steps


def message(layout, data):
    header = SimpleNamespace(frame_id="optical", stamp=SimpleNamespace(sec=1, nanosec=5))
    return SimpleNamespace(header=header, format=layout, data=data)


def refusal(layout, data):
    with pytest.raises(InputError) as caught:
        image_of(message(layout, data), "camera/depth")
    assert "camera/depth" in caught.value.message
    return caught.value


@pytest.mark.parametrize("encode", [depth_png, depth_rvl])
@pytest.mark.parametrize("first", [0, 1], ids=["hole first", "depth first"])
def test_integer_depth_comes_back_exactly(encode, first):
    steps = depths()
    steps[0, 0] = 700 * first
    suffix = " rvl" if encode is depth_rvl else ""
    found = image_of(message("16UC1; compressedDepth" + suffix, encode(steps)), "depth")
    assert (found.stamp, found.frame_id, found.encoding) == (1_000_000_005, "optical", "16UC1")
    np.testing.assert_array_equal(found.pixels, steps)


@pytest.mark.parametrize("steps", [np.zeros((4, 6), np.uint16), np.full((4, 6), 65535, np.uint16)])
def test_run_lengths_of_one_run(steps):
    np.testing.assert_array_equal(image_of(message("16UC1; compressedDepth rvl", depth_rvl(steps)), "d").pixels, steps)


@pytest.mark.parametrize("encode", [depth_png, depth_rvl])
def test_float_depth_comes_back_from_its_inverse(encode):
    metres = depths().astype(np.float32) * np.float32(1e-3)
    metres[metres == 0] = np.nan
    scale, offset = 100.0 * 101.0, -100.0  # of compressed_depth_image_transport: depth_quantization 100
    quantised = np.where(np.isfinite(metres), np.round(scale / np.nan_to_num(metres, nan=1.0) + offset), 0)
    found = image_of(message("32FC1; compressedDepth", encode(quantised.astype(np.uint16), (scale, offset))), "depth")
    assert found.encoding == "32FC1"
    np.testing.assert_array_equal(found.pixels == 0, ~np.isfinite(metres))
    np.testing.assert_allclose(found.pixels[found.pixels > 0], metres[np.isfinite(metres)], atol=1e-4)


def test_colours_come_back_as_rgb():
    pixels = np.zeros((40, 50, 3), np.uint8)
    pixels[:, :25], pixels[:, 25:] = (200, 40, 10), (20, 60, 180)
    for layout, kind in (
        ("bgr8; jpeg compressed bgr8", "JPEG"),
        ("rgb8; png compressed bgr8", "PNG"),
        ("jpeg", "JPEG"),
    ):
        found = image_of(message(layout, picture_bytes(pixels, kind)), "colour")
        assert found.encoding == "rgb8"
        assert np.abs(found.pixels[:, 5:20].astype(int) - pixels[:, 5:20]).max() < 6
    grey = image_of(message("mono8; jpeg compressed ", picture_bytes(pixels[..., 0], "JPEG")), "colour")
    assert grey.encoding == "mono8"
    assert grey.pixels.shape == (40, 50, 3)


def test_depth_as_a_plain_png_is_depth():
    found = image_of(message("16UC1; png compressed ", picture_bytes(depths(), "PNG")), "depth")
    assert found.encoding == "16UC1"
    np.testing.assert_array_equal(found.pixels, depths())


def test_the_encoding_is_told_without_decoding():
    for layout, encoding in (
        ("16UC1; compressedDepth", "16UC1"), ("32FC1; compressedDepth png", "32FC1"),
        ("16UC1; png compressed ", "16UC1"),
        ("bgr8; jpeg compressed bgr8", "bgr8"), ("jpeg", ""),
    ):  # fmt: skip
        assert encoding_of(message(layout, b"")) == encoding


@pytest.mark.parametrize(
    ("layout", "data"),
    [
        ("16UC1; compressedDepth", b""),
        ("16UC1; compressedDepth", depth_png(depths())[:200]),
        ("16UC1; compressedDepth", bytes(12) + picture_bytes(np.zeros((4, 4, 3), np.uint8), "PNG")),
        ("16UC1; compressedDepth rvl", depth_rvl(depths())[:400]),
        ("16UC1; compressedDepth rvl", depth_rvl(depths())[:16]),
        ("16UC1; compressedDepth rvl", depth_rvl(depths())[:20] + b"\x88" * 4000),
        ("16UC1; compressedDepth rvl", bytes(12) + b"\xff" * 400),
        ("bgr8; jpeg compressed bgr8", picture_bytes(np.zeros((40, 50, 3), np.uint8), "JPEG")[:150]),
        ("bgr8; jpeg compressed bgr8", b"GIF89a" + bytes(50)),
    ],
    ids=[
        "empty", "cut PNG", "colours", "cut RVL", "short RVL", "overlong RVL values", "huge RVL", "cut JPEG", "GIF",
    ],
)  # fmt: skip
def test_damaged_images_are_refused(layout, data):
    error = refusal(layout, data)
    assert error.code == ErrorCode.TYPE_MISMATCH
    assert "record it again" in error.message


def test_a_picture_of_very_many_pixels_is_refused():
    width = (10**6).to_bytes(4, "big")
    data = picture_bytes(np.zeros((4, 4), np.uint8), "PNG")

    chunk = b"IHDR" + width + width + data[24:29]
    huge = data[:12] + chunk + zlib.crc32(chunk).to_bytes(4, "big") + data[33:]
    assert refusal("mono8; png compressed ", huge).code in (ErrorCode.UNSUPPORTED, ErrorCode.TYPE_MISMATCH)
