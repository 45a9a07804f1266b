"""What an entry of the registry of sensors is: a name, its parameters, its link and its fake."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from poise.force_torque.wire import Calibration, FakeSensor, Link, Reports, WrenchSource

SensorValues = Mapping[str, Any]
"""Parameters by name: those of the driver and those of the sensor."""


class SensorSetting(NamedTuple):
    """One parameter of a sensor: `choices` is the (least, greatest) number, or the words that are allowed."""

    name: str
    default: Any
    description: str
    choices: tuple[Any, ...] = ()


class Sensor(ABC):
    """A kind of device that ft_driver can read.

    Attributes:
        name: value of the driver's parameter `device`.
        summary: product and wire, for people.
        address: what the driver's parameter `address` is for this device.
        settings: its own parameters; two sensors that share a name share the whole setting.
        can_zero_itself: whether the device has a bias command (`Link.bias`).
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    address: ClassVar[str]
    settings: ClassVar[tuple[SensorSetting, ...]] = ()
    can_zero_itself: ClassVar[bool] = False

    @abstractmethod
    def link(self, values: SensorValues) -> Link:
        """The link to a device; nothing is opened yet.

        Raises:
            InputError: BAD_INPUT or UNSUPPORTED, naming the parameter and how to fix it.
        """

    @abstractmethod
    def fake(self, source: WrenchSource, **options: Any) -> FakeSensor:
        """A device in software that measures `source`; options are the fake's own."""


def reports_of(values: SensorValues) -> Reports:
    """Whose force the device reports."""
    return Reports(values["reports"])


def limit_of(values: SensorValues) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(6,) N and N m at which a sample counts as saturated; inf where the parameters give none."""
    return np.repeat([values["force_limit"] or np.inf, values["torque_limit"] or np.inf], 3)


def rated(
    values: SensorValues, counts_per_force: float, counts_per_torque: float, rating: tuple[float, ...]
) -> Calibration:
    """Calibration of a device of fixed counts per N and N m, with its rating where the parameters give no limit."""
    return Calibration.from_counts(
        counts_per_force, counts_per_torque, limit=rating, reports=reports_of(values)
    ).with_limit(limit_of(values))
