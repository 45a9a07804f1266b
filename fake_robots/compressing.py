"""sensor_msgs/CompressedImage as image_transport's plugins write it, for recordings that never were."""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.fake_robots.sweep_bag import header_of_image
from poise.recording import COMPRESSED, typestore


def depth_png(steps: NDArray[np.uint16], quantised: tuple[float, float] = (0.0, 0.0)) -> bytes:
    """Data of compressedDepth in PNG: header, and (H, W) steps, or 16 bits of inverse depth and how they were made."""
    return _header(quantised) + picture_bytes(steps, "PNG")


def depth_rvl(steps: NDArray[np.uint16], quantised: tuple[float, float] = (0.0, 0.0)) -> bytes:
    """Data of compressedDepth in RVL (Wilson 2017, listing 1): pixel by pixel, as the paper writes it."""
    nibbles: list[int] = []

    def put(value: int) -> None:
        while True:
            low, value = value & 7, value >> 3
            nibbles.append(low | (8 if value else 0))
            if not value:
                return

    pixels, at, before = steps.ravel().tolist(), 0, 0
    while at < len(pixels):
        begin = at
        while at < len(pixels) and pixels[at] == 0:
            at += 1
        put(at - begin)
        begin = at
        while at < len(pixels) and pixels[at] != 0:
            at += 1
        put(at - begin)
        for value in pixels[begin:at]:
            put(2 * (value - before) if value >= before else 2 * (before - value) - 1)
            before = value
    nibbles += [0] * (-len(nibbles) % 8)
    words = np.array(nibbles, np.uint32).reshape(-1, 8) << np.arange(28, -4, -4, dtype=np.uint32)
    size = np.array(steps.shape[::-1], "<u4")
    return _header(quantised) + size.tobytes() + words.sum(axis=1).astype("<u4").tobytes()


def picture_bytes(pixels: NDArray[Any], kind: str, **options: Any) -> bytes:
    """(H, W) or (H, W, 3) pixels as a PNG or JPEG file."""
    from PIL import Image as Picture

    out = io.BytesIO()
    Picture.fromarray(pixels).save(out, format=kind, **options)
    return out.getvalue()


def compressed_bytes(stamp: int, frame: str, layout: str, data: bytes) -> bytes:
    """CDR of sensor_msgs/CompressedImage, at a stamp, ns."""
    message = typestore().types[COMPRESSED](header_of_image(stamp, frame), layout, np.frombuffer(data, np.uint8))
    return bytes(typestore().serialize_cdr(message, COMPRESSED))


def _header(quantised: tuple[float, float]) -> bytes:
    return np.int32(0).tobytes() + np.array(quantised, "<f4").tobytes()
