"""The readings that are tried, one file per kind."""

from poise.weighing.axes import wrong_axes
from poise.weighing.channels import wrong_channel
from poise.weighing.clipping import clipped, stuck
from poise.weighing.contact import in_contact
from poise.weighing.gravity import wrong_gravity
from poise.weighing.moving_base import moving_base
from poise.weighing.pulls import pulled
from poise.weighing.reading import Family
from poise.weighing.times import late_or_filtered
from poise.weighing.units import wrong_units
from poise.weighing.variation import varied

FAMILIES: tuple[Family, ...] = (
    wrong_axes,
    wrong_units,
    wrong_gravity,
    clipped,
    stuck,
    wrong_channel,
    varied,
    moving_base,
    pulled,
)

__all__ = ["FAMILIES", "in_contact", "late_or_filtered"]
