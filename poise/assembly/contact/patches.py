"""All places where two objects touch, whatever their shapes."""

from poise.assembly.contact.placed import ContactPatch, PlacedBody
from poise.assembly.contact.round_contacts import round_patches
from poise.assembly.contact.sphere_contacts import sphere_patches
from poise.assembly.contact.touching import touching_patches


def patches_between(first: PlacedBody, second: PlacedBody, margin: float) -> list[ContactPatch]:
    """All places where two objects are within a margin, m, of each other; overlaps by as much count, too."""
    if first.sphere or second.sphere:
        return sphere_patches(first, second, margin)
    search = round_patches if first.cylinder or second.cylinder else touching_patches
    return search(first, second, margin)
