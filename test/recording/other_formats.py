"""The sample recording of the tests in the other formats that are read, written by rosbags."""

from pathlib import Path

import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from poise.recording import open_recording

JAZZY, NOETIC = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
NOETIC.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
PLUGINS = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}


def write_rosbag2(source: Path, folder: Path, storage: str, compression: str = "none") -> Path:
    """Write the messages of a recording as a rosbag2 folder."""
    recording = open_recording(source)
    writer = Writer2(folder, version=9, storage_plugin=PLUGINS[storage])
    if compression != "none":
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        connections = {
            name: writer.add_connection(name, kind, typestore=JAZZY) for name, kind in recording.topics.items()
        }
        for message in recording.messages():
            writer.write(connections[message.topic], message.log_time, message.data)
    return folder


def write_splits(source: Path, folder: Path, storage: str) -> Path:
    """Write the messages as a rosbag2 folder of three files, the later ones in the order of recording."""
    recording = open_recording(source)
    messages = list(recording.messages())
    listed = []
    folder.mkdir()
    for number in range(3):
        part = folder.parent / f"part_{number}"
        first, last = len(messages) * number // 3, len(messages) * (number + 1) // 3
        with Writer2(part, version=9, storage_plugin=PLUGINS[storage]) as writer:
            connections = {
                name: writer.add_connection(name, kind, typestore=JAZZY) for name, kind in recording.topics.items()
            }
            for message in messages[first:last]:
                writer.write(connections[message.topic], message.log_time, message.data)
        file = next(path for path in part.iterdir() if path.suffix == f".{storage}")
        listed.append(f"bag_{10 + number if number else 9}.{storage}")
        file.rename(folder / listed[-1])
    identifier = {"db3": "sqlite3", "mcap": "mcap"}[storage]
    information = {"storage_identifier": identifier, "compression_mode": "", "relative_file_paths": listed}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    return folder


def write_ros1(source: Path, path: Path, compression: str = "none") -> Path:
    """Write the messages as a ROS 1 bag; headers get the sequence number 0."""
    recording = open_recording(source)
    writer = Writer1(path)
    if compression != "none":
        writer.set_compression(Writer1.CompressionFormat[compression])
    with writer:
        connections = {
            name: writer.add_connection("/" + name, kind, typestore=NOETIC) for name, kind in recording.topics.items()
        }
        for message in recording.messages():
            kind = recording.topics[message.topic]
            data = JAZZY.cdr_to_ros1(message.data, kind)
            writer.write(connections[message.topic], message.log_time, data)
    return path
