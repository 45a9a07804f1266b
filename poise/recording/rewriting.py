"""A bag again with some of its streams replaced, everything else as it was, byte for byte."""

import heapq
from collections.abc import Iterator, Mapping
from pathlib import Path

from poise.recording.encoding import encode_stream, message_type_of
from poise.recording.reading import Recording
from poise.recording.streams import Stream
from poise.recording.writing import RecordingWriter

Message = tuple[int, str, bytes]


def rewrite_recording(recording: Recording, path: str | Path, streams: Mapping[str, Stream]) -> None:
    """Write a recording with other samples on some of its topics.

    Args:
        recording: what is kept: every message of the other topics, and the metadata.
        path: the .mcap file; one that exists is replaced once all is written.
        streams: by topic, as `Recording.topic` finds them.

    Raises:
        InputError: TOPIC_MISSING, FILE_UNWRITABLE.
    """
    replaced = {recording.topic(name).name: stream for name, stream in streams.items()}
    kept = [name for name in recording.topics if name not in replaced]
    with RecordingWriter(path, metadata=recording.metadata) as writer:
        for name in recording.topics:
            if name in replaced:
                writer.add_topic(name, message_type_of(name, replaced[name]))
            else:
                topic = recording.topic(name)
                writer.add_topic(
                    name,
                    topic.type,
                    definition=topic.definition,
                    definition_encoding=topic.definition_encoding,
                    metadata=dict(topic.metadata),
                )
        others: Iterator[Message] = ((raw.log_time, raw.topic, raw.data) for raw in recording.messages(kept))
        new = [_named(name, stream) for name, stream in replaced.items()]
        for stamp, name, data in heapq.merge(others, *new, key=lambda message: message[0]):
            writer.write(name, stamp, data)


def _named(topic: str, stream: Stream) -> Iterator[Message]:
    for stamp, data in encode_stream(topic, stream):
        yield stamp, topic, data
