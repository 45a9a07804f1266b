"""sensor_msgs/CompressedImage as image_transport writes it: JPEG and PNG, and depth as PNG or RVL behind a header.

RVL is run-length coding of Wilson (2017, Fast lossless depth image compression): counts of zeros and of known pixels,
and the differences between these, each as nibbles of three bits.
"""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError

_HEADER = np.dtype([("format", "<i4"), ("quantised", "<f4", 2)])
"""Of compressed_depth_image_transport: how 32FC1 was made 16 bits of inverse depth."""
_PNG, _JPEG = b"\x89PNG", b"\xff\xd8"
_MOST_PIXELS = 67_108_864
DEPTH_TRANSPORT = "compressedDepth"


def is_depth(layout: str) -> bool:
    """Whether the format of a CompressedImage says that it holds depth."""
    return DEPTH_TRANSPORT in layout or layout.split(";")[0].strip() in ("16UC1", "32FC1", "mono16")


def decompressed(layout: str, data: bytes, name: str) -> tuple[str, NDArray[Any]]:
    """The encoding of sensor_msgs, and (H, W) depth or (H, W, 3) RGB.

    Args:
        layout: field `format`, such as "rgb8; jpeg compressed bgr8" or "16UC1; compressedDepth rvl".
        data: field `data`.
        name: of the topic.

    Raises:
        InputError: TYPE_MISMATCH for bytes that are no such image, UNSUPPORTED for one that is too large.
    """
    encoding = layout.split(";")[0].strip()
    if DEPTH_TRANSPORT in layout:
        encoding = encoding if encoding in ("16UC1", "32FC1", "mono16") else "16UC1"
        return encoding, _depth(encoding, data, "rvl" in layout.lower(), name)
    pixels = _picture(data, name)
    if pixels.ndim == 2:
        return ("16UC1", pixels) if pixels.dtype == np.uint16 else ("mono8", np.repeat(pixels[..., None], 3, axis=2))
    return "rgb8", pixels


def _depth(encoding: str, data: bytes, rvl: bool, name: str) -> NDArray[Any]:
    if len(data) <= _HEADER.itemsize:
        raise _broken(name, f"{len(data)} bytes")
    header, body = np.frombuffer(data[: _HEADER.itemsize], _HEADER)[0], data[_HEADER.itemsize :]
    steps = _run_length(body, name) if rvl or not body.startswith(_PNG) else _picture(body, name)
    if steps.ndim != 2:
        raise _broken(name, "a picture in colour in the place of depth")
    if encoding != "32FC1":
        return steps.astype(np.uint16)
    scale, offset = (float(value) for value in header["quantised"])
    with np.errstate(divide="ignore", invalid="ignore"):
        metres = scale / (steps.astype(np.float32) - offset)
    return np.where((steps > 0) & np.isfinite(metres), metres, 0).astype(np.float32)


def _picture(data: bytes, name: str) -> NDArray[Any]:
    """(H, W) uint8 or uint16, or (H, W, 3) RGB of a PNG or JPEG file."""
    from PIL import Image as Picture
    from PIL import UnidentifiedImageError

    if not data.startswith((_PNG, _JPEG)):
        raise _broken(name, "neither PNG nor JPEG")
    try:
        with Picture.open(io.BytesIO(data), formats=("PNG", "JPEG")) as picture:
            if picture.width * picture.height > _MOST_PIXELS:
                raise InputError(ErrorCode.UNSUPPORTED, f"{name}: {picture.width} x {picture.height} pixels")
            deep = picture.mode.startswith("I")
            pixels = np.asarray(picture if deep or picture.mode == "L" else picture.convert("RGB"))
    except (UnidentifiedImageError, Picture.DecompressionBombError, OSError, SyntaxError, ValueError) as error:
        raise _broken(name, str(error)) from error
    return pixels.astype(np.uint16) if deep else pixels


def _run_length(body: bytes, name: str) -> NDArray[np.uint16]:
    """(H, W) of RVL: columns and rows, then 32-bit words of nibbles, the first in the highest bits."""
    if len(body) < 8:
        raise _broken(name, f"{len(body)} bytes of RVL")
    width, height = (int(value) for value in np.frombuffer(body[:8], "<u4"))
    if not 0 < width * height <= _MOST_PIXELS:
        raise _broken(name, f"RVL of {width} x {height} pixels")
    words = np.frombuffer(body[8 : 8 + (len(body) - 8) // 4 * 4], "<u4")
    nibbles = ((words[:, None] >> np.arange(28, -4, -4, dtype=np.uint32)) & 15).astype(np.int64).ravel()
    ends = np.flatnonzero(nibbles < 8)
    starts = np.append(0, ends[:-1] + 1)[: len(ends)]
    place = np.arange(len(nibbles)) - np.repeat(starts, np.diff(np.append(starts, len(nibbles)))) if len(ends) else []
    values = np.add.reduceat((nibbles & 7) << (3 * np.minimum(place, 20)), starts) if len(ends) else np.zeros(0, int)
    pixels, at, number = np.zeros(width * height, np.int64), 0, 0
    deltas, places = [], []
    while at < len(pixels):
        if number + 2 > len(values):
            raise _broken(name, f"RVL that ends after {at} of {len(pixels)} pixels")
        zeros, known = int(values[number]), int(values[number + 1])
        own = values[number + 2 : number + 2 + known]
        at += zeros
        if len(own) < known or at + known > len(pixels):
            raise _broken(name, f"RVL whose runs leave its {width} x {height} pixels")
        deltas.append(own)
        places.append(np.arange(at, at + known))
        at, number = at + known, number + 2 + known
        if not zeros and not known:
            raise _broken(name, "RVL with an empty run")
    packed = np.concatenate([np.zeros(0, np.int64), *deltas])
    pixels[np.concatenate([np.zeros(0, np.int64), *places])] = np.cumsum((packed >> 1) ^ -(packed & 1))
    return pixels.astype(np.uint16).reshape(height, width)


def _broken(name: str, what: str) -> InputError:
    return InputError(
        ErrorCode.TYPE_MISMATCH, f"{name}: a compressed image does not decode ({what}); record it again, or record raw"
    )
