"""Serial lines and Modbus RTU, and devices in software on pseudo-terminals.

- `serial_line`: a port for this process alone. `modbus`: registers of a device. `backoff`: when to connect again.
- `pseudo_terminal`: a device in software, and its answers to Modbus requests.
"""

from poise.serial_bus.backoff import Backoff
from poise.serial_bus.modbus import ModbusLine
from poise.serial_bus.pseudo_terminal import ModbusAnswers, PseudoTerminalDevice, with_modbus_crc
from poise.serial_bus.serial_line import SerialLine, unreachable_port

__all__ = [
    "Backoff",
    "ModbusAnswers",
    "ModbusLine",
    "PseudoTerminalDevice",
    "SerialLine",
    "unreachable_port",
    "with_modbus_crc",
]
