"""Certified maps: how hard each point of the surface may be pushed, between bounds that meet a tolerance."""

import time
from dataclasses import dataclass

import numpy as np

from poise.assembly.analysis import Analysis, BlockAnalysis, Mechanism
from poise.assembly.geometry import Array, wrench_of_force
from poise.assembly.map_regions import Bounds, Integers, Pool, bound_block
from poise.assembly.models import Deadline
from poise.assembly.scene import Assembly
from poise.assembly.surface import SurfacePoints, sample_surface
from poise.errors import ErrorCode, InputError

CEILING = 100.0
"""Points that hold this many weights of the assembly are strong enough: how much more is not looked into."""


@dataclass(frozen=True, eq=False)
class RobustnessMap:
    """How hard points of the surface may be pushed.

    Args:
        analysis: of the assembly.
        surface: where, and along which direction.
        lower, upper: (N,) N; certified by the model. The upper bound is what the best mechanism found allows.
        block: (N,) number in `analysis.blocks` of what gives way at the upper bound; -1 for none.
        mechanism: (N,) number in `mechanisms` of how; -1 for none, or when a patch alone gives way (ask `assess`).
        mechanisms: collapse mechanisms; each bounds the robustness of every point from above.
        complete: the bounds meet the tolerance everywhere; otherwise the deadline passed before.
        solves: conic programs solved.
        seconds: taken.
    """

    analysis: Analysis
    surface: SurfacePoints
    lower: Array
    upper: Array
    block: Integers
    mechanism: Integers
    mechanisms: tuple[Mechanism, ...]
    complete: bool
    solves: int
    seconds: float

    def moves(self, point: int) -> tuple[str, ...]:
        """Ids of what moves first when one point is pushed at its upper bound."""
        objects = self.analysis.assembly.objects
        if self.mechanism[point] >= 0:
            places = tuple(self.mechanisms[self.mechanism[point]].velocities)
        elif self.block[point] >= 0:
            places = self.analysis.blocks[self.block[point]].block.members[0]
        else:
            places = ()
        return tuple(objects[place].id for place in places)


def robustness_map(
    assembly: Assembly | Analysis,
    surface: SurfacePoints | int = 10_000,
    tolerance: float = 0.03,
    model: str | None = None,
    deadline: float | None = None,
) -> RobustnessMap:
    """Bound the robustness of many points of the surface, with few solved exactly.

    1 / robustness is a convex function of the load. On a flat face with one direction of push the load is affine in
    the point: solved points bound all between them from above by convexity, and every collapse mechanism found
    bounds all points, directions and objects from below. Points are solved where the bounds are farthest apart.

    Args:
        assembly: prepared as an `Analysis` when more will be asked.
        surface: points and directions of push, or how many to spread over the surface (pushes inward along the normal).
        tolerance: the bounds are brought to upper <= (1 + tolerance) lower, except above `CEILING` weights.
        model: limit, patch, or default (the weaker of both). Under `patch`, bodies on several interfaces have their
            centres of pressure where they are at rest.
        deadline: s; what is certified by then is returned.

    Raises:
        InputError: BAD_INPUT for a model without certified bounds; INTERPENETRATION, FLOATING.
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    start, clock = time.perf_counter(), Deadline.after(deadline)
    name = model or "default"
    if name not in ("default", "limit", "patch"):
        raise InputError(ErrorCode.BAD_INPUT, f"maps are certified for limit, patch and default, not for {name!r}")
    analysis = Analysis.of(assembly)
    analysis.require_stable()
    if isinstance(surface, int):
        surface = sample_surface(analysis.structure, surface)
    bounds = Bounds.none(len(surface.points))
    wrenches = wrench_of_force(surface.directions, surface.points)
    loaded = [np.flatnonzero(np.isin(surface.place, list(block.geometry.place_of))) for block in analysis.blocks]
    if name != "limit":
        for number, (block, rows) in enumerate(zip(analysis.blocks, loaded, strict=True)):
            _single_patch(block, number, rows, wrenches, bounds)
    complete = True
    floor = 1 / (CEILING * (sum(block.geometry.units.weight for block in analysis.blocks) or 1.0))
    for number, (block, rows) in enumerate(zip(analysis.blocks, loaded, strict=True)):
        if name == "patch" and block.single_patch is not None:
            continue
        pool = Pool(block, number, bounds, clock, with_limit=name != "patch", with_patch=name != "limit")
        complete &= bound_block(pool, surface, rows, wrenches, tolerance, floor)
    with np.errstate(divide="ignore"):
        lower, upper = 1 / bounds.upper, 1 / bounds.lower
    return RobustnessMap(
        analysis,
        surface,
        lower,
        upper,
        bounds.block,
        bounds.mechanism,
        tuple(bounds.mechanisms),
        complete,
        bounds.solves,
        time.perf_counter() - start,
    )


def _single_patch(block: BlockAnalysis, number: int, rows: Integers, wrenches: Array, bounds: Bounds) -> None:
    """Blocks of one body on one interface need no bounds: all points are solved at once."""
    if block.single_patch is None:
        return
    with np.errstate(divide="ignore"):
        gauge = 1 / block.single_patch.collapse(wrenches[rows]).factor
    bounds.raise_to(rows, gauge, gauge, number, np.full(len(rows), -1))
