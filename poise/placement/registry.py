"""Placement planners by name: that of Poise, and the baselines of the thesis to compare with."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from poise.assembly import Analysis, Assembly, RigidObject
from poise.placement.planner import Options, Placement, PlacementProgress
from poise.placement.sequence import PlacementSequence
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


class PlanSeveral(Protocol):
    """Plans an order of objects and their placements; see `plan_sequence` for arguments and errors."""

    def __call__(
        self,
        assembly: Assembly | Analysis,
        items: Sequence[RigidObject],
        options: Options,
        seed: int,
        orders: int | None,
        progress: Callable[[PlacementProgress], bool] | None,
    ) -> PlacementSequence: ...


@dataclass(frozen=True)
class PlacementPlanner:
    """One planner.

    Args:
        name: as nodes and the command line take it; the name of its file.
        description: how it finds a placement.
        plan: places one object.
        compares: it takes the best of `Options.candidates` placements; otherwise the first that stays.
        plan_several: places several objects, and finds their order; None when it places one.
        needs, extra: see `RegistryEntry`.
    """

    name: str
    description: str
    plan: PlanOne
    compares: bool = False
    plan_several: PlanSeveral | None = None
    needs: tuple[str, ...] = ()
    extra: str = ""


PLACEMENT_PLANNERS = Registry[PlacementPlanner]("planner", ("poise.placement.planners", "poise.baselines.planners"))
"""By the names that nodes and the command line take."""
DEFAULT_PLANNER = "poise"
