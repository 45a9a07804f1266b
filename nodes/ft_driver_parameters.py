"""The parameters of ft_driver: declared with their ranges, and turned into what the core works with."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.node import Node

from poise.errors import ErrorCode, InputError
from poise.force_torque import rdt, robotiq
from poise.force_torque.acquisition import AcquisitionOptions
from poise.force_torque.link import Link
from poise.force_torque.rdt_link import RdtLink, RdtOptions
from poise.force_torque.samples import Calibration, Reports
from poise.nodes.parameters import Parameter, one_of

DEVICES = ("rdt", "robotiq_serial", "robotiq_modbus")
FAMILIES = ("auto", *(family.value for family in rdt.Family))
REPORTS = tuple(reports.value for reports in Reports)
LONGEST_GATHER = 0.002
"""s; a read waits this long at the most for more samples, however slow the publishing."""


PARAMETERS = (
    Parameter("device", "rdt", "what is connected", DEVICES),
    Parameter("address", "192.168.1.1", "IP address or name (rdt), or path of the serial port (robotiq_*)"),
    Parameter("port", rdt.PORT, "UDP port of RDT", (1, 65535)),
    Parameter("http_port", 80, "TCP port of the RDT device's web page; 0: do not ask it", (0, 65535)),
    Parameter("slave", robotiq.SLAVE, "Modbus address of a Robotiq sensor", (1, 247)),
    Parameter("family", "auto", "meaning of the RDT status bits; auto: by the product's name", FAMILIES),
    Parameter("buffered", False, "rdt: several records a datagram, as the device's RDT buffer size says"),
    Parameter("frame_id", "ft_sensor", "frame of the sensor"),
    Parameter("reports", Reports.LOAD_ON_SENSOR.value, "whose force the device reports", REPORTS),
    Parameter("counts_per_force", 0.0, "rdt: counts per force unit; 0: as the device's page says", (0.0, 1e12)),
    Parameter("counts_per_torque", 0.0, "rdt: counts per torque unit; 0: as the device's page says", (0.0, 1e12)),
    Parameter("force_unit", "N", "unit of counts_per_force: N, kN, lbf, klbf, kgf, gf"),
    Parameter("torque_unit", "N m", "unit of counts_per_torque: N m, N mm, kN m, lbf in, lbf ft, kgf cm"),
    Parameter("force_limit", 0.0, "N at which a sample counts as saturated; 0: the device's rating", (0.0, 1e6)),
    Parameter("torque_limit", 0.0, "N m at which a sample counts as saturated; 0: the device's rating", (0.0, 1e6)),
    Parameter("sample_rate", 0.0, "Hz of an RDT device; 0: as its page says, else 7000", (0.0, 1e5)),
    Parameter("publish_rate", 1000.0, "Hz of `wrench`, at the most; the device's rate if that is lower", (1.0, 1e4)),
    Parameter("batch_rate", 0.0, "Hz of `wrench_batch`, which holds every sample; 0: none", (0.0, 1000.0)),
    Parameter("publish_saturated", False, "publish averages of saturated samples on `wrench` too"),
    Parameter("silence", 0.05, "s without a sample that make a sensor silent", (0.02, 5.0)),
    Parameter("bias", [0.0] * 6, "N and N m subtracted from the start: fx fy fz tx ty tz in the contract's sign"),
    Parameter("bias_samples", 500, "how many samples bias_sensor averages", (10, 100000)),
    Parameter("hardware_bias", False, "bias_sensor zeroes the device itself (rdt only; it stays so for every client)"),
    Parameter("autostart", True, "configure and activate at start, as a node without a manager needs"),
)


@dataclass(frozen=True)
class Setup:
    """What a configured driver works with."""

    link: Link
    options: AcquisitionOptions
    frame_id: str
    bias_samples: int
    hardware_bias: bool


def read_parameters(node: Node) -> Setup:
    """Turn the parameters' present values into a setup.

    Raises:
        InputError: BAD_INPUT or UNSUPPORTED, naming the parameter and how to mend it.
    """
    values = {parameter.name: node.get_parameter(parameter.name).value for parameter in PARAMETERS}
    for parameter in PARAMETERS:
        if isinstance(parameter.default, str) and parameter.choices:
            one_of(parameter, values[parameter.name])
    if not values["address"] or not values["frame_id"]:
        raise InputError(ErrorCode.BAD_INPUT, "parameters address and frame_id must not be empty")
    if values["hardware_bias"] and values["device"] != "rdt":
        raise InputError(
            ErrorCode.UNSUPPORTED, f"parameter hardware_bias: {values['device']} cannot zero itself; set it to false"
        )
    bias = np.asarray(values["bias"], dtype=float)
    if bias.shape != (6,) or not np.all(np.isfinite(bias)):
        raise InputError(ErrorCode.BAD_INPUT, f"parameter bias must be six finite numbers, not {values['bias']}")
    return Setup(
        link=_link(values),
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


def _link(values: dict[str, Any]) -> Link:
    reports = Reports(values["reports"])
    limit = np.repeat([values["force_limit"] or np.inf, values["torque_limit"] or np.inf], 3)
    if values["device"] == "rdt":
        return RdtLink(_rdt_options(values, reports, limit))
    # Here, because an RDT device needs neither pyserial nor pymodbus.
    from poise.force_torque.robotiq_link import RobotiqModbusLink, RobotiqStreamLink

    calibration = Calibration.from_counts(
        robotiq.COUNTS_PER_NEWTON, robotiq.COUNTS_PER_NEWTON_METRE, limit=robotiq.RANGE, reports=reports
    ).with_limit(limit)
    if values["device"] == "robotiq_serial":
        return RobotiqStreamLink(values["address"], calibration, values["slave"])
    return RobotiqModbusLink(values["address"], calibration, min(values["publish_rate"], 100.0), values["slave"])


def _rdt_options(values: dict[str, Any], reports: Reports, limit: np.ndarray) -> RdtOptions:
    counts = values["counts_per_force"], values["counts_per_torque"]
    calibration = None
    if any(counts):
        calibration = Calibration.from_counts(
            *counts, values["force_unit"], values["torque_unit"], reports=reports
        ).with_limit(limit)
    elif not values["http_port"]:
        raise InputError(
            ErrorCode.BAD_INPUT, "parameters counts_per_force and counts_per_torque are needed when http_port is 0"
        )
    return RdtOptions(
        host=values["address"],
        port=values["port"],
        http_port=values["http_port"],
        calibration=calibration,
        reports=reports,
        limit=limit,
        rate=values["sample_rate"],
        family=None if values["family"] == "auto" else rdt.Family(values["family"]),
        buffered=values["buffered"],
        gather=min(1.0 / values["publish_rate"], LONGEST_GATHER),
    )
