"""ATI Axia and Net F/T: Raw Data Transfer (RDT) over UDP, with the calibration of the device's web page.

- `protocol`: requests, records, status words. `page`: the web page. `link`: the socket. `fake`: a device on loopback.
"""

from typing import Any

from poise.errors import ErrorCode, InputError
from poise.force_torque.sensors import Sensor, SensorSetting, SensorValues, limit_of, reports_of
from poise.force_torque.sensors.ati_rdt import protocol
from poise.force_torque.wire import Calibration, FakeSensor, Link, WrenchSource

__all__ = ["AtiRdt"]

_LONGEST_GATHER = 0.002
"""s; a read waits at most this long for more samples, however slow the publishing."""


class AtiRdt(Sensor):
    """ATI's network sensors."""

    name = "rdt"
    summary = "ATI Axia, ATI Net F/T box: RDT over UDP"
    address = "IP address or name"
    settings = (
        SensorSetting("port", protocol.PORT, "UDP port of RDT", (1, 65535)),
        SensorSetting("http_port", 80, "TCP port of the RDT device's web page; 0: do not ask it", (0, 65535)),
        SensorSetting(
            "family",
            "auto",
            "meaning of the RDT status bits; auto: by the product's name",
            ("auto", *(family.value for family in protocol.RdtFamily)),
        ),
        SensorSetting("buffered", False, "rdt: several records a datagram, as the device's RDT buffer size says"),
        SensorSetting("counts_per_force", 0.0, "rdt: counts per force unit; 0: as the device's page says", (0.0, 1e12)),
        SensorSetting(
            "counts_per_torque", 0.0, "rdt: counts per torque unit; 0: as the device's page says", (0.0, 1e12)
        ),
        SensorSetting("force_unit", "N", "unit of counts_per_force: N, kN, lbf, klbf, kgf, gf"),
        SensorSetting("torque_unit", "N m", "unit of counts_per_torque: N m, N mm, kN m, lbf in, lbf ft, kgf cm"),
        SensorSetting("sample_rate", 0.0, "Hz of an RDT device; 0: as its page says, else 7000", (0.0, 1e5)),
    )
    can_zero_itself = True

    def link(self, values: SensorValues) -> Link:
        """The link to an ATI device."""
        from poise.force_torque.sensors.ati_rdt.link import RdtLink, RdtOptions

        return RdtLink(
            RdtOptions(
                host=values["address"],
                port=values["port"],
                http_port=values["http_port"],
                calibration=_calibration(values),
                reports=reports_of(values),
                limit=limit_of(values),
                rate=values["sample_rate"],
                family=None if values["family"] == "auto" else protocol.RdtFamily(values["family"]),
                buffered=values["buffered"],
                gather=min(1.0 / values["publish_rate"], _LONGEST_GATHER),
            )
        )

    def fake(self, source: WrenchSource, **options: Any) -> FakeSensor:
        """A device on loopback; options of `FakeRdtSensor`."""
        from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor

        return FakeRdtSensor(source, **options)


def _calibration(values: SensorValues) -> Calibration | None:
    """What the parameters say, or None for the page's."""
    counts = values["counts_per_force"], values["counts_per_torque"]
    if not any(counts):
        if not values["http_port"]:
            raise InputError(
                ErrorCode.BAD_INPUT, "parameters counts_per_force and counts_per_torque are needed when http_port is 0"
            )
        return None
    return Calibration.from_counts(
        *counts, values["force_unit"], values["torque_unit"], reports=reports_of(values)
    ).with_limit(limit_of(values))
