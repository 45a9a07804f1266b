"""The registry of force-torque sensors: one file or folder a sensor, discovered in this folder.

- `base`: `Sensor` and `SensorSetting`, the base classes of an entry.
- every other file: a sensor with its protocol, link, fake and parameters. See docs/add_a_sensor.md.
"""

from functools import cache

from poise.force_torque.sensors.base import Sensor, SensorSetting, SensorValues, limit_of, rated, reports_of
from poise.registry import entries_of, entry_called

__all__ = [
    "Sensor",
    "SensorSetting",
    "SensorValues",
    "all_sensors",
    "limit_of",
    "rated",
    "reports_of",
    "sensor_named",
    "sensor_settings",
]


@cache
def all_sensors() -> tuple[Sensor, ...]:
    """Every sensor of the registry, by name."""
    found: tuple[Sensor, ...] = entries_of(__name__, __path__, Sensor)  # type: ignore[type-abstract]
    return tuple(sorted(found, key=lambda sensor: sensor.name))


def sensor_named(name: str) -> Sensor:
    """The sensor of a name.

    Raises:
        InputError: BAD_INPUT, with the names there are.
    """
    return entry_called(name, {sensor.name: sensor for sensor in all_sensors()}, "no sensor is named")


def sensor_settings() -> tuple[SensorSetting, ...]:
    """The parameters of all sensors, each name once."""
    return tuple({setting.name: setting for sensor in all_sensors() for setting in sensor.settings}.values())
