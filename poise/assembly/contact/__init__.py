"""Which objects touch, where they touch, and the graph of their contacts.

- `placed`, `penetration`: bodies at their poses, and how deep they overlap.
- `contacts` (with `touching`, `round_contacts`, `sphere_contacts`): contact interfaces between bodies.
- `round_touch`, `facet_curves`: lines and points on which bodies roll; meshes whose facets stand for round sides.
- `graph`: the contact interface graph, cut into blocks. `surface`: points at which pushes are assessed.
- `way_out`: straight lines along which an object can be taken away.
"""

from poise.assembly.contact.contacts import CONTACT_MARGIN, Interface, find_interfaces, overlapping
from poise.assembly.contact.facet_curves import facet_curve
from poise.assembly.contact.graph import FIXED_NODE, ContactBlock, Structure
from poise.assembly.contact.patches import patches_between
from poise.assembly.contact.penetration import (
    convex_geometry,
    convex_overlap,
    distance_between,
    distance_to_triangles,
    winding_number,
)
from poise.assembly.contact.placed import ContactPatch, RoundTouch, bounds_of, placed, triangle_areas
from poise.assembly.contact.surface import SurfacePoints, sample_surface
from poise.assembly.contact.way_out import WayOut, way_out

__all__ = [
    "CONTACT_MARGIN",
    "FIXED_NODE",
    "ContactBlock",
    "ContactPatch",
    "Interface",
    "RoundTouch",
    "Structure",
    "SurfacePoints",
    "WayOut",
    "bounds_of",
    "convex_geometry",
    "convex_overlap",
    "distance_between",
    "distance_to_triangles",
    "facet_curve",
    "find_interfaces",
    "overlapping",
    "patches_between",
    "placed",
    "sample_surface",
    "triangle_areas",
    "way_out",
    "winding_number",
]
