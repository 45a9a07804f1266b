"""Placement planners by name: that of Poise, and the baselines of the thesis to compare with."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from poise.assembly import Analysis, Assembly, RigidObject
from poise.placement.planner import Options, Placement, PlacementProgress
from poise.registry import Registry


class PlanOne(Protocol):
    """Plans the placement of one object; see `plan_placement` for arguments and errors."""

    def __call__(
        self,
        assembly: Assembly | Analysis,
        item: RigidObject,
        options: Options,
        seed: int,
        progress: Callable[[PlacementProgress], bool] | None,
    ) -> Placement: ...


@dataclass(frozen=True)
class PlacementPlanner:
    """One planner.

    Args:
        name: as nodes and the command line take it; the name of its file.
        description: how it finds a placement.
        plan: places one object.
        compares: it takes the best of `Options.candidates` placements; otherwise the first that stays.
        sequences: `plan_sequence` uses it to place several objects.
        needs, extra: see `RegistryEntry`.
    """

    name: str
    description: str
    plan: PlanOne
    compares: bool = False
    sequences: bool = False
    needs: tuple[str, ...] = ()
    extra: str = ""


PLACEMENT_PLANNERS = Registry[PlacementPlanner]("planner", ("poise.placement.planners", "poise.baselines.planners"))
"""By the names that nodes and the command line take."""
DEFAULT_PLANNER = "poise"
