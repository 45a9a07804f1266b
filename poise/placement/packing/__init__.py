"""Several objects into a container: low and dense, and stable after each.

- `pack`: the objects, the order, and the place of each. `Packing`: the answer. `ORDERS`: how many are tried.
- `Container`, `find_container`, `encloses`: what is packed. `heights_over`: a height map of a surface.
"""

from poise.placement.packing.container import Container, encloses, find_container
from poise.placement.packing.cover import heights_over
from poise.placement.packing.job import ORDERS, REFUSALS, Packing, pack
from poise.placement.packing.turns import Turned, turns_of

__all__ = [
    "ORDERS",
    "REFUSALS",
    "Container",
    "Packing",
    "Turned",
    "encloses",
    "find_container",
    "heights_over",
    "pack",
    "turns_of",
]
