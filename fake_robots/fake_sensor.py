"""Fake force-torque sensors as programs: any sensor of the registry on loopback or on a pseudo-terminal.

python -m poise.fake_robots.fake_sensor rdt --bag bags/kuka_free_motion.mcap --set rate=7000
"""

import argparse
import contextlib
import threading
from pathlib import Path

import numpy as np

from poise.force_torque.sensors import all_sensors, sensor_named
from poise.force_torque.wire import WrenchSource
from poise.recording import open_recording

_BAG_RATE = 1000.0
"""Hz that a bag is interpolated to when the fake's rate is not set."""


def wrench_source_from_bag(path: Path, rate: float) -> WrenchSource:
    """Replay a bag's wrench, interpolated to `rate` samples a second."""
    stream = open_recording(path).wrench()
    time = (stream.stamps - stream.stamps[0]) * 1e-9
    grid = np.arange(0.0, time[-1], 1.0 / rate)
    return WrenchSource(np.column_stack([np.interp(grid, time, axis) for axis in stream.wrench_in_sensor.T]))


def _option(text: str) -> tuple[str, float | int]:
    name, _, value = text.partition("=")
    number = float(value)
    return name.replace("-", "_"), int(number) if number.is_integer() and "." not in value else number


def main() -> None:
    """Run until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("device", choices=[sensor.name for sensor in all_sensors()])
    parser.add_argument("--bag", type=Path, help="replay this bag's wrench (default: 10 N downwards)")
    parser.add_argument(
        "--set", type=_option, action="append", default=[], metavar="NAME=NUMBER", help="option of the fake, as rate"
    )
    arguments = parser.parse_args()
    options = dict(arguments.set)
    source = WrenchSource([0, 0, -10, 0, 0, 0])
    if arguments.bag:
        source = wrench_source_from_bag(arguments.bag, options.get("rate", _BAG_RATE))
    with sensor_named(arguments.device).fake(source, **options) as sensor:
        where = {"device": arguments.device, **sensor.parameters}
        print("ft_driver --ros-args", *(f"-p {name}:={value}" for name, value in where.items()), flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


if __name__ == "__main__":
    main()
