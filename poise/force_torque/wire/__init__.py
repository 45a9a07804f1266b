"""Building blocks of a sensor: samples and units, frames, and fakes.

- `link`: the interface between acquisition and device. `samples`, `units`: from counts and units to N and N m.
- `framing`: a stream of frames on a serial port (`poise.serial_bus`).
- `fakes`: devices in software.
"""

from poise.force_torque.wire.fakes import FakeSensor, FakeSerialSensor, WrenchSource
from poise.force_torque.wire.framing import FrameParser, reflected_crc16
from poise.force_torque.wire.link import Link
from poise.force_torque.wire.samples import Calibration, Reports, SensorSamples, no_samples

__all__ = [
    "Calibration",
    "FakeSensor",
    "FakeSerialSensor",
    "FrameParser",
    "Link",
    "Reports",
    "SensorSamples",
    "WrenchSource",
    "no_samples",
    "reflected_crc16",
]
