"""A robustness map as poise_msgs/RobustnessMap: one cloud with bounds, objects and movers as fields."""

from typing import Any

import numpy as np

from poise.assembly.robustness import RobustnessMap
from poise.nodes.clouds import point_cloud
from poise_msgs.msg import ObjectIds
from poise_msgs.msg import RobustnessMap as RobustnessMapMessage

MAP_POINT = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "normal_x", "normal_y", "normal_z")]
    + [("lower", "<f8"), ("upper", "<f8"), ("object", "<u4"), ("mover", "<i4"), ("doubtful", "u1")]
)
"""One point of the cloud."""


def map_message(found: RobustnessMap, header: Any) -> RobustnessMapMessage:
    """Turn a map into a message.

    Args:
        found: the map.
        header: with the frame of the assembly.
    """
    surface, objects = found.surface, found.analysis.assembly.objects
    # The points that collapse in the same way share their movers.
    _, first, way = np.unique(np.stack([found.mechanism, found.block]), axis=1, return_index=True, return_inverse=True)
    names = [found.moves(int(point)) for point in first]
    movers = sorted({ids for ids in names if ids})
    number = np.array([movers.index(ids) if ids else -1 for ids in names], dtype=np.int32)
    rows = np.zeros(len(surface.points), MAP_POINT)
    for axis, place, direction in zip("xyz", surface.points.T, surface.directions.T, strict=True):
        rows[axis], rows[f"normal_{axis}"] = place, direction
    rows["lower"], rows["upper"], rows["doubtful"] = found.lower, found.upper, found.doubtful
    rows["object"], rows["mover"] = surface.place, number[way.ravel()]
    return RobustnessMapMessage(
        header=header,
        ids=[item.id for item in objects],
        movers=[ObjectIds(ids=list(ids)) for ids in movers],
        cloud=point_cloud(header, rows),
        complete=bool(found.complete),
    )
