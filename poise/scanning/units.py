"""The unit of integer depth, when none is given: the one in which the views show one flat table."""

from collections.abc import Callable, Sequence

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.scanning.flatness import FLAT, noise_of_table, table_spread
from poise.scanning.frames import FARTHEST, MILLIMETRE, View
from poise.types import Array

_UNITS = (MILLIMETRE, 1e-4, 2.5e-4, 2e-4, 5e-4, 1e-5, 1e-2)
"""m: REP-118; RealSense D405, L515; the TUM benchmark; and others."""
_NEAR, _FAR = 0.1, 2.0
"""m, between which a camera on a hand sees a table, in the middle of its image."""
_ALIKE = 0.02
"""Share by which the cameras' heights must differ, of the depth, for a unit to show."""
_BETTER = 0.6


def guessed_unit(typical: float, views_in: Callable[[float], Sequence[View]], up: Array) -> tuple[float, str]:
    """m, and a sentence when that is not the millimetre of REP-118.

    In a wrong unit, cameras at different heights see the table at different heights.

    Args:
        typical: median of all depth, in units.
        views_in: some views, with their depth in a unit.
        up: (3,) against gravity.

    Raises:
        InputError: BAD_INPUT when millimetres cannot be, and nothing shows the unit.
    """
    possible = [unit for unit in _UNITS if _NEAR < typical * unit < _FAR]
    if possible == [MILLIMETRE]:
        return MILLIMETRE, ""
    flat = {unit: table_spread(views_in(unit), up, FARTHEST) for unit in possible}
    if MILLIMETRE in possible and flat[MILLIMETRE] < noise_of_table(views_in(MILLIMETRE), up, FARTHEST) + FLAT:
        return MILLIMETRE, ""
    unit = min(possible, key=lambda one: flat[one], default=MILLIMETRE)
    others = [flat[one] for one in possible if one != unit]
    shown = np.ptp([view.translation_world_camera @ up for view in views_in(unit)]) > _ALIKE * typical * unit
    if shown and min(others, default=np.inf) * _BETTER > flat[unit] and unit != MILLIMETRE:
        return unit, (
            f"the unit of the depth was guessed: {1e3 * unit:g} mm, in which the views show one table; give it"
            " (--depth-unit) to be sure"
        )
    if MILLIMETRE in possible:
        return MILLIMETRE, ""  # what is wrong will be said of the table
    raise InputError(
        ErrorCode.BAD_INPUT,
        f"scan: depth is typically {typical:.0f} steps, which is {typical * MILLIMETRE:.3g} m in millimetres; its unit"
        f" is another, and the views do not show which ({', '.join(f'{unit:g}' for unit in possible) or 'none'} m"
        " would do): give it (--depth-unit, depth_unit)",
    )
