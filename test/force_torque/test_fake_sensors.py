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

from poise.force_torque.sensors.ati_rdt.link import RdtLink, RdtOptions
from poise.force_torque.sensors.robotiq import protocol as robotiq
from poise.force_torque.sensors.robotiq.link import RobotiqStreamLink
from poise.force_torque.wire import Calibration, Link, SensorSamples, WrenchSource
from poise.recording import open_recording

BAG = Path(__file__).parents[2] / "bags" / "kuka_at_rest.mcap"


@contextmanager
def program(*arguments: str) -> Iterator[str]:
    """Run a fake sensor as a program until Ctrl-C; give the line with the driver's parameters."""
    command = [sys.executable, "-m", "poise.fake_robots.fake_sensor", *arguments]
    heeding = signal.signal(signal.SIGINT, signal.default_int_handler)  # a test run in the background ignores SIGINT
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


def first_samples(link: Link) -> SensorSamples:
    link.start()
    end = time.monotonic() + 20.0
    while not len(samples := link.read(0.1)):
        assert time.monotonic() < end
    link.close()
    return samples


def test_an_rdt_sensor_replays_a_bag_until_ctrl_c() -> None:
    with program("rdt", "--bag", str(BAG), "--set", "rate=1000") as line:
        ports = re.search(r"-p port:=(\d+) -p http_port:=(\d+)", line)
        assert ports is not None
        samples = first_samples(RdtLink(RdtOptions("127.0.0.1", int(ports[1]), int(ports[2]))))
    recorded = open_recording(BAG).wrench().wrench_in_sensor
    assert np.all(samples.wrench_in_sensor >= recorded.min(axis=0) - 1e-6)
    assert np.all(samples.wrench_in_sensor <= recorded.max(axis=0) + 1e-6)


def test_a_robotiq_sensor_runs_until_ctrl_c() -> None:
    with program("robotiq_serial") as line:
        calibration = Calibration.from_counts(robotiq.COUNTS_PER_NEWTON, robotiq.COUNTS_PER_NEWTON_METRE)
        samples = first_samples(RobotiqStreamLink(line.split("address:=")[1].strip(), calibration))
    np.testing.assert_allclose(samples.wrench_in_sensor[0], [0, 0, -10, 0, 0, 0])


def test_a_source_begins_again_after_its_last_sample() -> None:
    source = WrenchSource(np.arange(18).reshape(3, 6))
    assert source.samples(2, 3)[:, 0].tolist() == [12, 0, 6]
    with pytest.raises(ValueError, match="six numbers"):
        WrenchSource(np.zeros((3, 5)))
