"""The world as a robot knows it: which objects stand in the assembly, which one is in the hand, which are lost.

- `world`: `World` and its transitions; each gives a new world or raises, and changes nothing else.
- `weights`: what an object weighs that was not weighed, or only lifted.
- `scans`: a scanned surface as an object. `settling`: it is put on the surface that supports it.
- `world_file`: the world in a file, whole or refused.
"""

from poise.world.scans import standing_object
from poise.world.settling import settled
from poise.world.weights import assumed_weight, lifted_weight
from poise.world.world import KnownObject, WeightSource, Whereabouts, World
from poise.world.world_file import load_world, save_world

__all__ = [
    "KnownObject",
    "WeightSource",
    "Whereabouts",
    "World",
    "assumed_weight",
    "lifted_weight",
    "load_world",
    "save_world",
    "settled",
    "standing_object",
]
