"""The units that a table's columns may be in, each as its factor to SI."""

import math
import re
from collections.abc import Mapping

TIME = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""Nanoseconds."""
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_ANGLE = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "mdeg": math.pi / 180e3, "turn": 2 * math.pi}
_ANGULAR_SPEED = {f"{name}/s": factor for name, factor in _ANGLE.items()} | {"rpm": 2 * math.pi / 60}
_SPEED = {f"{name}/s": factor for name, factor in _LENGTH.items()}
FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": 4.4482216152605}
TORQUE = {"N m": 1.0, "mN m": 1e-3, "N mm": 1e-3, "N cm": 1e-2, "kgf cm": 0.0980665}
_ACCELERATION = {"m/s2": 1.0, "g": 9.80665}
_NUMBER = {"1": 1.0}
PER_GAIN = {"A": 1.0, "mA": 1e-3, "V": 1.0, "mV": 1e-3, "percent": 0.01, "count": 1.0}
"""Signals that are an effort only times a gain: N m (or N) for each ampere, volt, whole or count."""
TICKS = ("ticks", "ticks/s")
"""Encoder counts, with `ticks_per_turn`."""

UNITS_BY_QUANTITY: dict[str, dict[str, float]] = {
    "position": _ANGLE | _LENGTH,
    "velocity": _ANGULAR_SPEED | _SPEED,
    "effort": TORQUE | FORCE | PER_GAIN,
    "force": FORCE,
    "torque": TORQUE,
    "angular_velocity": _ANGULAR_SPEED,
    "linear_acceleration": _ACCELERATION,
    "translation": _LENGTH,
    "quaternion": _NUMBER,
    "rotation": _NUMBER,
}
"""The first unit of each is the one that is meant when none is given."""

_SPELLINGS = {"sec": "s", "degree": "deg", "degrees": "deg", "\N{DEGREE SIGN}": "deg", "\N{DEGREE SIGN}/s": "deg/s"}


def same_unit(stated: str, named: str, units: Mapping[str, float]) -> bool:
    """Whether a table's unit is the one that the mapping names; also of units that are not known here.

    Args:
        stated: as the table writes it: "Nm", "m/s^2", "sec".
        named: one of `units`, or ticks.
        units: factors by name.
    """
    bare = re.sub(r"[ ^*.\N{MIDDLE DOT}\N{DOT OPERATOR}]", "", _SPELLINGS.get(stated.lower(), stated))
    known = {unit.replace(" ", ""): unit for unit in units}.get(bare)
    if known is None or known == named:
        return True
    return units.get(named) == units[known] and not {known, named} & set(PER_GAIN)
