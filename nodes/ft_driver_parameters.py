"""The parameters of ft_driver: declared with their ranges, and turned into what the core works with."""

from dataclasses import dataclass

import numpy as np
from rclpy.node import Node

from poise.errors import ErrorCode, InputError
from poise.force_torque import AcquisitionOptions
from poise.force_torque.sensors import all_sensors, sensor_named, sensor_settings
from poise.force_torque.wire import Link, Reports
from poise.nodes.parameters import AUTOSTART, Parameter, one_of

FT_DRIVER_PARAMETERS = (
    Parameter("device", "rdt", "the connected device", tuple(sensor.name for sensor in all_sensors())),
    Parameter("address", "192.168.1.1", "; ".join(f"{sensor.name}: {sensor.address}" for sensor in all_sensors())),
    Parameter("frame_id", "ft_sensor", "frame of the sensor"),
    Parameter(
        "reports",
        Reports.LOAD_ON_SENSOR.value,
        "whose force the device reports",
        tuple(reports.value for reports in Reports),
    ),
    Parameter("force_limit", 0.0, "N at which a sample counts as saturated; 0: the device's rating", (0.0, 1e6)),
    Parameter("torque_limit", 0.0, "N m at which a sample counts as saturated; 0: the device's rating", (0.0, 1e6)),
    *(Parameter(*setting) for setting in sensor_settings()),
    Parameter("publish_rate", 1000.0, "Hz of `wrench`, at the most; the device's rate if that is lower", (1.0, 1e4)),
    Parameter("batch_rate", 0.0, "Hz of `wrench_batch`, which holds every sample; 0: none", (0.0, 1000.0)),
    Parameter("publish_saturated", False, "also publish averages of saturated samples on `wrench`"),
    Parameter("silence", 0.05, "s without a sample after which the sensor counts as silent", (0.02, 5.0)),
    Parameter("bias", [0.0] * 6, "N and N m subtracted from the start: fx fy fz tx ty tz, of the load on the sensor"),
    Parameter("bias_samples", 500, "number of samples that bias_sensor averages", (10, 100000)),
    Parameter("hardware_bias", False, "bias_sensor zeroes in the device, for every client (rdt only)"),
    AUTOSTART,
)


@dataclass(frozen=True)
class DriverSetup:
    """What a configured driver works with."""

    link: Link
    options: AcquisitionOptions
    frame_id: str
    bias_samples: int
    hardware_bias: bool


def read_parameters(node: Node) -> DriverSetup:
    """Turn the parameters' present values into a setup.

    Raises:
        InputError: BAD_INPUT or UNSUPPORTED, naming the parameter and how to fix it.
    """
    values = {parameter.name: node.get_parameter(parameter.name).value for parameter in FT_DRIVER_PARAMETERS}
    for parameter in FT_DRIVER_PARAMETERS:
        if isinstance(parameter.default, str) and parameter.choices:
            one_of(parameter, values[parameter.name])
    if not values["address"] or not values["frame_id"]:
        raise InputError(ErrorCode.BAD_INPUT, "parameters address and frame_id must not be empty")
    sensor = sensor_named(values["device"])
    if values["hardware_bias"] and not sensor.can_zero_itself:
        raise InputError(
            ErrorCode.UNSUPPORTED, f"parameter hardware_bias: {sensor.name} cannot zero itself; set it to false"
        )
    bias = np.asarray(values["bias"], dtype=float)
    if bias.shape != (6,) or not np.all(np.isfinite(bias)):
        raise InputError(ErrorCode.BAD_INPUT, f"parameter bias must be six finite numbers, not {values['bias']}")
    return DriverSetup(
        link=sensor.link(values),
        options=AcquisitionOptions(
            publish_rate=values["publish_rate"],
            batch_rate=values["batch_rate"],
            silence=values["silence"],
            publish_saturated=values["publish_saturated"],
            bias=bias,
        ),
        frame_id=values["frame_id"],
        bias_samples=values["bias_samples"],
        hardware_bias=values["hardware_bias"],
    )
