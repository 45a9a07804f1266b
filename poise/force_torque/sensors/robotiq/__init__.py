"""Robotiq FT 300 and FT 300-S on a serial port: the stream at 100 Hz, or Modbus RTU on a shared line.

- `protocol`: bytes of both. `link`: the serial port. `fake`: a device on a pseudo-terminal.
"""

from typing import Any

from poise.force_torque.sensors import Sensor, SensorSetting, SensorValues, rated
from poise.force_torque.sensors.robotiq import protocol
from poise.force_torque.wire import Calibration, FakeSensor, Link, WrenchSource

__all__ = ["RobotiqModbus", "RobotiqSerial"]

_SLAVE = SensorSetting("slave", protocol.SLAVE, "Modbus address of a Robotiq sensor", (1, 247))
_FASTEST_POLL = 100.0
"""Hz; at 19200 baud about 50 requests a second are answered."""


def _calibration(values: SensorValues) -> Calibration:
    return rated(values, protocol.COUNTS_PER_NEWTON, protocol.COUNTS_PER_NEWTON_METRE, protocol.RANGE)


class RobotiqSerial(Sensor):
    """The stream."""

    name = "robotiq_serial"
    summary = "Robotiq FT 300, FT 300-S: serial stream"
    address = "path of the serial port"
    settings = (_SLAVE,)

    def link(self, values: SensorValues) -> Link:
        """The link to the stream."""
        from poise.force_torque.sensors.robotiq.link import RobotiqStreamLink  # pymodbus, which rdt does not need

        return RobotiqStreamLink(values["address"], _calibration(values), values["slave"])

    def fake(self, source: WrenchSource, **options: Any) -> FakeSensor:
        """A device on a pseudo-terminal; options of `FakeRobotiqSensor`."""
        from poise.force_torque.sensors.robotiq.fake import FakeRobotiqSensor

        return FakeRobotiqSensor(source, **options)


class RobotiqModbus(RobotiqSerial):
    """Polling by Modbus RTU."""

    name = "robotiq_modbus"
    summary = "Robotiq FT 300, FT 300-S: Modbus RTU, for a shared line"

    def link(self, values: SensorValues) -> Link:
        """The link that polls, at the publish rate as far as the device can."""
        from poise.force_torque.sensors.robotiq.link import RobotiqModbusLink

        rate = min(values["publish_rate"], _FASTEST_POLL)
        return RobotiqModbusLink(values["address"], _calibration(values), rate, values["slave"])
