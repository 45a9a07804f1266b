"""Worlds of other programs as scenes, and scenes as worlds: MJCF, SDFormat, URDF and MoveIt's planning scenes.

- `read_world`: any of these files, or a scene file, as an `Assembly`, with what was assumed and left out.
- `write_world`: an assembly as a file of one of these formats; `save_scene`: as a scene file with its meshes beside it.
- `world_formats`: the registry; a format is one file in `poise/worlds`.
- `mjcf_geom`, `mjcf_inertial`, `mjcf_place`: an object in MJCF. `convex_pieces`: a solid cut up for simulators.
- `MJCF_MEMORY`: what MuJoCo gets for contacts.
"""

from poise.worlds.base import WorldBody, WorldContent, WorldFormat, WorldSolid
from poise.worlds.files import read_world, save_scene, world_formats, write_world
from poise.worlds.mjcf_text import MJCF_MEMORY, mjcf_geom, mjcf_inertial, mjcf_place
from poise.worlds.pieces import convex_pieces

__all__ = [
    "MJCF_MEMORY",
    "WorldBody",
    "WorldContent",
    "WorldFormat",
    "WorldSolid",
    "convex_pieces",
    "mjcf_geom",
    "mjcf_inertial",
    "mjcf_place",
    "read_world",
    "save_scene",
    "world_formats",
    "write_world",
]
