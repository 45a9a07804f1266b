"""Camera topics of a bag: images, camera info and point clouds, decoded one by one as they are asked for."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.recording.compressed_images import decompressed, is_depth
from poise.recording.encoding import typestore
from poise.recording.reading import Recording
from poise.recording.streams import stamp_of

IMAGE, INFO, CLOUD = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
_PIXELS = {
    "16UC1": ("u2", 1), "mono16": ("u2", 1), "32FC1": ("f4", 1), "mono8": ("u1", 1), "8UC1": ("u1", 1),
    "rgb8": ("u1", 3), "bgr8": ("u1", 3), "8UC3": ("u1", 3), "rgba8": ("u1", 4), "bgra8": ("u1", 4),
}  # fmt: skip
"""Type and channels by the encodings of sensor_msgs."""
_REVERSED = ("bgr8", "bgra8", "8UC3")


class Image(NamedTuple):
    """An image: ns, frame, encoding of sensor_msgs, (H, W) depth or (H, W, 3) RGB."""

    stamp: int
    frame_id: str
    encoding: str
    pixels: NDArray[Any]


def stamps_of(recording: Recording, topic: str) -> NDArray[np.int64]:
    """(N,) ns: the header stamps of any topic whose messages begin with a header, in the order of the bag."""
    stamps = []
    for message in recording.messages([topic]):
        order = "<" if len(message.data) > 1 and message.data[1] else ">"
        if len(message.data) < 12:
            raise _undecodable(recording, topic, "it is too short")
        seconds, rest = np.frombuffer(message.data[4:12], f"{order}u4")
        stamps.append(int(np.int32(np.uint32(seconds))) * 10**9 + int(rest))
    return np.array(stamps, dtype=np.int64)


def messages_of(recording: Recording, topic: str) -> Iterator[Any]:
    """The decoded messages of a topic, in the order of the bag.

    Raises:
        InputError: TOPIC_MISSING, UNSUPPORTED, TYPE_MISMATCH for a message that does not decode.
    """
    kind = recording.topic(topic).type
    for message in recording.messages([topic]):
        yield decoded(recording, kind, topic, message.data)


def decoded(recording: Recording, kind: str, topic: str, data: bytes) -> Any:
    """One message.

    Raises:
        InputError: TYPE_MISMATCH.
    """
    try:
        return typestore().deserialize_cdr(data, kind)
    except Exception as error:  # whatever broken bytes provoke
        raise _undecodable(recording, topic, repr(error)) from error


def image_of(message: Any, name: str) -> Image:
    """From the fields of sensor_msgs/Image or CompressedImage; of a decoded or of a live message.

    Raises:
        InputError: UNSUPPORTED for an encoding that is not read, TYPE_MISMATCH for fewer bytes than there should be.
    """
    if hasattr(message, "format"):
        encoding, decoded_pixels = decompressed(str(message.format), bytes(message.data), name)
        return Image(stamp_of(message), str(message.header.frame_id), encoding, decoded_pixels)
    encoding = str(message.encoding)
    if encoding not in _PIXELS:
        raise InputError(ErrorCode.UNSUPPORTED, f"{name}: encoding {encoding!r}; there are {', '.join(_PIXELS)}")
    kind, channels = _PIXELS[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(message.data, np.uint8)
    row = width * channels * np.dtype(kind).itemsize
    if step < row or len(data) < step * height or not height * width:
        raise InputError(
            ErrorCode.TYPE_MISMATCH,
            f"{name}: {len(data)} bytes for {width} x {height} {encoding} with a step of {step}: fix its publisher",
        )
    rows = data[: step * height].reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows).view((">" if message.is_bigendian else "<") + kind)
    if channels > 1:
        pixels = pixels.reshape(height, width, channels)[..., :3]
        pixels = pixels[..., ::-1] if encoding in _REVERSED else pixels
    elif kind == "u1":
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    return Image(stamp_of(message), str(message.header.frame_id), encoding, np.ascontiguousarray(pixels))


def encoding_of(message: Any) -> str:
    """What an Image or CompressedImage holds: an encoding of sensor_msgs; empty when only its pixels show that."""
    if not hasattr(message, "format"):
        return str(message.encoding)
    layout = str(message.format)
    encoding = layout.split(";")[0].strip()
    return (encoding or "16UC1") if is_depth(layout) else encoding if encoding in _PIXELS else ""


def _undecodable(recording: Recording, topic: str, why: str) -> InputError:
    return InputError(
        ErrorCode.TYPE_MISMATCH, f"{recording.path}: a message of {topic} does not decode ({why}): record it again"
    )
