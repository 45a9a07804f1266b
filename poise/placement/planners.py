"""Planners by name, all in one calling form: Poise's own, it without its guide, and those to compare with."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Protocol

from poise.assembly.analysis import Analysis
from poise.assembly.scene import Assembly, RigidObject
from poise.errors import ErrorCode, InputError
from poise.placement.planner import Options, Placement, Progress, plan_placement
from poise.placement.rivals.chance import anywhere
from poise.placement.rivals.dropping import from_above, from_anywhere
from poise.placement.rivals.heightmap import lowest_first
from poise.placement.rivals.trials import first_that_stays


class Planner(Protocol):
    """As `plan_placement`."""

    def __call__(
        self,
        assembly: Assembly | Analysis,
        item: RigidObject,
        options: Options,
        seed: int,
        progress: Callable[[Progress], bool] | None,
    ) -> Placement: ...


def _guided(
    guide: str,
    assembly: Assembly | Analysis,
    item: RigidObject,
    options: Options,
    seed: int,
    progress: Callable[[Progress], bool] | None,
) -> Placement:
    return plan_placement(assembly, item, replace(options, guide=guide), seed, progress)


PLANNERS: dict[str, Planner] = {
    "poise": plan_placement,
    "approx": partial(_guided, "approx"),
    "thesis": partial(_guided, "thesis"),
    "uniform": partial(_guided, "uniform"),
    "sim-above": partial(first_that_stays, from_above),
    "sim-random": partial(first_that_stays, from_anywhere),
    "hm": partial(first_that_stays, lowest_first),
    "chance": partial(first_that_stays, anywhere),
}
"""The last four try whole poses and take the first that stays, whatever its merit."""


def find_planner(name: str) -> Planner:
    """A planner by name.

    Raises:
        InputError: BAD_INPUT.
    """
    if name not in PLANNERS:
        raise InputError(ErrorCode.BAD_INPUT, f"there is no planner {name!r}; there are {', '.join(PLANNERS)}")
    return PLANNERS[name]
