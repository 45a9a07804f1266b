"""A bag is written whole or not at all."""

import subprocess
import sys

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.recording import ImuStream, RecordingWriter, WrenchStream, open_recording, write_recording

TYPE = "geometry_msgs/msg/WrenchStamped"

FILL_THE_DISK = """
import resource, sys
import numpy as np
from poise.errors import InputError
from poise.recording import WrenchStream, write_recording
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
rng = np.random.default_rng(0)
stream = WrenchStream(np.arange(20_000), rng.normal(size=(20_000, 6)), "ft_sensor")
try:
    write_recording(sys.argv[1], {"wrench": stream}, compression=sys.argv[3])
except InputError as error:
    print(error.code.name, error.message)
    sys.exit(error.exit_status)
"""


@pytest.mark.parametrize("compression", ["none", "zstd"])
@pytest.mark.parametrize("limit", [10, 100_000, 600_000])
def test_a_disk_that_fills_is_an_error_and_leaves_nothing(tmp_path, limit, compression):
    path = tmp_path / "bag.mcap"
    command = [sys.executable, "-c", FILL_THE_DISK, str(path), str(limit), compression]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    assert done.stdout.startswith(f"FILE_UNWRITABLE {path} cannot be written: File too large")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_fills_leaves_the_older_bag_as_it_was(tmp_path, streams):
    path = tmp_path / "bag.mcap"
    write_recording(path, {"wrench": streams["wrench"]})
    before = path.read_bytes()
    command = [sys.executable, "-c", FILL_THE_DISK, str(path), "100000", "none"]
    assert subprocess.run(command, capture_output=True, timeout=60, check=False).returncode == 2
    assert path.read_bytes() == before


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_exception_while_writing_leaves_nothing(tmp_path, error):
    def write_and_fail():
        with RecordingWriter(tmp_path / "bag.mcap") as writer:
            writer.add_topic("wrench", TYPE)
            writer.write("wrench", 1, bytes(76))
            raise error

    with pytest.raises(error):
        write_and_fail()
    assert list(tmp_path.iterdir()) == []


def test_the_bag_appears_only_when_it_is_whole(tmp_path):
    path = tmp_path / "bag.mcap"
    with RecordingWriter(path) as writer:
        writer.add_topic("wrench", TYPE)
        writer.write("wrench", 1, bytes(76))
        assert not path.exists()
    assert open_recording(path, strict=True).counts == {"wrench": 1}


def test_where_a_bag_cannot_be_written_is_said_with_the_reason(tmp_path, streams):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    for path in (tmp_path / "missing" / "bag.mcap", tmp_path / "folder", tmp_path / "file" / "bag.mcap"):
        with pytest.raises(InputError) as caught:
            write_recording(path, {"wrench": streams["wrench"]})
        assert caught.value.code == ErrorCode.FILE_UNWRITABLE
        assert str(path) in caught.value.message
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


def test_what_cannot_be_written_is_refused_before_anything_is_there(tmp_path, streams):
    path = tmp_path / "bag.mcap"
    empty = WrenchStream(np.zeros(0, dtype=int), np.zeros((0, 6)), "ft")
    imu = streams["imu"]
    assert isinstance(imu, ImuStream)
    cases = {
        ErrorCode.EMPTY: lambda: write_recording(path, {"wrench": empty}),
        ErrorCode.TYPE_MISMATCH: lambda: write_recording(path, {"wrench": [streams["wrench"], imu]}),
        ErrorCode.BAD_INPUT: lambda: write_recording(path, {"wrench": streams["wrench"]}, compression="gzip"),
    }
    for code, call in cases.items():
        with pytest.raises(InputError) as caught:
            call()
        assert caught.value.code == code
    assert list(tmp_path.iterdir()) == []


def test_a_topic_has_to_be_announced_with_a_known_type(tmp_path):
    with pytest.raises(InputError, match="call add_topic") as caught, RecordingWriter(tmp_path / "bag") as writer:
        writer.write("wrench", 1, b"")
    assert caught.value.code == ErrorCode.TOPIC_MISSING
    with pytest.raises(InputError, match="give it with the topic"), RecordingWriter(tmp_path / "bag") as writer:
        writer.add_topic("own", "our_msgs/msg/Own")
    with pytest.raises(InputError, match="`with` block"):
        RecordingWriter(tmp_path / "bag").add_topic("wrench", TYPE)
    assert list(tmp_path.iterdir()) == []
