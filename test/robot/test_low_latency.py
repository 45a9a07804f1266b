"""The motion with low latency: accelerations beside a gap are not used."""

from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from poise.robot import PairingSettings
from poise.robot.low_latency import LowLatencyMotion
from poise.robot.sources import StampedPoses


def test_accelerations_right_after_a_gap_are_as_good_as_elsewhere():
    rng = np.random.default_rng(2)
    at = np.arange(0.0, 2.0, 0.005)
    at = at[(at < 1.0) | (at > 1.03)]
    stamps = np.round(at * 1e9).astype(np.int64)
    moved = 0.3 * np.sin(2 * at)[:, None] * np.ones(3) + 1e-4 * rng.normal(size=(len(at), 3))
    turned = Rotation.from_rotvec(np.outer(np.sin(at), [0.5, 0.0, 0.0])).as_matrix()
    source = SimpleNamespace(newest=None)

    def poses(begin: int, end: int) -> StampedPoses:
        some = (stamps >= begin) & (stamps <= end)
        return StampedPoses(stamps=stamps[some], rotation=turned[some], translation=moved[some])

    source.poses = poses
    motion = LowLatencyMotion(source, PairingSettings())
    for newest in stamps[20:]:
        source.newest = int(newest)
        motion.update()
    found, reasons = motion.pair(stamps[(at > 0.2) & (at < 1.9)])
    known = reasons == ""
    true = -1.2 * np.sin(2e-9 * found.stamps[known])[:, None]
    linear = np.einsum("nij,nj->ni", found.rotation_world_sensor, found.linear_acceleration_in_sensor)[known]
    assert known.mean() > 0.8
    assert np.abs(linear - true).max() < 2.0
