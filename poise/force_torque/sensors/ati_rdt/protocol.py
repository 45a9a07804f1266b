"""ATI's Raw Data Transfer (RDT) protocol: bytes of requests and records, and what the status words say.

Sources: ATI 9620-05-C-Ethernet Axia-02, sections 5.5 (status) and 12 (RDT); ATI 9620-05-NET FT (the Net Box's bits).
No I/O here: see `link`.
"""

import struct
from collections.abc import Mapping
from enum import Enum, IntEnum
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, SensorError
from poise.types import Mask

PORT = 49152
_HEADER = 0x1234
RECORD = np.dtype([("rdt_sequence", ">u4"), ("ft_sequence", ">u4"), ("status", ">u4"), ("counts", ">i4", (6,))])
"""One sample: 36 bytes, network order, forces then torques."""


class RdtCommand(IntEnum):
    """What a request asks for."""

    STOP = 0x0000
    START_REALTIME = 0x0002
    """A record a datagram, at the device's RDT output rate."""
    START_BUFFERED = 0x0003
    """As many records a datagram as the device's RDT buffer size says."""
    BIAS = 0x0042


def request(command: RdtCommand, count: int = 0) -> bytes:
    """Encode a request; `count` records are asked for, 0 for no end."""
    return struct.pack(">HHI", _HEADER, command, count)


def parse_records(datagrams: bytes) -> NDArray[np.void]:
    """Decode one datagram, or several joined, into an array of RECORD.

    Raises:
        SensorError: SENSOR_PROTOCOL, when the length is not that of whole records.
    """
    if not datagrams or len(datagrams) % RECORD.itemsize:
        raise SensorError(
            ErrorCode.SENSOR_PROTOCOL,
            f"a datagram of {len(datagrams)} bytes is not made of {RECORD.itemsize}-byte RDT records; "
            "is another device at this address and port?",
        )
    return np.frombuffer(datagrams, dtype=RECORD)


_ERROR_SUMMARY = 1 << 31
_MONITOR_CONDITION = 1 << 16
"""A threshold that the user set on the device's web page was passed: no fault of the measurement."""


class RdtFamily(Enum):
    """The meaning of the status bits differs between families of RDT devices."""

    NET_FT = "net_ft"
    AXIA = "axia"

    @classmethod
    def of_product(cls, name: str) -> "RdtFamily":
        """The family, by the product name on the device's page."""
        return cls.AXIA if "axia" in name.lower() else cls.NET_FT

    @property
    def saturation(self) -> int:
        """Status bits that say a gage or an axis was beyond its range."""
        return 1 << 30 | 1 << 27 if self is RdtFamily.AXIA else 1 << 17

    def describe(self, status: int) -> str:
        """The text of a status word ("healthy" for 0)."""
        bits = _AXIA_BITS if self is RdtFamily.AXIA else _NET_FT_BITS
        names = [bits.get(bit, f"reserved bit {bit}") for bit in range(31) if status >> bit & 1]
        if status & _ERROR_SUMMARY and not names:
            names = ["error, not specified"]
        return ", ".join(names) or "healthy"


def is_fault(status: NDArray[np.uint32]) -> Mask:
    """Which status words mark their sample as wrong: the error summary, unless only a user threshold was exceeded."""
    fault: Mask = (status >= _ERROR_SUMMARY) & (status != (_ERROR_SUMMARY | _MONITOR_CONDITION))
    return fault


_AXIA_BITS: Mapping[int, str] = MappingProxyType(
    {
        0: "internal temperature out of range",
        1: "supply voltage out of range",
        2: "broken gage",
        3: "busy",
        5: "other error",
        7: "calibration not accessible",
        16: "monitor condition latched",
        27: "gage out of range",
        28: "simulated error",
        29: "calibration checksum error",
        30: "force or torque out of range",
    }
)
_NET_FT_BITS: Mapping[int, str] = MappingProxyType(
    {
        1: "HTTP protocol failure",
        2: "internal temperature error",
        3: "reference voltage or power monitoring error",
        4: "serial link data unavailable",
        5: "analog board power supply too low",
        6: "analog board power supply too high",
        7: "artificial analog ground out of range",
        8: "strain gage excitation current too low",
        9: "strain gage excitation current too high",
        10: "analog board watchdog timeout",
        11: "serial flash failure",
        12: "serial EEPROM failure",
        13: "stack check error",
        14: "watchdog timeout",
        16: "monitor condition latched",
        17: "transducer saturation or A/D error",
        18: "DeviceNet protocol failure",
        19: "EtherNet/IP protocol failure",
        20: "RDT communication error",
        21: "CAN communication error",
        22: "network communication failure",
        23: "configuration incompatible with calibration",
        24: "settings validation error",
        25: "halted due to configuration errors",
        26: "program memory verification error",
        27: "serial link communication error",
        28: "analog board error",
        29: "digital board error",
        30: "CPU or RAM error",
    }
)
