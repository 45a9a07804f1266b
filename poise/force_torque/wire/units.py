"""Units that force-torque devices report in, as factors to N and N m."""

from collections.abc import Mapping
from types import MappingProxyType

from poise.errors import ErrorCode, InputError
from poise.geometry import STANDARD_GRAVITY

"""m/s2, by which kilogram-force is defined (CGPM 1901)."""
_POUND_FORCE = 0.45359237 * STANDARD_GRAVITY
"""N; the international pound of 1959 is 0.45359237 kg."""
_INCH = 0.0254
_FOOT = 12 * _INCH

NEWTONS_PER_UNIT: Mapping[str, float] = MappingProxyType(
    {
        "n": 1.0,
        "kn": 1000.0,
        "lbf": _POUND_FORCE,
        "klbf": 1000.0 * _POUND_FORCE,
        "kgf": STANDARD_GRAVITY,
        "gf": STANDARD_GRAVITY / 1000.0,
        # As ATI's pages spell kilogram-force, gram-force and pound-force:
        "kg": STANDARD_GRAVITY,
        "g": STANDARD_GRAVITY / 1000.0,
        "lb": _POUND_FORCE,
        "klb": 1000.0 * _POUND_FORCE,
    }
)
NEWTON_METRES_PER_UNIT: Mapping[str, float] = MappingProxyType(
    {
        "nm": 1.0,
        "nmm": 0.001,
        "knm": 1000.0,
        "lbfin": _POUND_FORCE * _INCH,
        "lbfft": _POUND_FORCE * _FOOT,
        "kgfcm": STANDARD_GRAVITY * 0.01,
        "kgfm": STANDARD_GRAVITY,
        "gfcm": STANDARD_GRAVITY * 0.00001,
        "kgcm": STANDARD_GRAVITY * 0.01,
        "lbin": _POUND_FORCE * _INCH,
        "lbft": _POUND_FORCE * _FOOT,
    }
)


def newtons_per(unit: str) -> float:
    """How many newtons one `unit` of force is; capitals, spaces, dots and dashes do not matter.

    Raises:
        InputError: UNSUPPORTED, for a unit that is not known.
    """
    return _look_up(unit, NEWTONS_PER_UNIT, "force")


def newton_metres_per(unit: str) -> float:
    """How many newton metres one `unit` of torque is; "N-m", "N m" and "Nm" mean one unit.

    Raises:
        InputError: UNSUPPORTED, for a unit that is not known.
    """
    return _look_up(unit, NEWTON_METRES_PER_UNIT, "torque")


def _look_up(unit: str, table: Mapping[str, float], quantity: str) -> float:
    key = "".join(character for character in unit.lower() if character.isalnum())
    try:
        return table[key]
    except KeyError:
        raise InputError(
            ErrorCode.UNSUPPORTED,
            f"unit of {quantity} {unit!r} is not known; use one of {', '.join(table)}",
            unit=unit,
        ) from None
