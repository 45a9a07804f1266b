"""Which topics of a bag carry depth, colours and their cameras."""

from collections.abc import Sequence
from dataclasses import dataclass

from poise.errors import ErrorCode, InputError
from poise.recording import CLOUD, COMPRESSED, IMAGE, INFO, Recording, encoding_of, messages_of

_DEPTHS = ("16UC1", "mono16", "32FC1")


@dataclass(frozen=True)
class CameraTopics:
    """Names of topics.

    Args:
        cloud: whether `depth` is a PointCloud2; it has no others then.
        depth: of the depth images, raw or compressed.
        info: its camera.
        colour, colour_info: empty without.
    """

    cloud: bool
    depth: str
    info: str = ""
    colour: str = ""
    colour_info: str = ""


def find_topics(recording: Recording, depth: str = "", colour: str = "", info: str = "") -> CameraTopics:
    """Find them by their types and encodings; of several, those that are named most like aligned depth and colour.

    Args:
        recording: the bag.
        depth, colour, info: topics that are given; empty: found.

    Raises:
        InputError: TOPIC_MISSING, naming the topics of the bag; TYPE_MISMATCH and EMPTY for a topic that is given.
    """
    given = _given(recording, depth, (CLOUD, IMAGE, COMPRESSED))
    if given and recording.topic(depth).type == CLOUD:
        return CameraTopics(True, given)
    images = _of_type(recording, IMAGE) + _of_type(recording, COMPRESSED)
    encodings = {name: encoding_of(next(messages_of(recording, name))) for name in images}
    depths = [name for name in images if encodings[name] in _DEPTHS]
    found = given or _best(depths, ("aligned", "depth"))
    if not found:
        clouds = _of_type(recording, CLOUD)
        if clouds:
            return CameraTopics(True, _best(clouds, ("depth",)))
        there = ", ".join(f"{name} ({kind})" for name, kind in recording.topics.items())
        raise InputError(
            ErrorCode.TOPIC_MISSING,
            f"{recording.path} has no depth: record the depth image, raw or compressedDepth, with its camera_info, or a"
            f" PointCloud2; it has {there}",
        )
    colours = [name for name in images if name not in depths]
    painted = _given(recording, colour, (IMAGE, COMPRESSED)) or _best(colours, ("color", "rgb"))
    infos = _of_type(recording, INFO)
    camera = _given(recording, info, (INFO,)) or _nearest_name(infos, found)
    if not camera:
        raise InputError(
            ErrorCode.TOPIC_MISSING,
            f"{recording.path} has no camera_info, without which {found} has no rays: record the camera_info of the"
            " depth",
        )
    return CameraTopics(False, found, camera, painted, _nearest_name(infos, painted) if painted else "")


def _given(recording: Recording, name: str, kinds: tuple[str, ...]) -> str:
    """The topic of that name; empty without.

    Raises:
        InputError: TOPIC_MISSING, TYPE_MISMATCH, EMPTY.
    """
    if not name:
        return ""
    topic = recording.topic(name)
    if topic.type not in kinds:
        raise InputError(
            ErrorCode.TYPE_MISMATCH, f"{recording.path}: {topic.name} is {topic.type}; give one of {', '.join(kinds)}"
        )
    if not recording.counts[topic.name]:
        raise InputError(ErrorCode.EMPTY, f"{recording.path}: {topic.name} has no messages: record it again")
    return topic.name


def _of_type(recording: Recording, kind: str) -> list[str]:
    return [name for name, own in recording.topics.items() if own == kind and recording.counts[name]]


def _best(names: Sequence[str], words: Sequence[str]) -> str:
    """The name that holds most of these words; empty when there is none."""
    return max(names, key=lambda name: sum(word in name for word in words), default="")


def _nearest_name(infos: Sequence[str], image: str) -> str:
    """The camera info beside an image, else the one whose name shares most of its folders."""
    folders = image.split("/")[:-1]
    if folders and folders[-1].startswith("image"):  # image_raw/compressedDepth
        folders = folders[:-1]
    folder = "/".join(folders)
    inside = [name for name in infos if name.rpartition("/")[0] == folder]
    return inside[0] if inside else _best(infos, tuple(folders))
