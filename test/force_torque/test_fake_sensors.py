"""The sensors that are not there, as programs of their own."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from poise.fake_robots.wrench_source import WrenchSource
from poise.force_torque import robotiq
from poise.force_torque.link import Link
from poise.force_torque.rdt_link import RdtLink, RdtOptions
from poise.force_torque.robotiq_link import RobotiqStreamLink
from poise.force_torque.samples import Calibration, Samples
from poise.recording import open_recording

BAG = Path(__file__).parents[2] / "bags" / "kuka_at_rest.mcap"


@contextmanager
def program(module: str, *arguments: str) -> Iterator[str]:
    """Run a module as a program until Ctrl-C; give the line in which it says where it is."""
    command = [sys.executable, "-m", f"poise.fake_robots.{module}", *arguments]
    heeding = signal.signal(signal.SIGINT, signal.default_int_handler)  # a test run in the background inherits deafness
    try:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, heeding)
    assert process.stdout is not None
    try:
        yield process.stdout.readline()
    finally:
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(20.0) == 0
        finally:
            process.kill()
            process.stdout.close()


def first_samples(link: Link) -> Samples:
    link.start()
    end = time.monotonic() + 20.0
    while not len(samples := link.read(0.1)):
        assert time.monotonic() < end
    link.close()
    return samples


def test_an_rdt_sensor_replays_a_bag_until_ctrl_c() -> None:
    with program("rdt_sensor", "--bag", str(BAG), "--port", "0", "--http-port", "0", "--rate", "1000") as line:
        ports = re.search(r"127\.0\.0\.1:(\d+), page at http://127\.0\.0\.1:(\d+)/", line)
        assert ports is not None
        samples = first_samples(RdtLink(RdtOptions("127.0.0.1", int(ports[1]), int(ports[2]))))
    recorded = open_recording(BAG).wrench().wrench_in_sensor
    assert np.all(samples.wrench_in_sensor >= recorded.min(axis=0) - 1e-6)
    assert np.all(samples.wrench_in_sensor <= recorded.max(axis=0) + 1e-6)


def test_a_robotiq_sensor_runs_until_ctrl_c() -> None:
    with program("robotiq_sensor") as line:
        calibration = Calibration.from_counts(robotiq.COUNTS_PER_NEWTON, robotiq.COUNTS_PER_NEWTON_METRE)
        samples = first_samples(RobotiqStreamLink(line.split(" at ")[1].strip(), calibration))
    np.testing.assert_allclose(samples.wrench_in_sensor[0], [0, 0, -10, 0, 0, 0])


def test_a_source_begins_again_after_its_last_sample() -> None:
    source = WrenchSource(np.arange(18).reshape(3, 6))
    assert source.samples(2, 3)[:, 0].tolist() == [12, 0, 6]
    with pytest.raises(ValueError, match="six numbers"):
        WrenchSource(np.zeros((3, 5)))
