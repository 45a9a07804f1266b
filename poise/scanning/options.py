"""How an object is scanned."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class ScanOptions:
    """How to scan.

    Args:
        voxel: m, spacing of the seen points.
        cell: m, spacing of the completed points.
        farthest: m from the camera up to which it is looked at.
        region: (6,) m in the world: middle of the bottom and size of a box; objects outside are not seen. None: all.
        near: (3,) m in the world: of several objects, the one nearest to it (the grasp); None: nearest to where the
            camera looks.
        up: (3,) against gravity, in the world.
        refine: poses by ICP: when the views disagree, always, or never; and, unless never, depth that is too long or
            too short by a share.
        complete: fill what is hidden over the table.
        seed: of the search for the table.
    """

    voxel: float = 1.5e-3
    cell: float = 2e-3
    farthest: float = 1.2
    region: tuple[float, float, float, float, float, float] | None = None
    near: tuple[float, float, float] | None = None
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    refine: Literal["auto", "always", "never"] = "auto"
    complete: bool = True
    seed: int = 0


DEFAULT_SCAN = ScanOptions()
