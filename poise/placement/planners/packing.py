"""Planner `packing`: corners of what is there, the lowest arrangement of many orders, each step certified."""

from collections.abc import Callable

from poise.assembly import Analysis, Assembly, RigidObject
from poise.placement import Options, Placement, PlacementPlanner, PlacementProgress
from poise.placement.packing import pack


def pack_one(
    assembly: Assembly | Analysis,
    item: RigidObject,
    options: Options,
    seed: int,
    progress: Callable[[PlacementProgress], bool] | None,
) -> Placement:
    """Pack one object, see `pack`."""
    return pack(assembly, [item], options, seed, 1, progress).placements[0]


entry = PlacementPlanner(
    "packing",
    "low and dense in a container, by corners of what is there; each step certified",
    pack_one,
    plan_several=pack,
)
