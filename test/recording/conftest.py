"""Streams for the tests of recordings, one of each kind, and the bag that holds them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.recording import ImuStream, JointStream, PoseStream, WrenchStream, write_recording

START = 1_700_000_000_123_456_789
URDF = "<robot name='sample'/>"


@pytest.fixture(scope="session")
def streams():
    """Streams by topic."""
    rng = np.random.default_rng(5)
    fast = START + np.arange(400) * 1_000_000
    slow = fast[::10]
    nothing = np.full((40, 3), np.nan)
    rotations = Rotation.random(40, rng=rng).as_matrix()
    return {
        "wrench": WrenchStream(fast, rng.normal(size=(400, 6)), "ft_sensor"),
        "joint_states": JointStream(slow, ("a", "b", "c"), rng.normal(size=(40, 3)), rng.normal(size=(40, 3)), nothing),
        "tf": PoseStream(slow, rotations, rng.normal(size=(40, 3)), "base", "ft_sensor"),
        "tf_static": PoseStream(slow[:1], rotations[:1], rng.normal(size=(1, 3)), "ft_sensor", "imu"),
        "imu": ImuStream(slow, nothing, rng.normal(size=(40, 3)), "imu"),
        "odom": PoseStream(slow, rotations, rng.normal(size=(40, 3)), "odom", "base"),
    }


@pytest.fixture(scope="session")
def bag(streams, tmp_path_factory):
    """A bag of these streams; not to be changed."""
    path = tmp_path_factory.mktemp("bag") / "sample.mcap"
    write_recording(path, streams, robot_description=URDF, metadata={"poise": {"gravity": "9.82085"}})
    return path
