"""A bag as a source of messages: the bytes as they were recorded."""

from collections.abc import Collection, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

from poise.errors import ErrorCode, InputError
from poise.fake_robots.stream import Message, TopicInfo
from poise.recording import LATCHED_TOPICS, open_recording

_BEHIND, _LARGE_BEHIND = 20_000, 1000
"""Messages by which a subscriber on a busy machine may be behind; of large ones fewer, because each is kept."""
_LARGE = ("Image", "CompressedImage", "PointCloud2")


class BagSource:
    """The messages of a bag on relative topics; a leading slash falls off, so that a namespace and remappings apply.

    Args:
        path: the bag.
        topics: those to replay, as in the bag; empty: all.
        refuse_unknown: raise for a topic whose type is not installed; otherwise it is left out and named in `remarks`.

    Raises:
        InputError: as `open_recording`; TOPIC_MISSING when the bag lacks a topic; UNSUPPORTED when a type is not
            installed (refuse_unknown), or no topic is left.
    """

    def __init__(self, path: str | Path, topics: Collection[str] = (), refuse_unknown: bool = False) -> None:
        self._recording = open_recording(path)
        self.remarks = [loss.sentence for loss in self._recording.losses]
        names = sorted({self._recording.topic(name).name for name in topics} or self._recording.topics)
        self._relative: dict[str, str] = {}
        self.topics: dict[str, TopicInfo] = {}
        for name in names:
            topic = self._recording.topic(name)
            problem = _why_not(topic.type, topic.encoding)
            if problem:
                sentence = f"{path}: topic {name} cannot be replayed: {problem}"
                if refuse_unknown:
                    raise InputError(ErrorCode.UNSUPPORTED, f"{sentence}; or set refuse_unknown to false")
                self.remarks.append(f"{sentence}; left out")
                continue
            relative = name.strip("/")
            self._relative[name] = relative
            latched = _is_latched(relative, dict(topic.metadata))
            behind = _LARGE_BEHIND if topic.type.rpartition("/")[2] in _LARGE else _BEHIND
            depth = max(self._recording.counts[name], 1) if latched else behind
            self.topics[relative] = TopicInfo(topic.type, latched, depth)
        if not self.topics:
            raise InputError(ErrorCode.UNSUPPORTED, f"{path}: no topic can be replayed: {'; '.join(self.remarks)}")

    def messages(self) -> Iterator[Message]:
        """All messages in the order of their log times."""
        for message in self._recording.messages(self._relative):
            yield Message(message.log_time, self._relative[message.topic], message.data)


def message_class(type_name: str) -> Any:
    """The Python class of a message type such as geometry_msgs/msg/WrenchStamped.

    Raises:
        InputError: UNSUPPORTED when its package is not installed.
    """
    package, _, name = type_name.partition("/msg/")
    if package.isidentifier() and name.isidentifier():
        try:
            return getattr(import_module(f"{package}.msg"), name)
        except (ImportError, AttributeError):
            pass
    raise InputError(ErrorCode.UNSUPPORTED, f"message type {type_name or '(none)'} is not installed")


def _why_not(type_name: str, encoding: str) -> str:
    if encoding != "cdr":
        return f"its messages are encoded as {encoding or 'nothing'}, not cdr"
    try:
        message_class(type_name)
    except InputError as error:
        return error.message
    return ""


def _is_latched(relative: str, metadata: dict[str, str]) -> bool:
    """By its name, or by the QoS that it was recorded with."""
    if relative.rpartition("/")[2] in LATCHED_TOPICS:
        return True
    try:
        profiles = yaml.safe_load(metadata.get("offered_qos_profiles", ""))
    except yaml.YAMLError:
        return False
    profiles = profiles if isinstance(profiles, list) else []
    # rosbag2 wrote numbers up to version 8 of its metadata, words since.
    return any(
        isinstance(profile, dict) and profile.get("durability") in (1, "transient_local") for profile in profiles
    )
