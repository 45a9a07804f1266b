"""The readings that are tried, one file per kind."""

from poise.weighing.reading import Family
from poise.weighing.readings.axes import wrong_axes
from poise.weighing.readings.clipping import clipped
from poise.weighing.readings.contact import in_contact
from poise.weighing.readings.gravity import wrong_gravity
from poise.weighing.readings.moving_base import moving_base
from poise.weighing.readings.times import late_or_filtered
from poise.weighing.readings.units import wrong_units
from poise.weighing.readings.variation import varied

FAMILIES: tuple[Family, ...] = (
    wrong_axes,
    wrong_units,
    wrong_gravity,
    clipped,
    varied,
    moving_base,
    in_contact,
)

__all__ = ["FAMILIES", "late_or_filtered"]
