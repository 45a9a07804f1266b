"""All places where two objects touch, whatever their shapes."""

from poise.assembly.contact.placed import ContactPatch, placed
from poise.assembly.contact.round_contacts import round_patches
from poise.assembly.contact.touching import touching_patches
from poise.assembly.scene import RigidObject


def patches_between(first: RigidObject, second: RigidObject, margin: float) -> list[ContactPatch]:
    """All places where two objects are within a margin, m, of each other; overlaps by as much count, too."""
    bodies = placed(first), placed(second)
    search = round_patches if bodies[0].cylinder or bodies[1].cylinder else touching_patches
    return search(*bodies, margin)
